"""Membranes and plates: sheets with positions [x, y]."""

import math
from abc import abstractmethod
from collections.abc import Iterator
from typing import Any, ClassVar

import numpy as np
from pydantic import Field
from pydantic_core import InitErrorDetails

from engine.arithmetic.elementary import square
from engine.arithmetic.plain_numbers import hypot
from engine.arithmetic.products import product
from engine.arithmetic.quadrature import gauss_legendre
from engine.bodies.body import MAX_MODES, ModalBody, UnfitBody
from engine.bodies.distributed import DistributedBody, ModeSet
from engine.bodies.initial_shape import (
    Profile,
    Quadrature,
    circle_quadrature,
    peak_of_circle,
    peak_of_rectangle,
    rectangle_quadrature,
)
from engine.bodies.table import KeyPath, Positive, are_positive, is_given, is_number, make_fault
from engine.bodies.tips import Tip, disc_nodes, middle_of
from engine.wording import format_value

FASTEST_WAVE = 1.5  # of its highest mode, times the mean of those: along the softer side
RINGS = 96  # on which the motion of a circle is summed
MAX_SUMMED_MODES = 5_000  # of a sheet over which something is summed
LIGHTEST_SHEET = 20.0  # kg/m³, lighter than any: a smaller density is one in kg/m²
MAX_SHEET_MODES = 1_000  # of a membrane or a plate that does not say how many


class SheetBody(DistributedBody):
    """A membrane or a plate. A position on it is [x, y]."""

    modes: int | None = Field(
        default=None,
        ge=1,
        le=MAX_MODES,
        description=f"number of modes, the lowest; if absent, those below 0.49 of the sample rate, {MAX_SHEET_MODES}"
        " at most",
    )
    HEARD: ClassVar[str] = "acceleration"

    @abstractmethod
    def extent(self) -> tuple[float, float]:
        """Metres for which the two fractions of a position stand."""

    def to_rim(self, at: Any) -> float:
        """Distance of a position from the rim, m."""
        return min(float(min(x, 1 - x)) * side for x, side in zip(at, self.extent(), strict=True))

    def metres(self, place: Any) -> np.ndarray:
        """Coordinates of a position or a tip, or of positions [..., 2], m."""
        return np.asarray(middle_of(place) * np.array(self.extent()))

    def covered_radius(self, place: Any) -> float:
        """Radius of what a place covers, m: at most up to the rim; 0 of a position."""
        return max(0.0, min(place.radius, self.to_rim(place.at))) if isinstance(place, Tip) else 0.0

    def mean_shape(self, modes: ModeSet, tip: Tip) -> np.ndarray:
        extent, radius = np.array(self.extent()), self.covered_radius(tip)
        waves = FASTEST_WAVE * math.sqrt(4 * math.pi * modes.omega.size / float(np.prod(extent)))  # Weyl's law
        place, weight = disc_nodes(waves * radius)
        return np.asarray(product(weight, modes.shape(np.asarray(tip.at) + radius * place / extent)))

    @classmethod
    def split_positions(cls, at: Any) -> list[Any]:
        is_pair = isinstance(at, list) and not (at and isinstance(at[0], list))
        return at if isinstance(at, list) and not is_pair else [at]

    @classmethod
    def has_position(cls, table: dict[str, Any], item: Any) -> bool:
        return isinstance(item, list) and len(item) == 2 and all(map(is_number, item))

    @classmethod
    def position_help(cls, table: dict[str, Any]) -> str:
        return "[x, y], fractions of its sides"


class FlatSheet(SheetBody):
    """A flat membrane or plate: a rectangle or a circle."""

    HAS_AREA: ClassVar[bool] = True

    @abstractmethod
    def sides(self) -> tuple[float, float] | None:
        """Sides of a rectangle, m; None of a circle."""

    @abstractmethod
    def surface_density(self) -> float:
        """Mass per area, kg/m²."""

    @abstractmethod
    def area(self) -> float:
        """Area, m²."""

    def extent(self) -> tuple[float, float]:
        return self.sides() or (2 * math.sqrt(self.area() / math.pi),) * 2

    def to_rim(self, at: Any) -> float:
        if self.sides() is not None:
            return super().to_rim(at)
        side = self.extent()[0]
        return side / 2 - hypot(at[0] - 0.5, at[1] - 0.5) * side

    def total_mass(self) -> float:
        return self.surface_density() * self.area()

    def quadrature(self, modes: int, kinks: list[float]) -> Quadrature:
        if modes > MAX_SUMMED_MODES:
            raise UnfitBody(f"has {modes} modes; at most {MAX_SUMMED_MODES} where it begins with a shape or moves air")
        sides = self.sides()
        if sides is None:
            return circle_quadrature(math.ceil(2 * math.sqrt(modes)) + 4, self.total_mass())
        a, b = sides  # Weyl's law: modes/(ab) = β²/4π and what the rim takes
        waves = [math.ceil(math.sqrt(4 * modes * s / (math.pi * other))) + 4 for s, other in ((a, b), (b, a))]
        return rectangle_quadrature((min(waves[0], modes + 2), min(waves[1], modes + 2)), self.total_mass())

    def area_quadrature(self, modes: int) -> Quadrature:
        """Positions that resolve so many modes, with the area that each stands for in place of a mass, m²."""
        quadrature = self.quadrature(modes, [])
        return quadrature._replace(masses=quadrature.masses * (self.area() / float(np.sum(quadrature.masses))))

    def volume_row(self, body: ModalBody) -> np.ndarray:
        """∫ Φ dA: the volume that each mode displaces [modes], m²/√kg; none where waves stand for those left out. body:
        its modes"""
        row = self._integral_row(body)
        row[body.omega.size - body.residual :] = 0.0
        return row

    def _integral_row(self, body: ModalBody) -> np.ndarray:
        """∫ Φ dA of modes over the area [modes], m²/√kg."""
        if self.sides() is not None:
            return self.area_quadrature(body.omega.size).project(lambda position: 1.0, body.shape)
        node, weight = gauss_legendre(RINGS)  # on a circle only what moves its middle has a mean
        x = (node + 3) / 4
        rings = self.area() * weight * (node + 1) / 2
        row = product(rings, body.shape(np.column_stack([x, np.full(x.size, 0.5)])))
        middle = np.abs(body.shape([0.5, 0.5]))
        return np.where(middle > 1e-9 * np.max(middle), row, 0.0)

    def peak(self, at: Any) -> Profile:
        return peak_of_rectangle(at) if self.sides() is not None else peak_of_circle(at)

    def wave_numbers(self, omega: np.ndarray, rigidity: float, tension: float) -> np.ndarray:
        """β (1/m) of waves of angular frequency ω (rad/s): T·β² + D·β⁴ = ρω².

        rigidity: D, N·m; tension: T, N/m
        """
        inertia = self.surface_density() * square(omega)
        if rigidity == 0.0:
            return np.asarray(np.sqrt(inertia / tension))
        root = np.sqrt(square(tension) + 4 * rigidity * inertia)  # (root - T)/2D, without cancellation
        return np.asarray(np.sqrt(2 * inertia / (root + tension)))


class TunedSheet(FlatSheet):
    """A membrane or a plate: a circle of `radius`, or a rectangle of `size`."""

    area_density: float = Field(
        gt=0.0,
        le=1e9,
        description="mass per area, kg/m²; follows from the density and the thickness, if these are given",
    )
    density: float | None = Field(
        default=None, gt=0.0, le=1e6, description="density, kg/m³; with the thickness, instead of the mass per area"
    )
    frequency: float | None = Field(default=None, gt=0.0, le=1e6, description="frequency of the first partial, Hz")
    radius: float | None = Field(
        default=None, gt=0.0, le=1e3, description="radius of a circle, m; [x, y] are fractions of the square around it"
    )
    size: list[Positive] | None = Field(default=None, min_length=2, max_length=2, description="sides of a rectangle, m")

    stretching_stiffness: float | None = Field(
        default=None,
        ge=0.0,
        le=1e12,
        description="E·thickness/(1 - poisson²), N/m: the tension rises as the sheet stretches",
    )

    EXACTLY_ONE_OF: ClassVar[list[tuple[str, ...]]] = [
        ("radius", "size", "radius of a circle or size of a rectangle, in m")
    ]

    def sides(self) -> tuple[float, float] | None:
        return (self.size[0], self.size[1]) if self.size is not None else None

    def surface_density(self) -> float:
        return self.area_density

    def stiffness_of_stretch(self) -> float:
        """K = E·thickness/(1 - ν²)/(2A), N/m³ (Berger 1955)."""
        return (self.stretching_stiffness or 0.0) / (2 * self.area())

    def area(self) -> float:
        a, b = self.size or (0.0, 0.0)
        return math.pi * square(self.radius or 0.0) if self.size is None else a * b

    @classmethod
    def numbers_of_density(cls, table: dict[str, Any]) -> dict[str, Any]:
        """Return the mass per area that follows from a density and a thickness, unless it is given."""
        density, thickness = [table.get("density")], [table.get("thickness")]
        if not are_positive(density):
            return table
        return {"area_density": density[0] * (thickness[0] if are_positive(thickness) else 1.0)} | table  # or a fault

    @classmethod
    def faults(cls, path: KeyPath, table: dict[str, Any]) -> Iterator[InitErrorDetails]:
        """A density goes with a thickness. One without, or too small for any sheet, can be that of an old patch, in
        kg/m²: both readings are named."""
        yield from super().faults(path, table)
        density, thickness = table.get("density"), table.get("thickness")
        if density is None:
            return
        value, remedy = format_value(density), "give the thickness in m"
        message = f"{value} kg/m³, and no thickness is given"
        if are_positive([density, thickness]):
            message, remedy = f"{value} kg/m³ is lighter than any sheet", "give that of its material"
            if density >= LIGHTEST_SHEET:
                if table.get("area_density") != density * thickness:
                    message = "area_density and density are both given"
                    yield make_fault((*path, "density"), density, message, "give one of them")
                return
        yield make_fault(
            (*path, "density"), density, message, f"{remedy}; if {value} kg/m² is meant, its name is area_density"
        )

    @classmethod
    def explain_outside(cls, table: dict[str, Any], item: Any) -> tuple[str, str] | None:
        if not is_given(table, "radius") or hypot(2 * item[0] - 1, 2 * item[1] - 1) <= 1:
            return None
        outside = f"{format_value(item)} lies outside the circle of {format_value(table['name'])}"
        return outside, "[x, y] are fractions of the square around it, with [0.5, 0.5] its middle"

    @classmethod
    def position_help(cls, table: dict[str, Any]) -> str:
        return f"[x, y], fractions of {'the square around it' if is_given(table, 'radius') else 'its sides'}"
