"""Thin bars."""

import math
from collections.abc import Iterator
from functools import lru_cache
from typing import Any, ClassVar, Literal

import numpy as np
from pydantic import Field
from pydantic_core import InitErrorDetails

from engine.arithmetic.elementary import cosh, exp, sin_and_cos, square, tanh
from engine.arithmetic.plain_numbers import whole_power
from engine.bodies.body import TO_60_DB
from engine.bodies.distributed import LineBody, ModeSet, mode_numbers, rise_from_one
from engine.bodies.materials import Material, MaterialName, absent_losses, absent_numbers
from engine.bodies.table import KeyPath, Positive, Table, are_positive, is_given, make_fault
from engine.bodies.tips import Compliance
from engine.wording import format_value

MODES_OF_STATICS = 2_000  # whose compliances fall off with the fourth power of their number
SETS_OF_ROOTS = 64  # that are kept: bars of an instrument mostly share theirs
NODE = 0.2241575  # of the first partial of a free bar, fraction of its length


class Cords(Table):
    """Cords under a free bar, at the nodes of its first partial, or of a free plate, on which it bounces as a whole."""

    frequency: float = Field(
        default=10.0, ge=0.0, le=1e4, description="frequency at which it bounces, Hz; 0: it floats"
    )
    t60: Positive = Field(default=0.5, description="time in which bouncing decays by 60 dB, s")

    def rates(self) -> tuple[float, float]:
        """ω (rad/s) and σ (1/s)."""
        return 2 * math.pi * self.frequency, TO_60_DB / self.t60 if self.frequency else 0.0


class Bar(LineBody):
    """A thin bar (Euler-Bernoulli). With free ends it also moves as a whole, on cords or on its supports; that is in
    addition to `modes`."""

    kind: Literal["bar"]
    ends: Literal["free", "clamped", "cantilever"] = Field(
        default="free", description="both ends free, both clamped, or the first clamped"
    )
    bending_stiffness: float | None = Field(default=None, gt=0.0, le=1e12, description="bending stiffness EI, N·m²")
    young: float | None = Field(
        default=None, gt=0.0, le=1e15, description="Young's modulus, Pa; with width and thickness it gives EI"
    )
    density: float | None = Field(
        default=None, gt=0.0, le=1e6, description="density, kg/m³; with width and thickness, instead of mass"
    )
    width: float | None = Field(default=None, gt=0.0, le=1e3, description="width of a rectangular bar, m")
    thickness: float | None = Field(
        default=None, gt=0.0, le=1e3, description="thickness of a rectangular bar in the direction in which it bends, m"
    )
    material: MaterialName | None = Field(
        default=None,
        description="material of a bar of given width and thickness: gives what is not given of young (unless"
        " bending_stiffness or frequency is), density (unless mass or linear_density is), and decay",
    )
    cords: Cords | None = Field(
        default=None, description="cords under a free bar; soft ones if neither cords nor a support are given"
    )
    ratios: list[Positive] | None = Field(
        default=None,
        min_length=1,
        max_length=50,
        description="ratios of partials to the first, as makers tune them; only these partials are built",
    )

    EXACTLY_ONE_OF: ClassVar[list[tuple[str, ...]]] = [
        ("linear_density", "mass", "density", "linear_density in kg/m, mass in kg, or density in kg/m³"),
        ("bending_stiffness", "frequency", "young", "bending_stiffness in N·m², frequency in Hz, or young in Pa"),
    ]
    PITCH_POWERS: ClassVar[dict[str, int]] = {"frequency": 1, "bending_stiffness": 2, "young": 2}

    def mass_per_length(self) -> float:
        """Mass per length, kg/m; of a material ρ·width·thickness."""
        if self.density is not None:
            return self.density * (self.width or 0.0) * (self.thickness or 0.0)
        return super().mass_per_length()

    def bending(self) -> float | None:
        """Bending stiffness EI, N·m²: as given, or E·width·thickness³/12; None if a frequency is given instead."""
        if self.young is not None:
            return self.young * (self.width or 0.0) * whole_power(self.thickness or 0.0, 3) / 12
        return self.bending_stiffness

    def bending_thickness(self) -> float | None:
        return self.thickness

    def free_modes(self, max_omega: float) -> ModeSet:
        """ω = β²·√(EI/μ), where cos(βL)·cosh(βL) = 1 (both ends free, or both clamped) or -1 (cantilever); shapes of
        mean square 1 (Fletcher & Rossing, sec. 2.15 to 2.16; Blevins, Formulas for Natural Frequency and Mode Shape,
        table 8-1)."""
        density, length = self.mass_per_length(), self.length
        first = float(bar_roots(self.ends, np.array([1.0]))[0])
        speed = 2 * math.pi * (self.frequency or 0.0) * square(length / first)
        bending = self.bending()
        if bending is not None:
            speed = math.sqrt(bending / density)
        if self.ratios is not None:
            root = bar_roots(self.ends, np.arange(1.0, len(self.ratios) + 1))
            omega = speed * square(first / length) * np.array(self.ratios)
            chosen = omega < max_omega
            omega, root = omega[chosen][: self.modes], root[chosen][: self.modes]
        else:
            number = mode_numbers(lambda n: speed * square(bar_roots(self.ends, n) / length), self.modes, max_omega)
            root = bar_roots(self.ends, number)
            omega = speed * square(root / length)
        scale = 1 / math.sqrt(density * length)
        sigma = self.decay_rates(omega, root / length)
        if self.ends != "free" or omega.size == 0:
            return ModeSet(omega, sigma, lambda x: scale * bar_shape(self.ends, root, x))
        rigid_omega, rigid_sigma = self.rigid_modes()

        def shape(x: Any) -> np.ndarray:
            turn = math.sqrt(12) * (np.asarray(x) - 0.5)
            whole = scale * np.stack([np.ones_like(turn), turn], axis=-1)
            return np.concatenate([scale * bar_shape("free", root, x), whole], axis=-1)

        return ModeSet(np.concatenate([omega, rigid_omega]), np.concatenate([sigma, rigid_sigma]), shape)

    def compliance_beyond(self, omega: float, highest: float = math.inf) -> Compliance | None:
        if self.ratios is not None:
            return None
        return self.sum_beyond(self.model_copy(update={"modes": MODES_OF_STATICS}).free_modes(math.inf), omega, highest)

    def rigid_modes(self) -> tuple[np.ndarray, np.ndarray]:
        """ω (rad/s) and σ (1/s) of a free bar that moves and turns as a whole: on cords of stiffness k at its nodes,
        ω² = 2k/m, and 12·(½ - node)²·2k/m of the turn."""
        cords = self.cords or Cords(frequency=0.0 if self.support else Cords().frequency)
        omega, sigma = cords.rates()
        return omega * np.array([1.0, math.sqrt(12) * (0.5 - NODE)]), np.full(2, sigma)

    @classmethod
    def numbers_of_material(cls, table: dict[str, Any], material: Material) -> dict[str, Any]:
        numbers = absent_losses(table, material)
        if not is_given(table, "linear_density") and not is_given(table, "mass"):
            numbers |= absent_numbers(table, density=material.density)
        if not is_given(table, "bending_stiffness") and not is_given(table, "frequency"):
            numbers |= absent_numbers(table, young=material.young)
        return numbers

    @classmethod
    def faults(cls, path: KeyPath, table: dict[str, Any]) -> Iterator[InitErrorDetails]:
        """Cords hold a free bar; the ratios of partials rise from 1; what a material gives goes with a section."""
        yield from super().faults(path, table)
        of_material = [key for key in ("young", "density") if is_given(table, key)]
        if is_given(table, "density") and not any(is_given(table, key) for key in ("width", "thickness", "material")):
            value = format_value(table["density"])
            remedy = f"give both in m; if {value} kg/m is meant, its name is linear_density"
            message = f"{value} kg/m³, and no width and thickness are given"
            yield make_fault((*path, "density"), table["density"], message, remedy)
            return
        for key in ("width", "thickness"):
            if of_material and not is_given(table, key):
                remedy = "young in Pa and density in kg/m³ go with width and thickness in m"
                yield make_fault(path, table, f"{of_material[0]} is given, and no {key}", remedy)
            elif is_given(table, key) and not of_material:
                remedy = "give a material, or young in Pa and density in kg/m³"
                yield make_fault((*path, key), table[key], f"a {key} of no material", remedy)
        if is_given(table, "cords") and table.get("ends", "free") != "free":
            message = f"cords under a bar that is {table['ends']}"
            yield make_fault((*path, "cords"), table["cords"], message, 'a bar with ends = "free" lies on cords')
        ratios: Any = table.get("ratios")
        if are_positive(ratios) and not rise_from_one(ratios):
            remedy = "the first is 1, each next one is higher"
            yield make_fault((*path, "ratios"), ratios, "these do not rise from 1", remedy)


def bar_roots(ends: str, number: np.ndarray) -> np.ndarray:
    """βL of modes 1, 2, …, by Newton's method from its asymptote."""
    return _bar_roots(ends, np.asarray(number, float).tobytes())


@lru_cache(SETS_OF_ROOTS)
def _bar_roots(ends: str, number: bytes) -> np.ndarray:
    sign = -1.0 if ends == "cantilever" else 1.0
    root = (np.frombuffer(number) + 0.5 * sign) * math.pi
    for _ in range(6):  # cos x = sign/cosh x; the right side is a small correction
        small = sign / cosh(np.minimum(root, 700.0))
        sine, cosine = sin_and_cos(root)
        root = root - (cosine - small) / (-sine + small * tanh(root))
    root.flags.writeable = False
    return root


@lru_cache(SETS_OF_ROOTS)
def _shape_factors(ends: str, root: bytes) -> tuple[np.ndarray, np.ndarray]:
    """Return s and the factor of the growing exponential, of modes with βL = root."""
    betas = np.frombuffer(root)
    down, (sine, cosine) = exp(-betas), sin_and_cos(betas)
    if ends == "cantilever":
        bottom = 1 + square(down) + 2 * down * cosine
        return (1 - square(down) - 2 * down * sine) / bottom, (down + cosine + sine) / bottom
    bottom = 1 - square(down) - 2 * down * sine
    return (1 + square(down) - 2 * down * cosine) / bottom, (cosine - sine - down) / bottom


def bar_shape(ends: str, root: np.ndarray, x: Any) -> np.ndarray:
    """Shape of the modes with βL = root at fractions x, of mean square 1 [..., modes]: with z = βL·x
    cosh z - s·sinh z ± (cos z - s·sin z), written with falling exponentials only, or the high ones would cancel."""
    z = root * np.asarray(x)[..., None]
    s, rest = _shape_factors(ends, root.tobytes())
    growing = exp(z - root) * rest + 0.5 * (1 + s) * exp(-z)
    sine, cosine = sin_and_cos(z)
    wave = cosine - s * sine
    return np.asarray(growing + wave if ends == "free" else growing - wave)
