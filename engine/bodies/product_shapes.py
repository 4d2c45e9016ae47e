"""Shapes of modes as sums of products of functions of x and of y."""

from collections.abc import Callable, Sequence
from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np

from engine.arithmetic.products import product
from engine.bodies.side_functions import SideFunctions

PLACES_KEPT, MAX_NUMBERS_KEPT = 128, 100_000  # of shapes that were computed: a live change needs the same again


class ProductSum(NamedTuple):
    """Modes of one symmetry."""

    x: np.ndarray  # numbers of the functions of x, of y
    y: np.ndarray
    factors: np.ndarray  # [products of these, modes]
    ranks: np.ndarray  # of these modes among all


def sum_products(
    axes: Sequence[SideFunctions], sums: Sequence[ProductSum], modes: int, scale: float
) -> Callable[[Any], np.ndarray]:
    """Return the shapes at positions [..., 2]: [..., modes]."""

    @lru_cache(PLACES_KEPT)
    def shape_at(coordinates: bytes, size: tuple[int, ...]) -> np.ndarray:
        at = np.frombuffer(coordinates).reshape(-1, 2)
        (x, of_x), (y, of_y) = (np.unique(at[:, axis], return_inverse=True) for axis in range(2))
        along, across = scale * axes[0].values(x)[0], axes[1].values(y)[0]
        is_grid = x.size * y.size <= 2 * len(at)
        out = np.empty((len(at), modes))
        for functions_x, functions_y, factors, ranks in sums:
            in_x, in_y = along[:, functions_x], across[:, functions_y]
            if is_grid:
                out[:, ranks] = _on_grid(in_x, in_y, factors)[of_x, of_y]
            else:
                products = in_x[of_x][:, :, None] * in_y[of_y][:, None, :]
                out[:, ranks] = product(products.reshape(len(at), -1), factors)
        out = out.reshape(*size[:-1], modes)
        out.flags.writeable = False
        return out

    def shape(position: Any) -> np.ndarray:
        at = np.asarray(position, float)
        find = shape_at if at.size * modes <= MAX_NUMBERS_KEPT else shape_at.__wrapped__
        return find(at.tobytes(), at.shape)

    return shape


def _on_grid(in_x: np.ndarray, in_y: np.ndarray, factors: np.ndarray) -> np.ndarray:
    """At all x [places, functions] and y [places, functions]: [places of x, of y, modes]."""
    blocks = factors.reshape(in_x.shape[1], in_y.shape[1], -1)
    summed = product(in_y, np.moveaxis(blocks, 1, 0).reshape(in_y.shape[1], -1)).reshape(len(in_y), in_x.shape[1], -1)
    return product(in_x, np.moveaxis(summed, 1, 0).reshape(in_x.shape[1], -1)).reshape(len(in_x), len(in_y), -1)
