"""Bodies with many modes, such as strings, bars, membranes and plates: their losses, and the keys of their supports."""

import math
from abc import abstractmethod
from collections.abc import Callable, Iterator
from itertools import pairwise
from typing import Any, ClassVar, NamedTuple

import numpy as np
from pydantic import Field, PrivateAttr
from pydantic_core import InitErrorDetails

from engine.arithmetic.elementary import square
from engine.arithmetic.plain_numbers import whole_power
from engine.arithmetic.products import product
from engine.arithmetic.quadrature import gauss_legendre
from engine.bodies.body import MAX_MODES, MIN_OMEGA, BodyTable, ModalBody, TooManyModes, UnfitBody
from engine.bodies.decay import DECAY_LAWS, Decay, t60_faults, t60_rates
from engine.bodies.initial_shape import (
    INITIAL_SHAPES,
    Initial,
    InitialShape,
    Profile,
    Quadrature,
    line_quadrature,
    peak_of_line,
)
from engine.bodies.table import KeyPath, NotNegative, Positions, Positive, Table, is_given, make_fault
from engine.bodies.tips import Compliance, Tip, sum_modes
from engine.wording import format_value

AUDIBLE = 20_000.0  # Hz
FEW_MODES = 512  # of a body, if that is all it has: so many are tried first, which takes less time
MAX_SUPPORTS = 256  # of a body


class ModeSet(NamedTuple):
    """Modes of a body at rest."""

    omega: np.ndarray  # [modes], rad/s
    sigma: np.ndarray  # [modes], 1/s
    shape: Callable[[Any], np.ndarray]  # positions → [..., modes], 1/√kg


class Support(Table):
    """A spring and damper that hold a body to the ground, such as a thread, a felt or a soft rest."""

    at: Positions = Field(description="position, or a list of positions that share the stiffness and damping")
    stiffness: float = Field(default=0.0, ge=0.0, le=1e15, description="stiffness, N/m")
    damping_coefficient: float = Field(default=0.0, ge=0.0, le=1e9, description="damping coefficient, kg/s")


class DistributedBody(BodyTable):
    """A body with many modes. It is at rest at time 0 unless it has a `displacement` or `velocity`; it has no weight.

    Its decay rate is σ = sigma0 + sigma_beta·β + sigma_beta3·β³ + b3·ω² for a mode of wave number β and angular
    frequency ω; or `t60` or a law of `decay` gives it.
    """

    modes: int | None = Field(
        default=None,
        ge=1,
        le=MAX_MODES,
        description="number of modes, the lowest; if absent, all below 0.49 of the sample rate",
    )
    residual: bool | None = Field(
        default=None,
        description="true adds a few modes, which replace the compliance at contacts of the modes that are left out;"
        " if absent, they are added where it is 3 % or more. Not of soundboards, shells, bars of given ratios and air",
    )
    support: list[Support] = Field(
        default=[], max_length=MAX_SUPPORTS, description="springs and dampers that hold it to the ground"
    )
    sigma0: float = Field(default=0.0, ge=0.0, le=1e6, description="decay rate of all modes, 1/s")
    sigma_beta: float = Field(default=0.0, ge=0.0, le=1e6, description="decay rate per wave number, m/s")
    sigma_beta3: float = Field(default=0.0, ge=0.0, le=1e6, description="decay rate per wave number³, m³/s")
    b3: float = Field(default=0.0, ge=0.0, le=1.0, description="decay rate per angular frequency², s")
    t60: list[Positive] | None = Field(
        default=None,
        min_length=1,
        max_length=2,
        description="decay time to -60 dB at the frequencies of t60_at, s; instead of decay rates",
    )
    t60_at: list[NotNegative] | None = Field(
        default=None,
        min_length=2,
        max_length=2,
        description="two frequencies, Hz, the first 0 or more; between them σ is linear in frequency²",
    )
    decay: Decay | None = Field(default=None, description="decay law by its name; instead of decay rates and t60")

    displacement: Initial | None = Field(default=None, description="displacement at time 0")
    velocity: Initial | None = Field(default=None, description="velocity at time 0")

    GIVES_WAY_IN_BANDS: ClassVar[bool] = False  # its residual modes (engine.assembly.residual_modes)
    _residual_rate: float | None = PrivateAttr(default=None)

    BEGINS_AT_REST: ClassVar[bool] = False  # without `displacement` and `velocity`

    @abstractmethod
    def free_modes(self, max_omega: float) -> ModeSet:
        """Modes below an angular frequency (rad/s), without supports, the lowest first."""

    @abstractmethod
    def quadrature(self, modes: int, kinks: list[float]) -> Quadrature:
        """Positions that resolve so many modes, and profiles with such kinks (engine.bodies.initial_shape)."""

    @abstractmethod
    def peak(self, at: Any) -> Profile:
        """The profile that is 1 at a place, and falls to 0 at the ends or the rim."""

    def mean_shape(self, modes: ModeSet, tip: Tip) -> np.ndarray:
        """Mode shapes in the mean over what a tip covers [modes], 1/√kg."""
        return np.asarray(modes.shape(tip.at))

    def with_tips(self, modes: ModeSet) -> ModeSet:
        """The modes, with shapes at positions and under tips."""
        return modes._replace(
            shape=lambda at: self.mean_shape(modes, at) if isinstance(at, Tip) else np.asarray(modes.shape(at))
        )

    def compliance_beyond(self, omega: float, highest: float = math.inf) -> Compliance | None:
        """Static compliance between places of the modes above an angular frequency, and up to another one (rad/s); None
        if not known."""
        return None

    def sum_beyond(self, modes: ModeSet, omega: float, highest: float) -> Compliance:
        """The static compliance of those modes that are above an angular frequency, and up to another one, rad/s."""
        above = (modes.omega > omega * (1 + 1e-12)) & (modes.omega <= highest * (1 + 1e-12))
        modes = self.with_tips(modes)
        return sum_modes(modes.omega[above], lambda at: modes.shape(at)[..., above])

    def with_residual_of(self, samplerate: float) -> "DistributedBody":
        """Return the body with the residual modes that it has at a sample rate (Hz), whatever that of the scene is."""
        body = self.model_copy()
        body._residual_rate = samplerate
        return body

    def residual_rate(self, samplerate: float, steps: float) -> float:
        """Return the rate that its residual modes are for, Hz: that of the steps if the patch asks for them. steps: of
        each sample"""
        if self._residual_rate is not None:
            return self._residual_rate
        return samplerate * steps if self.residual else samplerate

    def modal_body(self, max_frequency: float = math.inf) -> ModalBody:
        with np.errstate(all="ignore"):  # what is not finite is refused in the end (engine.assembly.limits)
            body = at_rest(self.with_tips(self.free_modes(2 * math.pi * max_frequency)))
            return body._replace(q=self._modal(self.displacement, body), p=self._modal(self.velocity, body))

    def initial_displacement(self, at: Any) -> float:
        if self.displacement is None:
            return 0.0
        try:
            body = self.modal_body(AUDIBLE)
        except UnfitBody:  # a mode above those
            return 0.0
        return float(product(body.shape(at), body.q))

    def _modal(self, begin: InitialShape | None, body: ModalBody) -> np.ndarray:
        """Return the initial modal coordinates of a displacement or a velocity [modes]; zeros without any."""
        if begin is None:
            return np.zeros(body.omega.size)

        def peak(at: Any) -> Profile:
            return self.peak(self.split_positions(at)[0])

        return begin.modal(body.shape, self.quadrature(body.omega.size, begin.kinks()), peak)

    def decay_rates(self, omega: np.ndarray, wave_number: np.ndarray) -> np.ndarray:
        """σ (1/s) of modes of angular frequency ω (rad/s) and wave number β (1/m), the lowest first.

        By the law of `decay` (engine.bodies.decay), or by `t60`, or sigma0 + sigma_beta·β + sigma_beta3·β³ + b3·ω².
        """
        if self.decay is not None:
            return self.decay.rates(omega, wave_number)
        if self.t60 is not None:
            return t60_rates(self.t60, self.t60_at, omega)
        per_wave = self.sigma_beta * wave_number + self.sigma_beta3 * whole_power(wave_number, 3)
        return np.asarray((self.sigma0 or 0.0) + per_wave + self.b3 * square(omega))

    @classmethod
    def faults(cls, path: KeyPath, table: dict[str, Any]) -> Iterator[InitErrorDetails]:
        """Losses are given in one way, and make no mode grow."""
        rates = [k for k in ("sigma0", "sigma_beta", "sigma_beta3", "b3") if table.get(k)]
        ways = [k for k in ("decay", "t60") if is_given(table, k)] + rates[:1]
        if len(ways) > 1:
            remedy = "give the losses in one way: decay, t60, or decay rates"
            yield make_fault((*path, ways[0]), table[ways[0]], f"{ways[0]} and {ways[1]} are both given", remedy)
        yield from t60_faults(path, table, "t60", "t60_at")
        law = table.get("decay")
        if isinstance(law, dict) and str(law.get("kind")) in DECAY_LAWS:
            yield from DECAY_LAWS[str(law["kind"])].faults((*path, "decay"), law)
        for key in ("displacement", "velocity"):
            begin = table.get(key)
            if begin is not None and cls.BEGINS_AT_REST:
                message = f"a body of kind {format_value(table['kind'])} begins at rest"
                yield make_fault((*path, key), begin, message, "leave it out, or a force")
                continue
            if isinstance(begin, dict) and str(begin.get("kind")) in INITIAL_SHAPES:
                kind = INITIAL_SHAPES[str(begin["kind"])]
                yield from kind.faults((*path, key), begin, is_sheet=not cls.HAS_LENGTH)


class LineBody(DistributedBody):
    """A string or a bar."""

    length: float = Field(gt=0.0, le=1e4, description="length, m")
    linear_density: float | None = Field(default=None, gt=0.0, le=1e9, description="mass per length, kg/m")
    mass: float | None = Field(default=None, gt=0.0, le=1e9, description="mass, kg; instead of the linear density")
    frequency: float | None = Field(default=None, gt=0.0, le=1e6, description="frequency of the first partial, Hz")

    HAS_LENGTH: ClassVar[bool] = True

    def mass_per_length(self) -> float:
        """Mass per length, kg/m."""
        return self.linear_density if self.linear_density is not None else (self.mass or 0.0) / self.length

    def total_mass(self) -> float:
        return self.mass_per_length() * self.length

    def quadrature(self, modes: int, kinks: list[float]) -> Quadrature:
        return line_quadrature(modes + 2, kinks, self.total_mass())

    def peak(self, at: Any) -> Profile:
        return peak_of_line(at)

    def mean_shape(self, modes: ModeSet, tip: Tip) -> np.ndarray:
        begin, end = self.covered(tip)
        node, weight = gauss_legendre(8 + math.ceil(2 * modes.omega.size * (end - begin)))
        return np.asarray(product(weight / 2, modes.shape(begin + (end - begin) * (node + 1) / 2)))

    def covered(self, tip: Tip) -> tuple[float, float]:
        """Begin and end of what a tip covers, fractions of the length; beyond an end there is nothing."""
        reach = tip.radius / self.length
        return max(0.0, tip.at - reach), min(1.0, tip.at + reach)


def at_rest(modes: ModeSet) -> ModalBody:
    """A body of the given modes that does not move at time 0."""
    zeros = np.zeros(modes.omega.size)
    omega = np.where(modes.omega > MIN_OMEGA, modes.omega, 0.0)
    return ModalBody(omega, modes.sigma, modes.shape, zeros, zeros, zeros)


def mode_numbers(frequencies: Callable[[np.ndarray], np.ndarray], limit: int | None, max_omega: float) -> np.ndarray:
    """Numbers 1, 2, … of the modes whose angular frequency is below `max_omega` (rad/s), at most `limit` of them.

    frequencies: from mode numbers to angular frequencies, rad/s, which rise
    Raises TooManyModes if there is no limit, and too many modes.
    """
    count = limit or MAX_MODES + 1
    number = np.arange(1.0, count + 1)
    if count > FEW_MODES and frequencies(number[FEW_MODES - 1 : FEW_MODES])[0] >= max_omega:
        number = number[:FEW_MODES]
    number = number[frequencies(number) < max_omega]
    if limit is None and number.size > MAX_MODES:
        raise TooManyModes(f"has more than {MAX_MODES} modes below {max_omega / 2 / math.pi:.0f} Hz")
    return number


def rise_from_one(value: list[float]) -> bool:
    """True if a list of numbers begins with 1 and increases."""
    return value[0] == 1 and all(a < b for a, b in pairwise(value))
