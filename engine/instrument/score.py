"""The score of an instrument: notes, and how pedals are moved."""

from collections.abc import Container, Iterable
from dataclasses import dataclass, field, replace
from typing import Any, NamedTuple

from engine.instrument.key_names import parse_key
from engine.instrument.key_sequencer import FULL_VELOCITY, Message
from engine.instrument.tables import DEFAULT_VELOCITY, Note, Pedal


class PlayedNote(NamedTuple):
    """A note of a score."""

    time: float  # s
    key: int
    velocity: int
    duration: float  # s
    release: int
    bend: tuple[tuple[float, float], ...] = ()  # s after the press, semitones above the key

    @property
    def end(self) -> float:
        """When the key is let go, s."""
        return self.time + self.duration


class PedalMove(NamedTuple):
    """A pedal is moved."""

    time: float  # s
    name: str  # sustain | soft | sostenuto
    value: float


@dataclass(frozen=True)
class Score:
    """Notes and pedals, each in the order of their times; or all messages in the order in which they come."""

    notes: tuple[PlayedNote, ...] = ()
    pedals: tuple[PedalMove, ...] = field(default=())
    played: tuple[Message, ...] | None = None  # of a file; None: they follow from notes and pedals

    @property
    def end(self) -> float:
        """When the last key is let go and the last pedal moves, s."""
        return max([note.end for note in self.notes] + [move.time for move in self.pedals], default=0.0)

    def uses_sustain(self) -> bool:
        """True if the score uses the sustain pedal."""
        return any(move.name == "sustain" and move.value > 0.0 for move in self.pedals)

    def with_middle_note(self, keys: list[int]) -> "Score":
        """The score with one note, of the key nearest to C4."""
        middle = min(keys, key=lambda k: (abs(k - 60), k))
        return replace(self, notes=(PlayedNote(0.0, middle, DEFAULT_VELOCITY, 2.0, 64),))

    def without_keys(self, keys: Container[int]) -> "Score":
        """The score without the notes of some keys."""
        return replace(self, notes=tuple(note for note in self.notes if note.key not in keys))

    def messages(self) -> tuple[Message, ...]:
        """Return the messages in the order in which they come. Of those of one time: the soft pedal acts on notes that
        begin, keys are let go before others are pressed, and the other pedals act on the keys that are down then."""
        if self.played is not None:
            return self.played
        ranked = [
            (0 if move.name == "soft" else 3, Message(move.time, move.name, 0, move.value)) for move in self.pedals
        ]
        for n, note in enumerate(self.notes):
            ranked.append((2, Message(note.time, "on", note.key, note.velocity / FULL_VELOCITY, n)))
            ranked.append((1, Message(note.end, "off", note.key, note.release / FULL_VELOCITY, n)))
        return tuple(message for _, message in sorted(ranked, key=lambda one: (one[1].time, one[0])))


def make_score(notes: Iterable[PlayedNote], pedals: Iterable[PedalMove] = ()) -> Score:
    """A score of notes and pedal moves in any order."""
    return Score(tuple(sorted(notes)), tuple(sorted(pedals)))


def read_score(document: dict[str, Any]) -> Score:
    """The score of a document. Raises ValidationError, a ValueError."""
    notes = [Note.model_validate(table) for table in document.get("note") or []]
    pedals = [Pedal.model_validate(table) for table in document.get("pedal") or []]
    played = [
        PlayedNote(n.time, parse_key(n.key), n.velocity, n.duration, n.release, tuple((t, x) for t, x in n.bend))
        for n in notes
    ]
    moves = [
        PedalMove(p.time, name, value)
        for p in pedals
        for name in ("sustain", "soft", "sostenuto")
        if (value := getattr(p, name)) is not None
    ]
    return make_score(played, moves)
