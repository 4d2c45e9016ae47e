"""The queue of events from Python to the audio thread, and the log of what it took."""

import threading
from collections import deque
from collections.abc import Sequence
from typing import Any, NamedTuple, TypeVar

import numpy as np
from pydantic import ValidationError

from engine.argument_checks import checked_integer
from engine.assembly.event_table import EventRow
from engine.kernel.data.enums import EventKind
from engine.live.audio_memory import MAX_FRAMES, AudioMemory
from engine.live.audio_thread import TICKET_MADE
from engine.live.kernels import PUBLISH_EVENT, TAKE_EVENTS, WITHDRAW_EXCHANGE, kernel_of_memory
from engine.live.shared_memory import Slot
from engine.patch.scene import Scene
from engine.patch.tables import ChangeEvent, DampEvent, LiftEvent, PluckEvent, StrikeEvent
from engine.runtime.event_slots import VALUES_PER_EVENT, EventSlot
from engine.wording import describe_violation

EVENTS_PER_ISLAND = 64  # at a time, or …
EVENTS_PER_BODY = 4  # … so many for each body, if that is more: all dampers may move at once
REFUSED_WHY = "refused: "
NO_ROOM_WHY = "dropped: too many on this island"
WITHDRAWN = "withdrawn"
MAX_BEGUN = 4096  # events that are kept though they can no longer be dropped
NO_ROW = EventRow(0, 0, 0, 0, 0, 0)
E = TypeVar("E", StrikeEvent, PluckEvent, DampEvent, LiftEvent, ChangeEvent)


class Entry(NamedTuple):
    """An event that was put into the queue."""

    number: int  # how many were put in before; -1 of what was not
    start: int  # frame
    logged: dict[str, Any]


class RowSet(NamedTuple):
    """Events that begin together, as often as they are wanted: the dampers of a key."""

    number: int  # in the log
    rows: list[EventRow]
    packed: np.ndarray  # int64 [rows, numbers and values], as the audio thread reads them


def make_row_set(number: int, rows: list[EventRow]) -> RowSet:
    """Return events that end notes as a set. number: by which the log knows it"""
    rows = [row._replace(start=0, is_release=True) for row in rows]
    packed = np.zeros((len(rows), len(EventSlot) + VALUES_PER_EVENT), np.int64)
    for n, row in enumerate(rows):
        packed[n, : len(row.numbers)] = row.numbers
        packed[n, len(EventSlot) :] = np.array(row.values).view(np.int64)
    return RowSet(number, rows, packed)


class EventQueue:
    """Puts events into the queue of an audio thread, which never waits for Python, and keeps a log of them.

    Events that find the queue full wait here, in their order, until there is room.
    """

    def __init__(self, memory: AudioMemory, keeps_log: bool = True) -> None:
        self._memory, self._address, self._lock = memory.shared, memory.address, threading.Lock()
        self._owner = memory  # is kept as long as a thread that makes tables may write to the queue
        self._keeps_log = keeps_log
        self._log: list[Entry] = []  # with the frame at which each was taken
        self._pending = deque[Entry]()  # not taken yet, in their order
        self._begun_later: dict[int, Entry] = {}  # taken, and may still be dropped: by index
        self._waiting = deque[tuple[EventRow, np.ndarray | None, int]]()  # for room in the queue
        self._groups = deque[tuple[int, int, np.ndarray]]()  # that may not have begun: index, frame and rows
        self._logged_sets: set[int] = set()
        self._quality_changes = self._drops = self._noted = 0  # changes, drops and taken events that are in the log

    def put(
        self, description: list[Any], row: EventRow, table: np.ndarray | None = None, ticket: np.ndarray | None = None
    ) -> dict[str, Any]:
        """Put an event into the queue. Return its entry in the log, which says later when it was taken.

        description: the event as a person would say it, for the log
        table:       of an exchange of tables: the copies to make; they are kept by who made them
        ticket:      by which it can be withdrawn
        """
        if table is None and (start := checked_frame(row.start)) is not row.start:
            row = row._replace(start=start)
        entry = {"frame": None, "why": description, "row": [*row[:10], int(row.is_release)]}
        with self._lock:
            index = int(self._memory.counters[Slot.WRITE_INDEX]) + len(self._waiting)
            self._pending.append(Entry(index, row.start, entry))
            self._write(row, table, ticket)
        return entry

    def put_group(self, description: list[Any], sets: Sequence[RowSet], frame: int, is_logged: bool = True) -> None:
        """Put sets of events into the queue as one event: all begin at a frame. The log has each set once."""
        if not sets:
            return
        table = np.concatenate([one.packed for one in sets])
        row = EventRow(EventKind.GROUP, 0, 0, 0, checked_frame(frame), len(table), is_release=True)
        with self._lock:
            index = int(self._memory.counters[Slot.WRITE_INDEX]) + len(self._waiting)
            if is_logged:
                logged = [one.number if one.number in self._logged_sets else _numbered_rows(one) for one in sets]
                self._logged_sets.update(one.number for one in sets)
                entry = {"frame": None, "why": description, "row": [*row[:10], 1], "sets": logged}
                self._pending.append(Entry(index, row.start, entry))
            self._groups.append((index, frame, table))
            self._write(row, table, None)

    def put_unlogged(self, row: EventRow) -> None:
        """Put an event into the queue that is in no log."""
        with self._lock:
            self._write(row, None, None)

    def _write(self, row: EventRow, table: np.ndarray | None, ticket: np.ndarray | None) -> None:
        """Write an event to the queue, behind those that wait for room; only one thread at a time may."""
        self._waiting.append((row, table, 0 if ticket is None else int(ticket.ctypes.data)))
        self._drain()

    def _fill(self) -> None:
        """Write events that wait for room to the queue, as many as it has room for. What was taken, but not noted yet,
        is not written over."""
        size = len(self._memory.events)
        while self._waiting:
            index = int(self._memory.counters[Slot.WRITE_INDEX])
            if index - self._noted >= size:
                return
            row, table, ticket = self._waiting.popleft()
            address = 0 if table is None else table.ctypes.data
            self._memory.events[index % size] = *row.numbers, address, ticket, 0, 0
            self._memory.values[index % size] = row.values
            kernel_of_memory(PUBLISH_EVENT)(self._address)

    def fill(self) -> None:
        """Write events that wait for room to the queue. The thread that renders may call this before a block: it takes
        what the queue holds, as long as it has room for it."""
        with self._lock:
            left = len(self._waiting) + 1
            while len(self._waiting) not in (0, left):
                left = len(self._waiting)
                kernel_of_memory(TAKE_EVENTS)(self._address)
                self._drain()

    def refuse(self, description: list[Any], reason: str) -> None:
        """Note that an event was not put in, as it is impossible."""
        with self._lock:
            why = [*description, REFUSED_WHY + reason]
            self._keep(Entry(-1, 0, {"frame": None, "why": why, "row": list(NO_ROW[:10])}))

    def _keep(self, entry: Entry) -> None:
        """Keep an entry of the log, if there is one."""
        if self._keeps_log:
            self._log.append(entry)

    def withdraw(self, entry: dict[str, Any], ticket: np.ndarray) -> bool:
        """Withdraw an exchange of tables, unless it was made; it is in no log then. Return True if it is withdrawn."""
        kernel_of_memory(WITHDRAW_EXCHANGE)(int(ticket.ctypes.data))
        if ticket[1] == TICKET_MADE:
            return False
        entry["why"] = [WITHDRAWN]
        return True

    def entries(self) -> list[dict[str, Any]]:
        """The log up to now: events that were taken or dropped, and changes of quality, in the order in which they were
        done: changes of quality at the end of a block, events at the beginning of one."""
        with self._lock:
            self._drain()
            return _in_order(self._log)

    def take_entries(self) -> list[dict[str, Any]]:
        """Take the part of the log that nothing changes any more out of memory: what was done before anything that may
        still be dropped or withdrawn."""
        with self._lock:
            now = int(self._memory.counters[Slot.FRAME])  # before it is noted what was dropped up to now
            self._drain()
            open_frames = [e.logged["frame"] for e in self._log if e.start >= now and e.logged["frame"] is not None]
            until = min([now, *open_frames])
            final = [e for e in self._log if e.logged["frame"] is None or e.logged["frame"] < until]
            taken = {id(e) for e in final}
            self._log = [e for e in self._log if id(e) not in taken]
            return _in_order(final)

    def pending(self) -> int:
        """Number of events that the audio thread has not taken yet."""
        with self._lock:
            self._drain()
            return len(self._pending)

    def dropped(self) -> int:
        """Number of events that were dropped, or ended early for want of room."""
        return int(self._memory.counters[Slot.DISPLACED] + self._memory.counters[Slot.DROPPED])

    def _drain(self) -> None:
        """Note the frames of events that have been taken, events that were dropped, and the changes of quality; then
        there is room for events that wait."""
        counters, events, qualities = self._memory.counters, self._memory.events, self._memory.quality_log
        taken, changes = int(counters[Slot.READ_INDEX]), int(counters[Slot.QUALITY_CHANGES])
        for n in range(max(self._quality_changes, changes - len(qualities)), changes):
            frame, level = qualities[n % len(qualities)].tolist()
            row = list(NO_ROW._replace(kind=int(EventKind.QUALITY), target_begin=level)[:10])
            self._keep(Entry(-1, 0, {"frame": frame, "why": ["quality", level], "row": row}))
        self._quality_changes = changes
        while self._pending and self._pending[0].number < taken:
            entry = self._pending.popleft()
            entry.logged["frame"] = int(events[entry.number % len(events), EventSlot.TAKEN_AT])
            if self._keeps_log:
                self._begun_later[entry.number] = entry
            self._keep(entry)
        self._noted, now = taken, int(counters[Slot.FRAME])
        while self._groups and self._groups[0][0] < taken:
            index, start, _ = self._groups[0]  # it is read in the block that takes it, or later
            if now <= max(start, int(events[index % len(events), EventSlot.TAKEN_AT])):
                break
            self._groups.popleft()
        self._note_drops()
        self._fill()

    def _note_drops(self) -> None:
        """Note the events that were dropped after they were taken, as their island had no room for them."""
        drops, dropped = int(self._memory.counters[Slot.DROPPED]), self._memory.dropped
        for n in range(max(self._drops, drops - len(dropped)), drops):
            entry = self._begun_later.get(int(dropped[n % len(dropped)]))
            if entry is not None:
                entry.logged["frame"] = None
                entry.logged["why"].append(NO_ROOM_WHY)
        self._drops = drops
        if len(self._begun_later) > 2 * MAX_BEGUN:
            now = int(self._memory.counters[Slot.FRAME])
            self._begun_later = {n: entry for n, entry in self._begun_later.items() if entry.start >= now}


def _in_order(entries: Sequence[Entry]) -> list[dict[str, Any]]:
    """Return what was not withdrawn, in the order in which it was done."""
    kept = [entry.logged for entry in entries if entry.logged["why"] != [WITHDRAWN]]
    return sorted(kept, key=lambda logged: -1 if logged["frame"] is None else logged["frame"])


def _numbered_rows(one: RowSet) -> list[Any]:
    """Return a set as the log has it where it comes first."""
    return [one.number, [[*row[:10], int(row.is_release)] for row in one.rows]]


def make_event(of: type[E], said_as: str | None = None, **keys: Any) -> E:
    """An event of now. Raises ValueError, in a line, if a number is out of range. said_as: the parameter whose
    name is said."""
    try:
        return of.model_validate({"time": 0.0} | keys)
    except ValidationError as error:
        fault = error.errors()[0]
        name, value = str(fault["loc"][-1]), fault["input"]
        is_parameter = said_as is not None and said_as.endswith(f".{name}")
        name = "seconds" if name == "duration" else str(said_as) if is_parameter else name
        shown = f"{value:g}" if isinstance(value, int | float) and abs(value) < MAX_FRAMES**8 else repr(value)
        raise ValueError(f"{name} = {shown} is out of range; {describe_violation(fault)}") from None


def checked_frame(value: int) -> int:
    """When something is to be done. Raises TypeError or ValueError if that is no frame."""
    frame = checked_integer("frame", value)
    if not 0 <= frame <= MAX_FRAMES:
        raise ValueError(f"frame is out of range; give 0, which means at once, to {MAX_FRAMES}")
    return frame


def event_capacity(scene: Scene, is_instrument: bool) -> int:
    """Return the number of events that each subsystem can hold at a time."""
    return max(EVENTS_PER_ISLAND, EVENTS_PER_BODY * len(scene.body) if is_instrument else 0)
