"""Bodies that ring for ever, because nothing damps them."""

import numpy as np

from engine.assembly.layout import Layout
from engine.assembly.subsystems import connected_components
from engine.patch.tables import ChangeEvent, DampEvent


def undamped_modes(layout: Layout) -> dict[str, int]:
    """The number of modes of each body that never decay, of those that have any.

    Such a mode vibrates without loss, no event damps it, and nothing that its connections reach has loss. Contacts do
    not count: they may lose energy only while they are closed.
    """
    damped = {event.body for event in layout.scene.event if isinstance(event, DampEvent)}
    reached = _reached_by_loss(layout, damped)
    counts = {}
    for b, (body, modal) in enumerate(zip(layout.scene.body, layout.modal_bodies, strict=True)):
        undamped = (modal.sigma == 0.0) & (modal.omega > 0.0) & (body.name not in damped)
        if reached[b]:
            undamped &= ~_connected_modes(layout, b)
        undamped[undamped.size - modal.residual :] = False
        if undamped.any():
            counts[body.name] = int(undamped.sum())
    return counts


def _reached_by_loss(layout: Layout, damped: set[str]) -> list[bool]:
    """True for each body that connections join to one with loss, or to a damper, from the start or later. damped: names
    of bodies that events damp"""
    scene = layout.scene
    items = [item for coordinates in layout.islands.coordinates for item in coordinates.items]
    pairs = [(first, other) for item in items for first, *others in [list(item.parts)] for other in others]
    component = connected_components(len(scene.body), pairs)
    lossy = {component[b] for b, modal in enumerate(layout.modal_bodies) if np.any(modal.sigma > 0.0)}
    lossy |= {component[next(iter(item.parts))] for item in items if item.damping > 0.0}
    changed = {e.connection for e in scene.event if isinstance(e, ChangeEvent) and e.damping_coefficient}
    later = damped | {connection.body for connection in scene.connection if connection.name in changed - {None}}
    lossy |= {component[layout.body_index[name]] for name in later}
    return [component[b] in lossy for b in range(len(scene.body))]


def _connected_modes(layout: Layout, body: int) -> np.ndarray:
    """True for each mode of a body that connections move [modes]."""
    items = layout.islands.coordinates[layout.islands.of_body[body]].items
    rows = [item.parts[body] for item in items if body in item.parts]
    return np.any(np.array(rows) != 0.0, axis=0) if rows else np.zeros(layout.modal_bodies[body].omega.size, np.bool_)
