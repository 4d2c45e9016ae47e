"""New values of live parameters that tables are made of: built here, exchanged by the audio thread."""

import math
from collections.abc import Mapping, Sequence
from typing import Any

from engine.argument_checks import checked_number
from engine.build.table_changes import MAX_STEPS, Exchange, NewValue, TableChanges, scored_changes
from engine.faults import BuildError, Fault
from engine.kernel.codes import EventKind
from engine.live.audio_memory import QUEUE_SIZE, AudioMemory
from engine.live.event_queue import EventQueue
from engine.live.shared_memory import Slot
from engine.patch.live_parameters import LivePath, current_path, explain_unknown
from engine.patch.scene import Scene
from engine.patch.tables import MAX_SECONDS

MOST_WAITING = QUEUE_SIZE - 2 * MAX_STEPS  # exchanges: one more change has room


class ParameterQueue:
    """Builds the tables of live parameters, and puts their exchanges into the queue of the audio thread.

    paths: of the live parameters of a player; tables: of what it plays; queue, memory: its own
    """

    def __init__(
        self, paths: Mapping[str, LivePath], tables: TableChanges, queue: EventQueue, memory: AudioMemory
    ) -> None:
        self._paths, self._tables, self._queue, self._shared = paths, tables, queue, memory.shared
        self._values: dict[str, float] = {}  # of those that glide in the audio thread

    def checked_value(self, parameter: str, value: float) -> NewValue:
        """A value as it can be queued. Raises KeyError if there is no such parameter, TypeError, ValueError."""
        name = current_path(self._paths, parameter)
        if name not in self._paths:
            raise KeyError(explain_unknown(parameter, list(self._paths)))
        return NewValue(self._paths[name], name, checked_number(name, value))

    def keep(self, parameter: str, value: float) -> None:
        """Remember what a parameter that glides in the audio thread has been given."""
        self._values[parameter] = value

    def value(self, parameter: str) -> float:
        """The value of a parameter: where it glides to. Raises KeyError if there is no such parameter."""
        path = self._paths[parameter]
        if path.is_glided:
            return self._values.get(parameter, self._tables.value(path))
        return self._tables.value(path)

    def put(self, values: Sequence[NewValue], seconds: float, frame: int) -> None:
        """Build the tables of values, and let the audio thread exchange them; if it has too many before it, they are
        dropped, and that is said. Raises ValueError (BuildError, CannotExchange)."""
        for _, name, value in values:
            if not (0.0 <= seconds <= MAX_SECONDS and math.isfinite(value)):
                raise ValueError(f"{name} = {value:g} in {seconds:g} s is out of range; 0 to {MAX_SECONDS:g} s")
        with self._tables.lock:
            if self._queue.pending() + int(self._shared[Slot.WAITING_TUNINGS]) > MOST_WAITING:
                self._queue.refuse(["set", *_named(values)])
                return
            if (
                self._shared[Slot.READ_INDEX] == self._shared[Slot.WRITE_INDEX]
                and not self._shared[Slot.WAITING_TUNINGS]
            ):
                self._tables.forget()
            for step in self._tables.steps(values, seconds, max(frame, int(self._shared[Slot.FRAME]))):
                self._put_exchange("set", step)

    def put_score(self, scene: Scene) -> None:
        """Put the changes of tables that a score asks for into the queue; they wait there for their frames. Raises
        BuildError if they are too many."""
        changes, count = scored_changes(scene, self._tables.samplerate), 0
        for change in changes:
            count += len(steps := self._tables.steps(change.values, change.seconds, change.frame))
            if count > MOST_WAITING:
                message = f"its changes of {change.values[0].parameter} and others are too many to play live"
                raise BuildError(Fault("event", f"{message}; render it, or shorter durations"))
            for step in steps:
                self._put_exchange("score", step)

    def _put_exchange(self, why: str, step: Exchange) -> None:
        """Let the audio thread do an exchange."""
        table = step.copies.table
        row = (EventKind.TUNE, step.island, len(table), step.islands, table.ctypes.data, step.due, 0.0, 0.0)
        self._queue.put([why, *_named(step.values)], row)


def _named(values: Sequence[NewValue]) -> list[Any]:
    """Values as the log has them: name and value; of several, a table of these."""
    if len(values) == 1:
        return [values[0].parameter, values[0].value]
    return [{new.parameter: new.value for new in values}]
