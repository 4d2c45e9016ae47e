"""Gauss quadrature with the same bits on every machine."""

import math
from functools import lru_cache

import numpy as np

from engine.arithmetic.elementary import cos

NEWTON_STEPS = 4  # from a guess that is right to 1e-5 of the distance to the next node, or so


@lru_cache(64)
def gauss_legendre(count: int) -> tuple[np.ndarray, np.ndarray]:
    """Nodes from -1 to 1, rising, and weights of so many points: exact for polynomials up to degree 2·count - 1.

    Newton's method for the zeros of the Legendre polynomial, by its recurrence. Neither array can be written to.
    """
    half = (count + 1) // 2
    # Tricomi's guess, of the nodes from 1 down to the middle: Numer. Math. 54, 1989, 517
    x = (1 - (count - 1) / (8.0 * count * count * count)) * cos(
        math.pi * (4 * np.arange(1.0, half + 1) - 1) / (4 * count + 2)
    )
    if count % 2:
        x[-1] = 0.0
    for _ in range(NEWTON_STEPS):
        value, before = _legendre(count, x)
        x = x - value * (1 - x) * (1 + x) / (count * (before - x * value))
    value, before = _legendre(count, x)
    weight = 2 * (1 - x) * (1 + x) / np.square(count * (before - x * value))
    mirror = slice(None, half - 1 if count % 2 else half)
    nodes, weights = np.concatenate([-x[mirror], x[::-1]]), np.concatenate([weight[mirror], weight[::-1]])
    weights *= 2 / np.add.reduce(weights)
    nodes.flags.writeable = weights.flags.writeable = False
    return nodes, weights


def _legendre(degree: int, x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The Legendre polynomial of a degree and that before it, at x."""
    before, value = np.zeros(x.size), np.ones(x.size)
    for k in range(degree):
        before, value = value, ((2 * k + 1) * x * value - k * before) / (k + 1)
    return value, before
