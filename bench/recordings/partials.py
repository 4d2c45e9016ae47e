"""Partials of a stiff string in a recorded note: their frequencies, and the f0 and B of f_n = n f0 √(1 + B n²)."""

import math
from typing import NamedTuple

import numpy as np

from bench.recordings.measure import onset

CYCLES = 120.0  # of the fundamental that the window holds: partials of a choir are then still one peak each
SHORTEST, LONGEST = 0.25, 2.0  # s, of the window
START = 0.03  # s from the onset: the blow itself is over
PADDING = 4  # times the length of the window
MOST = 80  # partials sought
HIGHEST, HIGHEST_SHARE = 16_000.0, 0.45  # Hz, and of the rate: partials above either are not sought

CLEAR_DB = 12.0  # by which a peak stands above the median about it
FLOOR_WIDTH = 1.5  # times the fundamental, either way: what that median is of
CREDIT_DB = 40.0  # a peak this far above counts in full when the first guess is sought, and no more beyond it
FIRST = 16  # partials that choose the first guess
DETUNED = np.arange(-45.0, 45.1, 3.0)  # cents, in which the fundamental is sought
STIFFNESSES = np.geomspace(1e-5, 4e-2, 72)

NEAR = 0.12  # of the spacing, either way, in which the next partial is sought
TOO_FAR = 3.5  # standard deviations from the fit, as of the median, beyond which a peak is not the string's
LEAST_DEVIATION = 1e-4  # of a frequency: peaks are not better known
MISSING = 6  # partials in a row that are not there: the rest is noise
REFITS = 4


class Partials(NamedTuple):
    """What was read of a note: f_n = n · fundamental · √(1 + inharmonicity · n²)."""

    fundamental: float  # Hz
    inharmonicity: float
    numbers: np.ndarray  # of the partials used in the fit
    frequencies: np.ndarray  # theirs, Hz

    @property
    def pitch(self) -> float:
        """Frequency of the first partial, as the others have it, Hz."""
        return self.predict(1) if math.isfinite(self.inharmonicity) else self.fundamental

    def predict(self, number: int) -> float:
        """Frequency of a partial, Hz."""
        return number * self.fundamental * math.sqrt(max(0.0, 1 + self.inharmonicity * number**2))  # B may be below 0


def read_partials(audio: np.ndarray, rate: float, expected: float) -> Partials | None:
    """Frequencies of partials, and the string that has them; None if none are clear. audio: [frames, channels]

    expected: the fundamental, Hz, within 45 cents. Two partials or fewer do not tell how stiff a string is; B is then
    not a number.
    """
    frequency, level = spectrum(audio, rate, expected)
    clear = level - floor_level(frequency, level, expected)
    guess = first_guess(frequency, clear, expected)
    found: dict[int, float] = {}
    missing = 0
    for n in range(1, MOST + 1):
        string = fit(found, guess) if len(found) >= 3 else guess
        near, spacing = string.predict(n), string.predict(n + 1) - string.predict(n)
        if near > min(HIGHEST, HIGHEST_SHARE * rate) or missing > MISSING:
            break
        peak = find_peak(frequency, level, clear, near, NEAR * min(spacing, 3 * expected))
        missing = 0 if peak else missing + 1
        if peak:
            found[n] = peak
    return fit(found, guess) if found else None


def spectrum(audio: np.ndarray, rate: float, expected: float) -> tuple[np.ndarray, np.ndarray]:
    """Frequencies, Hz, and the level there, dB, of all channels together, shortly after the onset."""
    size = round(min(max(CYCLES / expected, SHORTEST), LONGEST) * rate)
    sound = audio[onset(audio) + round(START * rate) :][:size]
    window = np.blackman(len(sound) + 2)[1:-1]
    bins = 1 << math.ceil(math.log2(PADDING * size))
    power = np.sum(np.abs(np.fft.rfft(sound * window[:, None], bins, axis=0)) ** 2, axis=1)
    return np.fft.rfftfreq(bins, 1 / rate), 10 * np.log10(power + 1e-30)


def floor_level(frequency: np.ndarray, level: np.ndarray, expected: float) -> np.ndarray:
    """The level between partials, dB: the median about each frequency."""
    half = max(2, round(FLOOR_WIDTH * expected / frequency[1]))
    centres = np.arange(0, len(level), half)
    medians = [np.median(level[max(0, c - half) : c + half]) for c in centres]
    return np.asarray(np.interp(np.arange(len(level)), centres, medians))


def first_guess(frequency: np.ndarray, clear: np.ndarray, expected: float) -> Partials:
    """The string, of many, at whose partials most stands above the floor."""
    numbers = np.arange(1, FIRST + 1)
    credit = np.clip(clear, 0.0, CREDIT_DB)
    best, guess = -1.0, (expected, math.nan)
    for fundamental in expected * 2.0 ** (DETUNED / 1200):
        for stiffness in STIFFNESSES:
            at = numbers * fundamental * np.sqrt((1 + stiffness * numbers**2) / (1 + stiffness))
            at = at[at < min(HIGHEST, HIGHEST_SHARE * 2 * frequency[-1])]
            score = credit[np.round(at / frequency[1]).astype(int)].sum()
            if score > best:
                best, guess = score, (fundamental / math.sqrt(1 + stiffness), stiffness)
    return Partials(*guess, np.array([], int), np.array([]))


def find_peak(frequency: np.ndarray, level: np.ndarray, clear: np.ndarray, near: float, reach: float) -> float | None:
    """Frequency of the strongest clear peak within reach, Hz, by a parabola through its bins."""
    step = frequency[1]
    low, high = max(1, math.floor((near - reach) / step)), min(len(level) - 2, math.ceil((near + reach) / step))
    inside = np.arange(low, high + 1)
    inside = inside[clear[inside] > CLEAR_DB]
    tops = inside[(level[inside] >= level[inside - 1]) & (level[inside] > level[inside + 1])]
    if not len(tops):
        return None
    top = tops[np.argmax(level[tops])]
    left, middle, right = level[top - 1 : top + 2]
    return float((top + 0.5 * (left - right) / (left - 2 * middle + right)) * step)


def fit(found: dict[int, float], guess: Partials) -> Partials:
    """Least squares of (f/n)² = f0² + f0² B n², without the peaks that lie far off."""
    number, frequency = np.array(list(found), float), np.array(list(found.values()))
    if len(found) < 3:
        fundamental = float(np.median(frequency / number / np.sqrt(1 + guess.inharmonicity * number**2)))
        return Partials(fundamental, math.nan, number.astype(int), frequency)
    keep = np.ones(len(number), bool)
    lines = np.stack([np.ones_like(number), number**2], axis=1)
    for _ in range(REFITS):
        (square, slope), *_ = np.linalg.lstsq(lines[keep], (frequency[keep] / number[keep]) ** 2, rcond=None)
        off = (frequency / number) ** 2 / (square + slope * number**2) - 1
        deviation = 1.4826 * float(np.median(np.abs(off[keep])))
        keep = np.abs(off) <= TOO_FAR * max(deviation, 2 * LEAST_DEVIATION)
    return Partials(math.sqrt(square), float(slope / square), number[keep].astype(int), frequency[keep])
