"""Sums and products in two parts, of which the second holds what rounding takes from the first.

Dekker, Numer. Math. 18, 1971, 224; Knuth, The Art of Computer Programming, vol. 2, sec. 4.2.2.
"""

import math
from typing import NamedTuple

import numpy as np

from engine.arithmetic.products import MANTISSA

HEADROOM = 2  # bits, for the sum of four products of slices
MOST_SLICES = 8


def add_exactly(a: np.ndarray, b: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The rounded sum, and what is missing."""
    total = a + b
    of_b = total - a
    return total, (a - (total - of_b)) + (b - of_b)


def round_sum(a: np.ndarray, small: np.ndarray, step: np.ndarray | float) -> np.ndarray:
    """The sum, rounded once to a multiple of a step, which is a power of two."""
    whole = np.rint(a / step)
    return np.asarray((whole + np.rint((a / step - whole) + small / step)) * step)


class SlicedMatrix(NamedTuple):
    """A matrix as a sum of slices, whole numbers of at most 2^width: slice[i]·2^(exponent - width - i·(width + 1))."""

    slices: list[np.ndarray]
    width: int
    exponent: int


def slice_matrix(matrix: np.ndarray, most: int = 3) -> SlicedMatrix:
    """Cut a matrix for products with others. It loses what lies below the last slice, after 60 bits or more."""
    width = (MANTISSA - HEADROOM - (matrix.shape[1] - 1).bit_length()) // 2
    return _cut(matrix, width, most)


def _cut(matrix: np.ndarray, width: int, most: int) -> SlicedMatrix:
    exponent = math.frexp(float(np.max(np.abs(matrix), initial=0.0)))[1]
    rest = matrix * math.ldexp(1.0, width - exponent)
    slices = [np.rint(rest)]
    while len(slices) < most:
        rest -= slices[-1]
        if not rest.any():
            break
        rest *= math.ldexp(1.0, width + 1)
        slices.append(np.rint(rest))
    return SlicedMatrix(slices, width, exponent)


def multiply_sliced(a: SlicedMatrix, b: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """[n, k] × [k, m], in two parts: what is lost lies 95 bits below the largest products.

    Products of slices, and sums of those of the same size, are whole numbers below 2⁵³, so they are exact.
    """
    cut = _cut(b, a.width, MOST_SLICES)
    columns, m = np.concatenate(cut.slices, axis=1), b.shape[1]
    levels = [np.zeros((a.slices[0].shape[0], m)) for _ in range(len(a.slices) + len(cut.slices) - 1)]
    for i, rows in enumerate(a.slices):
        products = rows @ columns
        for j in range(len(cut.slices)):
            levels[i + j] += products[:, j * m : (j + 1) * m]
    step, small = math.ldexp(1.0, -a.width - 1), np.zeros_like(levels[0])
    for level in levels[:1:-1]:
        small = (small + level) * step
    total, missing = add_exactly(levels[0], levels[1] * step) if len(levels) > 1 else (levels[0], small)
    scale = math.ldexp(1.0, a.exponent + cut.exponent - 2 * a.width)
    return total * scale, (missing + small * step) * scale
