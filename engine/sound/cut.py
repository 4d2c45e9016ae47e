"""Begins and ends of sounds: what is cut off, and how it ends without a click."""

import math
from dataclasses import dataclass

import numpy as np

RANGE = 70.0  # dB below its peak, a sound has ended
FADE_SECONDS = 0.005
WINDOW_SECONDS = 0.02  # of the peak that is the level at a time
LEAST_DECAY = 0.5  # dB/s, below which a sound goes on
MAX_OVERLAP = 0.5  # of a sound that is repeated, what its end is cross-faded with


@dataclass(frozen=True)
class Cut:
    """The end of a sound that goes on."""

    level: float  # dB, of the end, on the peak of the sound
    seconds: float | None  # until it would be 70 dB below the peak, as it decays by then; None if it does not

    def __str__(self) -> str:
        goes_on = "does not die away" if self.seconds is None else f"rings for {self.seconds:.2g} s"
        return f"cut at {round(self.level)} dB; it {goes_on}"


def find_audible_frames(audio: np.ndarray) -> tuple[int, int]:
    """Return the first frame of a sound [frames, channels] that is not 70 dB below its peak, and the one after the
    last; all of silence."""
    size = np.abs(audio).max(axis=1, initial=0.0)
    heard = np.flatnonzero(size > size.max(initial=0.0) * 10 ** (-RANGE / 20))
    return (int(heard[0]), int(heard[-1]) + 1) if heard.size else (0, len(audio))


def find_cut(audio: np.ndarray, samplerate: int) -> Cut | None:
    """Return how the end of a sound [frames, channels] is cut; None if it has died away by then, or is silent."""
    levels = find_levels(audio, samplerate)
    if not len(levels) or levels[-1] <= -RANGE:
        return None
    last = levels[-max(4, len(levels) // 3) :]  # a decay may be fast at first
    last = last[last > -RANGE]
    slope = np.polyfit(np.arange(len(last)) * WINDOW_SECONDS, last, 1)[0] if len(last) > 1 else 0.0
    level = float(levels[-1])
    return Cut(level, (RANGE + level) / -float(slope) if slope < -LEAST_DECAY else None)


def find_levels(audio: np.ndarray, samplerate: int) -> np.ndarray:
    """Return the peak of each 20 ms of a sound, the last one whole, dB on the peak of the sound; none of silence."""
    length = min(max(1, round(WINDOW_SECONDS * samplerate)), max(1, len(audio)))
    count = len(audio) // length
    size = np.abs(audio[len(audio) - count * length :]).max(axis=1, initial=0.0).reshape(count, length).max(axis=1)
    peak = np.abs(audio).max(initial=0.0)
    if peak == 0.0:
        return np.zeros(0)
    return np.asarray(20.0 * np.log10(np.maximum(size, peak * 1e-15) / peak))


def fade_out(audio: np.ndarray, samplerate: int) -> np.ndarray:
    """Return a sound [frames, channels] whose last 5 ms go to zero, by a raised cosine."""
    frames = min(len(audio), math.ceil(FADE_SECONDS * samplerate))
    faded = np.array(audio)
    faded[len(audio) - frames :] *= 0.5 + 0.5 * np.cos(np.pi * np.arange(1, frames + 1) / frames)[:, None]
    return faded


def make_loop(audio: np.ndarray, overlap: int) -> np.ndarray:
    """Return a sound [frames - overlap, channels] that goes on at its begin as it ends: what would have come next is
    cross-faded with the begin, at equal power."""
    overlap = min(overlap, int(len(audio) * MAX_OVERLAP))
    frames = len(audio) - overlap
    angle = 0.5 * np.pi * (np.arange(overlap) + 0.5) / max(1, overlap)
    looped = np.array(audio[:frames])
    looped[:overlap] = looped[:overlap] * np.sin(angle)[:, None] + audio[frames:] * np.cos(angle)[:, None]
    return looped
