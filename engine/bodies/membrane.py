"""Membranes, round or rectangular."""

import math
from collections.abc import Iterator
from functools import lru_cache
from typing import Any, ClassVar, Literal

import numpy as np
from pydantic import Field
from pydantic_core import InitErrorDetails

from engine.arithmetic.bessel import bessel_j, zeros_of_j
from engine.arithmetic.elementary import arctan2, cos, hypot, square
from engine.bodies.distributed import ModeSet
from engine.bodies.materials import Material, MaterialName, absent_numbers
from engine.bodies.plate_modes import PlateStiffness, supported_plate_modes
from engine.bodies.sheet import MAX_SHEET_MODES, TunedSheet
from engine.bodies.stretching import Stretching
from engine.bodies.table import KeyPath, are_positive, is_given, make_fault
from engine.bodies.tips import Compliance, Tip, mean_over_disc, sum_waves

FIRST_ZERO = 2.404825557695773  # of J0


class Membrane(TunedSheet):
    """A membrane fixed at its rim: a circle of `radius`, or a rectangle of `size`."""

    kind: Literal["membrane"]
    tension: float | None = Field(default=None, gt=0.0, le=1e9, description="tension, N/m")

    young: float | None = Field(
        default=None,
        gt=0.0,
        le=1e15,
        description="Young's modulus, Pa; with thickness, instead of stretching_stiffness",
    )
    thickness: float | None = Field(default=None, gt=0.0, le=1.0, description="thickness, m")
    poisson: float | None = Field(default=None, ge=0.0, lt=0.5, description="Poisson's ratio; 0.3 if absent")

    material: MaterialName | None = Field(
        default=None,
        description="material of the membrane: with a thickness it gives what is not given of area_density, poisson,"
        " and young (unless stretching_stiffness is)",
    )

    EXACTLY_ONE_OF: ClassVar[list[tuple[str, ...]]] = [
        *TunedSheet.EXACTLY_ONE_OF,
        ("tension", "frequency", "tension in N/m or frequency in Hz"),
    ]
    STRETCHED_BY: ClassVar[tuple[str, ...]] = "stretching_stiffness", "young"
    PITCH_POWERS: ClassVar[dict[str, int]] = {"frequency": 1, "tension": 2}

    AT_MOST_ONE_OF: ClassVar[list[tuple[str, str]]] = [("stretching_stiffness", "young")]
    CONTACT_RADIUS: ClassVar[float] = 0.005  # a point would sink in without limit
    GIVES_WAY_IN_BANDS: ClassVar[bool] = True

    def stiffness_of_stretch(self) -> float:
        if self.young is None:
            return super().stiffness_of_stretch()
        poisson = 0.3 if self.poisson is None else self.poisson
        return self.young * (self.thickness or 0.0) / (1 - square(poisson)) / (2 * self.area())

    def find_stretching(self, omega: np.ndarray) -> Stretching | None:
        """κ = β²/ρ = ω²/T."""
        stiffness = self.stiffness_of_stretch()
        return Stretching(stiffness, self._kappa(omega)) if stiffness else None

    def slope_squares(self, omega: np.ndarray) -> np.ndarray:
        return self._kappa(omega) / self.area()

    def _kappa(self, omega: np.ndarray) -> np.ndarray:
        """κ of Stretching [modes]."""
        return np.asarray(square(omega) / self.tension_for(self.lowest_wave_number()))

    @classmethod
    def numbers_of_material(cls, table: dict[str, Any], material: Material) -> dict[str, Any]:
        numbers = absent_numbers(table, poisson=material.poisson)
        if not is_given(table, "stretching_stiffness"):
            numbers |= absent_numbers(table, young=material.young)
        if are_positive([table.get("thickness")]):
            numbers |= absent_numbers(table, area_density=material.density * table["thickness"])
        return numbers

    @classmethod
    def faults(cls, path: KeyPath, table: dict[str, Any]) -> Iterator[InitErrorDetails]:
        """Its Young's modulus and its thickness go together."""
        yield from super().faults(path, table)
        is_in_need = is_given(table, "thickness") and not (is_given(table, "material") or is_given(table, "density"))
        if is_given(table, "young") != is_given(table, "thickness") and (is_given(table, "young") or is_in_need):
            missing = "thickness" if is_given(table, "young") else "young"
            yield make_fault(path, table, f"no {missing} is given", "young in Pa and thickness in m go together")

    def lowest_wave_number(self) -> float:
        """β of the first partial, 1/m."""
        if self.size is not None:
            return math.pi * math.sqrt(square(1 / self.size[0]) + square(1 / self.size[1]))
        return FIRST_ZERO / (self.radius or 1.0)

    def tension_for(self, lowest: float) -> float:
        """Tension T, N/m: ω = β·√(T/ρ). lowest: wave number of the first partial, 1/m"""
        return self.tension or self.area_density * square(2 * math.pi * (self.frequency or 0.0) / lowest)

    def tension_at_rest(self) -> float:
        return self.tension_for(self.lowest_wave_number())

    def mean_shape(self, modes: ModeSet, tip: Tip) -> np.ndarray:
        wave_number = self.wave_numbers(modes.omega, 0.0, self.tension_at_rest())
        return np.asarray(modes.shape(tip.at) * mean_over_disc(wave_number * self.covered_radius(tip)))

    def compliance_beyond(self, omega: float, highest: float = math.inf) -> Compliance | None:
        tension = self.tension_at_rest()
        waves = self.wave_numbers(np.array([omega, highest]), 0.0, tension)
        return sum_waves((float(waves[0]), float(waves[1])), tension, 0.0, self.covered_radius, self.metres)

    def free_modes(self, max_omega: float) -> ModeSet:
        """ω = β·√(T/ρ). On a rectangle as those of a plate without rigidity; on a circle β = j_mn/a, the zeros of J_m,
        and shapes J_m(βr)·cos mθ and sin mθ (Fletcher & Rossing, sec. 3.3)."""
        if self.size is not None:
            tension = self.tension_for(self.lowest_wave_number())
            limp, modes = PlateStiffness(0.0, 0.0, 0.0, 0.0), self.modes or MAX_SHEET_MODES
            flat = supported_plate_modes(self.size, limp, self.area_density, tension, modes, max_omega)
            beta = self.wave_numbers(flat.omega, 0.0, tension)
            return ModeSet(flat.omega, self.decay_rates(flat.omega, beta), flat.shape)
        modes = self.modes or MAX_SHEET_MODES
        radius = self.radius or 1.0
        speed = math.sqrt(self.tension_for(self.lowest_wave_number()) / self.area_density)
        top = min(max_omega * radius / speed, 2 * math.sqrt(modes) + 10)  # Weyl: about z²/4 zeros below z
        zeros = [zero for zero in bessel_zeros(math.ceil(top)) if zero[0] < top]
        zero, order, turn = np.array(zeros[:modes]).reshape(-1, 3).T
        area = math.pi * square(radius) * np.where(order == 0, 1.0, 0.5)
        scale = 1 / (np.sqrt(self.area_density * area) * np.abs(bessel_j(order + 1, zero)))

        def shape(position: Any) -> np.ndarray:
            x, y = np.moveaxis(2 * np.asarray(position) - 1, -1, 0)[..., None]
            waves = cos(order * arctan2(y, x) - turn)
            if x.size == 1:
                return np.asarray(scale * bessel_j(order, zero * hypot(x, y)) * waves)
            # many places lie on a few rings
            ring, number = np.unique(np.round(hypot(x, y), 12), return_inverse=True)
            return np.asarray((scale * bessel_j(order, zero * ring[:, None]))[number.reshape(x.shape[:-1])] * waves)

        omega = speed * zero / radius
        return ModeSet(omega, self.decay_rates(omega, zero / radius), shape)


@lru_cache(8)
def bessel_zeros(top: int) -> list[tuple[float, int, float]]:
    """Zeros below `top` of the Bessel functions J_m, with m and the turn of each shape, 0 and, but for m = 0, a
    quarter; the lowest first."""
    # the first zero is beyond m, the next ones π apart and more
    pairs = [(m, number) for m in range(top + 1) for number in range(1, int((top - m) / math.pi) + 3)]
    rows: list[tuple[float, int, float]] = []
    for (m, _), zero in zip(pairs, zeros_of_j(*np.array(pairs).T).tolist(), strict=True):
        if zero < top:
            rows += [(zero, m, 0.0)] + ([(zero, m, math.pi / 2)] if m else [])
    return sorted(rows)
