"""Thin plates."""

import math
from collections.abc import Iterator
from functools import lru_cache
from typing import Annotated, Any, ClassVar, Literal

import numpy as np
from pydantic import Field
from pydantic_core import InitErrorDetails

from engine.arithmetic.elementary import square
from engine.arithmetic.plain_numbers import whole_power
from engine.bodies.bar import Cords
from engine.bodies.circular_plate_modes import circular_plate_modes
from engine.bodies.distributed import ModeSet
from engine.bodies.materials import Material, MaterialName, absent_losses, absent_numbers
from engine.bodies.plate_modes import MAX_RITZ_MODES, PlateModes, PlateStiffness, rectangle_plate_modes
from engine.bodies.sheet import MAX_SHEET_MODES, TunedSheet
from engine.bodies.stretching import Stretching
from engine.bodies.table import KeyPath, are_positive, is_given, make_fault
from engine.bodies.tips import Compliance, sum_waves

MODES_OF_STATICS = 4_000  # beyond, a point gives way by less than 1e-3 more
Modulus = Annotated[float, Field(gt=0.0, le=1e15)]


rectangle_modes, circle_modes = lru_cache(16)(rectangle_plate_modes), lru_cache(16)(circular_plate_modes)


class Plate(TunedSheet):
    """A thin plate (Kirchhoff). With free edges it also moves as a whole, on cords or on its supports, in addition to
    `modes`."""

    kind: Literal["plate"]
    edges: Literal["supported", "clamped", "free"] = Field(
        default="supported", description="boundary condition of all edges: simply supported, clamped or free"
    )
    flexural_rigidity: float | None = Field(default=None, gt=0.0, le=1e15, description="flexural rigidity D, N·m")
    young: Modulus | Annotated[list[Modulus], Field(min_length=2, max_length=2)] | None = Field(
        default=None,
        description="Young's modulus, Pa, with a thickness, instead of flexural_rigidity; of wood two, along x and y",
    )
    thickness: float | None = Field(default=None, gt=0.0, le=1e3, description="thickness, m")
    shear: Modulus | None = Field(
        default=None, description="shear modulus of wood, Pa; √(Ex·Ey)/(2 + 2√(νxy·νyx)) if absent"
    )
    poisson: float | None = Field(
        default=None,
        ge=0.0,
        lt=0.5,
        description="Poisson's ratio, of wood νxy, or that along the stiffer side where νxy·νyx would be 1 or more; 0.3"
        " if absent, of wood along the stiffer side",
    )
    tension: float | None = Field(
        default=None, gt=0.0, le=1e9, description="tension in addition to the flexural rigidity, N/m"
    )
    material: MaterialName | None = Field(
        default=None,
        description="material of the plate: with a thickness it gives what is not given of young (unless"
        " flexural_rigidity or frequency is), shear, poisson, area_density, and decay",
    )
    cords: Cords | None = Field(
        default=None, description="cords of a free plate; soft ones if neither cords nor a support are given"
    )

    stretching: bool | None = Field(
        default=None,
        description="true: the tension rises as the plate stretches, by its young and its thickness; a supported"
        " rectangle of one modulus",
    )

    EXACTLY_ONE_OF: ClassVar[list[tuple[str, ...]]] = [
        *TunedSheet.EXACTLY_ONE_OF,
        (
            "flexural_rigidity",
            "frequency",
            "young",
            "flexural_rigidity in N·m, frequency in Hz, or Young's modulus in Pa",
        ),
    ]
    STRETCHED_BY: ClassVar[tuple[str, ...]] = "stretching_stiffness", "stretching"
    PITCH_POWERS: ClassVar[dict[str, int]] = {
        "frequency": 1,
        "flexural_rigidity": 2,
        "young": 2,
        "shear": 2,
        "tension": 2,
    }

    def free_modes(self, max_omega: float) -> ModeSet:
        """Modes of a rectangle (engine.bodies.plate_modes) or a circle (engine.bodies.circular_plate_modes)."""
        stiffness, tension = self._tuned_stiffness(), self.tension or 0.0
        known = MAX_SHEET_MODES if self.edges == "supported" and self.size is not None else MAX_RITZ_MODES
        rigid = self.count_whole_modes()
        count = (self.modes or known) + rigid
        omega, shape = self._modes(stiffness, tension, count, max_omega)
        sigma = self.decay_rates(omega[rigid:], self.wave_numbers(omega[rigid:], stiffness.mean(), tension))
        if not rigid:
            return ModeSet(omega, sigma, shape)
        cords = self.cords or Cords(frequency=0.0 if self.support else Cords().frequency)
        whole_omega, whole_sigma = cords.rates()
        return ModeSet(
            np.concatenate([omega[rigid:], np.full(rigid, whole_omega)]),
            np.concatenate([sigma, np.full(rigid, whole_sigma)]),
            lambda position: np.roll(shape(position), -rigid, axis=-1),
        )

    def compliance_beyond(self, omega: float, highest: float = math.inf) -> Compliance | None:
        """Of a rectangle that is not supported, and of a circle, far from the edges; of wood, as of a plate of one
        modulus that gives way as much."""
        if self.edges == "supported" and self.size is not None:
            modes = self.model_copy(update={"modes": MODES_OF_STATICS}).free_modes(math.inf)
            return self.sum_beyond(modes, omega, highest)
        rigidity, tension = self._tuned_stiffness().yielding(), self.tension or 0.0
        low, high = (
            float(self.wave_numbers(np.array(at), rigidity, tension)) if at < math.inf else math.inf
            for at in (omega, highest)
        )
        return sum_waves((low, high), tension, rigidity, self.covered_radius, self.metres)

    def _tuned_stiffness(self) -> PlateStiffness:
        """Flexural rigidities, N·m; those that a frequency asks for, if it is given instead."""
        stiffness, rigid = self.stiffness(), self.count_whole_modes()
        if self.frequency is None:
            return stiffness
        first = self._modes(stiffness, 0.0, rigid + 1, math.inf).omega[rigid]  # of rigidity 1: it goes as its root
        factor = square(2 * math.pi * self.frequency / first)
        return PlateStiffness(*(factor * d for d in stiffness))

    def _modes(self, stiffness: PlateStiffness, tension: float, count: int, max_omega: float) -> PlateModes:
        """The lowest modes; those of a free plate as a whole come first."""
        if self.size is not None:
            a, b = self.size
            return rectangle_modes((a, b), stiffness, self.area_density, tension, self.edges, (), count, max_omega)
        poisson = 0.3 if self.poisson is None else self.poisson
        rim = (self.area_density, tension, self.edges, count, max_omega)
        return circle_modes(self.radius or 1.0, stiffness.x, poisson, *rim)

    def stiffness(self) -> PlateStiffness:
        """Flexural rigidities, N·m; of rigidity 1, if a frequency is given instead.

        Dx = Ex·h³/(12·(1 - νxy·νyx)), νyx = νxy·Ey/Ex, D1 = νyx·Dx, Dk = G·h³/12 (Timoshenko & Woinowsky-Krieger,
        Theory of Plates and Shells, sec. 85). Wood whose sides are the other way round is turned: a ratio that cannot
        be νxy, or that is not given, is νyx where y is stiffer.
        """
        poisson = 0.3 if self.poisson is None else self.poisson
        if self.young is None:
            return PlateStiffness.isotropic(self.flexural_rigidity or 1.0, poisson)
        along, across = self.young if isinstance(self.young, list) else (self.young, self.young)
        if along < across and (self.poisson is None or square(poisson) * across >= along):
            poisson *= along / across
        other = poisson * across / along
        bend = whole_power(self.thickness or 0.0, 3) / 12
        shear = self.shear or math.sqrt(along * across) / (2 * (1 + math.sqrt(poisson * other)))
        solid = bend / (1 - poisson * other)
        return PlateStiffness(along * solid, across * solid, other * along * solid, shear * bend)

    def find_stretching(self, omega: np.ndarray) -> Stretching | None:
        """κ = β²/ρ, β² = π²·(i²/a² + j²/b²): only a supported rectangle has shapes whose slopes are orthogonal."""
        stiffness = self.stiffness_of_stretch()
        if self.stretching and isinstance(self.young, float):
            poisson = 0.3 if self.poisson is None else self.poisson
            stiffness = self.young * (self.thickness or 0.0) / (1 - square(poisson)) / (2 * self.area())
        if stiffness == 0.0 or self.size is None:
            return None
        number = np.arange(1, 2 * omega.size + 1)
        x, y = (np.square(number * (math.pi / side))[: omega.size] for side in self.size)
        return Stretching(stiffness, np.sort(np.add.outer(x, y), axis=None)[: omega.size] / self.area_density)

    def tension_at_rest(self) -> float | None:
        return self.tension

    def bending_thickness(self) -> float | None:
        """The thickness, or √(12·D/(E·h/(1 - ν²))) where that follows from stiffnesses."""
        if self.thickness is not None or not self.stretching_stiffness or self.size is None:
            return self.thickness
        rigidity = self.flexural_rigidity
        if rigidity is None:  # of a supported rectangle ω² = D·β⁴/ρ
            lowest = sum(square(math.pi / side) for side in self.size)
            rigidity = self.area_density * square(2 * math.pi * (self.frequency or 0.0) / lowest)
        return math.sqrt(12 * rigidity / self.stretching_stiffness)

    def count_whole_modes(self) -> int:
        return 3 if self.edges == "free" else 0

    @classmethod
    def numbers_of_material(cls, table: dict[str, Any], material: Material) -> dict[str, Any]:
        numbers = absent_numbers(table, poisson=material.poisson) | absent_losses(table, material)
        if are_positive([table.get("thickness")]):
            numbers |= absent_numbers(table, area_density=material.density * table["thickness"])
        if not any(is_given(table, key) for key in ("young", "flexural_rigidity", "frequency")):
            numbers |= {"young": material.moduli()} | absent_numbers(table, shear=material.shear or None)
        return numbers

    @classmethod
    def faults(cls, path: KeyPath, table: dict[str, Any]) -> Iterator[InitErrorDetails]:
        """Its stiffness is given in one way, and what holds it goes with its edges."""
        yield from super().faults(path, table)
        young, edges = table.get("young"), table.get("edges", "supported")
        is_in_need = is_given(table, "thickness") and not (is_given(table, "material") or is_given(table, "density"))
        if is_given(table, "young") != is_given(table, "thickness") and (is_given(table, "young") or is_in_need):
            missing = "thickness" if is_given(table, "young") else "young"
            yield make_fault(path, table, f"no {missing} is given", "young in Pa and thickness in m go together")
        if is_given(table, "shear") and not isinstance(young, list):
            message = "a shear modulus is given without two Young's moduli"
            yield make_fault((*path, "shear"), table["shear"], message, "young = [Pa along x, Pa along y]")
        if isinstance(young, list) and is_given(table, "radius"):
            yield make_fault((*path, "young"), young, "a circle of wood", "one modulus, or a rectangle of size")
        if is_given(table, "tension") and edges == "free":
            yield make_fault((*path, "tension"), table["tension"], "a free plate under tension", "it needs held edges")
        if is_given(table, "tension") and is_given(table, "frequency"):
            message = "tension and frequency are both given"
            yield make_fault(
                (*path, "tension"), table["tension"], message, "give a flexural_rigidity beside it, or young"
            )
        yield from cls._stretching_faults(path, table)
        if is_given(table, "cords") and edges != "free":
            message = f"cords under a plate that is {edges}"
            yield make_fault((*path, "cords"), table["cords"], message, 'a plate with edges = "free" hangs on cords')

    @classmethod
    def _stretching_faults(cls, path: KeyPath, table: dict[str, Any]) -> Iterator[InitErrorDetails]:
        """Only a supported rectangle of one modulus stretches, and in one way."""
        ways = [key for key in ("stretching_stiffness", "stretching") if table.get(key)]
        if not ways:
            return
        place, value = (*path, ways[0]), table[ways[0]]
        if len(ways) == 2:
            yield make_fault(place, value, "stretching_stiffness and stretching are both given", "give one of them")
        if table.get("edges", "supported") != "supported" or not is_given(table, "size"):
            remedy = "only a rectangle of size with supported edges stretches; leave it out"
            yield make_fault(place, value, "a plate of this shape or these edges that stretches", remedy)
        elif isinstance(table.get("young"), list):
            yield make_fault(
                place, value, "a plate of wood that stretches", "give one Young's modulus, or leave it out"
            )
        elif ways == ["stretching"] and not is_given(table, "young"):
            yield make_fault(
                place, value, "stretching without young and thickness", "give these, or stretching_stiffness"
            )
