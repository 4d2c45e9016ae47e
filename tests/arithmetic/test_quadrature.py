"""Gauss points by Newton's method."""

import numpy as np
import pytest

from engine.arithmetic.quadrature import gauss_legendre


@pytest.mark.parametrize("count", [*range(1, 40), 96, 200, 501])
def test_nodes_and_weights_are_those_of_gauss(count):
    nodes, weights = gauss_legendre(count)
    expected, of_them = np.polynomial.legendre.leggauss(count)
    assert np.max(np.abs(nodes - expected)) < 3e-16 and np.max(np.abs(weights - of_them)) < 5e-14
    assert np.max(np.abs(weights / of_them - 1)) < 1e-14 * count**2  # NumPy's own error, which grows so
    assert np.array_equal(nodes, -nodes[::-1]) and np.array_equal(weights, weights[::-1])


@pytest.mark.parametrize("count", [1, 2, 5, 24, 61])
def test_powers_are_integrated(count):
    nodes, weights = gauss_legendre(count)
    for power in range(0, 2 * count, 2):
        assert weights @ nodes**power == pytest.approx(2 / (power + 1), rel=1e-13)
