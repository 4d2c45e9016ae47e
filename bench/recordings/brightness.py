"""How loud and how bright a recorded note is, and how one follows the other from velocity to velocity."""

import math
from typing import NamedTuple

import numpy as np

from bench.recordings.measure import FRAME, SECONDS, onset

EDGE = 2000.0  # Hz, above which sound is bright


class Brightness(NamedTuple):
    """Of the two seconds after the onset, all channels."""

    level: float  # dB; of a sine of amplitude 1 in every channel -3
    share: float  # of the energy that is above 2 kHz, dB
    centroid: float  # Hz, of the energy


def brightness(audio: np.ndarray, rate: float) -> Brightness:
    """Level, and where in the spectrum the energy is. audio: [frames, channels]"""
    size = 2 * round(FRAME * rate / 2)
    begin = onset(audio) - size // 2  # windowed, so that neither end is a click, which would be bright
    sound = np.pad(audio, ((max(0, -begin), size), (0, 0)))[max(0, begin) :][: round(SECONDS * rate)]
    window = np.hanning(size + 1)[:-1, None]
    frames = [sound[b : b + size] * window for b in range(0, len(sound) - size + 1, size // 2)]
    power = np.sum(np.abs(np.fft.rfft(frames, axis=1)) ** 2, axis=(0, 2))
    frequency = np.fft.rfftfreq(size, 1 / rate)
    share = power[frequency >= EDGE].sum() / power.sum()
    mean_square = np.sum(audio[onset(audio) :][: round(SECONDS * rate)] ** 2) / (round(SECONDS * rate) * audio.shape[1])
    return Brightness(
        10 * math.log10(mean_square + 1e-30),
        10 * math.log10(share + 1e-30),
        float(np.sum(frequency * power) / power.sum()),
    )


def brightness_slope(notes: list[Brightness]) -> float:
    """By how much the share above 2 kHz rises as a note is struck harder, dB per dB of level; of two velocities or
    more, least squares."""
    levels = np.array([note.level for note in notes])
    if len(notes) < 2 or np.ptp(levels) == 0:
        return math.nan
    return float(np.polyfit(levels, [note.share for note in notes], 1)[0])
