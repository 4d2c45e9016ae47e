"""Parameters that bend the keys of an instrument: the frequency or the tension of their bodies; and bends of notes."""

import itertools
from collections.abc import Iterable, Iterator
from typing import Any, NamedTuple

from engine.arithmetic.elementary import power
from engine.instrument.key_names import note_name, plain_note_name
from engine.instrument.key_sequencer import Table
from engine.instrument.score import PlayedNote

PITCH_KEYS = {"frequency": 1, "tension": 2}  # of a body: the first that it has goes with this power of the ratio


class BentParameter(NamedTuple):
    """A live parameter that bends a key."""

    key: int
    path: str
    value: float  # where nothing is bent
    power: int  # of the ratio of frequencies

    def bent(self, semitones: float, time: float, duration: float) -> dict[str, Any]:
        """An event that bends it."""
        value = self.value * float(power(2.0, semitones / 12 * self.power))
        return {"kind": "change", "time": time, "parameter": self.path, "value": value, "duration": duration}


def bent_parameters(bodies: Iterable[dict[str, Any]], keys: Iterable[int], prefix: str = "") -> Iterator[BentParameter]:
    """Yield the parameters that bend the keys of an instrument. bodies: as its patch, written out, gives them; prefix:
    of their names"""
    names = {plain_note_name(key): key for key in keys}
    for body in bodies:
        name = str(body.get("name", ""))  # of what is no body, before it is refused
        key = names.get(name.removeprefix(prefix).partition("_")[0]) if name.startswith(prefix) else None
        pitch = next((pitch for pitch in PITCH_KEYS if isinstance(body.get(pitch), float | int)), None)
        if key is not None and pitch is not None:
            yield BentParameter(key, f"body.{name}.{pitch}", float(body[pitch]), PITCH_KEYS[pitch])


def events_of_bends(parameters: Iterable[BentParameter], notes: Iterable[PlayedNote], seconds: float) -> list[Table]:
    """Return the bends of notes as events, changes of what keys are made of, that begin before `seconds`. A note ends
    the bend of the one before on its key."""
    events: list[Table] = []
    notes = sorted(notes)
    for key, group in itertools.groupby(sorted(parameters), lambda one: one.key):
        own, played = list(group), [note for note in notes if note.key == key]
        is_bent = False  # by the note before
        for note, end in zip(played, [*(later.time for later in played[1:]), seconds], strict=True):
            glides = list(glides_of(note))[0 if is_bent or (note.bend and note.bend[0][1]) else 1 :]
            is_bent = bool(note.bend)
            for begin, duration, semitones in glides:
                if begin < min(end, seconds):
                    events += [(one.bent(semitones, begin, duration), ("note",), note_name(key)) for one in own]
    return events


def glides_of(note: PlayedNote) -> Iterator[tuple[float, float, float]]:
    """Yield the glides of a bend: when each begins, s, how long it lasts, s, and where it leads to, semitones. The
    first, to where it begins, lasts no time."""
    yield note.time, 0.0, note.bend[0][1] if note.bend else 0.0
    for (begin, before), (end, after) in itertools.pairwise(note.bend):
        if after != before:
            yield note.time + begin, end - begin, after
