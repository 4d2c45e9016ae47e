"""A note by octave bands: how fast each falls in the end, and how alike its channels are."""

import math

import numpy as np
import scipy

from bench.recordings.decay import DEPTH_DB, LEAST_SLOPE, SMOOTH_SECONDS
from bench.recordings.decay import SECONDS as DECAY_SECONDS
from bench.recordings.measure import (
    CENTRES,
    CLEAR_DB,
    FLOOR_DB,
    FRAMES,
    Frames,
    band_powers,
    decibels,
    from_onset,
    noise_powers,
    spectra,
    sum_bands,
)

DECAY_FRAMES = Frames(0.2, 0.05, seconds=DECAY_SECONDS)  # long enough for the lowest octave
LATE = 1 / 3  # of the time that an octave is heard: its late decay begins
LEAST_SECONDS = 0.5  # that an octave is heard, to have a late decay
OCTAVES = CENTRES[3:-1:3]  # Hz, 62.5 Hz to 8 kHz: centres of octaves of three bands each
FIRST = 2  # band of the first octave


def sum_octaves(bands: np.ndarray) -> np.ndarray:
    """Sums over the three bands of each octave [..., octaves]. bands: [..., third-octave bands]"""
    return np.asarray(bands[..., FIRST : FIRST + 3 * len(OCTAVES)].reshape(*bands.shape[:-1], -1, 3).sum(axis=-1))


def octave_levels(audio: np.ndarray, rate: float) -> np.ndarray:
    """Levels [frames, octaves] of ten seconds after the onset, dB. audio: [frames, channels]"""
    return decibels(sum_octaves(band_powers(audio, rate, DECAY_FRAMES)) + 1e-30)


def clear_frames(levels: np.ndarray, audio: np.ndarray, rate: float) -> np.ndarray:
    """Frames that each octave of a recording stays 6 dB above its noise [octaves]. levels: dB [frames, octaves]"""
    return frames_above(levels, decibels(sum_octaves(noise_powers(audio, rate, DECAY_FRAMES))) + CLEAR_DB)


def frames_above(levels: np.ndarray, least: np.ndarray) -> np.ndarray:
    """Frames that each octave stays above a level, a beat's trough aside [octaves]. levels: dB [frames, octaves]"""
    length = 1 + 2 * round(SMOOTH_SECONDS / 2 / DECAY_FRAMES.hop)
    below = scipy.ndimage.median_filter(levels - least, (length, 1), mode="nearest") < 0
    return np.where(below.any(axis=0), below.argmax(axis=0), len(levels))


def late_ratios(levels: np.ndarray, recorded: np.ndarray, clear: np.ndarray, lowest: float) -> np.ndarray:
    """Late decay of octaves over the recorded one, natural logarithms of ratios of dB/s [octaves].

    Both are lines through the same time: from a third of that in which the recording is heard to its end. It is heard
    until it has fallen by 50 dB, or to 60 dB below the loudest octave, or has come near its noise. Not a number for an
    octave that is below the note, or heard for less than half a second.

    levels: dB [frames, octaves], recorded likewise;
    clear: frames in which both are clear of their noise [octaves]; lowest: frequency of the note, Hz
    """
    top = recorded.max(axis=0)
    ends = np.minimum(clear, frames_above(recorded, np.maximum(top - DEPTH_DB, top.max() - FLOOR_DB)))
    ratios = np.full(len(OCTAVES), math.nan)
    for n, end in enumerate(ends):
        if OCTAVES[n] * math.sqrt(2) > lowest and end * DECAY_FRAMES.hop >= LEAST_SECONDS:
            seconds = np.arange(round(LATE * end), end) * DECAY_FRAMES.hop
            falls = [-np.polyfit(seconds, x[round(LATE * end) : end, n], 1)[0] for x in (levels, recorded)]
            ratios[n] = np.log(np.divide(*np.maximum(falls, LEAST_SLOPE)))
    return ratios


def channel_correlation(audio: np.ndarray, rate: float, lowest: float) -> np.ndarray:
    """Correlation of the first two channels in the two seconds after the onset, by octave [octaves].

    Not a number for a single channel, nor for an octave that is below the note, or 60 dB softer than the loudest.
    audio: [frames, channels]; lowest: frequency of the note, Hz
    """
    if audio.shape[1] < 2:
        return np.full(len(OCTAVES), math.nan)
    frequency, spectrum = spectra(from_onset(audio, rate), rate, FRAMES._replace(length=0.2, hop=0.1))
    left, right = spectrum[:, 0], spectrum[:, 1]
    products = np.array([(left * right.conj()).real, np.abs(left) ** 2, np.abs(right) ** 2]).sum(axis=1)
    both, *powers = sum_octaves(sum_bands(frequency, products))
    level = decibels(np.add(*powers) + 1e-30)
    is_heard = (OCTAVES * math.sqrt(2) > lowest) & (level > level.max() - FLOOR_DB)
    return np.where(is_heard, both / np.sqrt(np.multiply(*powers) + 1e-60), math.nan)
