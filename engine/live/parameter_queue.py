"""New values of live parameters that tables are made of: built here, exchanged by the audio thread."""

import math
import threading
from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np

from engine.argument_checks import checked_number
from engine.assembly.event_table import EventRow
from engine.assembly.scored_changes import plan_score
from engine.assembly.table_changes import Exchange, NewValue, TableChanges
from engine.faults import BuildError, Fault
from engine.kernel.data.enums import EventKind
from engine.live.audio_memory import MAX_FRAMES
from engine.live.event_queue import EventQueue
from engine.live.shared_memory import SharedMemory, Slot
from engine.patch.frames import nearest_frame
from engine.patch.live_parameters import LivePath, explain_unknown
from engine.patch.scene import Scene
from engine.patch.tables import MAX_SECONDS

GLIDE_BUDGET = 0.5  # s, for the tables of a glide that are made beside the sound; it has no more steps than that allows
MADE_AHEAD = 0.5  # s before they are due, at which tables are made beside the sound
MOST_WAITING = 1024  # exchanges of a score, whose tables are made before it begins


class Request(NamedTuple):
    """New values that are to be planned; without any, the changes of a note that have not begun are forgotten."""

    values: tuple[NewValue, ...]
    seconds: float  # of the glide
    frame: int
    thread: int  # that set it
    note: int  # that it belongs to; 0: none


class ParameterQueue:
    """Plans changes of live parameters that tables are made of, builds the tables, and puts their exchanges into the
    queue of the audio thread.

    Nobody waits for tables but the thread that renders, and that only if it has set something itself: so a program that
    sets and renders in turn gets the same samples each time. It then waits for all that is due in the block. All else
    is made by another thread, beside the sound, soon before it is due.

    paths: of the live parameters of a player; tables: of what it plays; queue, memory: its own
    """

    def __init__(
        self, paths: Mapping[str, LivePath], tables: TableChanges, queue: EventQueue, memory: SharedMemory
    ) -> None:
        self._paths, self._tables, self._queue, self._counters = paths, tables, queue, memory.counters
        self._values: dict[str, float] = {}  # that parameters have been given last
        self._tickets: dict[int, tuple[np.ndarray, dict[str, Any]]] = {}  # of exchanges, by id; and entries of the log
        self._requests: list[Request] = []  # in the order in which they were set
        self._has_notes = False  # whether changes belong to notes
        self._wake = threading.Condition()  # of the requests, and of the worker
        self._worker: threading.Thread | None = None
        self.renderer: int | None = threading.get_ident()  # the thread that renders; None: that of a device
        self.refused: dict[str, str] = {}  # parameters that could not have their last value, and why
        for path in paths.values():
            tables.range_of(path)  # to find it takes 10 ms a table the first time, which `set` then need not wait for

    def checked_value(self, parameter: str, value: float) -> NewValue:
        """A value as it can be queued. Raises KeyError if there is no such parameter, TypeError, ValueError."""
        new = NewValue(self._path_of(parameter), parameter, checked_number(parameter, value))
        self._tables.check_range(new)
        return new

    def _path_of(self, parameter: str) -> LivePath:
        """The path of a parameter. Raises KeyError, which names those that there are, if there is no such parameter."""
        if parameter not in self._paths:
            raise KeyError(explain_unknown(parameter, list(self._paths)))
        return self._paths[parameter]

    def keep(self, parameter: str, value: float) -> None:
        """Remember what a parameter that glides in the audio thread has been given."""
        self._values[parameter] = value

    def value(self, parameter: str) -> float:
        """The value of a parameter: where it glides to. Raises KeyError if there is no such parameter."""
        path = self._path_of(parameter)
        return self._values.get(parameter, self._tables.value(path))

    @property
    def tables(self) -> TableChanges:
        """Builder of the tables."""
        return self._tables

    # --- what is planned

    def put(self, values: Sequence[NewValue], seconds: float, frame: int, note: int = 0) -> None:
        """Plan a change. Raises ValueError (BuildError) if it is soon seen that its values are impossible.

        note: with which it is cancelled if it has not begun; 0: none
        """
        if not 0.0 <= seconds <= MAX_SECONDS:
            raise ValueError(f"seconds = {seconds:g} is out of range; give 0 to {MAX_SECONDS:g}")
        tables = {(new.path.section, new.path.number) for new in values}
        set_before = [
            NewValue(path, name, value)
            for name, value in list(self._values.items())  # another thread may set one meanwhile
            if not (path := self._paths[name]).is_glided and (path.section, path.number) in tables
        ]
        self._tables.check(values, set_before)
        self._values |= {new.parameter: new.value for new in values}
        self._has_notes = self._has_notes or note != 0
        self._request(Request(tuple(values), seconds, frame, threading.get_ident(), note))

    def cancel(self, note: int, frame: int) -> None:
        """Forget the changes of a note that have not begun before a frame."""
        if self._has_notes:
            self._request(Request((), 0.0, frame, threading.get_ident(), note))

    def _request(self, request: Request) -> None:
        with self._wake:
            self._requests.append(request)
        if self.renderer != request.thread or self._counters[Slot.CALLS]:
            self._make_beside()

    def _plan_requests(self) -> None:
        """Plan what was set. Whoever does so has the lock of the tables."""
        with self._wake:
            requests, self._requests = self._requests, []
        for values, seconds, frame, thread, note in requests:
            now = self._now()
            if not values:
                self._tables.cancel(note, max(frame, now), self._withdraw)
                continue
            if frame == 0 or frame < now:  # at once: what waits for older ones of the same parameters is forgotten
                self._tables.forget_late([new.parameter for new in values], now)
            change = self._tables.plan(values, seconds, max(frame, now), thread, note=note)
            self._tables.withdraw(change.written, change.frame, self._withdraw)

    def plan_score(self, scene: Scene) -> None:
        """Plan the changes of tables that a score asks for, and make them: they wait for their frames. Raises
        BuildError if they are too many, or impossible."""
        count = plan_score(self._tables, scene)
        if count > MOST_WAITING:
            message = "its score changes parameters of bodies too often to be played live"
            raise BuildError(Fault("event", f"{message}; render it, or give shorter durations"))
        for exchange in self._tables.due(MAX_FRAMES):
            self._put_exchange(exchange)

    def _withdraw(self, exchange: Exchange) -> bool:
        """Withdraw an exchange that the audio thread has not made. Return False if it has."""
        ticket, entry = self._tickets[id(exchange)]
        return self._queue.withdraw(entry, ticket)

    # --- what is made

    def before_block(self, frames: int) -> None:
        """Make the tables that are due in the next block if the rendering thread has set anything; others follow beside
        the sound."""
        self.renderer = threading.get_ident()
        if self._tables.waits_for(self.renderer) or any(one.thread == self.renderer for one in list(self._requests)):
            self._make_until(self._now() + frames - 1)
        elif self._is_waiting():
            self._make_beside()
        self._queue.fill()

    def leave_to(self, renderer: int | None) -> None:
        """Let a thread render from now on; None: that of a device, and all tables are made beside."""
        self.renderer = renderer
        if renderer is None:
            self._make_beside()

    def make_tables(self) -> None:
        """Make the tables of all that is planned."""
        self._make_until(MAX_FRAMES)

    def _make_until(self, frame: int, budget: float = math.inf) -> None:
        """Make the tables of what is due up to a frame, and let the audio thread exchange them. budget: seconds for a
        glide"""
        while True:
            with self._tables.lock:
                self._plan_requests()
                following = self._tables.next_frame
                if following is None or following > frame:
                    return
                self._forget_made()
                self._make_next(budget)

    def _make_next(self, budget: float) -> None:
        """Make the tables of the next step. Values that are impossible are refused, and the sound goes on."""
        change, reason = self._tables.next_change, ""
        names = [new.parameter for new in change.values]
        try:
            exchange = self._tables.make_next(self._now(), budget)
            if exchange is not None:
                self._put_exchange(exchange)
        except Exception as error:  # whatever it is
            reason = str(error) or type(error).__name__
            self._queue.refuse([change.why, *_named(change.values)], reason)
            for new in change.values:
                if self._values.get(new.parameter) == new.value:
                    del self._values[new.parameter]
        kept = {name: why for name, why in self.refused.items() if name not in names}
        self.refused = kept | dict.fromkeys(names, reason) if reason else kept

    def _forget_made(self) -> None:
        """Forget the exchanges that the audio thread has made, or seen to be withdrawn: it reads their numbers no
        more."""
        now = self._now()  # what was made at a frame before is over
        self._queue.pending()  # notes what was taken

        def is_read(exchange: Exchange) -> bool:
            made_at = self._tickets[id(exchange)][1]["frame"]
            return made_at is None or int(made_at) >= now

        self._tables.forget_before(now, is_read)
        kept = {id(exchange) for exchange in self._tables.exchanges}
        self._tickets = {n: ticket for n, ticket in self._tickets.items() if n in kept}

    def _make_beside(self) -> None:
        """Let a thread make the tables of what is planned, unless one does."""
        with self._wake:
            if self._worker is None:
                self._worker = threading.Thread(target=self._work, name="tables", daemon=True)
                self._worker.start()
            self._wake.notify()

    def _work(self) -> None:
        """Make tables soon before they are due, until there are none to make."""
        ahead = nearest_frame(MADE_AHEAD, self._tables.samplerate)
        while True:
            self._make_until(self._now() + ahead, GLIDE_BUDGET)
            with self._wake:
                if not self._is_waiting():
                    self._worker = None
                    return
                if not self._requests:
                    self._wake.wait(MADE_AHEAD / 4)

    def _is_waiting(self) -> bool:
        """True if some tables are still to be made."""
        return bool(self._requests) or self._tables.next_frame is not None

    def _now(self) -> int:
        """The frame that the sound has reached."""
        return int(self._counters[Slot.FRAME])

    def _put_exchange(self, step: Exchange) -> None:
        """Let the audio thread do an exchange."""
        table, ticket = step.copies.table, np.zeros(2, np.int64)
        row = EventRow(EventKind.EXCHANGE_TABLES, 0, step.island, step.island + step.islands, step.due, len(table))
        entry = self._queue.put([step.why, *_named(step.values)], row, table, ticket)
        self._tickets[id(step)] = ticket, entry


def _named(values: Sequence[NewValue]) -> list[Any]:
    """Values as the log has them: name and value; of several, a table of these."""
    if len(values) == 1:
        return [values[0].parameter, values[0].value]
    return [{new.parameter: new.value for new in values}]
