"""The notes of a score: when each ends, and the events that it would cause alone."""

from collections.abc import Iterator
from dataclasses import dataclass, field, replace

from pydantic import TypeAdapter

from engine.instrument.held_keys import HeldKeys
from engine.instrument.key_sequencer import UNKNOWN_RELEASE, KeyEvent, KeySequencer, Message
from engine.instrument.key_writer import KeyWriter
from engine.instrument.score import Score
from engine.patch.tables import Event

SAME_TIME = 1e-9  # s
OF_NO_NOTE = '"kind":"damp"', '"kind":"lift"', '"parameter":"body.'  # of pedals and pitch wheels
EVENTS: TypeAdapter[Event] = TypeAdapter(Event)


@dataclass(frozen=True)
class LoneNote:
    """A note of a score, and how the rules of the keyboard end it."""

    begin: float  # s
    key: int
    v: float  # velocity, from 0 to 1
    soft: float  # how far the soft pedal is down at the begin
    end: float = float("inf")  # s
    ended_by: str = ""  # let go | pressed again | stolen
    release: float = UNKNOWN_RELEASE
    pedals: dict[str, float] = field(default_factory=dict)  # at the end
    kept: bool = False  # by the sostenuto pedal at the end


class NoteRules:
    """The rules by which notes begin and end, written down again beside the sequencer that is tested.

    writer: of the instrument
    keys:   that there are
    """

    def __init__(self, writer: KeyWriter, keys: set[int]) -> None:
        self._writer, self._keys = writer, keys
        self._mono, self._polyphony = writer.keyboard.get("mono"), writer.keyboard.get("polyphony")
        self._held = HeldKeys[int]()
        self._parts: dict[int, list[int]] = {}  # that hold a key, each as often as it has pressed it
        self._open: dict[int, LoneNote] = {}  # by the keys that are down
        self._sounding: list[int] = []  # keys that no damper has reached, the oldest first
        self.notes: list[LoneNote] = []

    def follow(self, score: Score) -> list[LoneNote]:
        """Return the notes of a score in the order of their begins."""
        for message in score.messages():
            if message.kind not in ("on", "off"):
                self._move(message)
            elif message.key in self._keys and message.kind == "on":
                self._press(message)
            elif message.key in self._keys:
                parts = self._parts.get(message.key, [])
                if message.part in parts:
                    parts.remove(message.part)
                if not parts:
                    self._end(message.key, message.time, "let go", message.value)
        self.notes += self._open.values()
        return sorted(self.notes, key=lambda note: note.begin)

    def _press(self, message: Message) -> None:
        key, now = message.key, message.time
        self._parts.setdefault(key, []).append(message.part)
        self._end(key, now, "pressed again")
        for other in [k for k in self._open if self._mono and self._group(k) == self._group(key)]:
            self._parts.pop(other, None)
            self._end(other, now, "let go")
        others = [k for k in self._sounding if k != key]
        while self._polyphony and len(others) >= self._polyphony:
            stolen = next((k for k in others if k not in self._open), others[0])
            self._held.kept.discard(stolen)
            self._parts.pop(stolen, None)
            self._end(stolen, now, "stolen")
            others.remove(stolen)
        self._sounding = [*others, key]
        self._held.press(key, message.channels)
        self._open[key] = LoneNote(now, key, message.value, self._held.pedal("soft", key))

    def _group(self, key: int) -> float | None:
        return self._writer.names(key).get(str(self._mono))

    def _end(self, key: int, now: float, ended_by: str, release: float = UNKNOWN_RELEASE) -> None:
        if (note := self._open.pop(key, None)) is None:
            return
        self._held.down.discard(key)
        pedals, kept = self._held.pedals_of(key), key in self._held.kept
        self.notes.append(replace(note, end=now, ended_by=ended_by, release=release, pedals=pedals, kept=kept))
        self._forget_damped(ended_by)

    def _move(self, message: Message) -> None:
        if message.kind == "silence":
            for key in [key for key in self._sounding if self._held.follows(key, message.channels[0])]:
                self._held.kept.discard(key)
                self._parts.pop(key, None)
                self._sounding.remove(key)
                self._end(key, message.time, "stolen")
        elif self._held.move_pedal(message.kind, message.value, message.channels[0]):
            self._forget_damped("")

    def _forget_damped(self, ended_by: str) -> None:
        """Take the keys whose dampers are down from those that sound."""
        if ended_by != "pressed again":
            self._sounding = [k for k in self._sounding if self._held.damper_share(k) == 0.0]


def events_alone(writer: KeyWriter, note: LoneNote, seconds: float) -> Iterator[Event]:
    """Yield the events of a note alone: what its key does when it is pressed, and when the note ends."""
    sequencer = KeySequencer(writer, [note.key])

    def tell(time: float, kind: str, value: float) -> list[KeyEvent]:
        found = sequencer.take(Message(time, kind, note.key, value))
        return [event for event in found if isinstance(event, KeyEvent)]

    tell(note.begin, "soft", note.soft)
    caused = [(note.begin, event) for event in tell(note.begin, "on", note.v)]
    if note.ended_by:
        for name in ("soft", "sustain"):
            tell(note.end, name, note.pedals[name])
        if note.ended_by == "stolen":
            ending = [event for event in sequencer.end(note.key) if isinstance(event, KeyEvent)]
        else:
            ending = tell(note.end, "off", note.release)
        lifted = note.kept or note.ended_by == "pressed again"
        caused += [(note.end, event) for event in ending if not (lifted and event.table["kind"] == "damp")]
    for begin, event in caused:
        time = begin + event.table.get("time", 0.0)
        is_cancelled = event.note and time >= note.end
        if time < seconds - 1e-6 and not is_cancelled:
            yield EVENTS.validate_python(event.table | {"time": time})


class EventCount:
    """The events of a scene, from which those of its notes are taken one by one."""

    def __init__(self, events: list[Event]) -> None:
        self._times: dict[str, list[float]] = {}
        for event in events:
            self._times.setdefault(without_time(event), []).append(event.time)

    def take(self, event: Event) -> bool:
        """Take an event away. Return False if there is none such."""
        times = self._times.get(without_time(event), [])
        nearest = min(times, key=lambda time: abs(time - event.time), default=float("inf"))
        if abs(nearest - event.time) > SAME_TIME:
            return False
        times.remove(nearest)
        return True

    def left(self) -> list[str]:
        """Return the events that have not been taken as text, but for dampers and pitch bends."""
        texts = [f"{time:.6f} s {event}" for event, times in self._times.items() for time in times]
        return [text for text in texts if not any(part in text for part in OF_NO_NOTE)]


def without_time(event: Event) -> str:
    """Return an event but for its time, as text."""
    return event.model_dump_json(exclude={"time"}, exclude_none=True)
