"""Shapes of strings, bars and sheets while they move: displacements at many places, at moments evenly apart.

At those samples the kernels trace every place as if it were a body of its own; at all others, the bodies alone. So the
shapes are exact, the samples are the same bit for bit, and a snapshot costs a product of shapes and modes.
"""

from typing import Any, NamedTuple

import numpy as np

from engine.assembly.build import trace_points
from engine.assembly.contact_points import BodyPoint
from engine.assembly.layout import Layout
from engine.assembly.mode_shape_rows import mode_shape_rows
from engine.bodies import Body
from engine.bodies.distributed import LineBody
from engine.bodies.sheet import SheetBody
from engine.kernel.data.model import Model
from engine.kernel.data.state import Trace
from engine.offline.simulation import Simulation
from engine.offline.trace import allocate_trace, trace_rows
from engine.runtime.job_memory import TracedJob

LINE_PLACES = 65  # along a string or a bar, ends included
SHEET_PLACES = 17  # along each side of a sheet
MAX_SNAPSHOTS = 4_000  # a snapshot takes 0.1 ms
MAX_NUMBERS = 1 << 23  # of all shapes together: 64 MB


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
        self._simulation, self._frame = simulation, 0
        self.shapes = [shape for body in layout.scene.body if (shape := body_shape(body)) is not None]
        points, self._columns, self._bodies, begins = wide_points(layout, self.shapes)
        places = sum(shape.is_inside.size for shape in self.shapes)
        count = max(1, min(MAX_SNAPSHOTS, MAX_NUMBERS // places, frames)) if places else 1
        self.every = -(-frames // count)
        self.kept = np.zeros((-(-frames // self.every), len(points)))
        channels = layout.scene.channels
        between = simulation.memory(self.every, channels)
        at_places = simulation.memory_of(lambda model: widened(model, layout, points, begins), channels)
        self._between, self._wide = (
            allocate_trace(m.model.value, n) for m, n in ((between, self.every), (at_places, 1))
        )
        self._jobs = TracedJob(between, self._between), TracedJob(at_places, self._wide)

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
                audio[done : done + 1] = self._render(1, self._jobs[1], self._wide, rows)
                self.kept[self._frame // self.every] = self._wide.displacement[0]
            else:
                audio[done : done + count] = self._render(count, self._jobs[0], self._between, rows)
            self._frame, done = self._frame + count, done + count

    def _render(self, count: int, job: TracedJob, traced: Trace, rows: Trace) -> np.ndarray:
        """Render so many samples, with what is traced into rows of the trace as well. Returns the audio."""
        traced = trace_rows(traced, 0, count)
        for array in traced:
            array[:] = 0
        job.render(count)
        columns = self._bodies if traced.displacement.shape[1] > len(self._bodies) else slice(None)
        for name, array in traced._asdict().items():
            getattr(rows, name)[:] = array[:, columns] if name in ("displacement", "velocity") else array
        return job.memory.audio[:count]

    def arrays(self, samplerate: float) -> dict[str, np.ndarray]:
        """Return the snapshots by their public names; positions that lie on no body are NaN."""
        found: dict[str, np.ndarray] = {"shape_time": np.arange(len(self.kept)) * self.every / samplerate}
        for shape in self.shapes:
            values = np.full((len(self.kept), *shape.is_inside.shape), np.nan)
            values[:, shape.is_inside] = self.kept[:, self._columns[shape.body]]
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
    the points of each island begin."""
    by_body, bodies = {shape.body: shape for shape in shapes}, trace_points(layout)
    points, columns, own = list[BodyPoint](), dict[str, list[int]](), list[int]()
    begins = [0]
    for of_island in layout.islands.bodies:
        for place in range(len(own), len(own) + len(of_island)):
            own.append(len(points))
            points.append(bodies[place])
            if shape := by_body.get(layout.scene.body[layout.islands.body_order[place]].name):
                inside: list[Any] = shape.positions[shape.is_inside].tolist()
                columns[shape.body] = list(range(len(points), len(points) + len(inside)))
                points += [BodyPoint(shape.body, position, 1.0) for position in inside]
        begins.append(len(points))
    return points, columns, own, np.array(begins, np.int64)


def widened(model: Model, layout: Layout, points: list[BodyPoint], begins: np.ndarray) -> Model:
    """The model with these points traced, and not its bodies alone."""
    rows = mode_shape_rows([layout.row(point) for point in points])
    rows = rows._replace(phi=rows.phi.astype(model.bodies.phi.dtype))
    return model._replace(bodies=rows, islands=model.islands._replace(body=begins))
