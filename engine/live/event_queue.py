"""The queue of events from Python to the audio thread, and the log of what it took."""

import threading
from typing import Any, TypeVar

import numpy as np
from pydantic import ValidationError

from engine.argument_checks import checked_integer
from engine.assembly.event_table import EventRow
from engine.kernel.data.enums import EventKind
from engine.live.audio_memory import MAX_FRAMES, QUEUE_SIZE, AudioMemory
from engine.live.kernels import PUBLISH_EVENT, kernel_of_memory
from engine.live.shared_memory import Slot
from engine.patch.scene import Scene
from engine.patch.tables import ChangeEvent, DampEvent, StrikeEvent
from engine.runtime.event_slots import DROPPED, EventSlot
from engine.wording import describe_violation

EVENTS_PER_ISLAND = 64  # at a time, or …
EVENTS_PER_BODY = 4  # … so many for each body, if that is more: all dampers may move at once
DROPPED_WHY, REFUSED_WHY = "dropped: too many at once", "refused: "
NO_ROW = EventRow(0, 0, 0, 0, 0, 0)
E = TypeVar("E", StrikeEvent, DampEvent, ChangeEvent)


class EventQueue:
    """Puts events into the queue of an audio thread, which never waits for Python, and keeps a log of them."""

    def __init__(self, memory: AudioMemory) -> None:
        self._memory, self._address, self._lock = memory.shared, memory.address, threading.Lock()
        self._log: list[dict[str, Any]] = []  # with the frame at which each was taken
        self._pending: list[tuple[int, dict[str, Any]]] = []  # not taken yet, by their index in the queue
        self._quality_changes = 0  # that are in the log

    def put(self, description: list[Any], row: EventRow, table: np.ndarray | None = None) -> None:
        """Put an event into the queue. While that is full, all one could do is wait: it is dropped, and that is said.

        description: the event as a person would say it, for the log
        table:       of an exchange of tables: the copies to make; they are kept by who made them
        """
        if table is None:
            row = row._replace(start=checked_frame(row.start))
        logged = [*map(int, row[: EventSlot.TABLE]), *row[EventSlot.TABLE :]]
        with self._lock:
            index = int(self._memory.counters[Slot.WRITE_INDEX])
            if self._write(row, table):
                self._pending.append((index, {"why": description, "row": logged}))
            else:
                self._log.append({"frame": None, "why": [*description, DROPPED_WHY], "row": logged})
            self._drain()

    def put_unlogged(self, row: EventRow) -> None:
        """Put an event into the queue that is in no log; drop it if there is no room."""
        with self._lock:
            self._write(row, None)

    def _write(self, row: EventRow, table: np.ndarray | None) -> bool:
        """Write an event to the queue; only one thread at a time may. Return True if there was room."""
        counters = self._memory.counters
        index = int(counters[Slot.WRITE_INDEX])
        if index - int(counters[Slot.READ_INDEX]) >= QUEUE_SIZE:
            return False
        numbers, address = row[: EventSlot.TABLE], 0 if table is None else table.ctypes.data
        self._memory.events[index % QUEUE_SIZE] = *numbers, address, 0
        self._memory.values[index % QUEUE_SIZE] = row[EventSlot.TABLE :]
        kernel_of_memory(PUBLISH_EVENT)(self._address)
        return True

    def drop(self, description: list[Any]) -> None:
        """Note that an event was not put in, as there is no room for it."""
        self._note([*description, DROPPED_WHY])

    def refuse(self, description: list[Any], reason: str) -> None:
        """Note that an event was not put in, as it is impossible."""
        self._note([*description, REFUSED_WHY + reason])

    def _note(self, description: list[Any]) -> None:
        with self._lock:
            self._log.append({"frame": None, "why": description, "row": list(NO_ROW)})

    def entries(self) -> list[dict[str, Any]]:
        """The log up to now: events that were taken or dropped, and changes of quality, in the order in which they were
        done: changes of quality at the end of a block, events at the beginning of one."""
        with self._lock:
            self._drain()
            return sorted(self._log, key=lambda e: -1 if e["frame"] is None else e["frame"])

    def pending(self) -> int:
        """Number of events that the audio thread has not taken yet."""
        with self._lock:
            self._drain()
            return len(self._pending)

    def dropped(self) -> int:
        """Number of events that were dropped."""
        lost = [str(entry["why"][-1]) for entry in self.entries() if entry["frame"] is None]
        return sum(not reason.startswith(REFUSED_WHY) for reason in lost)

    def _drain(self) -> None:
        """Note the frames of events that have been taken, and the changes of quality."""
        counters, events, qualities = self._memory.counters, self._memory.events, self._memory.quality_log
        taken, changes = int(counters[Slot.READ_INDEX]), int(counters[Slot.QUALITY_CHANGES])
        for n in range(max(self._quality_changes, changes - QUEUE_SIZE), changes):
            frame, level = qualities[n % QUEUE_SIZE].tolist()
            row = list(NO_ROW._replace(kind=int(EventKind.QUALITY), target_begin=level))
            self._log.append({"frame": frame, "why": ["quality", level], "row": row})
        self._quality_changes = changes
        while self._pending and self._pending[0][0] < taken:
            index, entry = self._pending.pop(0)
            frame = int(events[index % QUEUE_SIZE, EventSlot.TAKEN_AT])
            if frame == DROPPED:
                entry["why"].append("dropped: too many on this island")
            self._log.append({"frame": None if frame == DROPPED else frame} | entry)


def make_event(of: type[E], parameter: str | None = None, **keys: Any) -> E:
    """An event of now. Raises ValueError, in a line, if a number is out of range. parameter: whose name is said."""
    try:
        return of.model_validate({"time": 0.0} | keys)
    except ValidationError as error:
        fault = error.errors()[0]
        name, value = str(fault["loc"][-1]), fault["input"]
        is_parameter = parameter is not None and parameter.endswith(f".{name}")
        name = "seconds" if name == "duration" else str(parameter) if is_parameter else name
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
