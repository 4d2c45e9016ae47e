"""Live parameters that change tables, such as the pitch of a body. New tables are built while the sound goes on, and
exchanged between two samples."""

import heapq
import math
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from itertools import count
from typing import Any, NamedTuple

import numpy as np

from engine.arithmetic.plain_numbers import power
from engine.assembly import limits
from engine.assembly.build import BuildResult, build
from engine.assembly.pickup_points import channel_gains
from engine.assembly.table_exchange import (
    Copies,
    Part,
    collect_copies,
    copy_parts,
    find_varying_parts,
    make_alternatives,
)
from engine.kernel.data.axes import map_arrays
from engine.kernel.data.model import Model
from engine.patch.frames import nearest_frame
from engine.patch.live_parameters import OUTPUT, LivePath, check_range, value_at, with_value
from engine.patch.live_ranges import FACTORS, LiveRange, live_range
from engine.patch.scene import Scene
from engine.patch.tables import Pickup

TABLE_STEP_SECONDS = 0.005  # the shortest step in which tables glide …
LEVEL_STEP_SECONDS = 0.0005  # … and levels of pickups …
MAX_STEPS = 64  # … and how many steps there are at most
SCORE = "score"  # asks for a change
ANY_TIME = -1  # when an alternative is due


class NewValue(NamedTuple):
    """A new value of a live parameter. parameter: its path in a patch"""

    path: LivePath
    parameter: str
    value: float


class Exchange(NamedTuple):
    """Tables that are exchanged at a frame."""

    values: tuple[NewValue, ...]
    copies: Copies
    island: int  # the first whose energy is counted again …
    islands: int  # … and how many there are
    due: int  # frame
    why: str = "set"  # who asked for it: `set`, or the `score`


class WrittenTables(NamedTuple):
    """The tables of islands, and the levels of pickups, that a change writes to."""

    island: int  # the first whose tables change …
    islands: int  # … and how many do
    pickups: frozenset[int]

    def meets(self, other: "WrittenTables") -> bool:
        """True if both write to the same."""
        islands = max(self.island, other.island) < min(self.island + self.islands, other.island + other.islands)
        return islands or bool(self.pickups & other.pickups)


@dataclass(eq=False)
class PlannedChange:
    """Parameters that glide to values from a frame on."""

    values: tuple[NewValue, ...]
    seconds: float
    frame: int
    written: WrittenTables
    why: str
    thread: int  # that asked for it
    note: int  # that it belongs to; 0: none
    steps: int  # of the glide
    before: dict[str, float] = field(default_factory=dict)  # values of the parameters when it began
    is_over: bool = False  # it turned out to be impossible


class Step(NamedTuple):
    """A step of a change that is due at a frame; those of one frame are in the order in which they were planned."""

    due: int
    order: int
    number: int  # 0: the glide begins
    change: PlannedChange


class MadeStep(NamedTuple):
    """A step whose tables are made, and what has to be put back if it is withdrawn."""

    step: Step
    exchange: Exchange | None
    parts: list[tuple[np.ndarray, np.ndarray]]  # of the known numbers, and what they were
    values: tuple[NewValue, ...]  # of the parameters, before
    newest: dict[str, "PlannedChange | None"]  # changes of the parameters, before


def count_steps(values: Sequence[NewValue], seconds: float) -> int:
    """Return in how many steps parameters glide to values."""
    shortest = LEVEL_STEP_SECONDS if all(new.path.is_level for new in values) else TABLE_STEP_SECONDS
    return max(1, min(MAX_STEPS, math.ceil(seconds / shortest)))


class TableChanges:
    """Build the tables of live parameters again, as they change in time.

    Changes may be planned in any order; their steps are made in the order of their frames. The tables of each are those
    for all values that the parameters have at its frame. A glide ends where a newer one of the same parameter begins,
    which starts from the value reached.

    scene, built: the rendered scene, and the result of `build` for it
    models:       the Models in use, with the coarser ones; their arrays are written to
    coarser:      makes the coarser Models of a build
    options:      of `build`
    """

    def __init__(
        self,
        scene: Scene,
        built: BuildResult,
        models: Sequence[Model] = (),
        coarser: Callable[[BuildResult], list[Model]] = lambda built: [],
        **options: Any,
    ) -> None:
        self._scene, self._state, self._layout = scene, built.state, built.layout
        self._latest = built.layout  # of what was built last
        self.layout = built.layout  # that the tables follow from, after all steps that are made
        self._targets, self._coarser, self._options = list(models) or [built.model], coarser, options
        # the numbers that the targets have once all steps that are made have acted
        self._known = [map_arrays(lambda array, items: array.copy(), model) for model in self._targets]
        self._changed: tuple[Scene, tuple[NewValue, ...], Scene] | None = None  # a scene with values, made last
        self._gains: tuple[list[Pickup], np.ndarray, list[int]] | None = None  # of points of pickups; their channels
        self._planned: list[Step] = []  # a heap: steps that are not made
        self._orders = count()
        self._newest: dict[str, PlannedChange] = {}  # of each parameter, of those that have begun
        self._made: list[MadeStep] = []  # whose numbers may still be read, in the order of their frames
        self._kept: list[Exchange] = []  # alternatives, whose numbers are read by others
        self.lock = threading.RLock()

    @property
    def samplerate(self) -> float:
        """Sample rate of the tables, Hz."""
        return self._targets[0].samplerate

    def range_of(self, path: LivePath) -> LiveRange:
        """Return the range of values of a parameter."""
        if path.section == OUTPUT:
            return FACTORS
        return live_range(self._scene, path.section, path.number, path.keys)

    def check_range(self, new: NewValue) -> None:
        """Raise ValueError if a parameter cannot have a value."""
        check_range(self._scene, *new)

    def value(self, path: LivePath) -> float:
        """Return the value that a parameter has after the steps that are made."""
        return value_at(self._scene, path)

    def check(self, values: Sequence[NewValue], before: Sequence[NewValue] = ()) -> None:
        """Raise ValueError (BuildError) if values are out of range, or if a body whose modes are computed quickly
        cannot have them. Other errors are found when the tables are built. before: other values, set earlier"""
        scene, accuracy = self._with_values([*before, *values]), self._options.get("accuracy") or self._scene.accuracy
        names: dict[int, list[str]] = {}
        for path, parameter, _ in values:
            if path.section == "body":
                names.setdefault(path.number, []).append(parameter)
        for number, parameters in names.items():
            body = scene.body[number]
            if body.IS_LUMPED or body.HAS_LENGTH:
                limits.build_modal_body(body, ", ".join(parameters), self.samplerate, accuracy.scheme)

    # --- planning

    def plan(
        self, values: Sequence[NewValue], seconds: float, frame: int, thread: int, why: str = "set", note: int = 0
    ) -> PlannedChange:
        """Plan that parameters glide to values from a frame on. thread: that asks for it; note: that it belongs to"""
        written = self._find_written([new.path for new in values])
        change = PlannedChange(tuple(values), seconds, frame, written, why, thread, note, count_steps(values, seconds))
        self._push(Step(frame, next(self._orders), 0, change))
        return change

    def _push(self, step: Step) -> None:
        heapq.heappush(self._planned, step)

    @property
    def next_frame(self) -> int | None:
        """Frame of the next step that is not made; None without any."""
        first = self._planned[:1]  # another thread may take it meanwhile
        return first[0].due if first else None

    def waits_for(self, thread: int) -> bool:
        """True if steps of changes that a thread set are still to be made."""
        return any(step.change.thread == thread for step in list(self._planned))

    @property
    def next_change(self) -> PlannedChange:
        """The change whose step is made next."""
        return self._planned[0].change

    def make_next(self, now: int = 0, budget: float = math.inf) -> Exchange | None:
        """Make the next step, and return its exchange, if it has one. Raises ValueError (BuildError, CannotExchange) if
        values are impossible: the change is over then, and its parameters stay as they are.

        now:    frame before which nothing can be done any more: what is due before is late
        budget: seconds; if the tables of all steps of a glide took longer, it has fewer steps
        """
        step = heapq.heappop(self._planned)
        step = step._replace(due=max(step.due, now))
        before = dict(self._newest)
        try:
            return self._make(step, math.inf if step.change.why == SCORE else budget)
        except Exception:
            step.change.is_over, self._newest = True, before
            raise

    def due(self, frame: int) -> Iterator[Exchange]:
        """Make the steps that are due up to a frame, and yield their exchanges. Raises what `make_next` raises."""
        while self._planned and self._planned[0].due <= frame:
            exchange = self.make_next()
            if exchange is not None:
                yield exchange

    def withdraw(self, written: WrittenTables, frame: int, can_withdraw: Callable[[Exchange], bool]) -> None:
        """Plan the steps again that are made for later than a frame and write to the same as a change that comes before
        them. can_withdraw: tells whether an exchange is not made yet by who makes it, and forbids it then"""
        for n in range(len(self._made) - 1, -1, -1):
            made = self._made[n]
            if made.step.due <= frame or not made.step.change.written.meets(written):
                continue  # those of other islands may be made in another order than that of their frames
            if made.exchange is not None and not can_withdraw(made.exchange):
                return
            for part, numbers in made.parts:
                part[:] = numbers
            self._scene = self._with_values(made.values)
            for name, change in made.newest.items():
                self._newest.pop(name, None)
                if change is not None:
                    self._newest[name] = change
            del self._made[n]
            if made.exchange is not None:
                self._kept.append(made.exchange)  # its ticket is still read
            if made.step.number == 0:
                self._planned = [step for step in self._planned if step.change is not made.step.change]
                heapq.heapify(self._planned)
            self._push(made.step)

    def cancel(self, note: int, frame: int, can_withdraw: Callable[[Exchange], bool]) -> None:
        """Forget the changes of a note that do not begin before a frame. can_withdraw: as of `withdraw`"""
        for change in {made.step.change for made in self._made if made.step.change.note == note}:
            if change.frame >= frame:
                self.withdraw(change.written, frame - 1, can_withdraw)
        self._planned = [
            step for step in self._planned if step.change.note != note or step.number > 0 or step.due < frame
        ]
        heapq.heapify(self._planned)

    def forget_late(self, parameters: Sequence[str], frame: int) -> None:
        """Forget changes of parameters that have not begun, though they are due by a frame, for newer ones."""
        for step in self._planned:
            if step.number == 0 and step.due <= frame and step.change.why != SCORE:
                rest = tuple(new for new in step.change.values if new.parameter not in parameters)
                step.change.values, step.change.is_over = rest, not rest

    def forget_before(self, frame: int, is_read: Callable[[Exchange], bool] = lambda exchange: False) -> None:
        """Forget the steps that were due before a frame. is_read: tells whether the numbers of an exchange, or whether
        it was withdrawn, may still be read: one that was put in late is made late"""
        while self._made and self._made[0].step.due < frame:
            exchange = self._made[0].exchange
            if exchange is not None and is_read(exchange):
                break
            del self._made[0]
        self._kept = [one for one in self._kept if one.due == ANY_TIME or one.due >= frame or is_read(one)]

    # --- making

    def _make(self, step: Step, budget: float) -> Exchange | None:
        """Make a step. Returns its exchange, if it has one."""
        change = step.change
        names = [new.parameter for new in change.values]
        newest = {name: self._newest.get(name) for name in names}
        if change.is_over:
            return None
        if step.number == 0:
            change.steps = self._affordable_steps(change, budget)
            is_score = any(one is not None and one.why == SCORE != change.why for one in newest.values())
            change.before = {new.parameter: self.value(new.path) for new in change.values}
            self._newest |= dict.fromkeys(names, change)
            if change.steps > 1:
                for n in range(1, change.steps + 1):  # each value amid the time for which it holds
                    due = step.due + nearest_frame((n - 0.5) * change.seconds / change.steps, self.samplerate)
                    self._push(Step(due, step.order, n, change))
                if not is_score:  # else the log tells of the begin, at which a glide of the score ends
                    self._made.append(MadeStep(step, None, [], (), newest))
                    return None
        share = 1.0 if change.steps == 1 else step.number / change.steps
        values = tuple(
            new._replace(value=glide_between(change.before[new.parameter], new.value, share))
            for new in change.values
            if self._newest.get(new.parameter) is change
        )
        if not values:
            return None
        return self._exchange(step, values, newest)

    def _affordable_steps(self, change: PlannedChange, budget: float) -> int:
        """Return in how many steps a change glides. Raises ValueError if its last values are impossible."""
        number = count_steps(change.values, change.seconds)
        if not all(new.path.is_level for new in change.values) and number > 1:
            begin = time.perf_counter()
            after = self._build(self._with_values(change.values))
            find_varying_parts(self._targets, [self._known, after])
            number = max(1, int(min(number, budget / max(1e-9, time.perf_counter() - begin))))
        return number

    def _exchange(self, step: Step, values: tuple[NewValue, ...], newest: dict[str, PlannedChange | None]) -> Exchange:
        """Make the tables of values, and return their exchange."""
        scene = self._with_values(values)  # as a replay knows them
        written = self._find_written([new.path for new in values])
        if all(new.path.is_level for new in values):
            paths = {new.path.section if new.path.section == OUTPUT else new.path: new.path for new in values}
            parts = [part for path in paths.values() for part in self._level_parts(scene, path)]
            copies = collect_copies([(part.ours, part.variants[-1]) for part in parts])
        else:
            after = self._build(scene)
            parts = find_varying_parts(self._targets, [self._known, after])
            self.layout = self._latest
            copies = copy_parts(self._targets, self._state, after, parts, (written.island, written.islands))
        undo = [(part.variants[0], part.variants[0].copy()) for part in parts]
        for part in parts:
            part.variants[0][:] = part.variants[-1]
        before = tuple(new._replace(value=self.value(new.path)) for new in values)
        self._scene = scene
        exchange = Exchange(values, copies, written.island, written.islands, step.due, step.change.why)
        self._made.append(MadeStep(step, exchange, undo, before, newest))
        return exchange

    def alternatives(self, variants: Sequence[Sequence[NewValue]]) -> list[Exchange]:
        """Return exchanges for those of some variants of the same parameters that are possible: each gives them its
        values, whichever of them was made last. They are due at once, and nothing has changed yet."""
        possible, models = list[tuple[NewValue, ...]](), list[list[Model]]()
        for values in variants:
            try:
                after = self._build(self._with_values(values))
                find_varying_parts(self._targets, [self._known, after])
            except ValueError:  # BuildError, CannotExchange
                continue
            possible.append(tuple(values))
            models.append(after)
        written = self._find_written([new.path for values in variants for new in values])
        span = written.island, written.islands
        _, *copies = make_alternatives(self._targets, self._state, [self._known, *models], span)
        steps = [Exchange(values, one, *span, ANY_TIME) for values, one in zip(possible, copies, strict=True)]
        self._kept += steps
        return steps

    @property
    def exchanges(self) -> list[Exchange]:
        """The exchanges whose numbers may still be read."""
        return [*(made.exchange for made in self._made if made.exchange is not None), *self._kept]

    def _with_values(self, values: Sequence[NewValue]) -> Scene:
        """Return the scene with other values. Raises ValueError if they are out of range."""
        last, before, chosen = self._changed, self._scene, tuple(values)
        if last is None or last[0] is not before or last[1] != chosen:
            scene = before
            for path, parameter, value in values:
                scene = with_value(scene, path, parameter, value)
            self._changed = last = before, chosen, scene
        return last[2]

    def _build(self, scene: Scene) -> list[Model]:
        like = self._layout.modal_bodies
        built = build(scene, self.samplerate, like=like, before=self._latest, **self._options)
        self._latest = built.layout
        return [built.model, *self._coarser(built)]

    def _level_parts(self, scene: Scene, path: LivePath) -> list[Part]:
        """Return the gains of a pickup on its channels, or of all pickups, as known and as new ones."""
        pickups, ours, known = self._layout.points.pickups, self._targets[0].pickups.gain, self._known[0].pickups.gain
        if path.section == OUTPUT:
            return [Part(ours[:], [known[:], self._gains_of(scene)])]
        gains, chosen = dict(channel_gains(scene.pickup[path.number])), self._layout.scene.pickup[path.number]
        items = [(slice(n, n + 1), one.channel) for n, one in enumerate(pickups) if one.pickup is chosen]
        new = [np.array([gains[channel] * scene.output_gain(channel)]) for _, channel in items]
        return [Part(ours[item], [known[item], one]) for (item, _), one in zip(items, new, strict=True)]

    def _gains_of(self, scene: Scene) -> np.ndarray:
        """Return the gains of all points of pickups."""
        if self._gains is None or self._gains[0] is not scene.pickup:  # which the gain of a channel leaves as they are
            points, present = self._layout.points.pickups, dict[int, Pickup]()
            present |= {id(old): new for old, new in zip(self._layout.scene.pickup, scene.pickup, strict=True)}
            gains = [dict(channel_gains(present.get(id(one.pickup), one.pickup)))[one.channel] for one in points]
            self._gains = scene.pickup, np.array(gains), [one.channel for one in points]
        _, gains_alone, channels = self._gains
        factors = {channel: scene.output_gain(channel) for channel in set(channels)}
        return np.asarray(gains_alone * np.array([factors[channel] for channel in channels]))

    def _find_written(self, paths: Sequence[LivePath]) -> WrittenTables:
        """Return what parameters write to."""
        layout, scene = self._layout, self._scene
        if all(path.section == OUTPUT for path in paths):
            return WrittenTables(0, 0, frozenset(range(len(scene.pickup))))
        if any(path.section == "" for path in paths):
            return WrittenTables(0, len(layout.islands.bodies), frozenset(range(len(scene.pickup))))
        tables = [(path, getattr(scene, path.section)[path.number]) for path in paths]
        names = [table.name if path.section == "body" else table.body for path, table in tables]
        islands = [layout.islands.of_body[layout.body_index[name]] for name in names]
        only_levels = all(path.is_level for path in paths)
        pickups = frozenset(path.number for path in paths if path.section == "pickup")
        return WrittenTables(min(islands), 0 if only_levels else max(islands) - min(islands) + 1, pickups)


def glide_between(before: float, after: float, share: float) -> float:
    """Return the value at a share of the way from one to another, in equal ratios if both have one sign, else in equal
    steps."""
    if share >= 1.0:
        return after
    if before * after > 0.0:
        return float(before * power(after / before, share))
    return before + (after - before) * share
