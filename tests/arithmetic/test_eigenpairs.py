"""Eigenvalues and eigenvectors with the same bits, whatever LAPACK's last digits are."""

from fractions import Fraction

import numpy as np
import pytest
import scipy

from engine.arithmetic.eigenpairs import Eigenproblem, Guess, guess_eigenpairs, guess_eigenvalues, refine_eigenpairs
from engine.arithmetic.two_parts import multiply_sliced, round_sum, slice_matrix

LOADS = [(0, 1.5), (1, 0.7)]


def graded_problem(shape: tuple[int, int], has_loads: bool, seed: int = 7) -> Eigenproblem:
    """Functions of which the last are stiffer by orders."""
    rng = np.random.default_rng(seed)
    size = shape[0] * shape[1]
    grades = np.add.outer(np.arange(1.0, shape[0] + 1) ** 2, np.arange(1.0, shape[1] + 1) ** 2).ravel()
    mixed = rng.standard_normal((size, size))
    mixed = np.eye(size) + (mixed + mixed.T) / (8 * np.sqrt(size))
    loads = []
    for axis, weight in LOADS if has_loads else []:
        rows = rng.standard_normal((shape[axis], 2))
        loads.append((axis, weight / shape[axis] * (rows @ rows.T)))
    return Eigenproblem(np.outer(grades, grades) * mixed, shape, loads)


def disturb(guess: Guess, seed: int) -> Guess:
    """As another LAPACK would find it: vectors mix the more, the closer their eigenvalues, and have other signs."""
    rng = np.random.default_rng(seed)
    size = guess.values.size
    large = 1 / (guess.values + guess.shift)
    apart = np.abs(large[:, None] - large) + np.eye(size)
    turn = np.triu(np.minimum(3e-16 * large.max() / apart, 1.0) * rng.standard_normal((size, size)), 1)
    turned = guess.turned @ scipy.linalg.expm(turn - turn.T) * rng.choice([-1.0, 1.0], size)
    values = 1 / (large + 3e-16 * large.max() * rng.standard_normal(size)) - guess.shift
    inverse = guess.inverse * (1 + 2e-16 * rng.standard_normal((size, size)))
    return guess._replace(values=np.sort(values), turned=turned, inverse=inverse)


@pytest.mark.parametrize("has_loads", [False, True])
def test_they_are_the_eigenpairs(has_loads):
    """Against mpmath with 40 digits."""
    from mpmath import mp, mpf

    problem = graded_problem((4, 3), has_loads)
    values, vectors = refine_eigenpairs(problem, guess_eigenpairs(problem, 20.0), 0, 6)
    mass = problem.mass()
    with mp.workdps(40):
        root = mp.cholesky(mp.matrix([[mpf(x) for x in row] for row in mass.tolist()]))
        over = mp.inverse(root)
        stiffness = mp.matrix([[mpf(x) for x in row] for row in problem.stiffness.tolist()])
        exact, columns = mp.eigsy(over * stiffness * over.T)
        order = sorted(range(12), key=lambda i: exact[i])[:6]
        wanted = np.array([float(exact[i]) for i in order])
        shapes = np.array([[float(x) for x in over.T * columns[:, i]] for i in order]).T
    assert values == pytest.approx(wanted, rel=1e-13)
    assert np.abs(vectors) == pytest.approx(np.abs(shapes), rel=1e-12, abs=1e-12)
    assert vectors.T @ mass @ vectors == pytest.approx(np.eye(6), abs=1e-12)
    assert guess_eigenvalues(problem, 20.0)[:6] == pytest.approx(wanted, rel=1e-10)


@pytest.mark.parametrize("has_loads", [False, True])
def test_another_guess_gives_the_same_bits(has_loads):
    problem = graded_problem((10, 8), has_loads)
    guess = guess_eigenpairs(problem, 100.0)
    values, vectors = refine_eigenpairs(problem, guess, 0, 30)
    for seed in range(5):
        other = disturb(guess, seed)
        assert not np.array_equal(other.turned, guess.turned)
        again, shapes = refine_eigenpairs(problem, other, 0, 30)
        signs = np.sign(np.sum(vectors * shapes, axis=0))
        assert np.array_equal(values, again) and np.array_equal(vectors, shapes * signs)


@pytest.mark.parametrize("distance", [1e-4, 1e-6, 1e-8, 1e-10])
def test_close_eigenvalues_have_the_same_vectors(distance):
    size = 60
    rng = np.random.default_rng(3)
    wanted = np.arange(1.0, size + 1) ** 2
    wanted[5], wanted[9] = wanted[4] * (1 + distance), wanted[10] * (1 - distance)
    turn = np.linalg.qr(rng.standard_normal((size, size)))[0]
    stiffness = (turn * wanted) @ turn.T
    problem = Eigenproblem((stiffness + stiffness.T) / 2, (size,))
    guess = guess_eigenpairs(problem, 20.0)
    values, vectors = refine_eigenpairs(problem, guess, 0, 20)
    assert values == pytest.approx(np.sort(wanted)[:20], rel=1e-13)
    assert vectors.T @ vectors == pytest.approx(np.eye(20), abs=1e-12)
    parted = np.abs(turn.T @ vectors)[[4, 5, 9, 10], [4, 5, 9, 10]]
    assert parted == pytest.approx(np.ones(4), abs=max(1e-12, (2e-12 / distance) ** 2))
    for seed in range(5):
        again, shapes = refine_eigenpairs(problem, disturb(guess, seed), 0, 20)
        signs = np.sign(np.sum(vectors * shapes, axis=0))
        assert np.array_equal(values, again) and np.array_equal(vectors, shapes * signs)


def test_products_in_two_parts_have_twice_the_digits():
    rng = np.random.default_rng(5)
    a, b = rng.standard_normal((30, 70)), np.rint(rng.uniform(-1, 1, (70, 5)) * 2.0**43) * 2.0**-43
    high, low = multiply_sliced(slice_matrix(a, most=9), b)
    for i in range(0, 30, 7):
        for j in range(5):
            exact = sum(Fraction(x) * Fraction(y) for x, y in zip(a[i], b[:, j], strict=True))
            assert abs(exact - Fraction(high[i, j]) - Fraction(low[i, j])) < 2.0**-88
            assert abs(exact - Fraction(high[i, j])) < 2.0**-40


def test_a_sum_is_rounded_once():
    step = 2.0**-40
    a = np.array([1 + 0.5 * step, 1 + 0.5 * step, 3.0, -2.0])
    rounded = round_sum(a, np.array([1e-25, -1e-25, 0.75 * step, -0.25 * step]), step)
    assert np.array_equal(rounded, [1 + step, 1.0, 3 + step, -2.0])
