"""Events that the keys and pedals of an instrument cause: those of a score, and those of live sound."""

from collections import Counter
from collections.abc import Iterator
from typing import Any, NamedTuple

from engine.bodies.table import KeyPath
from engine.instrument.held_keys import ALL, HeldKeys
from engine.instrument.key_names import note_name
from engine.instrument.key_writer import EVENT_REFERENCES, KeyWriter

FULL_VELOCITY = 127.0
UNKNOWN_RELEASE = 64 / FULL_VELOCITY  # how fast a key is let go, from 0 to 1, where that is not known
STEAL_DAMPER = 300.0, 0.03  # of a key that must end: decay rate, 1/s, and how long, s

Table = tuple[dict[str, Any], KeyPath, str]  # an event as in a patch; where in the patch it comes from; the key's name


class Message(NamedTuple):
    """A key is pressed or let go, a pedal is moved, or all notes of a channel end."""

    time: float  # s
    kind: str  # on | off | silence | the name of a pedal
    key: int = 0
    value: float = 0.0  # velocity, or how far the pedal is down, from 0 to 1
    part: int = 0  # of a file, or channel of a port, that plays the key
    channels: tuple[int, ...] = (ALL,)  # whose pedals the key follows; or the one that it is a message of


class KeyEvent(NamedTuple):
    """An event that a key or a pedal causes. Its time counts from the message.

    note: it is cancelled with the note of this number, if it has not begun; 0: it belongs to none
    """

    table: dict[str, Any]
    path: KeyPath
    key: str  # name
    note: int = 0
    is_release: bool = False  # whether it ends a note


class Cancel(NamedTuple):
    """The events of a note that have not begun are forgotten."""

    note: int


def events_of_key(writer: KeyWriter, section: str, key: int, names: dict[str, float]) -> list[Table]:
    """Return the events when a key is pressed ("on") or released ("off"), or those of its dampers ("damper").

    names: what formulas know of the note: v, soft, release
    """
    events: list[Table] = []
    for path, table in writer.tables_at(section, key):
        count = writer.copies_of(key, table)
        for name in EVENT_REFERENCES:
            if isinstance(table.get(name), str):
                count = writer.copies_by_name(name, key, table[name])
        for copy in [None] if count is None else range(1, count + 1):
            event = writer.table_of_copy(section, key, path, table, (copy, count), names)
            events.append((event, path, note_name(key)))
    return events


def waiting_forces(writer: KeyWriter, key: int) -> list[Table]:
    """Return the plucks of a key as forces, whose points plucks of live sound act at."""
    names = {"v": 1.0, "soft": 0.0, "release": UNKNOWN_RELEASE}
    plucks = [one for one in events_of_key(writer, "on", key, names) if one[0].get("kind") == "pluck"]
    return [
        ({k: x for k, x in pluck.items() if k != "time"} | {"start": 0.0}, path, name) for pluck, path, name in plucks
    ]


class KeySequencer:
    """The keys of an instrument, which cause events as messages come in the order of their times.

    writer:   of the instrument, with the keys written
    keys:     that there are
    """

    def __init__(self, writer: KeyWriter, keys: list[int]) -> None:
        self.keys, self._writer = keys, writer
        self._mono, self._polyphony = writer.keyboard.get("mono"), writer.keyboard.get("polyphony")
        self._held = HeldKeys[int]()
        self._holding: dict[int, Counter[int]] = {}  # how often each part has pressed a key that it holds
        self._velocities: dict[int, float] = {}  # of the note of a key
        self._sounding: list[int] = []  # keys whose notes the dampers have not ended, the oldest first
        self.stolen = 0  # notes that ended for want of others

    def rest(self) -> Iterator[KeyEvent]:
        """Yield the events of keys at rest: their dampers are down."""
        for key in self.keys:
            yield from self.damp(key, UNKNOWN_RELEASE)

    def take(self, message: Message) -> Iterator[KeyEvent | Cancel]:
        """Yield what a message causes, in order."""
        key = message.key
        if message.kind == "on":
            self._holding.setdefault(key, Counter())[message.part] += 1
            yield from self._press(message)
        elif message.kind == "off":
            holding = self._holding.get(key, Counter[int]())
            holding[message.part] = max(0, holding[message.part] - 1)
            if not holding.total() and key in self._held.down:
                yield from self._release(key, message.value)
        elif message.kind == "silence":
            yield from self.silence(message.channels[0])
        else:
            for moved in self.move_pedal(message.kind, message.value, message.channels[0]):
                yield from self.move_dampers(*moved)

    @property
    def together(self) -> bool:
        """True if all keys follow the pedals of all channels."""
        return self._held.together

    @together.setter
    def together(self, together: bool) -> None:
        self._held.together = together

    def follows(self, key: int, channel: int) -> bool:
        """True if a key follows what moves on a channel."""
        return self._held.follows(key, channel)

    def pedal_moves(self) -> list[tuple[str, float, int]]:
        """Return the moves of pedals, each with its channel, that make them as they are."""
        return self._held.pedal_moves()

    def release_part(self, part: int) -> Iterator[KeyEvent | Cancel]:
        """Let go of all keys that a part holds, however often it has pressed them."""
        for key, holding in list(self._holding.items()):
            if holding[part]:
                holding[part] = 1
                yield from self.take(Message(0.0, "off", key, UNKNOWN_RELEASE, part))

    def silence(self, channel: int = ALL) -> Iterator[KeyEvent | Cancel]:
        """End all notes of a channel soon, whatever holds them."""
        for key in list(self._sounding):
            if self._held.follows(key, channel):
                yield from self.end(key)

    # --- keys

    def _press(self, message: Message) -> Iterator[KeyEvent | Cancel]:
        key, v = message.key, message.value
        if key in self._held.down:
            yield from self._let_go(key, UNKNOWN_RELEASE)
        yield from self._make_room(key)
        self._held.press(key, message.channels)
        self._velocities[key] = v
        self._sounding = [*(k for k in self._sounding if k != key), key]
        yield from self.lift(key)
        names = {"v": v, "soft": self._held.pedal("soft", key), "release": UNKNOWN_RELEASE}
        for table, path, name in events_of_key(self._writer, "on", key, names):
            yield KeyEvent(table, path, name, number_of_note(key) if table.get("kind") == "change" else 0)

    def _release(self, key: int, release: float) -> Iterator[KeyEvent | Cancel]:
        yield from self._let_go(key, release)
        self._held.down.discard(key)
        yield from self.damp(key, release)

    def _let_go(self, key: int, release: float) -> Iterator[KeyEvent | Cancel]:
        """Yield what a key does when it is let go, but for its dampers. What it was to change later does not begin."""
        yield Cancel(number_of_note(key))
        names = {"v": self._velocities[key], "soft": self._held.pedal("soft", key), "release": release}
        for one in events_of_key(self._writer, "off", key, names):
            yield KeyEvent(*one, is_release=True)

    def _make_room(self, key: int) -> Iterator[KeyEvent | Cancel]:
        """End the notes that cannot go on beside a new one: keys of its group are let go, and one too many ends."""
        if self._mono is not None:
            group = self._writer.names(key).get(self._mono)
            for other in [k for k in self._held.down if k != key]:
                if self._writer.names(other).get(self._mono) == group:
                    self._holding.pop(other, None)
                    yield from self._release(other, UNKNOWN_RELEASE)
        others = [k for k in self._sounding if k != key]
        while self._polyphony and len(others) >= self._polyphony:
            oldest = next((k for k in others if k not in self._held.down), others[0])
            self.stolen += 1
            yield from self.end(oldest)
            others.remove(oldest)

    def end(self, key: int) -> Iterator[KeyEvent | Cancel]:
        """End a note soon, whatever the pedals say: a bow is lifted, and dampers come down."""
        if key in self._held.down:
            yield from self._let_go(key, UNKNOWN_RELEASE)
        self._held.down.discard(key)
        self._held.kept.discard(key)
        self._holding.pop(key, None)
        self._sounding = [k for k in self._sounding if k != key]
        yield from self.damp(key, UNKNOWN_RELEASE)
        sigma, seconds = STEAL_DAMPER
        for event in self._dampers(key, UNKNOWN_RELEASE, "damp"):  # the newer counts, and that of the key goes on
            yield event._replace(table=event.table | {"sigma": sigma, "duration": seconds})

    # --- dampers and pedals

    def _dampers(self, key: int, release: float, kind: str) -> Iterator[KeyEvent]:
        names = {"release": release, "v": 0.0, "soft": 0.0}
        for table, path, name in events_of_key(self._writer, "damper", key, names):
            yield KeyEvent(table | {"kind": kind}, path, name, is_release=True)

    def lift(self, key: int) -> Iterator[KeyEvent]:
        """Yield the events that lift the dampers of a key."""
        for event in self._dampers(key, UNKNOWN_RELEASE, "lift"):
            yield event._replace(table={name: event.table[name] for name in ("kind", "body") if name in event.table})

    def damp(self, key: int, release: float) -> Iterator[KeyEvent]:
        """Yield the events that put the dampers of a key down as far as the pedals let them."""
        share = self._held.damper_share(key)
        if share == 0.0:
            return
        self._sounding = [k for k in self._sounding if k != key]
        for event in self._dampers(key, release, "damp"):
            sigma = event.table.get("sigma")
            if isinstance(sigma, int | float):  # as it is in a patch without faults
                event = event._replace(table=event.table | {"sigma": sigma * share})
            yield event

    def move_pedal(self, name: str, value: float, channel: int = ALL) -> list[tuple[int, float]]:
        """Move a pedal of a channel. Return the keys whose dampers move with it, each with the share of their force
        that it leaves them; 0 lifts them."""
        kept = self._held.kept
        if not self._held.move_pedal(name, value, channel):
            return []
        concerned = [key for key in (self.keys if name == "sustain" else sorted(kept)) if not self._held.keeps(key)]
        free = [key for key in concerned if self._held.follows(key, channel)]
        moved = [(key, self._held.damper_share(key)) for key in free]
        damped = {key for key, share in moved if share > 0.0}
        self._sounding = [key for key in self._sounding if key not in damped]
        return moved

    def move_dampers(self, key: int, share: float) -> Iterator[KeyEvent]:
        """Yield the events by which a pedal moves the dampers of a key."""
        return self.damp(key, UNKNOWN_RELEASE) if share else self.lift(key)


def number_of_note(key: int) -> int:
    """Return the number by which events belong to the note of a key."""
    return key + 1
