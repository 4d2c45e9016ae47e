"""The levels of notes in a MIDI file, compared with those of the notes alone."""

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

import engine
from bench.accuracy.lone_notes import LoneNote
from engine.instrument.expansion import expand_for_score
from engine.instrument.key_sequencer import FULL_VELOCITY
from engine.instrument.score import PedalMove, PlayedNote, make_score
from engine.patch.scene import Scene

RATE = 44_100
LONGEST, SHORTEST, STEP = 0.1, 0.02, 0.01  # s, over which a level is taken
BEFORE = 0.01  # s, over which the body is looked at before the note
TRACED = 400.0  # s, of all bodies together
ALLOWED, SOUNDING = 1.0, -30.0  # dB


class Level(NamedTuple):
    """The level of a note in a file."""

    note: LoneNote
    off: float  # dB, from that of the note alone
    before: float  # dB, of its body just before, relative to the note alone
    body: str
    change: float | None  # dB, by velocity; None if a body that still vibrates may be why it is off


class NoteLevels:
    """The levels of notes of an instrument.

    bodies: of each key, whose levels are taken
    """

    def __init__(self, scene: Scene, bodies: Mapping[int, list[str]]) -> None:
        self._scene, self._bodies = scene, bodies
        self._alone: dict[tuple[float, ...], tuple[str, float]] = {}  # of notes alone, as far as they are known

    def compare(self, scene: Scene, notes: Sequence[LoneNote], most: int) -> Iterator[Level]:
        """Compare the levels of at most so many notes, evenly chosen, with those of the notes alone."""
        seconds = min(scene.seconds, TRACED / len(scene.body))
        chosen = [note for note in notes if frames_of_level(note, notes) and note.begin + LONGEST < seconds]
        velocities = body_velocities(scene, seconds) if chosen else {}
        for note in chosen[:: max(1, math.ceil(len(chosen) / most))]:
            frames, begin = frames_of_level(note, notes), round(note.begin * RATE) + 1
            body, alone = self._level_alone(note, frames)
            here, before = velocities[body][begin : begin + frames], velocities[body][:begin][-round(BEFORE * RATE) :]
            off, left = decibels(rms(here) / alone), decibels(rms(before) / alone)
            is_strange = abs(off) > ALLOWED and left <= SOUNDING
            yield Level(note, off, left, body, self._change_by_velocity(note, frames) if is_strange else None)

    def _change_by_velocity(self, note: LoneNote, frames: int) -> float:
        """Return by how much the level of a note alone changes, in dB, where its velocity is one more or less."""
        others = [replace(note, v=note.v + step / FULL_VELOCITY) for step in (-1, 1)]
        level = self._level_alone(note, frames)[1]
        return max(abs(decibels(self._level_alone(one, frames)[1] / level)) for one in others if 0.0 < one.v <= 1.0)

    def _level_alone(self, note: LoneNote, frames: int) -> tuple[str, float]:
        """Return the body that moves most in so many frames of a note alone, and its RMS velocity, m/s."""
        seconds = frames / RATE
        hold = min(note.end - note.begin, seconds)
        pedals = {"soft": note.soft} | ({} if hold >= seconds else {"sustain": note.pedals["sustain"]})
        known = (note.key, note.v, *pedals.values(), hold, frames)
        if known not in self._alone:
            moves = [PedalMove(0.0, pedal, value) for pedal, value in pedals.items() if value > 0.0]
            lone = PlayedNote(0.0, note.key, round(note.v * FULL_VELOCITY), hold, 64)
            document = self._scene.instrument or {}
            expansion = expand_for_score(document | {"seconds": seconds + STEP}, make_score([lone], moves))
            velocities = body_velocities(self._scene.with_expansion(expansion), seconds + 1 / RATE)
            found = {name: rms(velocities[name][1:]) for name in self._bodies[note.key]}
            body = max(found, key=lambda name: found[name])
            self._alone[known] = body, max(found[body], 1e-30)
        return self._alone[known]


def body_velocities(scene: Scene, seconds: float) -> dict[str, np.ndarray]:
    """Return the velocities of the bodies of a scene by name, m/s; 0 of those that are not traced."""
    trace = engine.render(scene, seconds, RATE, trace=True, kernel="general", cores=1).trace
    assert trace is not None
    return {str(name): np.nan_to_num(trace["velocity"][:, n]) for n, name in enumerate(trace["bodies"])}


def rms(x: np.ndarray) -> float:
    """Return the root of the mean square."""
    return float(np.sqrt(np.mean(x**2))) if x.size else 0.0


def decibels(ratio: float) -> float:
    """Return a ratio of velocities in dB."""
    return 20.0 * math.log10(max(ratio, 1e-30))


def frames_of_level(note: LoneNote, notes: Sequence[LoneNote]) -> int:
    """Return over how many frames the level of a note is taken; 0 if it ends at once, or its key is
    pressed again too soon."""
    again = min((n.begin for n in notes if n.key == note.key and n is not note and n.begin >= note.begin), default=1e9)
    seconds = max(SHORTEST, min(LONGEST, STEP * math.floor((note.end - note.begin) / STEP)))
    is_too_short = note.end - note.begin < 1 / RATE or again - note.begin < seconds
    return 0 if is_too_short else round(seconds * RATE)
