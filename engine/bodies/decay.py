"""Laws of loss: the decay rate σ (1/s) of each mode of a body. A new one is a class and a place in `Decay`."""

import math
from abc import abstractmethod
from collections.abc import Iterator
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import Field
from pydantic_core import InitErrorDetails

from engine.arithmetic.elementary import square
from engine.arithmetic.plain_numbers import whole_power
from engine.bodies.body import TO_60_DB
from engine.bodies.table import KeyPath, NotNegative, Positive, Table, are_positive, is_given, is_number, make_fault

Rate = Annotated[float, Field(ge=0.0, le=1e6)]


class DecayLaw(Table):
    """A law of loss."""

    @abstractmethod
    def rates(self, omega: np.ndarray, wave_number: np.ndarray) -> np.ndarray:
        """σ (1/s) of modes of angular frequency ω (rad/s) and wave number β (1/m), the lowest first [modes]."""

    @classmethod
    def faults(cls, path: KeyPath, table: dict[str, Any]) -> Iterator[InitErrorDetails]:
        """Faults that no key shows alone. The table is as it was read; path: of the table"""
        yield from ()


class BilbaoDecay(DecayLaw):
    """σ = σ0 + σ1·β² (Bilbao, Numerical Sound Synthesis, 2009, sec. 7.3, whose σ are those here)."""

    kind: Literal["bilbao"]
    sigma0: Rate = Field(default=0.0, description="decay rate of all modes, 1/s")
    sigma1: Rate = Field(default=0.0, description="decay rate per wave number², m²/s")

    def rates(self, omega: np.ndarray, wave_number: np.ndarray) -> np.ndarray:
        return np.asarray(self.sigma0 + self.sigma1 * square(wave_number))


class VanWalstijnDecay(DecayLaw):
    """σ = σ0 + σ1·β + σ3·β³ (van Walstijn, Bridges & Mehes, DAFx-16)."""

    kind: Literal["van_walstijn"]
    sigma0: Rate = Field(default=0.0, description="decay rate of all modes, 1/s")
    sigma1: Rate = Field(default=0.0, description="decay rate per wave number, m/s")
    sigma3: Rate = Field(default=0.0, description="decay rate per wave number³, m³/s")

    def rates(self, omega: np.ndarray, wave_number: np.ndarray) -> np.ndarray:
        return np.asarray(self.sigma0 + self.sigma1 * wave_number + self.sigma3 * whole_power(wave_number, 3))


class ChaigneAskenfeltDecay(DecayLaw):
    """σ = b1 + b3·ω² (Chaigne & Askenfelt, JASA 95, 1994, eq. 2: their b1 and b3 in a string's equation)."""

    kind: Literal["chaigne_askenfelt"]
    b1: Rate = Field(default=0.0, description="decay rate of all modes, 1/s")
    b3: float = Field(default=0.0, ge=0.0, le=1.0, description="decay rate per angular frequency², s")

    def rates(self, omega: np.ndarray, wave_number: np.ndarray) -> np.ndarray:
        return np.asarray(self.b1 + self.b3 * square(omega))


class LinearDecay(DecayLaw):
    """σ = a + b·f, which fits recorded notes of a piano."""

    kind: Literal["linear"]
    a: Rate = Field(default=0.0, description="decay rate of all modes, 1/s")
    b: Rate = Field(default=0.0, description="decay rate per frequency: 1/s for each Hz")

    def rates(self, omega: np.ndarray, wave_number: np.ndarray) -> np.ndarray:
        return np.asarray(self.a + self.b * omega / (2 * math.pi))


class LossFactorDecay(DecayLaw):
    """σ = η·ω/2, the damping of a material with loss factor η, such as wood (Cremer & Heckl, Structure-Borne
    Sound, ch. 3)."""

    kind: Literal["loss_factor"]
    eta: float = Field(ge=0.0, le=1.0, description="loss factor: the share of the energy lost in a radian")

    def rates(self, omega: np.ndarray, wave_number: np.ndarray) -> np.ndarray:
        return np.asarray(self.eta * omega / 2)


class T60Decay(DecayLaw):
    """Decay times to -60 dB: one for all modes, or two at two frequencies; between and beyond them σ goes as
    frequency² (Bilbao, Numerical Sound Synthesis, 2009, sec. 7.3)."""

    kind: Literal["t60"]
    t60: list[Positive] = Field(min_length=1, max_length=2, description="one or two decay times to -60 dB, s")
    frequency: list[NotNegative] | None = Field(
        default=None, min_length=2, max_length=2, description="frequencies of the two times, Hz; the first may be 0"
    )

    def rates(self, omega: np.ndarray, wave_number: np.ndarray) -> np.ndarray:
        return t60_rates(self.t60, self.frequency, omega)

    @classmethod
    def faults(cls, path: KeyPath, table: dict[str, Any]) -> Iterator[InitErrorDetails]:
        yield from t60_faults(path, table, "t60", "frequency")


class ListDecay(DecayLaw):
    """One decay rate, or one decay time to -60 dB, for each mode; the last holds for all higher ones."""

    kind: Literal["list"]
    sigma: list[NotNegative] | None = Field(
        default=None, min_length=1, max_length=20_000, description="decay rates of the modes, the lowest first, 1/s"
    )
    t60: list[Positive] | None = Field(
        default=None, min_length=1, max_length=20_000, description="decay times to -60 dB, s; instead of sigma"
    )

    def rates(self, omega: np.ndarray, wave_number: np.ndarray) -> np.ndarray:
        rates = np.array(self.sigma) if self.sigma is not None else TO_60_DB / np.array(self.t60)
        return np.asarray(rates[np.minimum(np.arange(omega.size), rates.size - 1)])

    @classmethod
    def faults(cls, path: KeyPath, table: dict[str, Any]) -> Iterator[InitErrorDetails]:
        if is_given(table, "sigma") == is_given(table, "t60"):
            message = "both sigma and t60 are given" if is_given(table, "t60") else "neither sigma nor t60 is given"
            yield make_fault(path, table, message, "give one of them: a list of one number per mode")


_LAWS = (BilbaoDecay, VanWalstijnDecay, ChaigneAskenfeltDecay, LinearDecay, LossFactorDecay, T60Decay, ListDecay)
DECAY_LAWS: dict[str, type[DecayLaw]] = {law.__annotations__["kind"].__args__[0]: law for law in _LAWS}
Decay = Annotated[
    BilbaoDecay | VanWalstijnDecay | ChaigneAskenfeltDecay | LinearDecay | LossFactorDecay | T60Decay | ListDecay,
    Field(discriminator="kind"),
]


def t60_rates(times: list[float], at: list[float] | None, omega: np.ndarray) -> np.ndarray:
    """σ (1/s) from one time (s) for all modes, or from two at two frequencies (Hz), with σ going as ω²."""
    rates = [TO_60_DB / t for t in times]
    if len(rates) == 1 or at is None:
        return np.full_like(omega, rates[0])
    a, b = (square(2 * math.pi * f) for f in at)
    slope = (rates[1] - rates[0]) / (b - a)
    return np.asarray(rates[0] + slope * (square(omega) - a))


def t60_faults(path: KeyPath, table: dict[str, Any], key: str, at_key: str) -> Iterator[InitErrorDetails]:
    """Two times come with two frequencies, and must not make any mode grow. key, at_key: of both in the table."""
    times, at = table.get(key), table.get(at_key)
    if not are_positive(times):
        return
    if at is not None and not (isinstance(at, list) and all(is_number(f) and 0.0 <= f < math.inf for f in at)):
        return
    if len(times) == 2 and at is None:
        yield make_fault((*path, key), times, "two times are given without frequencies", f"give {at_key} = [Hz, Hz]")
    elif at is not None and len(at) == 2 and len(times) == 2:
        (a, b), (long, short) = at, times
        if a >= b or short > long:
            message = f"{long:g} s at {a:g} Hz and {short:g} s at {b:g} Hz"
            remedy = "the higher frequency second, and its time not the longer: else some mode would never decay"
            yield make_fault((*path, key), times, message, remedy)
        elif short < long * square(a / b):
            remedy = f"the second time at least {long * square(a / b):.3g} s"
            yield make_fault((*path, key), times, "modes below the first frequency would grow", remedy)
    elif at is not None:
        yield make_fault((*path, at_key), at, "frequencies are given without two times", f"give {key} = [s, s]")
