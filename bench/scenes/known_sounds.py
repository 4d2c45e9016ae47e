"""Synthetic sounds whose features are known: sums of decaying sines, with closed forms of their energies, and noise."""

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

RATES = 44_100, 22_050, 48_000, 96_000  # Hz
TO_60_DB = 3 * math.log(10)
BAR = np.array([1.0, 2.7565, 5.4039, 8.9330, 13.3443])  # frequencies of a free bar, over the first
MEMBRANE = np.array([1.0, 1.5933, 2.1355, 2.2954, 2.6531, 2.9173, 3.1555])  # of a circular membrane
Bounds = tuple[float, float]


@dataclass(frozen=True)
class Partial:
    """A mode that is struck: its oscillation begins anew at each strike, and adds to what is left.

    strikes: time (s), amplitude and phase (rad, of a sine) of each
    """

    frequency: float  # Hz
    t60: float  # s
    strikes: tuple[tuple[float, float, float], ...]

    @property
    def sigma(self) -> float:
        """Decay rate, 1/s."""
        return TO_60_DB / self.t60

    def sound(self, time: np.ndarray) -> np.ndarray:
        """The oscillation at times [frames], s."""
        heard = np.zeros_like(time)
        for begin, amplitude, phase in self.strikes:
            t = time[time >= begin] - begin
            decay = amplitude * np.exp(-self.sigma * t)
            heard[len(time) - len(t) :] += decay * np.sin(2 * math.pi * self.frequency * t + phase)
        return heard

    def energy_to_come(self, time: np.ndarray, seconds: float) -> np.ndarray:
        """∫ ½|a|² from each time up to the end, where a is the complex amplitude; in closed form."""
        begins = [begin for begin, _, _ in self.strikes]
        total, amplitude = np.zeros_like(time), 0.0 + 0.0j
        for n, (begin, size, phase) in enumerate(self.strikes):
            if n:
                elapsed = begin - begins[n - 1]
                amplitude *= np.exp((2j * math.pi * self.frequency - self.sigma) * elapsed)
            amplitude += size * np.exp(1j * phase)
            end = min(begins[n + 1], seconds) if n + 1 < len(begins) else seconds
            first = np.clip(time, begin, end) - begin
            left = np.exp(-2 * self.sigma * first) - np.exp(-2 * self.sigma * (end - begin))
            total += abs(amplitude) ** 2 * left / (4 * self.sigma)
        return total


@dataclass(frozen=True)
class KnownSound:
    """A sound and its features. Bounds hold one frequency, or those between which it must lie.

    fundamental, strongest: Hz; None if there must be none
    centroid:               Hz; None if it is not asked for
    t60:                    right answers, s; if there are none, None must be given
    has_t60:                whether None is wrong
    """

    kind: str
    name: str
    audio: np.ndarray  # [frames, channels]
    rate: int
    fundamental: Bounds | None
    strongest: Bounds | None
    centroid: float | None
    t60: tuple[float, ...]
    has_t60: bool = False


def mean_t60(energy: np.ndarray, step: float) -> float | None:
    """T60 by the definition of the feature, from an energy to come [times] in closed form."""
    level = 10 * np.log10(np.maximum(energy, 1e-300) / energy[0])
    chosen = (level <= -5) & (level >= -25)
    return (
        None
        if chosen.sum() < 3 or level[-1] > -25
        else float(-60 / np.polyfit(np.flatnonzero(chosen) * step, level[chosen], 1)[0])
    )


def sum_of(kind: str, name: str, partials: list[Partial], rate: int, seconds: float, **more: Any) -> KnownSound:
    """A sound of partials of which the lowest is within 20 dB of the strongest."""
    time = np.arange(round(seconds * rate)) / rate
    audio = sum(partial.sound(time) for partial in partials)
    frequencies = np.array([partial.frequency for partial in partials])
    energies = np.array([partial.energy_to_come(np.zeros(1), seconds)[0] for partial in partials])
    strongest = float(frequencies[np.argmax(energies)])
    centroid = float(frequencies @ energies / energies.sum())
    fine = np.linspace(0.0, 4 * max(partial.t60 for partial in partials), 4001)
    whole = [replace(partial, strikes=tuple((0.0, a, p) for _, a, p in partial.strikes[:1])) for partial in partials]
    t60 = mean_t60(sum(partial.energy_to_come(fine, 1e9) for partial in whole), fine[1])
    known = {
        "fundamental": (float(frequencies.min()),) * 2,
        "strongest": (strongest,) * 2,
        "centroid": centroid,
        "t60": (t60,),
    }
    return KnownSound(kind, name, np.asarray(audio)[:, None], rate, **known | more)


def struck(frequency: float, t60: float, amplitude: float = 1.0, phase: float = 0.0, at: float = 0.0) -> Partial:
    """A mode that is struck once."""
    return Partial(frequency, t60, ((at, amplitude, phase),))


# --- the kinds; random: np.random.Generator


def one_mode(random: Any, n: int) -> KnownSound:
    """A single decaying sine of any phase, from 40 Hz to 0.45 of the sample rate."""
    rate = RATES[n % 4]
    frequency = 40.0 * (0.45 * rate / 40.0) ** random.uniform()
    t60 = max(0.1 * 40 ** random.uniform(), 200 / frequency)
    partial = struck(frequency, t60, 1.0, random.uniform(0, 2 * math.pi))
    name = f"{frequency:.1f} Hz, T60 {t60:.2f} s, {rate} Hz"
    return sum_of("one mode", name, [partial], rate, 1.1 * t60, has_t60=True)


def sines(random: Any, n: int) -> KnownSound:
    """Harmonic partials, each with its own decay."""
    rate, f0, count = RATES[n % 4], random.uniform(55, 880), random.integers(3, 10)
    t60 = random.uniform(0.5, 4)
    partials = [
        struck(k * f0, t60 * k**-0.3, k**-0.8 * random.uniform(0.5, 1), n % 2 * random.uniform(0, 6.28))
        for k in range(1, count)
        if k * f0 < 0.45 * rate
    ]
    return sum_of("decaying sines", f"{f0:.1f} Hz and {count - 2} overtones", partials, rate, 1.2 * t60)


def inharmonic(random: Any, n: int) -> KnownSound:
    """Partials of stiff strings, of bars and of membranes."""
    f0, t60 = random.uniform(80, 400), random.uniform(0.8, 3)
    k = np.arange(1, 15)
    stiff = k * np.sqrt((1 + 4e-4 * k**2) / (1 + 4e-4))
    ratios = (stiff, BAR, MEMBRANE)[n % 3]
    partials = [
        struck(float(f0 * r), t60 * random.uniform(0.4, 1) / r**0.4, random.uniform(0.3, 1) / r**0.5) for r in ratios
    ]
    name = f"{f0:.1f} Hz, {('stiff string', 'bar', 'membrane')[n % 3]}"
    return sum_of("inharmonic partials", name, partials, 44_100, 1.2 * t60)


def bright_attack(random: Any, n: int) -> KnownSound:
    """A long partial, and a short and louder one far above."""
    if n < 4:
        partials = [struck(1000.0, 2.0), struck(5000.0, 0.05, (0.3, 1.0, 3.0, 10.0)[n])]
    else:
        low, t60 = random.uniform(100, 1200), random.uniform(0.5, 3)
        high = struck(low * random.uniform(4, 12), random.uniform(0.02, 0.1), 10 ** random.uniform(0, 0.8))
        partials = [struck(low, t60), high]
    seconds = 1.2 * partials[0].t60
    name = f"{partials[0].frequency:.0f} Hz; {partials[1].frequency:.0f} Hz, T60 {partials[1].t60:.2f} s"
    return sum_of("bright attack", name, partials, RATES[n % 2 * 2], seconds)


def beats(random: Any, n: int) -> KnownSound:
    """Two modes a few hertz apart: one line, whose frequency is between them; or two."""
    low, apart, t60 = random.uniform(100, 2000), 0.2 * 30 ** random.uniform(), random.uniform(1, 5)
    if n < 3:
        low, apart, t60 = (440.0, 440.0, 440.0)[n], (0.3, 1.0, 2.0)[n], (4.0, 2.0, 4.0)[n]
    partials = [struck(low, t60), struck(low + apart, t60, 1.0 if n < 10 else random.uniform(0.2, 1))]
    between = low, low + apart
    name = f"{low:.1f} Hz and {apart:.2f} Hz more, T60 {t60:.2f} s"
    more: dict[str, Any] = {"fundamental": between, "strongest": between, "t60": (t60,)}
    return sum_of("beats", name, partials, 44_100, 1.2 * t60, **more)


def two_slopes(random: Any, n: int) -> KnownSound:
    """A loud mode that falls soon, and a soft one that stays."""
    low, early, late = random.uniform(100, 1000), random.uniform(0.3, 1), random.uniform(3, 10)
    soft = 10 ** (-random.uniform(0.3, 1.5))
    partials = [struck(low, early), struck(low * 1.5, late, soft)]
    name = f"T60 {early:.2f} s; {20 * math.log10(soft):.0f} dB, {late:.2f} s"
    known = sum_of("two slopes", name, partials, 44_100, 1.2 * late)
    return replace(known, t60=(early, late, *filter(None, known.t60)))


def displacement(random: Any, n: int) -> KnownSound:
    """Displacements: low modes on an offset, short ones, and a force that only pushes."""
    rate, offset = 44_100, (0.0, 1.0, 0.1, -3.0)[n % 4]
    if n < 3:
        time, length = np.arange(rate // 2) / rate, (1e-3, 3e-3, 5e-3)[n]
        push = np.where(time < length, np.sin(math.pi * time / length), 0.0)[:, None]
        return KnownSound("one-sided", f"push of {1e3 * length:g} ms", push, rate, None, None, None, ())
    frequency, t60 = (random.uniform(25, 80), random.uniform(0.2, 1)) if n < 12 else (random.uniform(500, 3000), 0.02)
    t60 = max(t60, 8 / frequency)
    known = sum_of(
        "one-sided", f"{frequency:.1f} Hz, T60 {t60:.3f} s, offset {offset:g}", [struck(frequency, t60)], rate, 1.0
    )
    return replace(known, audio=known.audio + offset, centroid=known.centroid if frequency > 35 else None)


def cut(random: Any, n: int) -> KnownSound:
    """Sounds that end before they have fallen."""
    frequency, t60 = random.uniform(100, 4000), random.uniform(1, 10)
    share = random.uniform(0.05, 0.9)
    partials = [struck(frequency, t60), struck(2.1 * frequency, t60, 0.7)]
    known = sum_of("cut", f"T60 {t60:.2f} s, cut after {share * t60:.2f} s", partials, RATES[n % 4], share * t60)
    if n % 4 == 3:
        time = np.arange(len(known.audio)) / known.rate
        fading = known.audio * (1 - time / (share * t60))[:, None]
        return replace(
            known, name=f"{frequency:.0f} Hz, linear fade in {share * t60:.2f} s", audio=fading, t60=(), centroid=None
        )
    return replace(known, t60=(t60,) if share > 0.42 else (), has_t60=share > 0.5)


def strikes(random: Any, n: int) -> KnownSound:
    """One mode or more, struck two to six times."""
    rate = 44_100
    if n < 16:
        t60 = (4.0, 8.0)[n % 2]
        partials = [Partial(261.6256, t60, ((0.0, 1.0, 0.0), (2.0, 1.0, n * math.pi / 8)))]
        return sum_of("repeated strikes", f"C4, T60 {t60:g} s, phase {n}π/8", partials, rate, 6.0)
    f0, t60 = random.uniform(200, 1000), random.uniform(1.5, 4)
    times = np.cumsum([0.0, *random.uniform(0.15, 1.0, random.integers(1, 6))])
    partials = []
    for k, ratio in enumerate(BAR[:3]):
        blows = tuple((float(at), float(random.uniform(0.4, 1) / (k + 1)), random.uniform(0, 6.28)) for at in times)
        partials.append(Partial(f0 * ratio, t60 / ratio**0.5, blows))
    name, fine = f"{f0:.1f} Hz, T60 {t60:.2f} s, {len(times)} blows", np.linspace(0.0, 4 * t60, 4001)
    known = sum_of("repeated strikes", name, partials, rate, times[-1] + t60)
    after = (mean_t60(sum(p.energy_to_come(begin + fine, 1e9) for p in partials), fine[1]) for begin in (0, times[-1]))
    return replace(known, t60=tuple(filter(None, after)))


def noise(random: Any, n: int) -> KnownSound:
    """Bursts of noise and clicks, without pitch."""
    rate, t60 = RATES[n % 4], random.uniform(0.2, 1.5)
    frames = round(1.3 * t60 * rate)
    if n % 4 == 3:
        click = np.zeros((rate, 1))
        click[random.integers(1, 1000)] = 1.0
        return KnownSound("noise", f"click, {rate} Hz", click, rate, None, None, rate / 4, ())
    if n % 4 == 2:
        steady = random.standard_normal((2 * rate, 1))
        return KnownSound("noise", f"steady, {rate} Hz", steady, rate, None, None, rate / 4, ())
    white = random.standard_normal((frames, 1))
    fall = np.exp(-TO_60_DB / t60 * np.arange(frames) / rate)[:, None]
    return KnownSound("noise", f"burst, T60 {t60:.2f} s", white * fall, rate, None, None, None, (t60,), has_t60=True)


def late_onset(random: Any, n: int) -> KnownSound:
    """Silence before the onset; every second one on two channels in opposite phase."""
    known = (one_mode, sines, bright_attack, inharmonic)[n % 4](random, n)
    audio = np.concatenate([np.zeros((round(random.uniform(0.05, 1) * known.rate), 1)), known.audio])
    audio = np.hstack([audio, -audio]) if n % 2 else audio
    return replace(known, kind="silence before", name=f"late {known.name}", audio=audio)


KINDS = (
    (one_mode, 24),
    (sines, 20),
    (inharmonic, 21),
    (bright_attack, 20),
    (beats, 20),
    (two_slopes, 20),
    (displacement, 20),
    (cut, 16),
    (strikes, 32),
    (noise, 12),
    (late_onset, 16),
)


def known_sounds(seed: int = 0) -> Iterator[KnownSound]:
    """Two hundred sounds and more, one by one."""
    for number, (make, count) in enumerate(KINDS):
        random = np.random.default_rng([seed, number])
        for n in range(count):
            yield make(random, n)
