"""Pieces of music as text, bench/pieces/*.toml, and how they are performed.

A voice is written as notes with their lengths in beats: "E4:1 G4+B4:1/2 - C5:2> |". A length holds until another is
given; + joins the notes of a chord, - is a rest, > an accent, ~ ties a note to the next, and | ends a bar. A number
stands for a tone of the chord of its bar. What is written is repeated up to the last bar of the voice.

Tempo (beats a minute) and dynamics (MIDI velocity) are given at some bars, and are linear between them. Each phrase is
an arch, as players shape it (Todd, JASA 91, 3540, 1992): faster and louder in its middle than at its ends.
"""

import tomllib
from collections.abc import Iterator
from dataclasses import dataclass
from fractions import Fraction
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from engine.instrument.key_names import parse_key
from engine.instrument.score import PedalMove, PlayedNote, Score, make_score

RELEASE = 64
ACCENT, DOWNBEAT = 10, 3  # MIDI velocity: of an accent, and of the first beat of a bar
TOUCH, TIMING = 2.0, 0.004  # MIDI velocity and s: how uneven a player is, as standard deviations
PEDAL_UP = 0.12  # s, for which the pedal is up when it is changed
STEP = 1 / 48  # beats, in which the tempo is summed up
SOFTEST, LOUDEST = 1, 127  # MIDI velocity


@dataclass(frozen=True)
class Piece:
    """A piece as it is performed: in words, and the notes of each part by its name."""

    about: str
    parts: dict[str, Score]

    @property
    def score(self) -> Score:
        """All parts, as one instrument plays them."""
        scores = self.parts.values()
        return make_score((n for s in scores for n in s.notes), (m for s in scores for m in s.pedals))


class WrittenNote(NamedTuple):
    """A note or a chord of a voice, as it is written."""

    beat: float  # from the begin of the piece
    length: float  # beats
    keys: tuple[int, ...]
    accented: bool


class Interpretation:
    """Tempo and dynamics of a piece over its beats."""

    def __init__(self, text: dict[str, Any], last_beat: float) -> None:
        """text: `beats` of a bar, points of `tempo` and `dynamics`, and if there are phrases, the bars of each, and how
        far tempo (`ease`, as a fraction) and velocity (`swell`) rise in them"""
        self._bar = text["beats"]
        self._dynamics = np.array(text["dynamics"], float).T
        self._swell, ease = text.get("swell", 0.0), text.get("ease", 0.0)
        self._ends = np.cumsum([0, *text.get("phrases", [])])
        self._beats = np.arange(0.0, last_beat + STEP, STEP)
        bars, speeds = np.array(text["tempo"], float).T
        tempo = np.interp(1 + self._beats / self._bar, bars, speeds) * (1 + ease * (self.arch(self._beats) - 1))
        periods = 60 / tempo
        self._seconds = np.concatenate([[0.0], np.cumsum(STEP * (periods[1:] + periods[:-1]) / 2)])

    def arch(self, beat: np.ndarray) -> np.ndarray:
        """Return the shape of the phrases: 0 at their ends, 1 in the middle and where there are none."""
        bar = beat / self._bar
        k = np.searchsorted(self._ends, bar, "right")
        inside = k < len(self._ends)
        begin, end = self._ends[k - 1], self._ends[np.minimum(k, len(self._ends) - 1)]
        x = (bar - begin) / np.where(inside, end - begin, 1)
        return np.where(inside, 4 * x * (1 - x), 1.0)

    def seconds(self, beat: float) -> float:
        """Return the time of a beat, s."""
        return float(np.interp(beat, self._beats, self._seconds))

    def velocity(self, beat: float) -> float:
        """Return the MIDI velocity of what is played at a beat."""
        bars, velocities = self._dynamics
        first = DOWNBEAT if beat % self._bar == 0 else 0
        shape = float(self.arch(np.array([beat]))[0]) - 0.5
        return float(np.interp(1 + beat / self._bar, bars, velocities)) + self._swell * shape + first


def read_piece(path: Path) -> Piece:
    """Read a piece, and perform it. Raises ValueError if a bar is not full or a note has no name."""
    text = tomllib.loads(path.read_text("utf-8"))
    try:
        return Piece(text["about"], perform(text))
    except ValueError as error:
        raise ValueError(f"{path.name}: {error}") from None


def perform(text: dict[str, Any]) -> dict[str, Score]:
    """Play all voices of a piece; return the parts by their names. Times count from the first note."""
    chords = [bar.split() for bar in text.get("chords", "").split("|")]
    voices = [(voice, list(read_voice(voice, chords, text["beats"]))) for voice in text["voice"]]
    last = max(note.beat + note.length for _, written in voices for note in written)
    begin = min(note.beat for _, written in voices for note in written)
    played = Interpretation(text, last)
    start, rng = played.seconds(begin), np.random.default_rng(0)
    parts: dict[str, list[PlayedNote]] = {}
    for voice, written in voices:
        part = parts.setdefault(voice.get("part", ""), [])
        for note in written:
            part += play_note(note, voice, played, start, rng)
    pedals = list(change_pedal(text, played, start, last))
    return {name: make_score(notes, pedals) for name, notes in parts.items()}


def read_voice(voice: dict[str, Any], chords: list[list[str]], beats: int) -> Iterator[WrittenNote]:
    """Yield the notes of a voice, from its `first` bar to its `last`. Raises ValueError."""
    bars = voice["notes"].strip().removesuffix("|").split("|")
    first = voice.get("first", 1)
    length, tied = Fraction(1), None
    for number in range(first, voice.get("last", first + len(bars) - 1) + 1):
        at = Fraction(0)
        for word in bars[(number - first) % len(bars)].split():
            names, _, value = word.rstrip(">~").partition(":")
            length = Fraction(value) if value else length
            if names != "-":
                tones = [chords[number - 1][int(n) - 1] if n.isdecimal() else n for n in names.split("+")]
                keys = tuple(parse_key(tone) + voice.get("transpose", 0) for tone in tones)
                note = WrittenNote(float((number - 1) * beats + at), float(length), keys, ">" in word)
                note = note if tied is None else tied._replace(length=tied.length + note.length)
                tied = note if word.endswith("~") else None
                if tied is None:
                    yield note
            at += length
        if at != beats:
            raise ValueError(f"bar {number} has {at} beats in place of {beats}")


def play_note(
    note: WrittenNote, voice: dict[str, Any], played: Interpretation, start: float, rng: np.random.Generator
) -> Iterator[PlayedNote]:
    """Yield the notes of a chord as a player strikes them.

    voice: `level`, MIDI velocity above the others; `roll`, s from one note of a chord to the next; `hold`, the part of
           their length for which keys are held
    start: of the first note of the piece, s
    """
    time, end = played.seconds(note.beat), played.seconds(note.beat + note.length)
    duration = (end - time) * voice.get("hold", 1.0)
    for k, key in enumerate(note.keys):
        velocity = played.velocity(note.beat) + voice.get("level", 0) + ACCENT * note.accented + rng.normal(0, TOUCH)
        struck = max(0.0, time - start + k * voice.get("roll", 0.0) + rng.normal(0, TIMING))
        yield PlayedNote(struck, key, round(min(max(velocity, SOFTEST), LOUDEST)), duration, RELEASE)


def change_pedal(text: dict[str, Any], played: Interpretation, start: float, last: float) -> Iterator[PedalMove]:
    """Yield the moves of the sustain pedal, which is changed at some beats of each bar; none if it is not used.

    text: `pedal`, beats of a bar, from 1; `beats` of a bar
    """
    changes = [bar + beat - 1 for bar in np.arange(0, last, text["beats"]) for beat in text.get("pedal", [])]
    for beat in changes:
        time = played.seconds(beat) - start
        if time > 0.0:
            yield PedalMove(time, "sustain", 0.0)
        yield PedalMove(max(time, 0.0) + PEDAL_UP * (time > 0.0), "sustain", 1.0)
    if changes:
        yield PedalMove(played.seconds(last) - start + 0.5, "sustain", 0.0)
