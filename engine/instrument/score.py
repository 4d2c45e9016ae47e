"""The score of an instrument: notes, and how pedals are moved."""

from bisect import bisect_right
from collections.abc import Iterable
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any, NamedTuple

from engine.instrument.key_names import parse_key
from engine.instrument.tables import DEFAULT_VELOCITY, Note, Pedal


class PlayedNote(NamedTuple):
    """A note of a score."""

    time: float  # s
    key: int
    velocity: int
    duration: float  # s
    release: int

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
    """Notes and pedals, each in the order of their times."""

    notes: tuple[PlayedNote, ...] = ()
    pedals: tuple[PedalMove, ...] = field(default=())

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

    def pedal_at(self, name: str, time: float) -> float:
        """Return the position of a pedal at a time, from 0 (up) to 1 (down)."""
        times, values = self._moves_by_pedal.get(name, ([], []))
        before = bisect_right(times, time)
        return values[before - 1] if before else 0.0

    @cached_property
    def _moves_by_pedal(self) -> dict[str, tuple[list[float], list[float]]]:
        """The times and values of the moves of each pedal."""
        moves: dict[str, tuple[list[float], list[float]]] = {}
        for time, name, value in self.pedals:
            times, values = moves.setdefault(name, ([], []))
            times.append(time)
            values.append(value)
        return moves


def make_score(notes: Iterable[PlayedNote], pedals: Iterable[PedalMove] = ()) -> Score:
    """A score of notes and pedal moves in any order."""
    return Score(tuple(sorted(notes)), tuple(sorted(pedals)))


def read_score(document: dict[str, Any]) -> Score:
    """The score of a document. Raises ValidationError, a ValueError."""
    notes = [Note.model_validate(table) for table in document.get("note") or []]
    pedals = [Pedal.model_validate(table) for table in document.get("pedal") or []]
    played = [PlayedNote(n.time, parse_key(n.key), n.velocity, n.duration, n.release) for n in notes]
    moves = [
        PedalMove(p.time, name, value)
        for p in pedals
        for name in ("sustain", "soft", "sostenuto")
        if (value := getattr(p, name)) is not None
    ]
    return make_score(played, moves)
