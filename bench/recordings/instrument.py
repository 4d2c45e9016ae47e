"""How far an instrument is from recordings of one, key by key; and how far those are from each other."""

import math
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from functools import cached_property, lru_cache

import numpy as np
import soxr

from bench.recordings.brightness import Brightness, brightness, brightness_slope
from bench.recordings.decay import SECONDS as DECAY_SECONDS
from bench.recordings.decay import partial_decays
from bench.recordings.keys import key_frequency
from bench.recordings.measure import SECONDS as LEVEL_SECONDS
from bench.recordings.measure import band_levels, difference, knock_level
from bench.recordings.partials import Partials, read_partials

VELOCITY = 10  # of 16, at which all but the brightness is compared
VELOCITIES = (4, 10, 16)
MARGIN = 0.25  # s that a rendering is longer than what is measured of it: sound may be late
LEAST_SLOPE = 0.5  # dB/s: a slower decay looks like a beat in ten seconds
BRIGHTEST_KEY = 1000.0  # Hz: of a note above it, what lies over 2 kHz says nothing

Sound = tuple[np.ndarray, float]  # [frames, channels] and its rate, Hz
RenderNote = Callable[[int, int, float], Sound | None]  # of a key, a velocity and seconds; None if it has no such key
ReadNote = Callable[[int, int], Sound | None]  # of a key and a velocity


class Note:
    """A note, and its measures, computed when they are needed."""

    def __init__(self, sound: Sound, key: int) -> None:
        self.audio, self.rate = sound
        self.key = key

    @cached_property
    def levels(self) -> np.ndarray:
        """Levels in third-octave bands [frames of 50 ms, bands], dB."""
        return band_levels(self.audio, self.rate)

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


@dataclass(frozen=True)
class Distance:
    """Differences of one key from another, or from a recording of it; NaN where they cannot be measured."""

    levels: float = math.nan  # dB
    stiffness: float = math.nan  # share by which B is off
    early: float = math.nan  # factor, 1 or more, by which partials fall faster or slower
    late: float = math.nan
    brightness: float = math.nan  # share by which the slope of brightness over level is off


@dataclass(frozen=True)
class Reading:
    """What is read of one key; not a number where it cannot be."""

    cents: float  # of the first partial, over equal temperament
    inharmonicity: float  # B, the median over velocities
    partials: int  # that say so at the velocity of the comparison
    early: float  # dB/s, the median over partials 1 to 10
    late: float
    knock: float  # dB
    brightness: float  # dB of the share above 2 kHz per dB of level


@dataclass(frozen=True)
class KeyResult:
    """All about one key, and how far what is from what."""

    key: int
    recorded: Reading
    rendered: Reading | None  # None if the instrument has no such key
    off: Distance
    other_velocities: Distance  # of the same recorded key
    neighbour: Distance  # the next key recorded, played faster or slower until it has the pitch


def compare_keys(keys: Iterable[int], read_note: ReadNote, render_note: RenderNote) -> Iterator[KeyResult]:
    """Compare each recorded key with the rendered one, with itself at other velocities and with its neighbour."""
    keys = sorted(keys)
    recorded_notes = lru_cache(maxsize=2)(lambda key: notes_of(key, read_note))  # sounds are large
    for at, key in enumerate(keys):
        recorded = recorded_notes(key)
        next_key = keys[at + 1] if at + 1 < len(keys) else keys[at - 1]
        neighbour = {velocity: retuned(note, key) for velocity, note in recorded_notes(next_key).items()}
        rendered = notes_of(key, lambda key, velocity: render_note(key, velocity, seconds_needed(velocity)))
        others = [distance({VELOCITY: note}, recorded) for velocity, note in recorded.items() if velocity != VELOCITY]
        yield KeyResult(
            key,
            reading(recorded),
            reading(rendered) if VELOCITY in rendered else None,
            distance(rendered, recorded),
            mean_distance(others),
            distance(neighbour, recorded),
        )


def notes_of(key: int, sound_of: ReadNote) -> dict[int, Note]:
    """A key's notes by velocity, those that there are."""
    sounds = {velocity: sound_of(key, velocity) for velocity in VELOCITIES}
    return {velocity: Note(sound, key) for velocity, sound in sounds.items() if sound is not None}


def reading(notes: dict[int, Note]) -> Reading:
    """What a key's notes say, by velocity."""
    note = notes[VELOCITY]
    string = note.partials
    early, late = (mean_of(note.slopes[:, stage], np.median) for stage in (0, 1))
    return Reading(
        1200 * math.log2(string.pitch / key_frequency(note.key)) if string else math.nan,
        typical_inharmonicity(notes),
        len(string.numbers) if string else 0,
        early,
        late,
        note.knock,
        slope_of_brightness(notes.values()),
    )


def slope_of_brightness(notes: Iterable[Note]) -> float:
    """dB of the share above 2 kHz per dB of level; not a number for a high key."""
    notes = [note for note in notes if key_frequency(note.key) < BRIGHTEST_KEY]
    return brightness_slope([note.brightness for note in notes])


def seconds_needed(velocity: int) -> float:
    """How long a rendering must be: slow decays are read at one velocity only."""
    return (DECAY_SECONDS if velocity == VELOCITY else LEVEL_SECONDS) + MARGIN


def retuned(note: Note, key: int) -> Note:
    """A note played faster or slower, at the pitch of another key."""
    speed = key_frequency(key) / key_frequency(note.key)
    return Note((soxr.resample(note.audio, note.rate * speed, note.rate), note.rate), key)


def distance(notes: dict[int, Note], recorded: dict[int, Note]) -> Distance:
    """How far notes are from recorded ones of that key, both by velocity."""
    if VELOCITY not in notes or VELOCITY not in recorded:
        return Distance()
    one, other = notes[VELOCITY], recorded[VELOCITY]
    early, late = (slope_factor(one.slopes[:, stage], other.slopes[:, stage]) for stage in (0, 1))
    both = notes.keys() & recorded.keys()
    mine, its = (slope_of_brightness(by[velocity] for velocity in both) for by in (notes, recorded))
    stiffness = abs(one.inharmonicity / typical_inharmonicity(recorded) - 1)
    return Distance(difference(one.levels, other.levels)[0], stiffness, early, late, abs(mine / its - 1))


def typical_inharmonicity(notes: dict[int, Note]) -> float:
    """B of a key, the median over velocities: a string is as stiff at each."""
    return mean_of((note.inharmonicity for note in notes.values()), np.median)


def slope_factor(slopes: np.ndarray, recorded: np.ndarray) -> float:
    """By what factor, 1 or more, partials fall faster or slower than recorded, in the median over those of both.

    slopes: dB/s [partials]
    """
    both = np.isfinite(slopes) & np.isfinite(recorded)
    if not both.any():
        return math.nan
    mine, its = (np.maximum(-found[both], LEAST_SLOPE) for found in (slopes, recorded))
    return float(np.exp(abs(np.median(np.log(mine / its)))))


def mean_distance(distances: list[Distance]) -> Distance:
    """The means of those that can be told, of factors the geometric ones."""
    return Distance(
        mean_of(d.levels for d in distances),
        mean_of(d.stiffness for d in distances),
        math.exp(mean_of(math.log(d.early) for d in distances)),
        math.exp(mean_of(math.log(d.late) for d in distances)),
        mean_of(d.brightness for d in distances),
    )


def mean_of(values: Iterable[float], mean: Callable[[list[float]], float] = np.mean) -> float:
    """Mean, or median, of what is a number."""
    finite = [value for value in values if math.isfinite(value)]
    return float(mean(finite)) if finite else math.nan
