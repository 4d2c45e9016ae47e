"""Shapes of strings, bars and sheets while they move: displacements at many places, at moments evenly apart.

At those samples the kernels trace every place as if it were a body of its own; at all others, the bodies alone. So the
shapes are exact, the samples are the same bit for bit, and a snapshot costs a product of shapes and modes. What else
the kernels hold of each body, such as its tension, has places between the bodies as well, which do nothing.
"""

from typing import Any, NamedTuple, TypeVar

import numpy as np

from engine.assembly.build import trace_points
from engine.assembly.contact_points import BodyPoint
from engine.assembly.layout import Layout
from engine.assembly.mode_shape_rows import mode_shape_rows
from engine.bodies import Body
from engine.bodies.distributed import LineBody
from engine.bodies.sheet import SheetBody
from engine.kernel.data.axes import Axis, Items, map_arrays
from engine.kernel.data.model import Model
from engine.kernel.data.state import State, Trace
from engine.offline.simulation import Simulation
from engine.offline.trace import allocate_trace, trace_rows
from engine.runtime.job_memory import TracedJob

LINE_PLACES = 65  # along a string or a bar, ends included
SHEET_PLACES = 17  # along each side of a sheet
MAX_SNAPSHOTS = 4_000  # a snapshot takes 0.1 ms
MAX_NUMBERS = 1 << 23  # of all shapes together: 64 MB

Record = TypeVar("Record", Model, State)


class BodyShape(NamedTuple):
    """The places at which a body is looked at."""

    body: str
    positions: np.ndarray  # [places], fractions of a length; or [rows, columns, 2]: x, y, fractions of the sides
    is_inside: (
        np.ndarray
    )  # [places] or [rows, columns]: whether it lies on the body, as the corners of a round one do not


def body_shape(body: Body) -> BodyShape | None:
    """The places of a body; None if it has no shape."""
    if isinstance(body, LineBody):
        return BodyShape(body.name, np.linspace(0.0, 1.0, LINE_PLACES), np.ones(LINE_PLACES, bool))
    if not isinstance(body, SheetBody):
        return None
    side, table = np.linspace(0.0, 1.0, SHEET_PLACES), body.model_dump(exclude_none=True)
    positions = np.stack(np.meshgrid(side, side), axis=-1)
    inside = [[body.explain_outside(table, place.tolist()) is None for place in row] for row in positions]
    return BodyShape(body.name, positions, np.array(inside))


class ShapeSnapshots:
    """A simulation that is traced, and keeps the shapes of its bodies.

    frames: that will be rendered
    """

    def __init__(self, simulation: Simulation, layout: Layout, frames: int) -> None:
        self._simulation, self._frame, self._layout = simulation, 0, layout
        self.shapes = [shape for body in layout.scene.body if (shape := body_shape(body)) is not None]
        self._points, self._columns, self._bodies, begins = wide_points(layout, self.shapes)
        places = sum(shape.is_inside.size for shape in self.shapes)
        count = max(1, min(MAX_SNAPSHOTS, MAX_NUMBERS // places, frames)) if places else 1
        self.every = -(-frames // count)
        self.kept = np.zeros((-(-frames // self.every), len(self._points)))
        model, state = simulation.model, simulation.state
        wide_model, self._tables = widened(model, self._bodies, len(self._points))
        wide_state, self._numbers = widened(state, self._bodies, len(self._points))
        self._phi = self._mode_shapes(layout)
        rows = mode_shape_rows([layout.row(point) for point in self._points])._replace(phi=self._phi)
        wide_model = wide_model._replace(bodies=rows, islands=model.islands._replace(body=begins))
        memory = simulation.memory_of(wide_model, wide_state, layout.scene.channels)
        self._trace = allocate_trace(wide_model, 1)
        self._job = TracedJob(memory, self._trace)

    def render_block(self, audio: np.ndarray, trace: Trace | None) -> None:
        """Render len(audio) samples into audio [frames, channels], and fill the trace; of none, compile."""
        assert trace is not None
        done = 0
        if not len(audio):
            self._simulation.render_block(audio, trace)
        while done < len(audio):
            since = self._frame % self.every
            count = 1 if since == 0 else min(len(audio) - done, self.every - since)
            rows = trace_rows(trace, done, done + count)
            if since == 0:
                self._take(audio[done : done + 1], rows)
            else:
                self._simulation.render_block(audio[done : done + count], rows)
            self._frame, done = self._frame + count, done + count

    def _take(self, audio: np.ndarray, rows: Trace) -> None:
        """Render one sample with a snapshot; what else is traced goes into the row of the trace."""
        self._simulation.exchange_due_tables()
        self._follow_tables()
        for array in self._trace:
            array[:] = 0
        for ours, widened in self._numbers:
            widened[self._bodies] = ours
        self._simulation.render_sample(self._job)
        for ours, widened in self._numbers:
            ours[:] = widened[self._bodies]
        audio[:] = self._job.memory.audio
        for name, array in self._trace._asdict().items():
            getattr(rows, name)[:] = array[:, self._bodies] if name in ("displacement", "velocity") else array
        self.kept[self._frame // self.every] = self._trace.displacement[0]

    def _follow_tables(self) -> None:
        """Give the widened model the numbers of tables that the score has changed."""
        for ours, widened in self._tables:
            widened[self._bodies] = ours
        layout = self._simulation.layout_of_tables
        if layout is not None and layout is not self._layout:
            self._layout = layout
            self._phi[:] = self._mode_shapes(layout)

    def _mode_shapes(self, layout: Layout) -> np.ndarray:
        """Return the mode shapes at all points, as the kernels have them."""
        return mode_shape_rows([layout.row(point) for point in self._points]).phi

    def arrays(self, samplerate: float, frames: int) -> dict[str, np.ndarray]:
        """Return the snapshots of so many frames by their public names; positions that lie on no body are NaN."""
        kept = self.kept[: -(-frames // self.every)]
        found: dict[str, np.ndarray] = {"shape_time": np.arange(len(kept)) * self.every / samplerate}
        for shape in self.shapes:
            values = np.full((len(kept), *shape.is_inside.shape), np.nan)
            values[:, shape.is_inside] = kept[:, self._columns[shape.body]]
            found |= {f"shape.{shape.body}": values, f"shape_positions.{shape.body}": shape.positions}
        return found

    @property
    def units(self) -> list[tuple[str, str]]:
        """The names of the arrays with their units."""
        names = [("shape_time", "s")]
        for shape in self.shapes:
            names += [(f"shape.{shape.body}", "m"), (f"shape_positions.{shape.body}", "1")]
        return names


def wide_points(
    layout: Layout, shapes: list[BodyShape]
) -> tuple[list[BodyPoint], dict[str, list[int]], list[int], np.ndarray]:
    """All points to be traced in the kernels' order; the columns of each shape's places, and of the bodies; and where
    the points of each island begin. The bodies of an island come first, so that they keep their numbers in it."""
    by_body, bodies = {shape.body: shape for shape in shapes}, trace_points(layout)
    points, columns, own = list[BodyPoint](), dict[str, list[int]](), list[int]()
    begins = [0]
    for of_island in layout.islands.bodies:
        numbers = range(len(own), len(own) + len(of_island))
        own += range(len(points), len(points) + len(of_island))
        points += [bodies[n] for n in numbers]
        for n in numbers:
            if shape := by_body.get(layout.scene.body[layout.islands.body_order[n]].name):
                inside: list[Any] = shape.positions[shape.is_inside].tolist()
                columns[shape.body] = list(range(len(points), len(points) + len(inside)))
                points += [BodyPoint(shape.body, position, 1.0) for position in inside]
        begins.append(len(points))
    return points, columns, own, np.array(begins, np.int64)


def widened(record: Record, columns: list[int], count: int) -> tuple[Record, list[tuple[np.ndarray, np.ndarray]]]:
    """Return a Model or a State that has other numbers of each body in arrays of `count` items, those of the bodies in
    these columns, and neutral ones between them. Also return these arrays, as they were and as they are now."""
    pairs = list[tuple[np.ndarray, np.ndarray]]()

    def widen(array: np.ndarray, items: Items) -> np.ndarray:
        if items.axis is not Axis.BODY:
            return array
        widened = np.full((count, *array.shape[1:]), items.neutral, array.dtype)
        widened[columns] = array
        pairs.append((array, widened))
        return widened

    return map_arrays(widen, record), pairs
