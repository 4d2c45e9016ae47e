"""Fit numbers of the piano to the recorded keys that it may be tuned on: damped Gauss-Newton steps on what is measured.

A patch has few numbers for many keys, in tables that are smooth in between; all keys are fitted at once.
"""

import copy
import math
import sys
from collections.abc import Iterator
from typing import Any

import numpy as np

import engine
from bench.recordings.decay import LEAST_SLOPE
from bench.recordings.instrument import VELOCITY, ReadNote, seconds_needed, slope_of_brightness
from bench.recordings.keys import key_name
from bench.recordings.measure import decibels, differences
from bench.recordings.note import Note
from bench.recordings.piano import FITTED_KEYS, FITTED_LAYERS, load_piano, render_note

PROBE = 0.18  # change of the logarithm of a number that shows what it does
LARGEST = 0.75  # change of a logarithm in a round
DAMPINGS = (0.01, 0.1, 1.0, 10.0)
PULL = 0.2  # dB² of each key that it costs to change a number by a factor of e: without effect, it stays
DECAY_WEIGHT = 2.0  # dB that partials count which fall faster or slower by a factor of e
BRIGHTNESS_WEIGHT = 3.0  # dB that counts a slope of brightness which is off by its size
ROUNDS = 3

Path = tuple[str | int, ...]  # of a number in a document
Notes = dict[int, Note]  # of a key, by velocity


def find_numbers(document: dict[str, Any], names: list[str]) -> list[Path]:
    """Paths of numbers: a value of the keyboard, "strike", or one of a shared body, "board.flexural_rigidity".

    Raises ValueError if there are none, or if they are not positive.
    """
    bodies = {body["name"]: number for number, body in enumerate(document["body"])}
    paths: list[Path] = []
    for name in names:
        owner, _, field = name.rpartition(".")
        if owner and owner not in bodies:
            raise ValueError(f"{name}: there is no shared body {owner}; there are {', '.join(bodies)}")
        path: Path = ("body", bodies[owner], field) if owner else ("keyboard", "values", name)
        value = value_at(document, path[:-1]).get(field)
        numbers = value if isinstance(value, dict) else {"": value}
        if not all(isinstance(number, float | int) and number > 0 for number in numbers.values()):
            raise ValueError(f"{name}: no positive number, nor a table of them")
        paths += [(*path, key) for key in value] if isinstance(value, dict) else [path]
    return paths


def value_at(document: Any, path: Path) -> Any:
    """What stands at a path."""
    for part in path:
        document = document[part]
    return document


def change_numbers(document: dict[str, Any], paths: list[Path], logarithms: np.ndarray) -> dict[str, Any]:
    """The document with each number times a factor, given by its logarithm [paths]."""
    document = copy.deepcopy(document)
    for path, change in zip(paths, logarithms, strict=True):
        value_at(document, path[:-1])[path[-1]] = float(f"{value_at(document, path) * math.exp(change):.3g}")
    return document


def read_recorded(key: int, read: ReadNote) -> Notes:
    """A recorded key. Raises ValueError if it is not there at all velocities."""
    sounds = {velocity: read(key, velocity) for velocity in FITTED_LAYERS}
    if missing := [str(velocity) for velocity, sound in sounds.items() if sound is None]:
        raise ValueError(f"no recording of {key_name(key)} at velocity {', '.join(missing)}")
    return {velocity: Note(sound, key, is_recording=True) for velocity, sound in sounds.items() if sound}


def residuals(piano: engine.Scene, recorded: Notes) -> np.ndarray:
    """How far a key is from the recorded one, dB: the sum of squares is the mean square of the differences of levels,
    and something for its decays and its brightness."""
    its = recorded[VELOCITY]
    notes = {v: Note(render_note(its.key, v, seconds_needed(v), piano), its.key) for v in FITTED_LAYERS}
    mine = notes[VELOCITY]
    off, counted = differences(decibels(mine.powers()), decibels(its.powers()), its.clear())
    ratios = np.log(np.maximum(-mine.slopes, LEAST_SLOPE) / np.maximum(-its.slopes, LEAST_SLOPE))
    known = ratios[np.isfinite(ratios).all(axis=1)]
    decays = np.median(known, axis=0) if len(known) else np.ones(2)
    slopes = [slope_of_brightness(by) for by in (notes, recorded)]
    brighter = math.tanh(slopes[0] / slopes[1] - 1) if math.isfinite(slopes[1]) else 0.0
    levels = np.ravel(np.where(counted, off, 0.0)) / math.sqrt(np.sum(counted))
    return np.concatenate([levels, DECAY_WEIGHT * decays, [BRIGHTNESS_WEIGHT * brighter]])


def fit(document: dict[str, Any], paths: list[Path], recorded: list[Notes]) -> Iterator[dict[str, Any]]:
    """Fit numbers to keys: yields a document that is nearer to the recordings after each round, while there is one."""

    def off(document: dict[str, Any]) -> np.ndarray:
        piano = engine.Scene.model_validate(document)
        return np.concatenate([residuals(piano, key) for key in recorded])

    error = off(document)
    for _ in range(ROUNDS):
        probes = PROBE * np.eye(len(paths))
        slopes = np.stack([off(change_numbers(document, paths, probe)) - error for probe in probes], axis=1) / PROBE
        square, pull = slopes.T @ slopes, PULL * len(recorded) * np.eye(len(paths))
        tried = []
        for damping in DAMPINGS:
            step = np.linalg.solve(square + damping * np.diag(np.diag(square)) + pull, -slopes.T @ error)
            new = change_numbers(document, paths, np.clip(step, -LARGEST, LARGEST))
            tried.append((off(new), new))
        nearest, new = min(tried, key=lambda result: float(np.sum(result[0] ** 2)))
        if np.sum(nearest**2) >= np.sum(error**2):
            return
        error, document = nearest, new
        print(f"off by {math.sqrt(np.sum(error**2) / len(recorded)):.2f} dB", file=sys.stderr)
        yield document


def tune(names: list[str], read: ReadNote) -> None:
    """Fit numbers of the shipped piano, and print them after each round. Raises ValueError as those above do."""
    document = load_piano().instrument or {}
    paths = find_numbers(document, names)
    for fitted in fit(document, paths, [read_recorded(key, read) for key in FITTED_KEYS]):
        print("\n".join(f"{'.'.join(map(str, path[1:]))} = {value_at(fitted, path)}" for path in paths))
