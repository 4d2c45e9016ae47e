"""Bends of the keys of an instrument, by the pitch wheel and by messages that tune keys: of those bodies that have a
frequency or a tension."""

from collections.abc import Iterable, Mapping, Sequence
from typing import Any

from engine.instrument.bent_parameters import BentParameter
from engine.instrument.held_keys import ALL
from engine.instrument.key_names import note_frequency
from engine.live.midi_notes import PITCH_KINDS, Note
from engine.live.mpe import ChannelBends, NoteChannels

BEND_STEP_SECONDS = 0.01  # between two steps of a bend in a score


class KeyBends:
    """The present pitch bend of each key: by the wheel of the channel that played it last. A key that no channel has
    played follows the latest move of any.

    parameters:  of the keys
    frequencies: of the keys as the patch has them, Hz
    """

    def __init__(self, parameters: Sequence[BentParameter], frequencies: Mapping[int, float]) -> None:
        self.parameters, self._frequencies = parameters, frequencies
        self._tuned = dict[int, float]()  # ratios of keys that messages have tuned
        self._channels = {one.key: NoteChannels(ALL, ALL) for one in parameters}  # that a key follows
        self._bends = ChannelBends()

    def follow(self, note: Note) -> None:
        """Follow a message: a move of the wheel, a key that is tuned, or one that is pressed on another channel."""
        if note.kind == "bend":
            self._bends.move(note.channels, note.value)
        elif note.kind == "tune" and note.number in self._frequencies:
            wanted = note_frequency(note.number) * 2.0 ** (note.value / 1200.0)
            self._tuned[note.number] = wanted / self._frequencies[note.number]
        elif note.kind == "on" and note.number in self._channels:
            self._channels[note.number] = note.channels

    def expect(self, notes: Iterable[Note]) -> None:
        """Let each key follow the channel that will play it first."""
        first = {note.number: note.channels for note in reversed(list(notes)) if note.kind == "on"}
        self._channels |= {key: channels for key, channels in first.items() if key in self._channels}

    @property
    def together(self) -> bool:
        """True if outside zones the latest move of any wheel bends all keys."""
        return self._bends.together

    @together.setter
    def together(self, together: bool) -> None:
        self._bends.together = together

    def take_over(self, other: "KeyBends") -> None:
        """Have the wheels where those of another one are."""
        self._bends, self._tuned = other._bends, other._tuned

    def values(self) -> dict[str, float]:
        """The values of all parameters, by their paths."""
        return {
            one.path: one.value
            * (self._bends.ratio(self._channels[one.key]) * self._tuned.get(one.key, 1.0)) ** one.power
            for one in self.parameters
        }


def bend_events(bends: KeyBends, notes: Sequence[Note]) -> list[dict[str, Any]]:
    """The bends of a file as events of a score: changes of what keys are made of, in steps."""
    bends.expect(notes)
    before, steps = bends.values(), dict[int, dict[str, float]]()
    for note in notes:
        bends.follow(note)
        if note.kind in (*PITCH_KINDS, "on"):
            steps[round(note.seconds / BEND_STEP_SECONDS)] = bends.values()
    events = []
    for step, values in steps.items():
        events += [
            {"kind": "change", "time": step * BEND_STEP_SECONDS, "parameter": path, "value": value}
            for path, value in values.items()
            if value != before[path]
        ]
        before = values
    return events
