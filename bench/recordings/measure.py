"""What is compared with a recorded note: levels in third-octave bands over time, and the knock below the partials."""

import functools
import itertools
import math
from typing import NamedTuple

import numpy as np

SECONDS = 2.0  # from the onset, of levels
FRAME = 0.05  # s
FLOOR_DB = 60.0  # below the loudest band of any frame; what is softer counts as that
ONSET_DB = 30.0  # below the peak, where a sound begins
LOWEST, HIGHEST = 25.0, 20_000.0  # Hz, centres of bands
GAIN_RANGE_DB = 40.0  # either way, in which the gain is sought
PADDED, PADDING = 0.2, 4  # s, to which a frame is padded so that low bands have bins; at most so many times its length

NOISE_PART = 0.6, 0.8  # of a recording's length: the note has died away, and the fade to silence has not begun
CLEAR_DB = 6.0  # above the noise: a recording is its instrument, not its microphones and room

KNOCK_SECONDS = 0.06
KNOCK_EDGE = 0.8  # of the fundamental: below it no partial is


class Frames(NamedTuple):
    """How a sound is cut in time; s, from the onset."""

    length: float = FRAME
    hop: float = FRAME
    begin: float = 0.0
    seconds: float = SECONDS  # from the begin of the first frame to the end of the last, at most


FRAMES = Frames()
CENTRES = 1000.0 * 2.0 ** (
    np.arange(math.ceil(3 * math.log2(LOWEST / 1000)), math.floor(3 * math.log2(HIGHEST / 1000)) + 1) / 3
)  # Hz [bands]
WIDTHS = CENTRES * (2 ** (1 / 6) - 2 ** (-1 / 6))  # Hz [bands]


def onset(audio: np.ndarray) -> int:
    """The first frame within 30 dB of the peak. audio: [frames, channels]"""
    size = functools.reduce(np.maximum, np.abs(audio).T)  # sooner than a maximum over so short an axis
    return int(np.argmax(size > size.max() * 10 ** (-ONSET_DB / 20)))


def spectra(sound: np.ndarray, rate: float, frames: Frames, padding: int = 1) -> tuple[np.ndarray, np.ndarray]:
    """Frequencies, Hz [bins], and spectra [frames, channels, bins] of a sound that begins with the first frame.

    sound: [samples, channels]; it counts as silent after its end.
    """
    size, hop = round(frames.length * rate), round(frames.hop * rate)
    count = max(1, 1 + round((frames.seconds - frames.length) / frames.hop))
    length = size + hop * (count - 1)
    sound = np.pad(sound[:length], ((0, max(0, length - len(sound))), (0, 0)))
    cut = np.lib.stride_tricks.sliding_window_view(sound, size, axis=0)[::hop]
    bins = padding * size
    return np.fft.rfftfreq(bins, 1 / rate), np.fft.rfft(cut * np.hanning(size + 2)[1:-1], bins, axis=2)


def sum_bands(frequency: np.ndarray, values: np.ndarray) -> np.ndarray:
    """Sums over the bins of third-octave bands [..., bands]. values: [..., bins]"""
    bins = np.searchsorted(frequency, np.append(CENTRES, CENTRES[-1] * 2 ** (1 / 3)) * 2 ** (-1 / 6))
    return np.stack([values[..., a:b].sum(axis=-1) for a, b in itertools.pairwise(bins)], axis=-1)


def from_onset(audio: np.ndarray, rate: float, begin: float = 0.0) -> np.ndarray:
    """A sound from some seconds after its onset; before its begin it was silent. audio: [frames, channels]"""
    first = onset(audio) + round(begin * rate)
    return np.pad(audio[max(0, first) :], ((max(0, -first), 0), (0, 0)))


def band_powers(audio: np.ndarray, rate: float, frames: Frames = FRAMES) -> np.ndarray:
    """Powers [frames, third-octave bands] after the onset: the mean over the channels. audio: [frames, channels]

    Signals of channels are not added: two microphones at a distance would cancel each other in part.
    """
    return mean_powers(from_onset(audio, rate, frames.begin), rate, frames)


def mean_powers(sound: np.ndarray, rate: float, frames: Frames) -> np.ndarray:
    """Powers [frames, third-octave bands] of a sound from its first sample: the mean over its channels."""
    frequency, spectrum = spectra(sound, rate, frames, min(PADDING, math.ceil(PADDED / frames.length)))
    return sum_bands(frequency, np.mean(np.abs(spectrum) ** 2, axis=1))


def noise_powers(audio: np.ndarray, rate: float, frames: Frames = FRAMES) -> np.ndarray:
    """Powers [third-octave bands] of the noise of a recording in a frame: those of the late part, before it is faded
    out. audio: [frames, channels], the whole recording"""
    first, last = (round(part * len(audio)) for part in NOISE_PART)
    quiet = Frames(frames.length, frames.length, seconds=(last - first) / rate)
    return np.asarray(mean_powers(audio[first:last], rate, quiet).mean(axis=0))


def band_levels(audio: np.ndarray, rate: float, frames: Frames = FRAMES) -> np.ndarray:
    """Levels [frames, third-octave bands] after the onset, dB. What a sound at a low rate cannot have is at -inf."""
    return decibels(band_powers(audio, rate, frames))


def clear_cells(audio: np.ndarray, rate: float, frames: Frames = FRAMES) -> np.ndarray:
    """Bands and frames in which a recording stands 6 dB above its noise: truths [frames, bands].

    audio: [frames, channels], the whole recording
    """
    return band_powers(audio, rate, frames) > 10 ** (CLEAR_DB / 10) * noise_powers(audio, rate, frames)


def decibels(power: np.ndarray) -> np.ndarray:
    """Levels of powers, dB."""
    with np.errstate(divide="ignore"):
        return np.asarray(10 * np.log10(power))


def difference(levels: np.ndarray, recorded: np.ndarray, clear: np.ndarray | None = None) -> tuple[float, float]:
    """Difference of levels from recorded ones, dB: root mean square, and mean of the absolute values.

    The gain is the one that makes the root mean square least. Counted is where either is above the floor, and the
    recording is clear of its noise.
    """
    off, counted = differences(levels, recorded, clear)
    return root_mean_square(off[counted]), float(np.mean(np.abs(off[counted]))) if counted.any() else math.nan


def differences(
    levels: np.ndarray, recorded: np.ndarray, clear: np.ndarray | None = None, floor: float = FLOOR_DB
) -> tuple[np.ndarray, np.ndarray]:
    """Differences of levels from recorded ones, dB, at that gain, and which of them count. Levels: [frames, bands]

    clear: where the recording is clear of its noise; everywhere if None. floor: dB below the loudest
    """
    clear = np.ones(recorded.shape, bool) if clear is None else clear
    levels, recorded = levels - levels.max(), recorded - recorded.max()

    def at_gain(gain: float) -> tuple[np.ndarray, np.ndarray]:
        a, b = (np.maximum(x, -floor) for x in (levels + gain, recorded))
        return a - b, ((a > -floor) | (b > -floor)) & clear

    def rms(gain: float) -> float:
        off, counted = at_gain(gain)
        return root_mean_square(off[counted])

    best = min(np.arange(-GAIN_RANGE_DB, GAIN_RANGE_DB + 1), key=rms)
    return at_gain(min(best + np.arange(-1, 1.001, 0.05), key=rms))


def root_mean_square(values: np.ndarray) -> float:
    """Root of the mean square; not a number of none."""
    return float(np.sqrt(np.mean(values**2))) if len(values) else math.nan


def knock_level(audio: np.ndarray, rate: float, fundamental: float) -> float:
    """Energy below the fundamental in the first 60 ms against all there, dB. audio: [frames, channels]"""
    size = round(KNOCK_SECONDS * rate)
    sound = audio[onset(audio) :][:size]
    power = np.abs(np.fft.rfft(sound * np.hanning(len(sound) + 2)[1:-1, None], 16 * size, axis=0)) ** 2
    below = np.fft.rfftfreq(16 * size, 1 / rate) < KNOCK_EDGE * fundamental
    return 10 * math.log10(float(power[below].sum() / power.sum()) + 1e-30)
