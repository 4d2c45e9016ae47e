"""Bessel functions against SciPy's, and against mpmath's where SciPy's have larger errors."""

import mpmath
import numpy as np
import pytest
import scipy

from engine.arithmetic.bessel import bessel_j, bessel_j_pair, j0, j1, scaled_i, scaled_i_pair, zeros_of_j

ORDERS = np.arange(121)
SMALL = np.concatenate([[0.0], np.geomspace(1e-12, 1.0, 60)])
ARGUMENTS = np.concatenate([SMALL, np.linspace(0.0, 500.0, 301)])
SCIPY_ERROR_J, SCIPY_ERROR_I = 2e-14, 2e-13  # of SciPy, against mpmath with 40 digits, orders to 120


def exactly(function, orders, arguments):
    """Values of mpmath, with 40 digits."""
    with mpmath.workdps(40):
        return np.array([float(function(int(n), mpmath.mpf(float(x)))) for n, x in zip(orders, arguments, strict=True)])


@pytest.mark.hard
def test_bessel_functions_are_near_those_of_scipy():
    expected = scipy.special.jv(ORDERS[:, None], ARGUMENTS)
    assert np.max(np.abs(bessel_j(ORDERS[:, None], ARGUMENTS) - expected)) < SCIPY_ERROR_J
    low = ARGUMENTS < 60.0
    assert np.max(np.abs(bessel_j(ORDERS[:, None], ARGUMENTS[low]) - expected[:, low])) < 5e-15


@pytest.mark.hard
def test_bessel_functions_are_right():
    draw = np.random.default_rng(1)
    orders, arguments = draw.integers(0, 121, 300), draw.uniform(0.0, 500.0, 300)
    expected = exactly(mpmath.besselj, orders, arguments)
    assert np.max(np.abs(bessel_j(orders, arguments) - expected)) < 1e-15


def test_small_values_have_their_digits():
    orders, arguments = np.repeat(ORDERS[::8], 40), np.tile(np.geomspace(1e-6, 5.0, 40), ORDERS[::8].size)
    expected = exactly(mpmath.besselj, orders, arguments)
    known = (np.abs(expected) > 1e-280) & (arguments < 0.5 * orders)
    assert known.sum() > 100
    assert np.max(np.abs(bessel_j(orders, arguments)[known] / expected[known] - 1.0)) < 1e-14


def test_growing_functions_are_near_those_of_scipy():
    arguments = np.concatenate([ARGUMENTS, np.geomspace(500.0, 1e6, 40)])
    expected = scipy.special.ive(ORDERS[:, None], arguments)
    known = expected > 1e-290
    found = scaled_i(ORDERS[:, None], arguments)
    assert np.max(np.abs(found[known] / expected[known] - 1.0)) < SCIPY_ERROR_I


def test_growing_functions_are_right():
    draw = np.random.default_rng(2)
    orders = draw.integers(0, 121, 400)
    arguments = np.concatenate([draw.uniform(0.0, 500.0, 200), np.geomspace(1e-3, 1e6, 200)])
    expected = exactly(lambda n, x: mpmath.besseli(n, x) * mpmath.exp(-x), orders, arguments)
    known = expected > 1e-290
    assert np.max(np.abs(scaled_i(orders, arguments)[known] / expected[known] - 1.0)) < 1e-14


@pytest.mark.parametrize(("one", "pair"), [(bessel_j, bessel_j_pair), (scaled_i, scaled_i_pair)])
def test_pairs_are_of_this_order_and_the_next(one, pair):
    here, above = pair(ORDERS[:, None], ARGUMENTS)
    assert np.array_equal(here, one(ORDERS[:, None], ARGUMENTS))
    assert np.max(np.abs(above - one(ORDERS[:, None] + 1, ARGUMENTS))) < 1e-15


@pytest.mark.hard_for("j1-1")
@pytest.mark.parametrize(("function", "order"), [(j0, 0), (j1, 1)])
def test_functions_of_large_arrays_are_right(function, order):
    draw = np.random.default_rng(3)
    arguments = np.concatenate([draw.uniform(0.0, 1e4, 300), draw.uniform(31.0, 34.0, 100), SMALL])
    expected = exactly(mpmath.besselj, np.full(arguments.size, order), arguments)
    assert np.max(np.abs(function(arguments) - expected)) < 1e-15
    many = np.linspace(0.0, 1e4, 100_001)
    assert np.max(np.abs(function(many) - scipy.special.jv(order, many))) < SCIPY_ERROR_J
    assert np.max(np.abs(function(SMALL) - scipy.special.jv(order, SMALL))) < 1e-15
    assert np.max(np.abs(j1(SMALL[1:]) / scipy.special.j1(SMALL[1:]) - 1.0)) < 1e-15


def test_a_value_does_not_depend_on_the_others_of_its_array():
    draw = np.random.default_rng(4)
    orders, arguments = draw.integers(0, 60, 900), draw.uniform(0.0, 90.0, 900)
    for function in (bessel_j, scaled_i):
        each = [float(function(n, x)) for n, x in zip(orders[:50], arguments[:50], strict=True)]
        assert np.array_equal(function(orders, arguments)[:50], each)
    assert np.array_equal(j0(arguments)[:50], [float(j0(np.array([x]))[0]) for x in arguments[:50]])


@pytest.mark.hard
def test_no_zero_is_left_out():
    number = np.arange(1, 61)
    found = zeros_of_j(ORDERS[:, None], number)
    expected = np.array([scipy.special.jn_zeros(n, number.size) for n in ORDERS])
    assert np.max(np.abs(found / expected - 1.0)) < 1e-13


def test_arrays_without_numbers_stay_so():
    assert bessel_j(np.zeros(0), np.zeros(0)).shape == scaled_i(np.zeros(0), np.zeros(0)).shape == (0,)
    assert j0(np.zeros((0, 3))).shape == (0, 3)
