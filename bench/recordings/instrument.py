"""How far an instrument is from recordings of one, key by key; and how far those are from each other."""

import math
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from bench.recordings.brightness import brightness_slope
from bench.recordings.decay import LEAST_SLOPE
from bench.recordings.decay import SECONDS as DECAY_SECONDS
from bench.recordings.distances import BRIGHTEST_KEY, NoteResult, compare_layers, spectral_distance
from bench.recordings.keys import key_frequency
from bench.recordings.measure import SECONDS as LEVEL_SECONDS
from bench.recordings.note import Note, Sound, retune
from bench.recordings.summary import mean_of

VELOCITY = 10  # the layer, of 16, at which strings and decays are compared
STRING_LAYERS = (4, 10, 16)  # at which partials are read, and how brightness follows level
LAYERS = (2, 4, 6, 10, 16)  # at which spectra, levels and brightness are, those of them that are recorded
MARGIN = 0.25  # s that a rendering is longer than what is measured of it: sound may be late

RenderNote = Callable[[int, int, float], Sound | None]  # of a key, a layer and seconds; None if it has no such key
ReadNote = Callable[[int, int], Sound | None]  # of a key and a layer
INSTRUMENT = "this piano"  # the source of what is rendered


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
    notes: list[NoteResult]  # by layer and source


def compare_keys(
    keys: Iterable[int], read_note: ReadNote, render_note: RenderNote, peers: dict[str, ReadNote] | None = None
) -> Iterator[KeyResult]:
    """Compare each recorded key with the rendered one, with itself at other velocities and with its neighbour.

    peers: other instruments, by name
    """
    keys = sorted(keys)
    recorded_notes = lru_cache(maxsize=2)(lambda key: notes_of(key, read_note, True))  # sounds are large
    for at, key in enumerate(keys):
        recorded = recorded_notes(key)
        next_key = keys[at + 1] if at + 1 < len(keys) else keys[at - 1]
        neighbour = {layer: retune(note, key) for layer, note in recorded_notes(next_key).items()}
        rendered = notes_of(key, lambda key, velocity: render_note(key, velocity, seconds_needed(velocity)))
        sources = {INSTRUMENT: rendered} | {name: notes_of(key, play) for name, play in (peers or {}).items()}
        its, mine, beside = (notes_of_strings(notes) for notes in (recorded, rendered, neighbour))
        yield KeyResult(
            key,
            reading(its),
            reading(mine) if VELOCITY in mine else None,
            distance(mine, its),
            mean_distance([distance({VELOCITY: note}, its) for layer, note in its.items() if layer != VELOCITY]),
            distance(beside, its),
            list(compare_layers(recorded, neighbour, sources, VELOCITY)),
        )


def notes_of(key: int, sound_of: ReadNote, is_recording: bool = False) -> dict[int, Note]:
    """A key's notes by layer, those that there are."""
    sounds = {layer: sound_of(key, layer) for layer in LAYERS}
    return {layer: Note(sound, key, is_recording) for layer, sound in sounds.items() if sound is not None}


def notes_of_strings(notes: dict[int, Note]) -> dict[int, Note]:
    """Notes of the layers at which strings are read."""
    return {layer: note for layer, note in notes.items() if layer in STRING_LAYERS}


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
        slope_of_brightness(notes),
    )


def slope_of_brightness(notes: dict[int, Note]) -> float:
    """dB of the share above 2 kHz per dB of level; not a number for a high key. notes: by layer"""
    return brightness_slope([note.brightness for note in notes.values() if key_frequency(note.key) < BRIGHTEST_KEY])


def seconds_needed(velocity: int) -> float:
    """How long a rendering must be: slow decays are read at one velocity only."""
    return (DECAY_SECONDS if velocity == VELOCITY else LEVEL_SECONDS) + MARGIN


def distance(notes: dict[int, Note], recorded: dict[int, Note]) -> Distance:
    """How far notes are from recorded ones of that key, both by velocity."""
    if VELOCITY not in notes or VELOCITY not in recorded:
        return Distance()
    one, other = notes[VELOCITY], recorded[VELOCITY]
    early, late = (slope_factor(one.slopes[:, stage], other.slopes[:, stage]) for stage in (0, 1))
    both = notes.keys() & recorded.keys()
    mine, its = (slope_of_brightness({layer: by[layer] for layer in both}) for by in (notes, recorded))
    stiffness = abs(one.inharmonicity / typical_inharmonicity(recorded) - 1)
    return Distance(spectral_distance(one, other), stiffness, early, late, abs(mine / its - 1))


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
