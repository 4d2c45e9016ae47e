"""How the partials of a recorded note fall: two lines through the level of each."""

import math

import numpy as np
import scipy

from bench.recordings.measure import onset
from bench.recordings.partials import Partials

PARTIALS = 10
SECONDS = 10.0  # from the onset
PERIODS, SHORTEST = 4.0, 0.04  # of the fundamental, s: the longer is the window, in which neighbours are in its zeros
HOPS = 4  # to a window
RISE_SECONDS = 0.15  # the level is followed from its highest in this time, of the partial's rise nothing counts
DEPTH_DB = 50.0  # as far as a partial is followed
NOISE_DB = 6.0  # by which it must stand above what is half-way to the next partial
SMOOTH_SECONDS = 0.25  # over which that is judged: a beat's trough is no end
LEAST_SECONDS = 0.3  # of a partial that can be followed
LEAST_SLOPE = 0.5  # dB/s: a slower decay looks like a beat in ten seconds

KNEE_SECONDS = 0.15  # a knee is no sooner …
TAIL = 1 / 3  # … and leaves this share of the time after it
KNEES = 80  # tried at most, each later than the last by one factor


def partial_decays(audio: np.ndarray, rate: float, partials: Partials) -> np.ndarray:
    """Early and late slopes of partials 1 to 10, dB/s [10, 2]; not a number where a partial cannot be followed.

    All channels count. audio: [frames, channels]
    """
    slopes = np.full((PARTIALS, 2), math.nan)
    for n in range(1, PARTIALS + 1):
        frequency = partials.predict(n)
        if math.isfinite(frequency) and frequency + partials.fundamental / 2 < 0.45 * rate:
            slopes[n - 1] = two_slopes(*follow(audio, rate, frequency, partials.fundamental))
    return slopes


def median_decays(audio: np.ndarray, rate: float, partials: Partials) -> tuple[float, float]:
    """Early and late slope, dB/s: the medians over partials 1 to 10."""
    slopes = partial_decays(audio, rate, partials)
    slopes = slopes[np.isfinite(slopes[:, 0])]
    early, late = np.median(slopes, axis=0) if len(slopes) else (math.nan, math.nan)
    return float(early), float(late)


def follow(audio: np.ndarray, rate: float, frequency: float, fundamental: float) -> tuple[np.ndarray, np.ndarray]:
    """Time, s, and level, dB, of a partial from its highest level to where it is lost. audio: [frames, channels]"""
    sound = audio[onset(audio) :][: round(SECONDS * rate)]
    seconds, level = band_level(sound, rate, frequency, fundamental)
    if not len(level):
        return seconds, level
    _, beside = band_level(sound, rate, frequency + fundamental / 2, fundamental)
    begin = int(np.argmax(level[seconds <= RISE_SECONDS]))
    length = 1 + 2 * round(SMOOTH_SECONDS / 2 / seconds[1]) if len(seconds) > 1 else 1
    least = np.maximum(beside + NOISE_DB, level.max() - DEPTH_DB)
    lost = np.flatnonzero(scipy.ndimage.median_filter(level - least, length, mode="nearest")[begin:] < 0)
    end = begin + int(lost[0]) if len(lost) else len(level)
    return seconds[begin:end] - seconds[begin], level[begin:end]


def band_level(sound: np.ndarray, rate: float, frequency: float, fundamental: float) -> tuple[np.ndarray, np.ndarray]:
    """Time, s, and level, dB, in a narrow band about a frequency. sound: [frames, channels]"""
    size = round(max(SHORTEST, PERIODS / fundamental) * rate)
    starts = np.arange(0, len(sound) - size + 1, max(1, size // HOPS))
    parts = np.ascontiguousarray(sound.T, complex)
    wave = np.hanning(size) * np.exp(-2j * np.pi * frequency * np.arange(size) / rate)
    power = np.array([sum(abs(np.vdot(wave, part[s : s + size])) ** 2 for part in parts) for s in starts])
    return starts / rate, 10 * np.log10(power + 1e-30)


def two_slopes(seconds: np.ndarray, level: np.ndarray) -> tuple[float, float]:
    """Slopes of the two lines, joined at a knee, that fit a level best, dB/s; not numbers if it is too short."""
    if not len(seconds) or seconds[-1] < LEAST_SECONDS:
        return math.nan, math.nan
    best, slopes = math.inf, (math.nan, math.nan)
    last = max(KNEE_SECONDS, (1 - TAIL) * seconds[-1])
    for knee in seconds[np.unique(np.searchsorted(seconds, np.geomspace(KNEE_SECONDS, last, KNEES)))]:
        lines = np.stack([np.ones_like(seconds), np.minimum(seconds, knee), np.maximum(seconds - knee, 0.0)], axis=1)
        weights, *_ = np.linalg.lstsq(lines, level, rcond=None)
        error = float(np.sum((lines @ weights - level) ** 2))
        if error < best:
            best, slopes = error, (float(weights[1]), float(weights[2]))
    return slopes
