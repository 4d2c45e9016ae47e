"""Thin cylindrical shells."""

import math
from functools import lru_cache
from typing import Any, ClassVar, Literal

from pydantic import Field

from engine.arithmetic.elementary import power, square
from engine.bodies.cylinder_modes import Shell, cylinder_modes
from engine.bodies.distributed import ModeSet
from engine.bodies.initial_shape import Profile, Quadrature, peak_of_rectangle, rectangle_quadrature
from engine.bodies.materials import Material, MaterialName, absent_losses, absent_numbers
from engine.bodies.plate_modes import MAX_RITZ_MODES
from engine.bodies.sheet import SheetBody

shell_modes = lru_cache(16)(cylinder_modes)


class CylindricalShell(SheetBody):
    """A thin cylindrical shell, such as that of a drum. [x, y] are fractions of a turn and of the height. It does not
    move as a whole."""

    kind: Literal["shell"]
    radius: float = Field(gt=0.0, le=1e3, description="radius, m")
    length: float = Field(gt=0.0, le=1e3, description="height, m")
    thickness: float = Field(gt=0.0, le=10.0, description="thickness, m")
    young: float = Field(gt=0.0, le=1e15, description="Young's modulus, Pa")
    poisson: float = Field(default=0.3, ge=0.0, lt=0.5, description="Poisson's ratio")
    density: float = Field(gt=0.0, le=1e6, description="density of the material, kg/m³")
    material: MaterialName | None = Field(
        default=None,
        description="material of the shell: gives what is not given of young, poisson, density and decay",
    )
    ends: Literal["free", "supported", "clamped"] = Field(default="free", description="boundary condition of both rims")

    BEGINS_AT_REST: ClassVar[bool] = True
    PITCH_POWERS: ClassVar[dict[str, int]] = {"young": 2}

    @classmethod
    def numbers_of_material(cls, table: dict[str, Any], material: Material) -> dict[str, Any]:
        numbers = {"young": material.young, "poisson": material.poisson, "density": material.density}
        return absent_numbers(table, **numbers) | absent_losses(table, material)

    def free_modes(self, max_omega: float) -> ModeSet:
        """Outward motion of the modes of two and more waves around (engine.bodies.cylinder_modes)."""
        shell = Shell(self.radius, self.length, self.thickness, self.young, self.poisson, self.density)
        omega, shape = shell_modes(shell, self.ends, self.modes or MAX_RITZ_MODES, max_omega)
        beta = power(self.density * self.thickness * square(omega) / shell.rigidity(), 0.25)
        return ModeSet(omega, self.decay_rates(omega, beta), shape)

    def extent(self) -> tuple[float, float]:
        return 2 * math.pi * self.radius, self.length

    def to_rim(self, at: Any) -> float:
        return float(min(at[1], 1 - at[1])) * self.length

    def total_mass(self) -> float:
        return 2 * math.pi * self.radius * self.length * self.thickness * self.density

    def bending_thickness(self) -> float:
        return self.thickness

    def quadrature(self, modes: int, kinks: list[float]) -> Quadrature:
        return rectangle_quadrature((8, 8), self.total_mass())

    def peak(self, at: Any) -> Profile:
        return peak_of_rectangle(at)

    @classmethod
    def position_help(cls, table: dict[str, Any]) -> str:
        return "[x, y], fractions of a turn and of its height"
