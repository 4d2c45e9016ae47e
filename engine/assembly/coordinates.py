"""Coordinates of connections, as records."""

from typing import NamedTuple

import numpy as np


class Coordinate(NamedTuple):
    """A coordinate of connections: the sum of row · modal displacements over its bodies, minus its rest length."""

    path: str  # in the patch
    connection: int | None  # number of its connection
    parts: dict[int, np.ndarray]  # by number of the body: its row [modes], 1/√kg; of w in N/(√kg·m)
    stiffness: float = 0.0  # N/m
    damping: float = 0.0  # kg/s
    rest: float = 0.0  # m
    is_rigid: bool = False
    excess: float = 0.0  # m/N: compliance of its rows beyond that of its bodies (engine.assembly.spring_compensation)


class Coordinates(NamedTuple):
    """All coordinates of an island, and the stiffness that couples them."""

    items: list[Coordinate]
    coupling: np.ndarray  # [items, items], N/m: stiffness between coordinates
