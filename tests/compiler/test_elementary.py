"""Powers, logarithms and exponentials of compiled code, against fifty digits: no C library is in them, so that their
bits are the same everywhere."""

import math
from decimal import Decimal, localcontext

import numba
import numpy as np
import pytest

from engine.compiler import elementary

NUMBERS = 400


@numba.njit(error_model="numpy")
def powers(x, y, out):
    for n in range(x.size):
        out[n] = elementary.power_of(x[n], y[n])


@numba.njit(error_model="numpy")
def logarithms(x, out):
    for n in range(x.size):
        out[n] = elementary.log1p_of(x[n])


@numba.njit(error_model="numpy")
def exponentials(x, out):
    for n in range(x.size):
        out[n] = elementary.expm1_of(x[n])


@numba.njit(error_model="numpy")
def rises(u, out):
    for n in range(u.size):
        out[n] = elementary.rise(u[n])


def errors(found, exact):
    """Return how far numbers are from exact ones, in units of their last digits."""
    return [float(abs(Decimal(float(a)) - b) / Decimal(math.ulp(float(b)))) for a, b in zip(found, exact, strict=True)]


@pytest.fixture
def digits():
    with localcontext() as context:
        context.prec = 50
        yield


def spread(rng, low, high):
    """Numbers from e^low to e^high, evenly by their logarithms."""
    return np.exp(rng.uniform(low, high, NUMBERS))


@pytest.mark.hard
def test_powers_are_right_to_half_a_digit(digits):
    rng = np.random.default_rng(1)
    x = np.concatenate([spread(rng, -300.0, 200.0), spread(rng, -0.02, 0.02)])
    y, found = rng.uniform(0.2, 3.0, x.size), np.zeros(x.size)
    powers(x, y, found)
    exact = [(Decimal(b) * Decimal(a).ln()).exp() for a, b in zip(x.tolist(), y.tolist(), strict=True)]
    assert max(errors(found, exact)) < 0.502


@pytest.mark.hard
def test_whole_powers_of_small_numbers_are_exact():
    x, found = np.arange(1.0, 50.0), np.zeros(49)
    for n in (1.0, 2.0, 3.0):
        powers(x, np.full(49, n), found)
        np.testing.assert_array_equal(found, x**n)


def test_powers_at_the_ends_of_the_numbers():
    x = np.array([0.0, 5e-324, 1e-310, 1e308, math.inf, math.nan, 1e-300, 1.0])
    found = np.zeros(x.size)
    powers(x, np.full(x.size, 0.4), found)
    np.testing.assert_allclose(found, x**0.4, rtol=1e-14)
    powers(x, np.full(x.size, 3.0), found)
    with np.errstate(over="ignore"):
        np.testing.assert_array_equal(found, x**3.0)


@pytest.mark.hard
def test_logarithms_and_exponentials_keep_their_digits_near_zero(digits):
    rng = np.random.default_rng(2)
    small = spread(rng, -60.0, -0.01)
    found = np.zeros(NUMBERS)
    for x in (small, -small):
        logarithms(x, found)
        assert max(errors(found, [(1 + Decimal(a)).ln() for a in x.tolist()])) < 0.7
        exponentials(x, found)
        assert max(errors(found, [Decimal(a).exp() - 1 for a in x.tolist()])) < 1.1
    exponentials(np.array([-800.0, 800.0, 0.0, -30.0]), found[:4])
    np.testing.assert_allclose(found[:4], [-1.0, math.inf, 0.0, math.expm1(-30.0)], rtol=1e-15)


def test_a_glide_rises_as_a_cosine_does():
    u = np.linspace(0.0, 1.0, 101)
    found = np.zeros(101)
    rises(u, found)
    np.testing.assert_allclose(found, 0.5 * (1.0 - np.cos(np.pi * u)), atol=5e-16)
