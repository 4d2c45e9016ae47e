"""Retune the voices of a polyphonic model: a voice gets the numbers of a model of one voice at the new pitch.

Both have as many modes, contacts and connections (`like` of engine.assembly.build.build), so that each array of the one
has its place in the other.
"""

import math
from collections.abc import Iterator
from typing import Any, NamedTuple

import numpy as np

from engine.argument_checks import checked_integer, checked_number
from engine.assembly.build import BuildResult, build
from engine.assembly.event_table import EventRow
from engine.kernel.data.axes import SEGMENTED, Axis, Items, pair_arrays
from engine.kernel.data.enums import EventKind, PairOnBody
from engine.kernel.data.model import Connections, FreeFlight, Model, ModeShapeRows, StepCoefficients, Tension
from engine.live.event_queue import EventQueue, checked_frame
from engine.live.player_options import PlayerOptions
from engine.live.shared_memory import SharedMemory, Slot
from engine.live.voices import replicate, retune, sounding_bodies, tuned_bodies, with_chosen_residuals
from engine.patch.frames import nearest_frame
from engine.patch.scene import Scene
from engine.patch.tables import MAX_SECONDS

GLIDE_STEP_SECONDS, GLIDE_STEP_CENTS = 0.002, 2.0  # the smallest steps in which a pitch glides …
MAX_GLIDE_STEPS = 128  # … and how many they are at most
TOO_SMALL = "this pitch needs more modes or contacts than a voice has room for"

Arrays = tuple[np.ndarray, np.ndarray]  # to write, to read


class VoiceTuning:
    """The pitches of the voices of a player, and tables of what the audio thread copies to change them.

    patch:      the scene of one voice
    options:    how many voices there are, and the ratio of the lowest pitch, which all have at first
    built:      the polyphonic model
    built_with: arguments of `build` that it was made with
    """

    def __init__(
        self,
        patch: Scene,
        options: PlayerOptions,
        built: BuildResult,
        built_with: dict[str, Any],
        queue: EventQueue,
        memory: SharedMemory,
    ) -> None:
        self._patch = with_chosen_residuals(patch, built.model.samplerate) if options.voices else patch
        self._lowest, self._built, self._built_with = options.lowest, built, built_with
        self._queue, self._counters = queue, memory.counters
        self._pitch: list[tuple[float, str | None]] = [(options.lowest, None)] * options.voices
        self._tables: dict[tuple[int, float, str | None], tuple[np.ndarray, Model]] = {}

    def tune(self, voice: int, ratio: float, frame: int, seconds: float, body: str | None) -> None:
        """Give a voice another pitch (engine.live.player.Player.tune)."""
        voice, ratio = checked_integer("voice", voice), checked_number("ratio", ratio)
        seconds, frame = checked_number("seconds", seconds), self._check(voice, ratio, seconds, frame, body)
        counters = self._counters
        is_idle = counters[Slot.READ_INDEX] == counters[Slot.WRITE_INDEX] and not counters[Slot.WAITING]
        if is_idle and len(self._tables) > MAX_GLIDE_STEPS:
            self._tables.clear()  # the audio thread waits for none
        ratios = self._glide(voice, ratio, seconds, body)
        tables = [self._table(voice, one, body) for one in ratios]
        if seconds > 0.0:
            frame = max(frame, int(counters[Slot.FRAME]))
        islands = (self._built.model.islands.mode.size - 1) // len(self._pitch)
        first, last = voice * islands, (voice + 1) * islands
        for n, (one, table) in enumerate(zip(ratios, tables, strict=True), 1):
            due = frame + nearest_frame(n * seconds / len(ratios), self._built.model.samplerate)
            row = EventRow(EventKind.EXCHANGE_TABLES, 0, first, last, due, len(table))
            self._queue.put(["tune", voice, one, *([] if body is None else [body])], row, table)
        self._pitch[voice] = ratio, body

    def _check(self, voice: int, ratio: float, seconds: float, frame: int, body: str | None) -> int:
        """Raise what `tune` raises before anything has changed. Return the frame."""
        if not 0 <= voice < len(self._pitch):
            raise IndexError(f"there is no voice {voice}; the player has {len(self._pitch)} voices")
        if not self._lowest <= ratio < math.inf:  # there are no slots for the modes it would have
            raise ValueError(
                f"ratio = {ratio:g} is out of range; give at least {self._lowest:g}, the lowest ratio of this player"
            )
        if not 0.0 <= seconds <= MAX_SECONDS:
            raise ValueError(f"seconds = {seconds:g} is out of range; give 0 to {MAX_SECONDS:g}")
        names = [b.name for b in self._patch.body]
        if body is not None and body not in names:
            raise KeyError(f"there is no body {body}; the bodies are {', '.join(names)}")
        return checked_frame(frame)

    def _glide(self, voice: int, ratio: float, seconds: float, body: str | None) -> list[float]:
        """Return the ratios of the steps in which a voice glides from its pitch to another, that one last."""
        before, of = self._pitch[voice]
        before = before if of == body else ratio  # from another body, nothing can glide
        cents = 1200.0 * abs(math.log2(ratio / before))
        steps = max(1, math.ceil(min(MAX_GLIDE_STEPS, seconds / GLIDE_STEP_SECONDS, cents / GLIDE_STEP_CENTS)))
        return [before * (ratio / before) ** (n / steps) for n in range(1, steps)] + [ratio]

    def _table(self, voice: int, ratio: float, body: str | None) -> np.ndarray:
        """Return the copies that give a voice a pitch [n, 3]. They are kept, for the audio thread reads them."""
        key = voice, ratio, body
        if key not in self._tables:
            model = self.single_model(ratio, body)
            self._tables[key] = tuning_copies(self._built.model, model, voice), model
        return self._tables[key][0]

    def single_model(self, ratio: float, body: str | None) -> Model:
        """Return the model of one voice at a pitch; ratio and body: as of Player.tune. Raises BuildError."""
        scene = retune(self._patch, ratio)
        if body is not None:
            heard = set(sounding_bodies(self._patch))
            names = tuned_bodies(self._patch, body)
            scene = retune(retune(self._patch, self._lowest, heard - names), ratio, names)
        poly, _, layout = self._built
        single = replicate(scene, 1).model_copy(update={"accuracy": layout.scene.accuracy})
        like = layout.modal_bodies[: len(scene.body)]
        return build(single, poly.samplerate, like=like, **self._built_with).model

    def pairs(self, voice: int, single: Model) -> list[Arrays]:
        """Return the arrays that give a voice the pitch of a `single_model`. Raises ValueError if it has no room."""
        return tuning_pairs(self._built.model, single, voice)


def tuning_pairs(poly: Model, single: Model, voice: int) -> list[Arrays]:
    """Return the arrays that make a voice of a polyphonic model equal to the only voice of another: to write, and to
    read. Raises ValueError if the voice has no room for them."""
    islands = single.islands.mode.size - 1
    first, last = voice * islands, (voice + 1) * islands
    if single.effects & ~poly.effects:
        raise ValueError(TOO_SMALL)
    pairs = [*_segments(poly, single, first, last), *_entries(poly, single, first, last)]
    pairs += _stiffening(poly, single, first, last)
    if any(ours.shape != theirs.shape for ours, theirs in pairs):
        raise ValueError(TOO_SMALL)
    return [(ours, theirs) for ours, theirs in pairs if theirs.size]


def tuning_copies(poly: Model, single: Model, voice: int) -> np.ndarray:
    """Return the copies that make a voice of a polyphonic model equal to the only voice of another: addresses to copy
    to and from, and counts of numbers [n, 3]. Raises ValueError if the voice has no room for them."""
    pairs = tuning_pairs(poly, single, voice)
    return np.array([(a.ctypes.data, b.ctypes.data, b.size) for a, b in pairs], np.int64).reshape(-1, 3)


def _segments(poly: Model, single: Model, first: int, last: int) -> Iterator[Arrays]:
    """Yield the parts for islands `first` up to `last` of the arrays by island that a pitch changes."""
    arrays: list[tuple[Items, Any, Any]] = [(Items(Axis.MODE), poly.omega_squared, single.omega_squared)]
    arrays += pair_arrays(StepCoefficients, poly.step, single.step)
    arrays += pair_arrays(FreeFlight, poly.flight, single.flight)
    arrays += pair_arrays(Connections, poly.connection, single.connection)
    arrays += pair_arrays(Tension, poly.tension, single.tension)
    for items, ours, theirs in arrays:
        if items.axis in SEGMENTED and items.dtype is np.float64:
            begin = getattr(poly.islands, items.axis)
            yield ours[begin[first] : begin[last]], theirs[: getattr(single.islands, items.axis)[-1]]


class _Shapes(NamedTuple):
    """Mode shape rows, and arrays that have the same entries as their phi."""

    axis: Axis
    rows: ModeShapeRows
    arrays: list[np.ndarray]

    def entries(self, r: int) -> list[np.ndarray]:
        """Return the entries of a row in each array."""
        begin, count = int(self.rows.offset[r]), int(self.rows.mode_end[r]) - int(self.rows.mode_begin[r])
        return [array[begin : begin + count] for array in self.arrays]


def _entries(poly: Model, single: Model, first: int, last: int) -> Iterator[Arrays]:
    """Yield the mode shapes at points of islands `first` up to `last`, and what is computed from them."""
    for ours, theirs in zip(_shapes(poly), _shapes(single), strict=True):
        rows = range(*getattr(poly.islands, ours.axis)[[first, last]])
        if len(rows) != len(theirs.rows.offset):
            raise ValueError(TOO_SMALL)
        for s, r in enumerate(rows):
            yield from zip(ours.entries(r), theirs.entries(s), strict=True)


def _stiffening(poly: Model, single: Model, first: int, last: int) -> Iterator[Arrays]:
    """Yield the mode shapes of points on bodies that stretch, of islands `first` up to `last`."""
    ours, theirs = poly.tension.stiffening, single.tension.stiffening
    pairs = ours.pairs[slice(*poly.islands.pair_on_body[[first, last]])]
    if len(pairs) != len(theirs.pairs):
        raise ValueError(TOO_SMALL)
    for mine, other in zip(pairs, theirs.pairs, strict=True):
        a, b = mine[PairOnBody.SHAPE], other[PairOnBody.SHAPE]
        if a == mine[PairOnBody.OTHER_SHAPE]:  # each point makes a pair with itself, too
            yield ours.shapes[a : a + mine[PairOnBody.MODES]], theirs.shapes[b : b + other[PairOnBody.MODES]]


def _shapes(model: Model) -> Iterator[_Shapes]:
    """Yield the mode shape rows of a model."""
    step, contact = model.step, model.contact
    places: list[tuple[Axis, ModeShapeRows, Any]] = [
        (Axis.BODY, model.bodies, ()),
        (Axis.PICKUP, model.pickups.rows, (model.flight.pickup_tables,)),
        (Axis.PICKUP, model.tension.pull, ()),
        (Axis.FORCE, model.force.rows, step.force),
        (Axis.CONNECTION_PART, model.connection.rows, step.connection.rows),
        (Axis.CONTACT, contact.rows, step.contact.rows),
        (Axis.CONTACT, contact.other_rows, step.contact.other_rows),
    ]
    for axis, rows, arrays in places:
        yield _Shapes(axis, rows, [rows.phi, *arrays])
