"""New values of live parameters that tables are made of: built here, exchanged by the audio thread."""

import math
import threading
from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

from engine.argument_checks import checked_number
from engine.assembly.event_table import EventRow
from engine.assembly.table_changes import MAX_STEPS, Exchange, NewValue, TableChanges, scored_changes
from engine.faults import BuildError, Fault
from engine.kernel.data.enums import EventKind
from engine.live.audio_memory import QUEUE_SIZE
from engine.live.event_queue import EventQueue
from engine.live.shared_memory import SharedMemory, Slot
from engine.patch.live_parameters import LivePath, current_path, explain_unknown
from engine.patch.scene import Scene
from engine.patch.tables import MAX_SECONDS

GLIDE_BUDGET = 0.5  # s, for the tables of a glide that are made beside the sound; it has no more steps than that allows
MOST_WAITING = QUEUE_SIZE - 2 * MAX_STEPS  # exchanges: one more change has room


class Request(NamedTuple):
    """New values whose tables are to be made together."""

    values: tuple[NewValue, ...]
    seconds: float  # of the glide
    frame: int
    thread: int  # that set it


class ParameterQueue:
    """Builds the tables of live parameters, and puts their exchanges into the queue of the audio thread.

    Nobody waits for tables but the thread that renders, and that only if it has set something itself: so a program that
    sets and renders in turn gets the same samples each time. It then waits for all earlier requests, too. All
    else is made by another thread, beside the sound.

    paths: of the live parameters of a player; tables: of what it plays; queue, memory: its own
    """

    def __init__(
        self, paths: Mapping[str, LivePath], tables: TableChanges, queue: EventQueue, memory: SharedMemory
    ) -> None:
        self._paths, self._tables, self._queue, self._counters = paths, tables, queue, memory.counters
        self._values: dict[str, float] = {}  # of those that glide in the audio thread
        self._requests: list[Request] = []  # in the order in which their tables are made
        self._current: Request | None = None  # whose tables are being made
        self._lock = threading.Lock()  # of the requests
        self._worker: threading.Thread | None = None
        self.renderer: int | None = threading.get_ident()  # the thread that renders; None: that of a device
        self.refused: dict[str, str] = {}  # parameters that could not have their last value, and why
        for path in paths.values():
            tables.range_of(path)  # to find it takes 10 ms a table the first time, which `set` then need not wait for

    def checked_value(self, parameter: str, value: float) -> NewValue:
        """A value as it can be queued. Raises KeyError if there is no such parameter, TypeError, ValueError."""
        name = self._present_name(parameter)
        new = NewValue(self._paths[name], name, checked_number(name, value))
        self._tables.check_range(new)
        return new

    def _present_name(self, parameter: str) -> str:
        """The name that a parameter has now. Raises KeyError if there is no such parameter."""
        name = current_path(self._paths, parameter)
        if name not in self._paths:
            raise KeyError(explain_unknown(parameter, list(self._paths)))
        return name

    def keep(self, parameter: str, value: float) -> None:
        """Remember what a parameter that glides in the audio thread has been given."""
        self._values[parameter] = value

    def value(self, parameter: str) -> float:
        """The value of a parameter: where it glides to. Raises KeyError if there is no such parameter."""
        name = self._present_name(parameter)
        path = self._paths[name]
        if path.is_glided:
            return self._values.get(name, self._tables.value(path))
        with self._lock:
            requested = [request.values for request in (self._current, *self._requests) if request is not None]
        wanted = [new.value for values in requested for new in values if new.path == path]
        return wanted[-1] if wanted else self._tables.value(path)

    @property
    def tables(self) -> TableChanges:
        """Builder of the tables."""
        return self._tables

    # --- requests

    def put(self, values: Sequence[NewValue], seconds: float, frame: int) -> None:
        """Ask for the tables of values; what waits for older ones of the same parameters is forgotten. Raises
        ValueError (BuildError) if it is soon seen that they are impossible."""
        if not 0.0 <= seconds <= MAX_SECONDS:
            raise ValueError(f"seconds = {seconds:g} is out of range; give 0 to {MAX_SECONDS:g}")
        self._tables.check(values)
        request = Request(tuple(values), seconds, frame, threading.get_ident())
        with self._lock:
            self._requests = with_newest(self._requests, request)
        if self.renderer != request.thread or self._counters[Slot.CALLS]:
            self._make_beside()

    def before_block(self) -> None:
        """Compute the coefficients that the rendering thread has requested; others follow in the background."""
        self.renderer = threading.get_ident()
        with self._lock:
            asking = {request.thread for request in (self._current, *self._requests) if request is not None}
        if self.renderer in asking:
            self.make_tables()
        elif asking:
            self._make_beside()

    def leave_to(self, renderer: int | None) -> None:
        """Let a thread render from now on; None: that of a device, and all tables are made beside."""
        self.renderer = renderer
        if renderer is None:
            self._make_beside()

    # --- what is made

    def make_tables(self, budget: float = math.inf) -> None:
        """Compute all requested coefficients, and let the audio thread exchange them. budget: seconds for a glide"""
        while True:
            with self._tables.lock:
                with self._lock:
                    self._current = self._requests.pop(0) if self._requests else None
                if self._current is None:
                    return
                names, reason = [new.parameter for new in self._current.values], ""
                try:
                    self._make(self._current, budget)
                except Exception as error:  # whatever it is, the sound goes on
                    reason = str(error) or type(error).__name__
                    self._queue.refuse(["set", *_named(self._current.values)], reason)
                finally:
                    self._current = None
                kept = {name: why for name, why in self.refused.items() if name not in names}
                self.refused = kept | dict.fromkeys(names, reason) if reason else kept

    def _make_beside(self) -> None:
        """Let a thread compute the requested coefficients, unless one does."""
        with self._lock:
            if self._worker is None and self._requests:
                self._worker = threading.Thread(target=self._work, name="tables", daemon=True)
                self._worker.start()

    def _work(self) -> None:
        """Make tables until there are none to make."""
        while True:
            self.make_tables(GLIDE_BUDGET)
            with self._lock:
                if not self._requests:
                    self._worker = None
                    return

    def _make(self, request: Request, budget: float) -> None:
        """Build the tables of values, and let the audio thread exchange them; if it has too many before it, they are
        dropped, and that is said. Raises ValueError (BuildError, CannotExchange)."""
        waiting = int(self._counters[Slot.EXCHANGES_WAITING])
        if self._queue.pending() + waiting > MOST_WAITING:
            self._queue.drop(["set", *_named(request.values)])
            return
        if self._counters[Slot.READ_INDEX] == self._counters[Slot.WRITE_INDEX] and not waiting:
            self._tables.forget()
        for step in self._tables.steps(request.values, request.seconds, request.frame, self._now, budget):
            self._put_exchange("set", step)

    def _now(self) -> int:
        """The frame that the sound has reached."""
        return int(self._counters[Slot.FRAME])

    def put_score(self, scene: Scene) -> None:
        """Put the changes of tables that a score asks for into the queue; they wait there for their frames. Raises
        BuildError if they are too many."""
        changes, count = scored_changes(scene, self._tables.samplerate), 0
        for change in changes:
            count += len(steps := self._tables.steps(change.values, change.seconds, change.frame))
            if count > MOST_WAITING:
                message = (
                    f"its score changes {change.values[0].parameter} and other parameters too often to be played live"
                )
                raise BuildError(Fault("event", f"{message}; render it, or give shorter durations"))
            for step in steps:
                self._put_exchange("score", step)

    def _put_exchange(self, why: str, step: Exchange) -> None:
        """Let the audio thread do an exchange."""
        table = step.copies.table
        row = EventRow(EventKind.EXCHANGE_TABLES, 0, step.island, step.island + step.islands, step.due, len(table))
        self._queue.put([why, *_named(step.values)], row, table)


def with_newest(requests: Sequence[Request], newest: Request) -> list[Request]:
    """Requests with another, without what they ask for the same parameters: it takes the place of one of the same
    parameters, so that none waits for ever."""
    names, kept, is_placed = {new.parameter for new in newest.values}, list[Request](), False
    for request in requests:
        rest = tuple(new for new in request.values if new.parameter not in names)
        if not rest and not is_placed and len(request.values) == len(names):
            kept.append(newest)
            is_placed = True
        elif rest:
            kept.append(request._replace(values=rest))
    return kept if is_placed else [*kept, newest]


def _named(values: Sequence[NewValue]) -> list[Any]:
    """Values as the log has them: name and value; of several, a table of these."""
    if len(values) == 1:
        return [values[0].parameter, values[0].value]
    return [{new.parameter: new.value for new in values}]
