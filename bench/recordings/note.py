"""A note, recorded or rendered, and what is measured of it."""

import math
from functools import cached_property

import numpy as np
import soxr

from bench.recordings.brightness import Brightness, brightness
from bench.recordings.decay import partial_decays
from bench.recordings.keys import key_frequency
from bench.recordings.measure import FRAMES, Frames, band_powers, clear_cells, knock_level
from bench.recordings.octaves import channel_correlation, clear_frames, octave_levels
from bench.recordings.partials import Partials, read_partials

Sound = tuple[np.ndarray, float]  # [frames, channels] and its rate, Hz


class Note:
    """A note, and its measures, computed when they are needed."""

    def __init__(self, sound: Sound, key: int, is_recording: bool = False) -> None:
        """is_recording: it has a noise, and is there as a whole, so that its late part tells the noise."""
        self.audio, self.rate = sound
        self.key = key
        self.is_recording = is_recording
        self._powers: dict[Frames, np.ndarray] = {}
        self._clear: dict[Frames, np.ndarray] = {}

    def powers(self, frames: Frames = FRAMES) -> np.ndarray:
        """Powers in third-octave bands [frames, bands]."""
        if frames not in self._powers:
            self._powers[frames] = band_powers(self.audio, self.rate, frames)
        return self._powers[frames]

    def clear(self, frames: Frames = FRAMES) -> np.ndarray:
        """Cells that are clear of its noise: truths [frames, bands]."""
        if frames not in self._clear:
            of_all = np.ones(self.powers(frames).shape, bool)
            self._clear[frames] = clear_cells(self.audio, self.rate, frames) if self.is_recording else of_all
        return self._clear[frames]

    @cached_property
    def octaves(self) -> np.ndarray:
        """Levels of octaves over ten seconds [frames, octaves], dB."""
        return octave_levels(self.audio, self.rate)

    @cached_property
    def clear_frames(self) -> np.ndarray:
        """Frames in which octaves are clear of its noise [octaves]."""
        count = np.full(self.octaves.shape[1], len(self.octaves))
        return clear_frames(self.octaves, self.audio, self.rate) if self.is_recording else count

    @cached_property
    def correlation(self) -> np.ndarray:
        """Correlation of its channels by octave [octaves]."""
        return channel_correlation(self.audio, self.rate, key_frequency(self.key))

    @cached_property
    def partials(self) -> Partials | None:
        """What string it is."""
        return read_partials(self.audio, self.rate, key_frequency(self.key))

    @cached_property
    def slopes(self) -> np.ndarray:
        """Early and late slopes of partials 1 to 10, dB/s [10, 2]; not a number where there is none."""
        return partial_decays(self.audio, self.rate, self.partials) if self.partials else np.full((10, 2), math.nan)

    @cached_property
    def knock(self) -> float:
        """Energy below the fundamental in the first 60 ms against all there, dB."""
        return knock_level(self.audio, self.rate, key_frequency(self.key))

    @cached_property
    def brightness(self) -> Brightness:
        """Level and share above 2 kHz."""
        return brightness(self.audio, self.rate)

    @property
    def inharmonicity(self) -> float:
        """B, or not a number."""
        return self.partials.inharmonicity if self.partials else math.nan


def retune(note: Note, key: int) -> Note:
    """A note played faster or slower, at the pitch of another key."""
    speed = key_frequency(key) / key_frequency(note.key)
    return Note((soxr.resample(note.audio, note.rate * speed, note.rate), note.rate), key, note.is_recording)
