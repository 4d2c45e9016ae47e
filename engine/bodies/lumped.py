"""Masses and oscillators: bodies of one mode."""

import math
from typing import Any, ClassVar, Literal

import numpy as np
from pydantic import Field

from engine.bodies.body import MIN_OMEGA, BodyTable, ModalBody
from engine.bodies.table import Displacement, Velocity


class LumpedBody(BodyTable):
    """A body of one mode. It moves as a whole: there are no positions on it."""

    mass: float = Field(ge=1e-12, le=1e9, description="mass, kg")
    damping_rate: float = Field(default=0.0, ge=0.0, le=1e6, description="damping rate γ, 1/s: force -mass·γ·velocity")
    displacement: Displacement = Field(default=0.0, description="displacement at time 0, m")
    velocity: Velocity = Field(default=0.0, description="velocity at time 0, m/s")

    IS_LUMPED: ClassVar[bool] = True

    def angular_frequency(self) -> float:
        """ω without damping, rad/s."""
        return 0.0

    def modal_body(self, max_frequency: float = math.inf) -> ModalBody:
        """One mode with shape 1/√m and σ = γ/2 (paper, eq. 30 and 36: m·ÿ + m·γ·ẏ + k·y = f)."""
        root = math.sqrt(self.mass)
        shape = np.array([1 / root])
        return ModalBody(
            omega=np.array([self.angular_frequency()]),
            sigma=np.array([self.damping_rate / 2]),
            shape=lambda position: shape,
            q=np.array([self.displacement * root]),
            p=np.array([self.velocity * root]),
            gravity_participation=np.array([root]),
        )

    def total_mass(self) -> float:
        return self.mass

    def initial_displacement(self, at: Any) -> float:
        return self.displacement


class Mass(LumpedBody):
    """A free point mass."""

    kind: Literal["mass"]


class Oscillator(LumpedBody):
    """A point mass on a spring."""

    kind: Literal["oscillator"]
    stiffness: float | None = Field(default=None, ge=0.0, le=1e25, description="spring stiffness, N/m")
    frequency: float | None = Field(
        default=None, ge=0.0, le=1e6, description="frequency without damping, Hz; instead of the stiffness"
    )

    EXACTLY_ONE_OF: ClassVar[list[tuple[str, ...]]] = [
        ("stiffness", "frequency", "stiffness in N/m or frequency in Hz")
    ]
    PITCH_POWERS: ClassVar[dict[str, int]] = {"frequency": 1, "stiffness": 2}

    def angular_frequency(self) -> float:
        """ω = √(k/m), or from the frequency, rad/s."""
        if self.frequency is not None:
            omega = 2 * math.pi * self.frequency
        else:
            omega = math.sqrt((self.stiffness or 0.0) / self.mass)
        return omega if omega > MIN_OMEGA else 0.0
