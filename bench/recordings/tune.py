"""Fit numbers of the piano to the recorded keys that it may be tuned on: damped Gauss-Newton steps on what is measured.

A patch has few numbers for many keys, in tables that are smooth in between; all keys are fitted at once.
"""

import copy
import math
import sys
from collections.abc import Iterator
from typing import Any, NamedTuple

import numpy as np

import engine
from bench.recordings.brightness import brightness_slope
from bench.recordings.decay import partial_decays
from bench.recordings.instrument import BRIGHTEST_KEY, LEAST_SLOPE, VELOCITIES, VELOCITY, Note
from bench.recordings.keys import key_frequency, key_name
from bench.recordings.measure import SECONDS as LEVEL_SECONDS
from bench.recordings.measure import differences
from bench.recordings.patches import ReadNote
from bench.recordings.piano import TUNED, load_piano, render_note

SECONDS = 5.25  # of a note at the velocity of the comparison, recorded and rendered
PROBE = 0.18  # change of the logarithm of a number that shows what it does
LARGEST = 0.75  # change of a logarithm in a round
DAMPINGS = (0.01, 0.1, 1.0, 10.0)
PULL = 0.2  # dB² that it costs a number to change by a factor of e: without effect, it stays
DECAY_WEIGHT = 2.0  # dB that partials count which fall faster or slower by a factor of e
BRIGHTNESS_WEIGHT = 3.0  # dB that counts a slope of brightness which is off by its size

Path = tuple[str | int, ...]  # of a number in a document


class Recorded(NamedTuple):
    """A recorded key, as far as it is fitted."""

    note: Note
    slopes: np.ndarray  # early and late, of as many seconds as are rendered, dB/s [partials, 2]
    brightness: float  # dB per dB; not a number for a high key


def find_numbers(document: dict[str, Any], names: list[str]) -> list[Path]:
    """Paths of numbers: those of a value of the keyboard, "strike", or one of a shared body, "board.rigidity".

    Raises KeyError if there is none.
    """
    paths: list[Path] = []
    for name in names:
        owner, _, field = name.partition(".")
        table, path = document["keyboard"]["values"], ("keyboard", "values", name)
        if field:
            at = [body["name"] for body in document["body"]].index(owner)
            table, path = document["body"][at], ("body", at, field)
        value = table[field or name]
        paths += [(*path, key) for key in value] if isinstance(value, dict) else [path]
    return paths


def change_numbers(document: dict[str, Any], paths: list[Path], logarithms: np.ndarray) -> dict[str, Any]:
    """The document with each number times a factor, given by its logarithm [paths]."""
    document = copy.deepcopy(document)
    for path, change in zip(paths, logarithms, strict=True):
        table: Any = document
        for part in path[:-1]:
            table = table[part]
        table[path[-1]] = float(f"{table[path[-1]] * math.exp(change):.3g}")
    return document


def read_recorded(key: int, read: ReadNote) -> Recorded:
    """What a recorded key is fitted by. Raises ValueError if it is not there at all velocities."""
    sounds = {velocity: read(key, velocity) for velocity in VELOCITIES}
    notes = {velocity: Note(sound, key) for velocity, sound in sounds.items() if sound}
    if len(notes) < len(VELOCITIES) or notes[VELOCITY].partials is None:
        raise ValueError(f"{key_name(key)}: no clear recording at each of the velocities {VELOCITIES}")
    note = notes[VELOCITY]
    slopes = partial_decays(note.audio[: round(SECONDS * note.rate)], note.rate, note.partials)
    return Recorded(note, slopes, slope_of(notes))


def slope_of(notes: dict[int, Note]) -> float:
    """How much brighter a key is for its level, dB per dB; not a number for a high one."""
    if key_frequency(notes[VELOCITY].key) >= BRIGHTEST_KEY:
        return math.nan
    return brightness_slope([notes[velocity].brightness for velocity in VELOCITIES])


def residuals(piano: engine.Scene, recorded: Recorded) -> np.ndarray:
    """How far a key is from the recorded one, dB: the sum of squares is the mean square of the differences of levels,
    and something for its decays and its brightness."""
    key, partials = recorded.note.key, recorded.note.partials
    assert partials is not None  # as read_recorded has seen to
    seconds = {velocity: LEVEL_SECONDS + 0.05 for velocity in VELOCITIES} | {VELOCITY: SECONDS}
    notes = {v: Note(render_note(key, v, seconds[v], piano), key) for v in VELOCITIES}
    off, counted = differences(notes[VELOCITY].levels, recorded.note.levels)
    slopes = partial_decays(notes[VELOCITY].audio, notes[VELOCITY].rate, partials)
    ratios = np.log(np.maximum(-slopes, LEAST_SLOPE) / np.maximum(-recorded.slopes, LEAST_SLOPE))
    known = np.isfinite(ratios).all(axis=1)
    decays = np.median(ratios[known], axis=0) if known.any() else np.ones(2)
    brighter = slope_of(notes) / recorded.brightness - 1 if math.isfinite(recorded.brightness) else 0.0
    return np.concatenate(
        [
            np.ravel(off) / math.sqrt(np.sum(counted)),
            DECAY_WEIGHT * decays,
            [BRIGHTNESS_WEIGHT * math.tanh(brighter)],
        ]
    )


def fit(document: dict[str, Any], paths: list[Path], recorded: list[Recorded], rounds: int) -> Iterator[dict[str, Any]]:
    """Fit numbers to keys: yields a document that is nearer to the recordings after each round, until none is found."""

    def off(document: dict[str, Any]) -> np.ndarray:
        piano = engine.Scene.model_validate(document)
        return np.stack([residuals(piano, key) for key in recorded]).ravel()

    error = off(document)
    for _ in range(rounds):
        slopes = np.empty((error.size, len(paths)))
        for number in range(len(paths)):
            probe = PROBE * (np.arange(len(paths)) == number)
            slopes[:, number] = (off(change_numbers(document, paths, probe)) - error) / PROBE
        square = slopes.T @ slopes
        tried = []
        for damping in DAMPINGS:
            left = square + np.diag(damping * np.diag(square) + PULL * len(recorded))
            step = np.clip(-np.linalg.solve(left, slopes.T @ error), -LARGEST, LARGEST)
            new = change_numbers(document, paths, step)
            tried.append((off(new), new))
        best, new = min(tried, key=lambda result: float(np.sum(result[0] ** 2)))
        if np.sum(best**2) >= np.sum(error**2):
            return
        error, document = best, new
        print(f"root of the mean square {math.sqrt(np.sum(error**2) / len(recorded)):.2f} dB", file=sys.stderr)
        yield document


def tune(names: list[str], read: ReadNote, rounds: int = 3) -> None:
    """Fit numbers of the shipped piano, and print them as they stand in a patch after each round."""
    document = load_piano().instrument or {}
    paths = find_numbers(document, names)
    recorded = [read_recorded(key, read) for key in TUNED]
    for fitted in fit(document, paths, recorded, rounds):
        for path in paths:
            value: Any = fitted
            for part in path:
                value = value[part]
            print(f"{'.'.join(str(part) for part in path)} = {value}")
