"""Traces: every sample's displacements, forces and energies."""

import json
from collections.abc import Sequence
from typing import NotRequired, TypedDict, cast

import numpy as np

from engine.assembly.build import trace_points
from engine.assembly.layout import Layout
from engine.bodies.tips import middle_of
from engine.kernel.data.model import Model
from engine.kernel.data.state import Trace
from engine.patch.friction import Friction
from engine.patch.scene import Scene
from engine.patch.tables import Contact

ENERGIES = "kinetic", "potential", "contact", "dissipated", "supplied", "total"
UNITS = {"time": "s", "displacement": "m", "velocity": "m/s", "compression": "m", "force": "N", "iterations": "1"}
FRICTION_UNITS = {"slip": "m/s", "friction": "N", "sticks": "1", "friction_positions": "1"}
UNITS |= {**dict.fromkeys(ENERGIES, "J"), "samplerate": "Hz", "positions": "1", "contact_positions": "1"}

COLUMNS = {  # of arrays with a column for each, where their names are
    **dict.fromkeys(("displacement", "velocity"), ("body", "bodies")),
    **dict.fromkeys(("compression", "force"), ("contact_name", "contacts")),
    **dict.fromkeys(("slip", "friction", "sticks"), ("friction_name", "frictions")),
}
LISTS_OF_NAMES = dict.fromkeys(names for _, names in COLUMNS.values())


class TraceArrays(TypedDict):
    """The arrays of a trace by name, as `rendering.trace` has them and `fdh render --trace` writes them.

    time:         [n], s; sample 0 is the initial state
    displacement: [n, bodies], m; where each body is traced is in `positions`: at its first pickup, contact or force,
                  masses and oscillators always; NaN of others
    velocity:     [n, bodies], m/s
    compression:  [n, contacts], m: positive in contact, negative apart; NaN of a contact that can never touch. A
                  contact at several points has a column for each
    force:        [n, contacts], N; the mean over the step that ends at the sample
    iterations:   [n], of the contact solve
    kinetic, potential, contact, dissipated, supplied, total: [n], J
    bodies, contacts: the names of the columns
    positions:    [bodies], as JSON: a place as in a patch, `null` of a mass or oscillator; "" of a body that is not
                  traced
    contact_positions: [contacts], as JSON: the place on the body, and on the other
    slip:         [n, frictions], m/s: how fast surfaces slip past each other; this and the next five with friction
    friction:     [n, frictions], N, on the body, upwards; the mean over the step that ends at the sample
    sticks:       [n, frictions]: true where surfaces are pressed together and do not slip
    frictions, friction_positions: as of contacts
    samplerate:   Hz, of the trace: oversampled, it is higher than that of the sound
    units:        [arrays, 2]: name and unit
    shape_time:   [m], s; this and what follows with trace_shapes
    shape.NAME:   [m, 65] of a string or bar, m; [m, 17, 17] of a sheet: rows along y, NaN outside of a round one
    shape_positions.NAME: [65] or [17, 17, 2]: the places, as fractions; of a sheet, x and y

    Type checkers and editors know all names but those with the NAME of a body: read these from
    `typing.cast(dict[str, numpy.ndarray], rendering.trace)`.
    """

    time: np.ndarray
    displacement: np.ndarray
    velocity: np.ndarray
    compression: np.ndarray
    force: np.ndarray
    iterations: np.ndarray
    kinetic: np.ndarray
    potential: np.ndarray
    contact: np.ndarray
    dissipated: np.ndarray
    supplied: np.ndarray
    total: np.ndarray
    bodies: np.ndarray
    positions: np.ndarray
    contacts: np.ndarray
    contact_positions: np.ndarray
    slip: NotRequired[np.ndarray]
    friction: NotRequired[np.ndarray]
    sticks: NotRequired[np.ndarray]
    frictions: NotRequired[np.ndarray]
    friction_positions: NotRequired[np.ndarray]
    samplerate: np.ndarray
    units: np.ndarray
    shape_time: NotRequired[np.ndarray]


def allocate_trace(model: Model, frames: int) -> Trace:
    """Memory for a trace."""
    bodies = model.bodies.mode_begin.size
    contacts = model.contact.nominal_barrier.size
    return Trace(
        displacement=np.zeros((frames, bodies)),
        velocity=np.zeros((frames, bodies)),
        compression=np.zeros((frames, contacts)),
        force=np.zeros((frames, contacts)),
        iterations=np.zeros(frames, np.int64),
        **{name: np.zeros(frames) for name in ("kinetic", "potential", "contact", "dissipated", "supplied")},
    )


def trace_rows(trace: Trace, begin: int, end: int) -> Trace:
    """Some rows of a trace."""
    return Trace(*(a[begin:end] for a in trace))


def name_columns(trace: Trace, layout: Layout, samplerate: int) -> TraceArrays:
    """The arrays of a trace by their public names, columns in the order of the patch; and what each column is."""
    frames, labels = trace.iterations.size, column_labels(layout)
    body, is_traced = np.argsort(layout.islands.body_order), labels["positions"] != ""
    begin = column_begins(layout)
    contacts = begin[len(layout.scene.contact)]
    compression, force = np.full((frames, begin[-1]), np.nan), np.zeros((frames, begin[-1]))  # NaN: not built
    for place, (k, _) in enumerate(layout.islands.contact_points):
        compression[:, begin[k]], force[:, begin[k]] = trace.compression[:, place], trace.force[:, place]
        begin[k] += 1
    arrays = {
        "time": np.arange(frames) / samplerate,
        "displacement": np.where(is_traced, trace.displacement[:, body], np.nan),
        "velocity": np.where(is_traced, trace.velocity[:, body], np.nan),
        "compression": compression[:, :contacts],
        "force": force[:, :contacts],
        **{name: getattr(trace, name) for name in ("iterations", *ENERGIES[:-1])},
        "total": trace.kinetic + trace.potential + trace.contact,
        **labels,
        **(friction_arrays(layout, compression[:, contacts:], force[:, contacts:]) if layout.scene.friction else {}),
        "samplerate": np.array(samplerate),
        "units": np.array([*(UNITS | (FRICTION_UNITS if layout.scene.friction else {})).items()]),
    }
    return cast(TraceArrays, arrays)


def column_begins(layout: Layout) -> list[int]:
    """The first column of each contact of the patch, and then of friction; and how many columns there are."""
    counts = [len(layout.points_of(table)) for table in layout.touching]
    return [0, *np.cumsum(counts, dtype=int).tolist()]


def friction_arrays(layout: Layout, slip: np.ndarray, force: np.ndarray) -> dict[str, np.ndarray]:
    """Return the arrays of friction by their public names. slip, force: [n, points]"""
    names = [table.name or f"friction.{k}" for k, table in enumerate(layout.scene.friction)]
    labels, places = label_points(layout, names, layout.scene.friction)
    sticks = (force != 0.0) & (slip == 0.0)
    return {"slip": slip, "friction": 0.0 - force, "sticks": sticks, "frictions": labels, "friction_positions": places}


def label_points(
    layout: Layout, names: Sequence[str], tables: Sequence[Contact | Friction]
) -> tuple[np.ndarray, np.ndarray]:
    """Return the label of each point of tables with these names, and its positions as JSON."""
    labels, places = list[str](), list[str]()
    for name, table in zip(names, tables, strict=True):
        points = layout.points_of(table)
        labels += [name] if len(points) == 1 else [f"{name}.{n}" for n in range(len(points))]
        places += [json.dumps([point.at, point.on_at]) for point in points]
    return np.array(labels, dtype=str), np.array(places, dtype=str)


def column_labels(layout: Layout) -> dict[str, np.ndarray]:
    """Return the labels of the columns of a trace: names of bodies and contacts, and positions as JSON."""
    scene, points = layout.scene, trace_points(layout)
    places = {p.body: json.dumps(middle_of(p.position)) for p in points if p.body is not None}
    contacts, contact_places = label_points(layout, contact_names(scene), scene.contact)
    return {
        "bodies": np.array([body.name for body in scene.body], dtype=str),
        "positions": np.array([places.get(body.name, "") for body in scene.body], dtype=str),
        "contacts": contacts,
        "contact_positions": contact_places,
    }


def contact_names(scene: Scene) -> list[str]:
    """The names of the contacts of a scene in its order; those without one have a number."""
    return [contact.name or f"contact.{k}" for k, contact in enumerate(scene.contact)]
