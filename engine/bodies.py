"""Bodies as modes: angular frequency ω, decay rate σ, mass-normalised shape."""

import math
from typing import NamedTuple

import numpy as np

from engine.scene import Body, Oscillator


class ModalBody(NamedTuple):
    """A body as the kernels see it."""

    omega: np.ndarray  # [modes], rad/s
    sigma: np.ndarray  # [modes], 1/s
    shape: np.ndarray  # [modes], 1/√kg, where it is touched and heard
    q: np.ndarray  # [modes], √kg·m, displacement at time 0
    p: np.ndarray  # [modes], √kg·m/s, momentum at time 0
    weight: np.ndarray  # [modes], √kg: its share of a uniform gravity of 1 m/s²


def modal(body: Body) -> ModalBody:
    """Modes of a body.

    A mass is one mode with ω = 0, an oscillator one with ω = √(k/m); the shape is 1/√m for
    both, and σ = γ/2 (paper, eq. 30 and 36: m·ÿ + m·γ·ẏ + k·y = f).
    """
    root = math.sqrt(body.mass)
    return ModalBody(
        omega=np.array([angular_frequency(body)]),
        sigma=np.array([body.damping / 2]),
        shape=np.array([1 / root]),
        q=np.array([body.displacement * root]),
        p=np.array([body.velocity * root]),
        weight=np.array([root]),
    )


def angular_frequency(body: Body) -> float:
    """ω of a body of one mode, rad/s."""
    if not isinstance(body, Oscillator):
        return 0.0
    if body.frequency is not None:
        return 2 * math.pi * body.frequency
    return math.sqrt((body.stiffness or 0.0) / body.mass)
