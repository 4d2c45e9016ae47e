"""Live parameters that change tables, such as the pitch of a body. New tables are built while the sound goes on, and
exchanged between two samples."""

import heapq
import math
import threading
import time
from collections import deque
from collections.abc import Callable, Iterator, Sequence
from typing import Any, NamedTuple

import numpy as np

from engine.assembly import limits
from engine.assembly.build import BuildResult, build
from engine.assembly.pickup_points import channel_gains
from engine.assembly.table_exchange import Copies, collect_copies, make_alternatives, make_copies
from engine.kernel.data.axes import map_arrays
from engine.kernel.data.model import Model
from engine.patch.frames import nearest_frame
from engine.patch.live_parameters import LivePath, check_range, live_paths, value_at, with_value
from engine.patch.live_ranges import LiveRange, live_range
from engine.patch.scene import Scene
from engine.patch.tables import ChangeEvent

TABLE_STEP_SECONDS = 0.005  # the shortest step in which tables glide …
LEVEL_STEP_SECONDS = 0.0005  # … and levels of pickups …
MAX_STEPS = 64  # … and how many steps there are at most


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


def count_steps(values: Sequence[NewValue], seconds: float) -> int:
    """Return in how many steps parameters glide to values."""
    shortest = LEVEL_STEP_SECONDS if all(new.path.is_level for new in values) else TABLE_STEP_SECONDS
    return max(1, min(MAX_STEPS, math.ceil(seconds / shortest)))


class TableChanges:
    """Build the tables of live parameters again after a change.

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
        self._targets, self._coarser, self._options = list(models) or [built.model], coarser, options
        # the numbers that the targets have, or are to have
        self._known = [map_arrays(lambda array, items: array.copy(), model) for model in self._targets]
        self._changed: tuple[Scene, tuple[NewValue, ...], Scene] | None = None  # a scene with values, made last
        self._busy_until: dict[int, int] = {}  # frame, by island: changes of one follow each other
        self._kept: list[Exchange] = []  # exchanges whose numbers the audio thread may still read
        self.lock = threading.Lock()

    @property
    def samplerate(self) -> float:
        """Sample rate of the tables, Hz."""
        return self._targets[0].samplerate

    def range_of(self, path: LivePath) -> LiveRange:
        """Return the range of values of a parameter."""
        return live_range(self._scene, path.section, path.number, path.keys)

    def check_range(self, new: NewValue) -> None:
        """Raise ValueError if a parameter cannot have a value."""
        check_range(self._scene, *new)

    def value(self, path: LivePath) -> float:
        """Return the value that a parameter has, or glides to."""
        return value_at(self._scene, path)

    def check(self, values: Sequence[NewValue]) -> None:
        """Raise ValueError (BuildError) if values are out of range, or if a body whose modes are computed quickly
        cannot have them. Other errors are found when the tables are built."""
        scene, accuracy = self._with_values(values), self._options.get("accuracy") or self._scene.accuracy
        names: dict[int, list[str]] = {}
        for path, parameter, _ in values:
            if path.section == "body":
                names.setdefault(path.number, []).append(parameter)
        for number, parameters in names.items():
            body = scene.body[number]
            if body.IS_LUMPED or body.HAS_LENGTH:
                limits.build_modal_body(body, ", ".join(parameters), self.samplerate, accuracy.scheme)

    def steps(
        self,
        values: Sequence[NewValue],
        seconds: float,
        frame: int,
        now: Callable[[], int] = lambda: 0,
        budget: float = math.inf,
    ) -> list[Exchange]:
        """Return the steps in which parameters glide to values. They begin at a frame, or when the last changes of the
        same islands are over. Raises ValueError (BuildError, CannotExchange) if the values are impossible; nothing has
        changed then.

        now:    returns the frame that the sound has reached; called when the tables are ready
        budget: seconds; if the tables of all steps took longer, there are fewer steps
        """
        number = count_steps(values, seconds)
        if all(new.path.is_level for new in values):
            glide = self._glide(values, number)
            copies = [self._level_copies(step) for step in glide]
        else:
            begin = time.perf_counter()
            last = self._build(self._with_values(values))  # first of all: it may be impossible
            affordable = budget / max(1e-9, time.perf_counter() - begin)
            glide = self._glide(values, max(1, int(min(number, affordable))))
            copies = self._table_copies(glide, last)
        self._scene = self._with_values(values)
        first, count = self._islands([new.path for new in values])
        islands, number = range(first, first + max(1, count)), len(glide)
        frame = max([frame, now(), *(self._busy_until.get(n, 0) for n in islands)])
        due = [
            frame + nearest_frame((n if number > 1 else 0) * seconds / number, self.samplerate)
            for n in range(1, number + 1)
        ]
        steps = [Exchange(step, one, first, count, at) for step, one, at in zip(glide, copies, due, strict=True)]
        self._busy_until |= dict.fromkeys(islands, due[-1])
        self._kept += steps
        return steps

    def alternatives(self, variants: Sequence[Sequence[NewValue]]) -> list[Exchange]:
        """Return exchanges for those of some variants of the same parameters that are possible: each gives them its
        values, whichever of them was made last. They are due at once, and nothing has changed yet."""
        possible, models = list[tuple[NewValue, ...]](), list[list[Model]]()
        for values in variants:
            try:
                after = self._build(self._with_values(values))
                make_copies(self._targets, self._state, self._known, after)
            except ValueError:  # BuildError, CannotExchange
                continue
            possible.append(tuple(values))
            models.append(after)
        first, count = self._islands([new.path for values in variants for new in values])
        _, *copies = make_alternatives(self._targets, self._state, [self._known, *models])
        steps = [Exchange(values, one, first, count, 0) for values, one in zip(possible, copies, strict=True)]
        self._kept += steps
        return steps

    @property
    def exchanges(self) -> list[Exchange]:
        """The exchanges that the audio thread may still make."""
        return [*self._kept]

    def _glide(self, values: Sequence[NewValue], number: int) -> list[tuple[NewValue, ...]]:
        """Return the values of parameters in each step of a glide to new ones."""
        before = [self.value(new.path) for new in values]
        return [
            tuple(
                new._replace(value=glide_between(old, new.value, n / number))
                for new, old in zip(values, before, strict=True)
            )
            for n in range(1, number + 1)
        ]

    def _level_copies(self, values: Sequence[NewValue]) -> Copies:
        """Return the copies that give pickups new levels."""
        scene = self._with_values(values)
        return collect_copies([pair for new in values for pair in self._level_pairs(scene, new.path)])

    def _table_copies(self, glide: Sequence[tuple[NewValue, ...]], last: list[Model]) -> list[Copies]:
        """Return the copies that make the targets the Models of each step of a glide. last: Models of the last step"""
        known, copies = self._known, list[Copies]()
        for step in glide:
            after = last if step is glide[-1] else self._build(self._with_values(step))
            copies.append(make_copies(self._targets, self._state, known, after))
            known = after
        self._known = known
        return copies

    def _with_values(self, values: Sequence[NewValue]) -> Scene:
        """Return the scene with other values. Raises ValueError if they are out of range."""
        last, before, chosen = self._changed, self._scene, tuple(values)
        if last is None or last[0] is not before or last[1] != chosen:
            scene = before
            for path, parameter, value in values:
                scene = with_value(scene, path, parameter, value)
            self._changed = last = before, chosen, scene
        return last[2]

    def forget(self) -> None:
        """Forget all exchanges; the audio thread must have made them before."""
        self._kept.clear()

    def _build(self, scene: Scene) -> list[Model]:
        like = self._layout.modal_bodies
        built = build(scene, self.samplerate, like=like, before=self._latest, **self._options)
        self._latest = built.layout
        return [built.model, *self._coarser(built)]

    def _level_pairs(self, scene: Scene, path: LivePath) -> list[tuple[np.ndarray, np.ndarray]]:
        """Return pairs of arrays for the gains of a pickup on its channels: to write to, and to read from."""
        gains, pairs = dict(channel_gains(scene.pickup[path.number])), list[tuple[np.ndarray, np.ndarray]]()
        original = self._layout.scene.pickup[path.number]
        for n, heard in enumerate(self._layout.points.pickups):
            if heard.pickup is original:
                new = np.array([gains[heard.channel]])
                pairs += [(model.pickups.gain[n : n + 1], new) for model in self._targets[:1]]
        return pairs

    def _islands(self, paths: Sequence[LivePath]) -> tuple[int, int]:
        """Return the first island whose energy the parameters change, and the number of islands up to the last."""
        layout, scene = self._layout, self._scene
        if any(path.section == "" for path in paths):
            return 0, len(layout.islands.bodies)
        tables = [(path, getattr(scene, path.section)[path.number]) for path in paths]
        names = [table.name if path.section == "body" else table.body for path, table in tables]
        islands = [layout.islands.of_body[layout.body_index[name]] for name in names]
        only_levels = all(path.is_level for path in paths)
        return min(islands), 0 if only_levels else max(islands) - min(islands) + 1


class ScoredChange(NamedTuple):
    """Changes of tables at one time of the score."""

    frame: int
    seconds: float  # that it glides
    values: tuple[NewValue, ...]


def scored_changes(scene: Scene, samplerate: float) -> list[ScoredChange]:
    """Return the changes of tables in the score of a scene, in their order. Those of one time and duration are made
    together."""
    events = [e for e in scene.event if isinstance(e, ChangeEvent) and e.parameter is not None]
    paths, together = live_paths(scene, True) if events else {}, dict[tuple[int, float], list[NewValue]]()
    for event in events:
        name, value = event.parameter or "", event.value or 0.0
        new = NewValue(paths[name], name, value)
        together.setdefault((nearest_frame(event.time, samplerate), event.duration), []).append(new)
    return [ScoredChange(*when, tuple(together[when])) for when in sorted(together)]


class ScoredExchanges:
    """Exchanges of tables in a score; each is built when its time comes."""

    def __init__(self, tables: TableChanges, changes: Sequence[ScoredChange]) -> None:
        self._tables, self._changes = tables, deque(changes)
        self._steps: list[tuple[int, int, Exchange]] = []  # a heap: frame, number
        self._made = 0

    @property
    def next_frame(self) -> int | None:
        """Frame before which the next change is to be made; None without any."""
        frames = [change.frame for change in list(self._changes)[:1]] + [step[0] for step in self._steps[:1]]
        return min(frames, default=None)

    def due(self, frame: int) -> Iterator[Exchange]:
        """Yield the exchanges that are due at a frame. Raises ValueError (BuildError, CannotExchange)."""
        while self._changes and self._changes[0].frame <= frame:
            change = self._changes.popleft()
            for step in self._tables.steps(change.values, change.seconds, change.frame):
                heapq.heappush(self._steps, (step.due, self._made, step))
                self._made += 1
            self._tables.forget()
        while self._steps and self._steps[0][0] <= frame:
            yield heapq.heappop(self._steps)[2]


def scored_exchanges(scene: Scene, built: BuildResult, **options: Any) -> ScoredExchanges | None:
    """Return the exchanges of tables in the score of a scene; None without any. options: of TableChanges"""
    changes = scored_changes(scene, built.model.samplerate)
    return ScoredExchanges(TableChanges(scene, built, **options), changes) if changes else None


def glide_between(before: float, after: float, share: float) -> float:
    """Return the value at a share of the way from one to another, in equal ratios if both have one sign, else in equal
    steps."""
    if share >= 1.0:
        return after
    if before * after > 0.0:
        return float(before * (after / before) ** share)
    return before + (after - before) * share
