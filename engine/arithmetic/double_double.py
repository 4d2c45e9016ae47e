"""Sums and products in twice the precision of a float64: a pair holds a rounded value and its rounding error."""

from typing import NamedTuple, TypeVar

import numpy as np

Number = TypeVar("Number", float, np.ndarray)


def two_product(a: Number, b: Number) -> tuple[Number, Number]:
    """Return products and their rounding errors (Dekker): a·b = product + error exactly."""

    def halves(x: Number) -> tuple[Number, Number]:
        big = 134217729.0 * x
        high = big - (big - x)
        return high, x - high

    (ah, al), (bh, bl) = halves(a), halves(b)
    product = a * b
    return product, ((ah * bh - product) + ah * bl + al * bh) + al * bl


class Pair(NamedTuple):
    """Numbers high + low, two arrays of the same shape; |low| is at most half a unit in the last place of high."""

    high: np.ndarray
    low: np.ndarray


def as_pair(x: np.ndarray) -> Pair:
    """Return exact numbers as a pair."""
    return Pair(x, np.zeros_like(x))


def add(a: Pair, b: Pair) -> Pair:
    """Return a + b, to about 1e-31 of the larger."""
    high = a.high + b.high
    moved = high - a.high
    return _normalise(high, (a.high - (high - moved)) + (b.high - moved) + (a.low + b.low))


def multiply(a: Pair, b: Pair) -> Pair:
    """Return a·b, to about 1e-31 of the product."""
    product, error = two_product(a.high, b.high)
    return _normalise(product, error + (a.high * b.low + a.low * b.high))


def _normalise(high: np.ndarray, low: np.ndarray) -> Pair:
    total = high + low
    return Pair(total, low - (total - high))
