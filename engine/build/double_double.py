"""Sums and products to twice the precision of a number: pairs of what is rounded, and of what rounding cut off."""

from typing import NamedTuple

import numpy as np


def two_product(a: np.ndarray, b: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Products and their rounding errors (Dekker): a·b = product + error exactly."""

    def halves(x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        big = 134217729.0 * x
        high = big - (big - x)
        return high, x - high

    (ah, al), (bh, bl) = halves(a), halves(b)
    product = a * b
    return product, ((ah * bh - product) + ah * bl + al * bh) + al * bl


class Pair(NamedTuple):
    """high + low, each an array of the same shape; |low| is no more than half a unit in the last place of high."""

    high: np.ndarray
    low: np.ndarray


def as_pair(x: np.ndarray) -> Pair:
    """A pair of numbers that are exact."""
    return Pair(x, np.zeros_like(x))


def add(a: Pair, b: Pair) -> Pair:
    """a + b, to about 1e-31 of the larger."""
    high = a.high + b.high
    moved = high - a.high
    return _normalise(high, (a.high - (high - moved)) + (b.high - moved) + (a.low + b.low))


def multiply(a: Pair, b: Pair) -> Pair:
    """a·b, to about 1e-31 of it."""
    product, error = two_product(a.high, b.high)
    return _normalise(product, error + (a.high * b.low + a.low * b.high))


def _normalise(high: np.ndarray, low: np.ndarray) -> Pair:
    total = high + low
    return Pair(total, low - (total - high))
