"""How loud and how bright a recorded note is, and how one follows the other from velocity to velocity."""

import math
from typing import NamedTuple

import numpy as np

from bench.recordings.measure import SECONDS, onset

EDGE = 2000.0  # Hz, above which sound is bright


class Brightness(NamedTuple):
    """Of the two seconds after the onset, all channels."""

    level: float  # dB; of a sine of amplitude 1 in every channel -3
    share: float  # of the energy that is above 2 kHz, dB
    centroid: float  # Hz, of the energy


def brightness(audio: np.ndarray, rate: float) -> Brightness:
    """Level, and where in the spectrum the energy is. audio: [frames, channels]"""
    sound = audio[onset(audio) :][: round(SECONDS * rate)]
    power = np.sum(np.abs(np.fft.rfft(sound, axis=0)) ** 2, axis=1)
    frequency = np.fft.rfftfreq(len(sound), 1 / rate)
    share = power[frequency >= EDGE].sum() / power.sum()
    mean_square = np.sum(sound**2) / (round(SECONDS * rate) * sound.shape[1])
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
