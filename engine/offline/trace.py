"""Traces: every sample's displacements, forces and energies."""

import json

import numpy as np

from engine.build.build import trace_points
from engine.build.layout import Layout
from engine.kernel.model import Model
from engine.kernel.state import Trace

ENERGIES = "kinetic", "potential", "contact", "dissipated", "supplied", "total"
UNITS = {"time": "s", "displacement": "m", "velocity": "m/s", "compression": "m", "force": "N", "iterations": "1"}
UNITS |= {**dict.fromkeys(ENERGIES, "J"), "samplerate": "Hz", "positions": "1", "contact_positions": "1"}


def allocate_trace(model: Model, frames: int) -> Trace:
    """Memory for a trace."""
    bodies = model.bodies.mode_begin.size
    contacts = model.contact.nominal_barrier.size if model.contact is not None else 0
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


def name_columns(trace: Trace, layout: Layout, samplerate: int) -> dict[str, np.ndarray]:
    """The arrays of a trace by their public names, columns in the order of the patch; and what each column is."""
    frames = trace.iterations.size
    body = np.argsort(layout.body_order)
    begin = column_begins(layout)
    total = begin[-1]
    compression, force = np.full((frames, total), np.nan), np.zeros((frames, total))  # NaN: not built
    for place, (k, _) in enumerate(layout.contact_points):
        compression[:, begin[k]], force[:, begin[k]] = trace.compression[:, place], trace.force[:, place]
        begin[k] += 1
    arrays = {
        "time": np.arange(frames) / samplerate,
        "displacement": trace.displacement[:, body],
        "velocity": trace.velocity[:, body],
        "compression": compression,
        "force": force,
        "iterations": trace.iterations,
        "kinetic": trace.kinetic,
        "potential": trace.potential,
        "contact": trace.contact,
        "dissipated": trace.dissipated,
        "supplied": trace.supplied,
        "total": trace.kinetic + trace.potential + trace.contact,
    }
    return arrays | column_labels(layout) | {"samplerate": np.array(samplerate), "units": np.array([*UNITS.items()])}


def column_begins(layout: Layout) -> list[int]:
    """The first column of each contact of the patch, and how many columns there are."""
    counts = [len(layout.points_of(contact)) for contact in layout.scene.contact]
    return [0, *np.cumsum(counts, dtype=int).tolist()]


def column_labels(layout: Layout) -> dict[str, np.ndarray]:
    """What the columns of a trace are: names of bodies and contacts, and places as JSON."""
    scene, points = layout.scene, trace_points(layout)
    places = {p.body: json.dumps(p.position) for p in points if p.body is not None}
    contacts, contact_places = list[str](), list[str]()
    for k, contact in enumerate(scene.contact):
        name, joined = contact.name or f"contact.{k}", layout.points_of(contact)
        contacts += [name] if len(joined) == 1 else [f"{name}.{n}" for n in range(len(joined))]
        contact_places += [json.dumps([point.at, point.on_at]) for point in joined]
    return {
        "bodies": np.array([body.name for body in scene.body], dtype=str),
        "positions": np.array([places.get(body.name, "") for body in scene.body], dtype=str),
        "contacts": np.array(contacts, dtype=str),
        "contact_positions": np.array(contact_places, dtype=str),
    }
