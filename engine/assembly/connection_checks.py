"""Find connections that cannot be built, and name them by their paths in the patch."""

import math

import numpy as np

from engine.assembly.connection_coordinates import used_connections
from engine.assembly.coordinates import Coordinate
from engine.assembly.layout import Layout
from engine.bodies.distributed import LineBody
from engine.faults import BuildError, Fault
from engine.patch.accuracy import Accuracy
from engine.patch.tables import AirConnection, ChangeEvent, SpringConnection

MAX_ISLAND_COORDINATES = 512  # of an island; what they move is a product of matrices in each step
MAX_GAP = 1e-12  # m, of a rigid joint, beside rounding
MAX_DAMPING_OUTSIDE = 0.1  # r·W·h/2 of a damper outside steps back in time: beyond, it would take too little
STILL = 1e-12  # of a body's largest mode shape: what moves less at a place does not move


def check_connections(layout: Layout, accuracy: Accuracy, samplerate: float) -> None:
    """Raise BuildError if connections cannot be built; it names each of them."""
    faults = [*_find_still(layout), *_find_apart(layout)]
    if accuracy.order > 2:
        faults += _find_overdamped(layout, accuracy, samplerate)
        if accuracy.substeps % 2 == 0:
            faults += _find_unequal_loss(layout, accuracy)
    for coordinates in layout.coordinates:
        if len(coordinates.items) > MAX_ISLAND_COORDINATES:
            message = f"with this one, more than {MAX_ISLAND_COORDINATES} connection coordinates join the same bodies"
            faults.append(Fault(coordinates.items[MAX_ISLAND_COORDINATES].path, f"{message}; use fewer connections"))
    if faults:
        raise BuildError(*faults)


def _find_still(layout: Layout) -> list[Fault]:
    """Find connections at positions that do not move, where they would have no effect."""
    faults, scene = [], layout.scene
    used = used_connections(scene)
    for k, connection in enumerate(scene.connection):
        if k not in used and not getattr(connection, "one_way", False):
            continue
        sides = [("at", connection.body)] if isinstance(connection, SpringConnection) else []
        if connection.on is not None and not isinstance(connection, AirConnection):
            sides += [("on_at", connection.on)]
        for key, name in sides:
            number, at = layout.body_index[name], getattr(connection, key)
            body, modal = scene.body[number], layout.modal_bodies[number]
            shape = modal.shape(body.split_positions(at)[0])
            if np.max(np.abs(shape), initial=0.0) > STILL * _largest_shape(body, modal):
                continue
            remedy = (
                '; kind = "end" lets the end of a string move' if isinstance(body, LineBody) and key == "at" else ""
            )
            message = f'"{name}" does not move there, so the connection would hold nothing'
            faults.append(Fault(f"connection[{k}].{key}", f"{message}; choose another position{remedy}"))
    return faults


def _largest_shape(body: object, modal: object) -> float:
    """Estimate the largest mode shape of a body, 1/√kg."""
    mass = body.total_mass()  # type: ignore[attr-defined]
    return 1 / math.sqrt(mass) if 0.0 < mass < math.inf else 1e-300


def _find_apart(layout: Layout) -> list[Fault]:
    """Find rigid joints whose sides are apart, or move apart, at time 0."""
    faults = []
    for k, connection in enumerate(layout.scene.connection):
        if not (isinstance(connection, SpringConnection) and connection.rigid):
            continue
        gap, speed, size = -connection.rest, 0.0, abs(connection.rest)
        sides = [(connection.body, connection.at, 1.0)]
        sides += [(connection.on, connection.on_at, -1.0)] if connection.on is not None else []
        for name, at, sign in sides:
            number = layout.body_index[name]
            modal, body = layout.modal_bodies[number], layout.scene.body[number]
            shape = modal.shape(body.split_positions(at)[0])
            gap, speed = gap + sign * float(shape @ modal.q), speed + sign * float(shape @ modal.p)
            size += float(np.abs(shape) @ np.abs(modal.q))
        path = f"connection[{k}]"
        if abs(gap) > MAX_GAP + 1e-12 * size:
            rest = connection.rest + gap
            message = f"the sides of this rigid joint are {abs(gap):.6g} m apart at time 0"
            faults.append(
                Fault(f"{path}.rigid", f"{message}; give rest = {rest:.6g}, or start the bodies where they meet")
            )
        elif abs(speed) > 1e-12:
            message = f"the sides of this rigid joint move apart at {speed:.6g} m/s at time 0"
            faults.append(Fault(f"{path}.rigid", f"{message}; give both the same velocity"))
    return faults


def _find_overdamped(layout: Layout, accuracy: Accuracy, samplerate: float) -> list[Fault]:
    """Find dampers that are too strong to act outside of steps back in time."""
    changed = {
        e.connection: e.damping_coefficient
        for e in layout.scene.event
        if isinstance(e, ChangeEvent) and e.damping_coefficient
    }
    faults = []
    for coordinates in layout.coordinates:
        for item in coordinates.items:
            name = layout.scene.connection[item.connection].name if item.connection is not None else None
            damping = max(item.damping, changed.get(name) or 0.0 if name is not None else 0.0)
            limit = 2 * MAX_DAMPING_OUTSIDE * samplerate / max(_mobility(item), 1e-300)
            if damping > limit:
                message = f"order {accuracy.order} has steps back in time, in which a damper would create energy"
                remedy = f"give at most {limit:.3g} kg/s here, or use order = 2 with substeps"
                faults.append(Fault(f"{item.path}.damping_coefficient", f"{message}; {remedy}"))
    return faults


def _find_unequal_loss(layout: Layout, accuracy: Accuracy) -> list[Fault]:
    """Find rigid joints whose sides have unequal losses between samples of an even number of stages.

    Unequal losses give the sides a relative velocity, and the joint reverses it in each stage. After an even number of
    stages it is what it was, and the next loss adds to it.
    """
    faults = []
    for coordinates in layout.coordinates:
        for item in coordinates.items:
            if not item.is_rigid:
                continue
            sigma = np.concatenate([layout.modal_bodies[b].sigma[row != 0.0] for b, row in item.parts.items()])
            if np.ptp(sigma) > 0.0:
                stages = f"order {accuracy.order} with an even number of substeps"
                message = f"{stages} moves a rigid joint wrongly if its bodies have unequal losses"
                faults.append(Fault(item.path, f"{message}; use an odd number of substeps, or order = 2"))
    return faults


def _mobility(item: Coordinate) -> float:
    """Return the mobility W = Φ·Φᵀ of a coordinate, 1/kg."""
    return sum(float(np.sum(values**2)) for values in item.parts.values())
