"""Membranes, round or rectangular."""

import math
from functools import lru_cache
from typing import Any, ClassVar, Literal

import numpy as np
from pydantic import Field

from engine.bodies.distributed import MAX_GRID, MAX_SHEET_MODES, ModeSet, SheetBody
from engine.bodies.initial_shape import Profile, Quadrature, circle_quadrature, peak_of_circle
from engine.bodies.table import Positive, is_given
from engine.wording import format_value


class Membrane(SheetBody):
    """A membrane fixed at its rim: a circle of `radius`, or a rectangle of `size`."""

    kind: Literal["membrane"]
    radius: float | None = Field(
        default=None, gt=0.0, le=1e3, description="radius of a circle, m; [x, y] are fractions of the square around it"
    )
    size: list[Positive] | None = Field(default=None, min_length=2, max_length=2, description="sides of a rectangle, m")
    tension: float | None = Field(default=None, gt=0.0, le=1e9, description="tension, N/m")

    EXACTLY_ONE_OF: ClassVar[list[tuple[str, str, str]]] = [
        ("radius", "size", "radius of a circle or size of a rectangle, in m"),
        ("tension", "frequency", "tension in N/m or frequency in Hz"),
    ]
    PITCH_POWERS: ClassVar[dict[str, int]] = {"frequency": 1, "tension": 2}

    def free_modes(self, max_omega: float) -> ModeSet:
        """ω = β·√(T/ρ). On a rectangle as the plate's; on a circle β = j_mn/a, the zeros of J_m, and shapes
        J_m(βr)·cos mθ and sin mθ (Fletcher & Rossing, sec. 3.3)."""
        if self.size is not None:
            lowest = math.hypot(math.pi / self.size[0], math.pi / self.size[1])
            return self.rectangle_modes(self.size, self.dispersion_constant(self.tension, lowest), 1, max_omega)
        from scipy.special import jn_zeros, jv

        modes = self.modes or MAX_SHEET_MODES
        radius = self.radius or 1.0
        speed = self.dispersion_constant(self.tension, float(jn_zeros(0, 1)[0]) / radius)
        top = min(max_omega * radius / speed, 2 * math.sqrt(modes) + 10)  # Weyl: about z²/4 zeros below z
        zeros = [zero for zero in bessel_zeros(math.ceil(top)) if zero[0] < top]
        zero, order, turn = np.array(zeros[:modes]).reshape(-1, 3).T
        area = math.pi * radius**2 * np.where(order == 0, 1.0, 0.5)
        scale = 1 / (np.sqrt(self.density * area) * np.abs(jv(order + 1, zero)))

        def shape(position: Any) -> np.ndarray:
            x, y = 2 * position[0] - 1, 2 * position[1] - 1
            angle = order * math.atan2(y, x) - turn
            return np.asarray(scale * jv(order, zero * math.hypot(x, y)) * np.cos(angle))

        omega = speed * zero / radius
        return ModeSet(omega, self.decay_rates(omega, zero / radius), shape)

    def total_mass(self) -> float:
        a, b = self.size or (0.0, 0.0)
        return self.density * (math.pi * (self.radius or 0.0) ** 2 if self.size is None else a * b)

    def quadrature(self, modes: int, kinks: list[float]) -> Quadrature:
        if self.size is not None:
            return super().quadrature(modes, kinks)
        return circle_quadrature(min(12 + math.isqrt(modes), MAX_GRID // 2), self.total_mass())

    def peak(self, at: Any) -> Profile:
        return super().peak(at) if self.size is not None else peak_of_circle(at)

    @classmethod
    def explain_outside(cls, table: dict[str, Any], item: Any) -> tuple[str, str] | None:
        if not is_given(table, "radius") or math.hypot(2 * item[0] - 1, 2 * item[1] - 1) <= 1:
            return None
        outside = f"{format_value(item)} lies outside the circle of {format_value(table['name'])}"
        return outside, "[x, y] are fractions of the square around it, with [0.5, 0.5] its middle"

    @classmethod
    def position_help(cls, table: dict[str, Any]) -> str:
        return f"[x, y], fractions of {'the square around it' if is_given(table, 'radius') else 'its sides'}"


@lru_cache(8)
def bessel_zeros(top: int) -> list[tuple[float, int, float]]:
    """Zeros below `top` of the Bessel functions J_m, with m and the turn of each shape, 0 and, but for m = 0, a
    quarter; the lowest first."""
    from scipy.special import jn_zeros

    rows: list[tuple[float, int, float]] = []
    for m in range(top + 1):
        zeros = jn_zeros(m, int((top - m) / math.pi) + 2)  # the first is beyond m, the next ones π apart and more
        for zero in zeros[zeros < top].tolist():
            rows += [(zero, m, 0.0)] + ([(zero, m, math.pi / 2)] if m else [])
    return sorted(rows)
