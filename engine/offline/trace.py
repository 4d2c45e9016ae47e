"""Traces: every sample's displacements, forces and energies."""

import numpy as np

from engine.build.layout import Layout
from engine.kernel.model import Model
from engine.kernel.state import Trace


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
    """The arrays of a trace by their public names, columns in the order of the patch."""
    scene = layout.scene
    frames = trace.iterations.size
    body = np.argsort(layout.body_order)
    displacement = trace.displacement[:, body]
    columns = [(k, len(layout.points_of(contact))) for k, contact in enumerate(scene.contact)]
    begin = dict(zip([k for k, _ in columns], np.cumsum([0] + [n for _, n in columns]).tolist(), strict=False))
    total = sum(n for _, n in columns)
    compression, force = np.full((frames, total), np.nan), np.zeros((frames, total))  # NaN: not built
    for place, (k, _) in enumerate(layout.contact_points):
        compression[:, begin[k]], force[:, begin[k]] = trace.compression[:, place], trace.force[:, place]
        begin[k] += 1
    return {
        "time": np.arange(frames) / samplerate,
        "displacement": displacement,
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
