"""The pitch of a drum as its note decays: a head that was struck hard is stretched, and higher at first."""

import math
from typing import NamedTuple

import numpy as np

from bench.recordings.measure import onset

WINDOW = 0.093  # s, over which pitch is read
HOP = 0.02  # s, between readings
LATER = 0.4  # s after the onset, against which the fall counts
LOWEST, HIGHEST = 50.0, 300.0  # Hz, where the first partial of a tom is sought
LEAST_RATIO, GREATEST_RATIO = 0.9, 1.12  # of one reading to the next in time
RESOLUTION = 0.1  # Hz, of a reading at least


class Glide(NamedTuple):
    """The pitch of the first partial over time."""

    seconds: np.ndarray  # after the onset: the middle of each reading
    hertz: np.ndarray

    def later(self) -> float:
        """Pitch 0.4 s after the onset, Hz."""
        return float(np.interp(LATER, self.seconds, self.hertz))

    def cents(self) -> np.ndarray:
        """Pitch above that of 0.4 s after the onset, cents."""
        return 1200 * np.log2(self.hertz / self.later())

    def fall(self) -> float:
        """Cents from the first reading to 0.4 s after the onset."""
        return float(self.cents()[0])


def read_glide(audio: np.ndarray, rate: float) -> Glide:
    """Read the first partial, the strongest below 300 Hz, from 0.45 s back to the onset.

    audio: [frames, channels], 0.5 s or more from the onset; their mean is measured.
    """
    sound = audio.mean(axis=1)[onset(audio) :]
    size = round(WINDOW * rate)
    hann, padded = np.hanning(size + 2)[1:-1], 2 ** math.ceil(math.log2(rate / RESOLUTION))
    hertz = np.fft.rfftfreq(padded, 1 / rate)
    middles = np.arange(WINDOW / 2, LATER + WINDOW / 2 + HOP, HOP)
    pitches = list[float]()
    low, high = LOWEST, HIGHEST
    for middle in middles[::-1]:
        first = round((middle - WINDOW / 2) * rate)
        part = np.pad(sound[first : first + size], (0, max(0, first + size - len(sound))))[:size]
        near = (hertz >= low) & (hertz <= high)
        pitches.append(float(hertz[near][np.argmax(np.abs(np.fft.rfft(part * hann, padded)[near]))]))
        low, high = LEAST_RATIO * pitches[-1], GREATEST_RATIO * pitches[-1]
    return Glide(middles, np.array(pitches[::-1]))


def first_level(audio: np.ndarray, rate: float) -> float:
    """Level of the first 0.1 s, dB. audio: [frames, channels]"""
    begin = onset(audio)
    return float(10 * math.log10(np.mean(audio[begin : begin + round(0.1 * rate)] ** 2)))
