"""Decay time of a sound, or the reason why it has none.

The level is that of the energy still to come (Schroeder, J. Acoust. Soc. Am. 37, 1965). What decays, in one mode or
many, falls ever slower: the logarithm of a sum of decaying exponentials is convex. What does not is no decay.
"""

import itertools
import math

import numpy as np

RANGE_DB = (5.0, 25.0)  # below all energy, between which the decay is measured
JUDGED_DB = (5.0, 10.0, 15.0, 20.0, 25.0, 30.0, 35.0, 40.0, 45.0, 50.0)  # between which it must not become faster
TOLERANCE = 0.1  # of a decay time, by which it may
RIPPLE = 5.0  # of a decay time, over the periods in it: energy comes twice in each
NOISE = 10.0  # of a decay time, over the root of its samples, of a sound without pitch
MAX_SLOPE_RATIO = 1.5  # of the second half of the range and its first
MIN_PERIODS = 6.0  # in a decay time: two in the range
STRIKE_SECONDS, STRIKE_PERIODS = 0.01, 2.0  # before and after a strike, of which the powers are compared
STRIKE_RISE = 10**0.2  # of the power
FIT_POINTS = 1000  # of a line, at most
TAIL_PARTS = 8  # of a sound, of which the last two say what would have come after its end
MAX_TAIL_RATIO = 0.9  # of the energies of these; a sound that falls less does not fall by 25 dB

NO_END = "it ends before it has fallen by 25 dB"
TOO_SHORT = "it falls by 20 dB in less than two periods"
UNEVEN = "it does not fall as decaying modes do, but like beats, several strikes, a fade or a damper"


def measure_decay(
    power: np.ndarray, samplerate: float, frequency: float | None, has_pitch: bool
) -> tuple[float | None, str | None]:
    """Time to fall by 60 dB, s, as the mean from -5 to -25 dB, after the last strike if there are several; or None, and
    the reason.

    power:     [frames], of all channels
    frequency: of the sound, Hz; None if there is none from 20 Hz up
    has_pitch: or it is noise, whose power varies by chance
    """
    t60, reason = _measure(power, samplerate, frequency, has_pitch)
    if reason == UNEVEN and (strike := last_strike(power, samplerate, frequency)):
        t60, reason = _measure(power[strike:], samplerate, frequency, has_pitch)
    return t60, reason


def _measure(
    power: np.ndarray, samplerate: float, frequency: float | None, has_pitch: bool
) -> tuple[float | None, str | None]:
    """The same, of a sound that is struck once."""
    energy = EnergyToCome(power)
    begin, middle, end = (energy.frame_at(-bound) for bound in (RANGE_DB[0], sum(RANGE_DB) / 2, RANGE_DB[1]))
    if end >= len(power) - 1:
        return None, NO_END
    t60 = energy.decay_frames(begin, end) / samplerate
    if end - begin < 8 or frequency is None or t60 * frequency < MIN_PERIODS:
        return None, TOO_SHORT
    spread = RIPPLE / (t60 * frequency) if has_pitch else NOISE / math.sqrt(t60 * samplerate)
    is_even, is_even_in_range, slowest = True, True, 0.0
    for high, low in itertools.pairwise(JUDGED_DB):
        first, last = energy.frame_at(-high), energy.frame_at(-low)
        if last < len(power) - 1 and last - first >= 4:
            frames = energy.decay_frames(first, last)
            is_even &= frames >= (1 - TOLERANCE - spread) * slowest
            is_even_in_range &= is_even or low > RANGE_DB[1]
            slowest = max(slowest, frames)
    early, late = (energy.decay_frames(*part) / samplerate for part in ((begin, middle), (middle, end)))
    if is_even_in_range and late > (MAX_SLOPE_RATIO + spread) * early:  # whatever becomes of it after that
        return None, f"two slopes: {early:.3g} s from -5 to -15 dB, and {late:.3g} s from -15 to -25 dB"
    return (t60, None) if is_even else (None, UNEVEN)


def last_strike(power: np.ndarray, samplerate: float, frequency: float | None) -> int:
    """The frame of the last strike: where the power of the next periods is larger by 2 dB than that of the last ones,
    and most."""
    block = round(samplerate * max(STRIKE_SECONDS, STRIKE_PERIODS / (frequency or math.inf)))
    sums = np.concatenate([[0.0], np.cumsum(power)])
    at = np.arange(block, len(power) - block, max(1, block // 8))
    if not len(at):
        return 0
    before, after = sums[at] - sums[at - block], sums[at + block] - sums[at]
    rises = (after > STRIKE_RISE * before) & (sums[-1] - sums[at] > 1e-2 * sums[-1])
    if not rises.any():
        return 0
    last = int(np.flatnonzero(rises)[-1])
    first = last - int(np.argmax(~rises[last::-1])) if not rises[: last + 1].all() else 0
    ratio = after[first : last + 1] / np.maximum(before[first : last + 1], 1e-300)
    return int(at[first + int(np.argmax(ratio))])


class EnergyToCome:
    """Energy still to come, over all energy [frames]. What a sound that is cut off would have had after its end, if it
    had gone on to fall as from its last eighth but one to its last, counts: a geometric series."""

    def __init__(self, power: np.ndarray) -> None:
        rising = np.cumsum(power[::-1])
        self._rising = rising / rising[-1]  # backwards in time
        part = len(power) // TAIL_PARTS
        last, both = self._rising[part - 1 : 2 * part : part] if part else (0.0, 1.0)
        ratio = min(last / max(both - last, 1e-300), MAX_TAIL_RATIO)
        self._missing = float(last * ratio / (1 - ratio))

    def frame_at(self, level: float) -> int:
        """The first frame at which so little is to come, dB below all; the number of frames if there is none."""
        bound = (1 + self._missing) * 10 ** (level / 10) - self._missing
        return len(self._rising) - int(np.searchsorted(self._rising, bound, "right"))

    def decay_frames(self, begin: int, end: int) -> float:
        """Decay time in frames, of the line through the level between two frames; infinite if it does not fall."""
        frames = np.linspace(begin, max(end - 1, begin + 1), min(FIT_POINTS, max(2, end - begin))).astype(int)
        energy = (self._rising[len(self._rising) - 1 - frames] + self._missing) / (1 + self._missing)
        level = 10 * np.log10(np.maximum(energy, 1e-300))
        slope = float(np.polyfit(frames - begin, level, 1)[0])
        return -60.0 / slope if slope < 0.0 else math.inf
