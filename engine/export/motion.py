"""Moving parts of a scene on a page: bodies with a shape, by their lowest modes, and the points where they are touched.

A page gets small numbers, as it draws some hundred pixels: mode shapes are steps of 1/127 of their largest value, and
shapes that are alike, as those of all strings, are given once.
"""

from typing import Any, NamedTuple

import numpy as np

from engine.assembly.contact_points import BodyPoint, contact_sides
from engine.assembly.layout import Layout
from engine.kernel.data.enums import FlightFrame
from engine.offline.shape_snapshots import BodyShape, body_shape

MOST_MODES = 16  # of a body that are drawn, the lowest
STEPS = 127  # of a mode shape, from 0 to its largest value
LINE_STEP, SHEET_STEP = 2, 2  # of the places of engine.offline.shape_snapshots, one in so many is drawn
HARMONIC = 0.03  # partials that stray no farther from multiples of the lowest are seen by one stroboscope


class DrawnBody(NamedTuple):
    """A body that is drawn. Its displacement at a place is Σ scale·shape/127·q, with q in √kg·m."""

    name: str
    island: int
    modes: list[int]  # counted from the first of all
    scales: list[float]  # [modes], 1/√kg
    shape: int  # number of its shapes
    is_harmonic: bool


class Shapes(NamedTuple):
    """Mode shapes of bodies that are alike."""

    places: list[float] | list[list[float]]  # along a line from 0 to 1; or x, y on a sheet, in fractions of its sides
    columns: int  # of the grid of a sheet; 0: a line
    numbers: list[int]  # where each place is in the grid
    values: list[list[int]]  # [modes][places]


class TouchedPlace(NamedTuple):
    """A contact point on a body that is drawn."""

    contact: int  # of all contact points
    body: int  # of all that are drawn
    place: float | list[float]  # as those of the shapes


class Motion(NamedTuple):
    """All that is drawn."""

    bodies: list[DrawnBody]
    shapes: list[Shapes]
    touched: list[TouchedPlace]


def find_motion(layout: Layout) -> Motion:
    """Return what a page draws of a scene."""
    motion, numbers, drawn = Motion([], [], []), dict[str, int](), dict[str, int]()
    for b, body in enumerate(layout.scene.body):
        shape = body_shape(body)
        shown = None if shape is None else _shapes_of(layout, b, shape)
        if shown is None:
            continue
        shapes, modes, scales = shown
        number = numbers.setdefault(repr(shapes), len(motion.shapes))
        if number == len(motion.shapes):
            motion.shapes.append(shapes)
        drawn[body.name] = len(motion.bodies)
        rounded, is_harmonic = [float(f"{x:.4g}") for x in scales.tolist()], _is_harmonic(layout.modes.omega[modes])
        motion.bodies.append(
            DrawnBody(body.name, layout.islands.of_body[b], modes.tolist(), rounded, number, is_harmonic)
        )
    for contact, (k, point) in enumerate(layout.islands.contact_points):
        for side in contact_sides(layout.touching[k], point):
            if side.body in drawn and isinstance(side.position, (int, float, list, tuple)):
                place = side.position if isinstance(side.position, (int, float)) else [float(x) for x in side.position]
                motion.touched.append(TouchedPlace(contact, drawn[side.body], place))
    return motion


def _shapes_of(layout: Layout, number: int, shape: BodyShape) -> tuple[Shapes, np.ndarray, np.ndarray] | None:
    """Return the shapes of the lowest modes of a body, their numbers, and their scales; None if none of them moves."""
    is_line = shape.is_inside.ndim == 1
    chosen = np.zeros_like(shape.is_inside)
    chosen[(slice(None, None, LINE_STEP if is_line else SHEET_STEP),) * shape.is_inside.ndim] = True
    places = shape.positions[chosen & shape.is_inside].tolist()
    at_places = np.array([layout.row(BodyPoint(shape.body, place, 1.0)).phi for place in places])
    largest = np.abs(at_places).max(axis=0)
    omega = layout.modes.omega[layout.modes.of_body[number]]
    moving = np.flatnonzero((largest > 0.0) & (omega > 0.0))
    modes = moving[np.argsort(omega[moving], kind="stable")][:MOST_MODES]
    if not modes.size:
        return None
    values = np.rint(STEPS * at_places[:, modes] / largest[modes]).astype(int).T.tolist()
    columns = 0 if is_line else len(range(0, shape.is_inside.shape[1], SHEET_STEP))
    grid = shape.is_inside[chosen]
    return (
        Shapes(places, columns, np.flatnonzero(grid).tolist(), values),
        modes + layout.modes.of_body[number].start,
        largest[modes] / STEPS,
    )


def _is_harmonic(omega: np.ndarray) -> bool:
    """True if partials are near multiples of the lowest."""
    ratios = omega / omega[0]
    return bool((np.abs(ratios / np.maximum(np.rint(ratios), 1.0) - 1.0) < HARMONIC).all())


def motion_data(layout: Layout) -> dict[str, Any]:
    """Return what a page draws of a scene, for its data."""
    motion = find_motion(layout)
    return {
        "bodies": [body._asdict() for body in motion.bodies],
        "shapes": [shapes._asdict() for shapes in motion.shapes],
        "touched": [place._asdict() for place in motion.touched],
        "flight": [len(FlightFrame), int(FlightFrame.END)],
    }
