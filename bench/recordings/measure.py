"""What is compared with a recorded note: levels in third-octave bands, and the knock below the partials."""

import itertools
import math

import numpy as np

SECONDS = 2.0  # from the onset, of levels
FRAME = 0.05  # s
FLOOR_DB = 60.0  # below the loudest band of any frame; what is softer counts as that
ONSET_DB = 30.0  # below the peak, where a sound begins
LOWEST, HIGHEST = 25.0, 20_000.0  # Hz, centres of bands
GAIN_RANGE_DB = 40.0  # either way, in which the gain is sought
PADDING = 4  # times the length of a frame, so that the lowest bands have bins

KNOCK_SECONDS = 0.06
KNOCK_EDGE = 0.8  # of the fundamental: below it no partial is


def onset(audio: np.ndarray) -> int:
    """The first frame within 30 dB of the peak. audio: [frames, channels]"""
    size = np.abs(audio).max(axis=1)
    return int(np.argmax(size > size.max() * 10 ** (-ONSET_DB / 20)))


def band_levels(audio: np.ndarray, rate: float) -> np.ndarray:
    """Levels [frames of 50 ms, third-octave bands] of the two seconds after the onset, dB under the loudest of them.

    audio: [frames, channels]; their mean is measured. What a sound at a low rate cannot have is at -inf.
    """
    size, frames = round(FRAME * rate), round(SECONDS / FRAME)
    sound = audio.mean(axis=1)[onset(audio) :][: size * frames]
    sound = np.pad(sound, (0, size * frames - len(sound))).reshape(frames, size)
    power = np.abs(np.fft.rfft(sound * np.hanning(size + 2)[1:-1], PADDING * size, axis=1)) ** 2
    indices = np.arange(math.ceil(3 * math.log2(LOWEST / 1000)), math.floor(3 * math.log2(HIGHEST / 1000)) + 1)
    edges = 1000.0 * 2.0 ** ((np.append(indices, indices[-1] + 1) - 0.5) / 3)
    bins = np.searchsorted(np.fft.rfftfreq(PADDING * size, 1 / rate), edges)
    bands = np.stack([power[:, a:b].sum(axis=1) for a, b in itertools.pairwise(bins)], axis=1)
    with np.errstate(divide="ignore"):
        return np.asarray(10 * np.log10(bands / bands.max()))


def difference(levels: np.ndarray, recorded: np.ndarray) -> tuple[float, float]:
    """Difference of levels from recorded ones, dB: root mean square, and mean of the absolute values.

    The gain is the one that makes the root mean square least. Counted is where either is above the floor.
    """
    off, counted = differences(levels, recorded)
    return root_mean_square(off[counted]), float(np.mean(np.abs(off[counted])))


def differences(levels: np.ndarray, recorded: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Differences of levels from recorded ones, dB, at that gain, and which of them count. Levels: [frames, bands]"""

    def at_gain(gain: float) -> tuple[np.ndarray, np.ndarray]:
        a, b = (np.maximum(x, -FLOOR_DB) for x in (levels + gain, recorded))
        return a - b, (a > -FLOOR_DB) | (b > -FLOOR_DB)

    def rms(gain: float) -> float:
        off, counted = at_gain(gain)
        return root_mean_square(off[counted])

    best = min(np.arange(-GAIN_RANGE_DB, GAIN_RANGE_DB + 1), key=rms)
    return at_gain(min(best + np.arange(-1, 1.001, 0.05), key=rms))


def root_mean_square(values: np.ndarray) -> float:
    """Root of the mean square."""
    return float(np.sqrt(np.mean(values**2)))


def knock_level(audio: np.ndarray, rate: float, fundamental: float) -> float:
    """Energy below the fundamental in the first 60 ms against all there, dB. audio: [frames, channels]"""
    size = round(KNOCK_SECONDS * rate)
    sound = audio[onset(audio) :][:size].mean(axis=1)
    power = np.abs(np.fft.rfft(sound * np.hanning(len(sound) + 2)[1:-1], 16 * size)) ** 2
    below = np.fft.rfftfreq(16 * size, 1 / rate) < KNOCK_EDGE * fundamental
    return 10 * math.log10(float(power[below].sum() / power.sum()) + 1e-30)
