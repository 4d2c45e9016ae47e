"""Linear systems and decompositions of the tables, against what they must fulfil."""

import numpy as np
import pytest

from engine.arithmetic.linear import rounds_of_pairs, singular_vectors, solve, symmetric_eigenvectors

SIZES = [1, 2, 3, 5, 12, 31]


def random_matrix(seed: int, *shape: int) -> np.ndarray:
    """Return a matrix whose rows differ in size by many orders."""
    rng = np.random.default_rng([seed, *shape])
    return rng.standard_normal(shape) * 10.0 ** rng.uniform(-3, 3, (*shape[:-1], 1))


@pytest.mark.parametrize("size", SIZES)
def test_a_linear_system_is_solved(size):
    matrix, wanted = random_matrix(1, size, size), random_matrix(2, size, 4)
    x = solve(matrix, wanted)
    scale = np.abs(matrix) @ np.abs(x) + np.abs(wanted)
    assert np.max(np.abs(matrix @ x - wanted) / scale) < 1e-14
    np.testing.assert_array_equal(solve(matrix, wanted[:, 0]), solve(matrix, wanted[:, :1])[:, 0])


def test_a_singular_system_is_refused():
    with pytest.raises(ValueError, match="singular"):
        solve(np.array([[1.0, 2.0], [2.0, 4.0]]), np.ones(2))


@pytest.mark.parametrize("size", SIZES)
def test_eigenvectors_turn_a_matrix_into_its_eigenvalues(size):
    half = random_matrix(4, 3, size, size)
    matrices = half @ np.swapaxes(half, 1, 2)
    values, vectors = symmetric_eigenvectors(matrices)
    largest = values[:, -1, None, None]
    unit = np.swapaxes(vectors, 1, 2) @ vectors
    assert np.max(np.abs(unit - np.eye(size))) < 1e-13
    assert np.max(np.abs(matrices @ vectors - vectors * values[:, None]) / largest) < 1e-13
    assert np.all(np.diff(values) >= 0.0)
    np.testing.assert_allclose(values[:, -1], np.linalg.eigvalsh(matrices)[:, -1], rtol=1e-13)


def test_there_may_be_no_unknowns():
    values, vectors = symmetric_eigenvectors(np.zeros((4, 0, 0)))
    assert (values.shape, vectors.shape) == ((4, 0), (4, 0, 0))
    assert solve(np.zeros((0, 0)), np.zeros((0, 3))).shape == (0, 3)
    assert [part.shape for part in singular_vectors(np.zeros((2, 3)))] == [(2, 0), (0,), (0, 3)]


def test_eigenvectors_of_any_sign_and_of_equal_eigenvalues():
    turn, _ = np.linalg.qr(random_matrix(5, 6, 6))
    values, vectors = symmetric_eigenvectors(turn @ np.diag([-3.0, -3.0, 0.0, 1.0, 1.0, 7.0]) @ turn.T)
    np.testing.assert_allclose(values, [-3, -3, 0, 1, 1, 7], atol=1e-13)
    np.testing.assert_allclose(vectors.T @ vectors, np.eye(6), atol=1e-13)
    values, vectors = symmetric_eigenvectors(np.array([[0.0, 2.0], [2.0, 0.0]]))
    np.testing.assert_allclose(values, [-2.0, 2.0], rtol=1e-15)


@pytest.mark.parametrize("size, columns", [(1, 4), (3, 3), (8, 200), (31, 60)])
def test_singular_vectors_make_up_the_matrix(size, columns):
    matrix = random_matrix(6, size, columns)
    left, singular, right = singular_vectors(matrix)
    assert np.max(np.abs((left * singular) @ right - matrix)) < 1e-13 * singular[0]
    np.testing.assert_allclose(left.T @ left, np.eye(size), atol=1e-13)
    np.testing.assert_allclose(right @ right.T, np.eye(size), atol=1e-13)
    np.testing.assert_allclose(singular, np.linalg.svd(matrix)[1], rtol=1e-10)


def test_small_singular_values_come_last():
    """Thirty points of a bridge move in four ways."""
    at = np.linspace(0.99, 0.995, 30)[:, None] * np.arange(1, 41) * np.pi
    _, singular, _ = singular_vectors(np.sin(at))
    want = np.linalg.svd(np.sin(at))[1]
    np.testing.assert_allclose(singular[:5], want[:5], rtol=1e-6)
    assert np.all(singular[12:] < 1e-12 * singular[0])


@pytest.mark.parametrize("size", [1, 2, 7, 10])
def test_all_pairs_meet_once(size):
    met = [pair for p, q in rounds_of_pairs(size) for pair in zip(p.tolist(), q.tolist(), strict=True)]
    assert sorted(met) == [(a, b) for a in range(size) for b in range(a + 1, size)]
