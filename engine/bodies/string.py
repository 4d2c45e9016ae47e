"""Stiff strings.

A string with two polarisations has the modes of both directions in turn: the first of one, the first of the other, the
second of one, and so on. Whatever touches it moves the first; where an end rides on a body that moves by y, it moves
by y·cos θ in the first direction and by y·sin θ in the second, θ the `polarisation_angle`.
"""

import math
from collections.abc import Iterator
from functools import lru_cache
from typing import Any, ClassVar, Literal

import numpy as np
from pydantic import Field
from pydantic_core import InitErrorDetails

from engine.arithmetic import plain_numbers
from engine.arithmetic.elementary import sin, sinc, square
from engine.bodies.body import MAX_MODES, ModalBody
from engine.bodies.distributed import LineBody, ModeSet, mode_numbers
from engine.bodies.initial_shape import InitialShape
from engine.bodies.materials import Material, MaterialName, absent_numbers
from engine.bodies.stretching import Stretching, axial_stiffness
from engine.bodies.table import KeyPath, are_positive, is_given, make_fault
from engine.bodies.tips import Compliance, Tip, sum_modes
from engine.wording import format_value

MAX_TENSION = 1e9  # N
LIGHTEST_MATERIAL = 1.0  # kg/m³, lighter than any string: a smaller density is one in kg/m
NUMBERS = np.arange(1.0, MAX_MODES + 1)


class String(LineBody):
    """A stiff string, simply supported at both ends."""

    kind: Literal["string"]
    tension: float | None = Field(default=None, gt=0.0, le=MAX_TENSION, description="tension, N")
    bending_stiffness: float | None = Field(default=None, ge=0.0, le=1e9, description="bending stiffness EI, N·m²")
    inharmonicity: float | None = Field(
        default=None, ge=0.0, le=10.0, description="B of f_n = n·f0·√(1 + B·n²); instead of the bending stiffness"
    )

    axial_stiffness: float | None = Field(
        default=None, ge=0.0, le=1e15, description="axial stiffness EA, N: the tension rises as the string stretches"
    )
    young: float | None = Field(
        default=None,
        ge=0.0,
        le=1e15,
        description="Young's modulus of the core, Pa; with a diameter it gives EI, unless that or inharmonicity is"
        " given, and EA",
    )
    diameter: float | None = Field(default=None, gt=0.0, le=1.0, description="diameter of a plain string, m")
    core_diameter: float | None = Field(
        default=None, gt=0.0, le=1.0, description="diameter of the core of a wound string, m"
    )
    density: float | None = Field(
        default=None, gt=0.0, le=1e5, description="density, kg/m³; with the diameter, instead of the linear density"
    )
    material: MaterialName | None = Field(
        default=None,
        description="material of a string of given diameter: gives what is not given of young, and of density (unless"
        " linear_density or mass is); it stretches, unless axial_stiffness = 0",
    )

    polarisations: int = Field(
        default=1, ge=1, le=2, description="number of directions in which it moves; contacts act in the first"
    )
    polarisation_detuning: float = Field(
        default=0.0, ge=-100.0, le=100.0, description="pitch of the second polarisation above the first, cents"
    )
    polarisation_angle: float = Field(
        default=0.0,
        ge=-100.0,
        le=100.0,
        description="angle between the first polarisation and the motion of a body that carries an end, rad",
    )

    EXACTLY_ONE_OF: ClassVar[list[tuple[str, ...]]] = [
        ("linear_density", "mass", "density", "linear_density in kg/m, mass in kg, or density in kg/m³"),
        ("tension", "frequency", "tension in N or frequency in Hz"),
    ]
    AT_MOST_ONE_OF: ClassVar[list[tuple[str, str]]] = [("bending_stiffness", "inharmonicity")]
    STRETCHED_BY: ClassVar[tuple[str, ...]] = "axial_stiffness", "young"
    PITCH_POWERS: ClassVar[dict[str, int]] = {"frequency": 1, "tension": 2, "bending_stiffness": 2}

    def mass_per_length(self) -> float:
        """Mass per length, kg/m; of a material ρ·πd²/4."""
        if self.density is not None:
            return self.density * math.pi * square(self.diameter or 0.0) / 4
        return super().mass_per_length()

    def bending(self) -> float:
        """Bending stiffness EI, N·m²: as given, or that of a round core, E·πd⁴/64 (Fletcher & Rossing, Physics of
        Musical Instruments, sec. 2.18)."""
        if self.bending_stiffness is not None or self.young is None:
            return self.bending_stiffness or 0.0
        return self.young * math.pi * plain_numbers.whole_power(self._core(), 4) / 64

    def _core(self) -> float:
        """Diameter of what bends and stretches, m."""
        return self.core_diameter or self.diameter or 0.0

    def tension_and_bending(self) -> tuple[float, float]:
        """Tension T (N) and bending stiffness EI (N·m²), from whichever is given: B = π²·EI/(T·L²), and
        the first partial at √(T·β² + EI·β⁴)/√μ, β = π/L."""
        beta = math.pi / self.length
        if self.tension is not None:
            if self.inharmonicity is not None:
                return self.tension, self.inharmonicity * self.tension / square(beta)
            return self.tension, self.bending()
        stiffness = self.mass_per_length() * square(2 * math.pi * (self.frequency or 0.0)) / square(beta)  # T + EI·β²
        if self.inharmonicity is not None:
            tension = stiffness / (1 + self.inharmonicity)
            return tension, self.inharmonicity * tension / square(beta)
        bending = self.bending()
        return stiffness - bending * square(beta), bending

    @classmethod
    def numbers_of_material(cls, table: dict[str, Any], material: Material) -> dict[str, Any]:
        numbers = absent_numbers(table, young=material.young)
        if not is_given(table, "linear_density") and not is_given(table, "mass"):
            numbers |= absent_numbers(table, density=material.density)
        return numbers

    @classmethod
    def faults(cls, path: KeyPath, table: dict[str, Any]) -> Iterator[InitErrorDetails]:
        """A frequency needs no more tension than could be given."""
        yield from super().faults(path, table)
        yield from cls._material_faults(path, table)
        for key in ("polarisation_detuning", "polarisation_angle"):
            if table.get(key) and table.get("polarisations", 1) == 1:
                yield make_fault((*path, key), table[key], "it has one polarisation", "give polarisations = 2")
        length, frequency = table.get("length"), table.get("frequency")
        density, mass = table.get("linear_density"), table.get("mass")
        solid = [table.get("density"), table.get("diameter")]
        if are_positive(solid):
            density = solid[0] * math.pi * square(solid[1]) / 4
        given = [length, frequency, mass if density is None else density]
        if not are_positive(given):
            return
        length, frequency, mass = given
        speed = 2.0 * length * frequency  # of waves, m/s
        tension = speed * speed * (mass / length if density is None else mass)
        if tension > MAX_TENSION:
            message = f"a string of {length:g} m needs a tension of {tension:.3g} N for {frequency:g} Hz"
            yield make_fault((*path, "frequency"), frequency, message, f"at most {MAX_TENSION:g} N are possible")

    @classmethod
    def _material_faults(cls, path: KeyPath, table: dict[str, Any]) -> Iterator[InitErrorDetails]:
        """A modulus and a density go with a diameter. A density without one, or too small for any material, can be that
        of an old patch, in kg/m: both readings are named."""
        young, density = is_given(table, "young"), is_given(table, "density")
        if density:
            value, has_diameter = format_value(table["density"]), is_given(table, "diameter")
            linear = f"if {value} kg/m is meant, its name is linear_density"
            if not has_diameter:
                message, remedy = f"{value} kg/m³, and no diameter is given", f"give the diameter in m; {linear}"
                yield make_fault((*path, "density"), table["density"], message, remedy)
            elif are_positive([table["density"]]) and table["density"] < LIGHTEST_MATERIAL:
                message, remedy = f"{value} kg/m³ is lighter than any string", f"give that of its material; {linear}"
                yield make_fault((*path, "density"), table["density"], message, remedy)
        if young and not is_given(table, "core_diameter") and not is_given(table, "diameter"):
            remedy = "young in Pa goes with diameter in m, or core_diameter of a wound string"
            yield make_fault(path, table, "no diameter is given", remedy)
        if is_given(table, "core_diameter") and not young:
            yield make_fault(path, table, "no young is given", "young in Pa and core_diameter in m go together")
        if is_given(table, "diameter") and not young and not density:
            remedy = "give density in kg/m³, or young in Pa"
            yield make_fault((*path, "diameter"), table["diameter"], "a diameter of no material", remedy)

    def find_stretching(self, omega: np.ndarray) -> Stretching | None:
        """K = EA/(2L), κ = β²/μ (Kirchhoff 1883, Carrier 1945); both polarisations have one tension."""
        stiffness = self.axial_stiffness or 0.0
        if self.young is not None and self.axial_stiffness is None:
            stiffness = axial_stiffness(self.young, self._core())
        if stiffness == 0.0:
            return None
        return Stretching(stiffness / (2 * self.length), self._kappa(omega))

    def slope_squares(self, omega: np.ndarray) -> np.ndarray:
        return self._kappa(omega) / self.length

    def _kappa(self, omega: np.ndarray) -> np.ndarray:
        """κ of Stretching [modes]."""
        beta = self._mode_numbers(omega) * (math.pi / self.length)
        return np.asarray(square(beta) / self.mass_per_length())

    def tension_at_rest(self) -> float:
        return self.tension_and_bending()[0]

    def end_row(self, omega: np.ndarray, end: float) -> np.ndarray:
        """∂V/∂y per modal displacement when an end (0 or 1) moves by y, for modes of these frequencies (rad/s), the
        lowest first [modes], N/(√kg·m): ωₙ·cₙ = ±ω²·μ·φₙ'/β², φₙ' the slope of the mode shape at the end.

        It follows from the linear shape y·x/L that takes the end along: of mode n it has -μ·φₙ'(L)/β²·y. y is the
        motion of the body that carries the end, of which each polarisation has its part.
        """
        number = self._mode_numbers(omega)
        beta, density = number * math.pi / self.length, self.mass_per_length()
        slope = self._scale() * beta * (np.where(number % 2 == 0, 1.0, -1.0) if end else 1.0)
        row: np.ndarray = (1.0 if end else -1.0) * square(omega) * density * slope / square(beta)
        if self.polarisations == 2:
            angle = self.polarisation_angle
            row *= np.tile([plain_numbers.cos(angle), plain_numbers.sin(angle)], omega.size // 2)
        return row

    def end_tension(self) -> float:
        """Tension that resists the motion of an end, N: that of each polarisation by its part of the motion."""
        tension = self.tension_and_bending()[0]
        if self.polarisations == 1:
            return tension
        across = square(self._second_ratio()) * tension
        return tension + (across - tension) * square(plain_numbers.sin(self.polarisation_angle))

    def compliance_beyond(self, omega: float, highest: float = math.inf) -> Compliance | None:
        all_omega, scale = self._frequencies(NUMBERS) * max(1.0, self._second_ratio()), self._scale()
        first, last = np.searchsorted(all_omega, [omega * (1 + 1e-12), highest * (1 + 1e-12)], "right").tolist()

        def shape(at: Any) -> np.ndarray:
            middle, half = self._middle(at)
            shapes = scale * sines_at(middle)[..., first:last]
            return np.asarray(shapes * sinc(NUMBERS[first:last] * half) if half else shapes)

        return sum_modes(all_omega[first:last], shape)

    def mean_shape(self, modes: ModeSet, tip: Tip) -> np.ndarray:
        """The mean of sin βx from a to b is sin(β(a + b)/2)·sin(βw)/(βw), w = (b - a)/2."""
        middle, half = self._middle(tip)
        number = np.arange(modes.omega.size) // self.polarisations + 1
        return np.asarray(modes.shape(middle) * sinc(number * half))

    def _middle(self, at: Any) -> tuple[Any, float]:
        """Return the middle of what a place covers, and half of its width, fractions of the length."""
        if not isinstance(at, Tip):
            return at, 0.0
        begin, end = self.covered(at)
        return (begin + end) / 2, (end - begin) / 2

    def free_modes(self, max_omega: float) -> ModeSet:
        """ω² = (T·β² + EI·β⁴)/μ, β = iπ/L; shapes sin βx, with modal mass μL/2 (Fletcher & Rossing, Physics of
        Musical Instruments, sec. 2.18)."""
        ratio, scale = self._second_ratio(), self._scale()
        number = mode_numbers(self._frequencies, self.modes, max_omega / max(1.0, ratio))
        omega, beta = self._frequencies(number), number * (math.pi / self.length)
        decay = self.decay_rates(omega, beta)

        def shape(x: Any) -> np.ndarray:
            return np.asarray(scale * sin(math.pi * number * np.asarray(x)[..., None]))

        if self.polarisations == 1:
            return ModeSet(omega, decay, shape)
        second = ratio * omega
        return ModeSet(
            _in_turn(omega, second),
            _in_turn(decay, self.decay_rates(second, beta)),
            lambda x: _in_turn(first := shape(x), np.zeros_like(first)),
        )

    def _modal(self, begin: InitialShape | None, body: ModalBody) -> np.ndarray:
        if self.polarisations == 1 or begin is None:
            return super()._modal(begin, body)
        first = body._replace(omega=body.omega[::2], shape=lambda x: body.shape(x)[..., ::2])
        modal = super()._modal(begin, first)
        return _in_turn(modal, np.zeros_like(modal))

    def _mode_numbers(self, omega: np.ndarray) -> np.ndarray:
        """Numbers 1, 2, … of modes of these frequencies, in each polarisation [modes]."""
        return np.repeat(np.arange(1.0, omega.size // self.polarisations + 1), self.polarisations)

    def _second_ratio(self) -> float:
        """Frequencies of the second polarisation over those of the first."""
        return float(plain_numbers.power(2.0, self.polarisation_detuning / 1200.0))

    def _frequencies(self, number: np.ndarray) -> np.ndarray:
        """Angular frequencies of modes [modes], rad/s."""
        tension, bending = self.tension_and_bending()
        wave_number = number * (math.pi / self.length)
        return np.asarray(np.sqrt((tension + bending * square(wave_number)) / self.mass_per_length()) * wave_number)

    def _scale(self) -> float:
        """Largest value of a mode shape, 1/√kg."""
        return math.sqrt(2 / (self.mass_per_length() * self.length))


def _in_turn(first: np.ndarray, second: np.ndarray) -> np.ndarray:
    """Values of the modes of two polarisations in turn [..., 2·modes]."""
    return np.stack([first, second], axis=-1).reshape(*first.shape[:-1], -1)


def sines_at(x: Any) -> np.ndarray:
    """sin nπx of n = 1, 2, … [..., MAX_MODES] at positions; at a single one they are kept."""
    return sines_at_one(x) if isinstance(x, float) else np.asarray(sin(math.pi * NUMBERS * np.asarray(x)[..., None]))


@lru_cache(128)  # 20 MB: a piano has a place for each of its keys, where its strings at all pitches have the same
def sines_at_one(x: float) -> np.ndarray:
    """`sines_at` of a single position."""
    return np.asarray(sin(math.pi * NUMBERS * x))
