"""Connections in the layout of the kernels: rows, compliance, and the factors of their forces
(engine.kernel.interactions.connection_factors).

Connections that cannot be built are named by their paths in the patch.
"""

import math
from itertools import pairwise

import numpy as np

from engine.assembly.connection_coordinates import used_connections
from engine.assembly.contact_reach import contact_reach, contact_reach_by_forces, dense_rows
from engine.assembly.coordinates import Coordinate, Coordinates, IslandFactors, find_factors
from engine.assembly.layout import Layout
from engine.assembly.mode_shape_rows import mode_shape_rows, row_coefficients
from engine.bodies.distributed import LineBody
from engine.faults import BuildError, Fault
from engine.kernel.data.enums import FLIGHT_FRAMES
from engine.kernel.data.model import ConnectionCoefficients, Connections, StepCoefficients
from engine.patch.accuracy import Accuracy
from engine.patch.tables import AirConnection, ChangeEvent, SpringConnection

MAX_MODES_AT_REST = 400  # of an island under load; with more, its energy at rest is not computed


def island_factors(
    layout: Layout, island: int, kick: np.ndarray, drift: np.ndarray, step_rate: float
) -> IslandFactors | None:
    """Return the factors of an island's connections; None without any.

    kick, drift: t and v of the modes of the island, s
    step_rate:   one over the length of the step, 1/s; 0 if dampers act outside it
    """
    coordinates = layout.coordinates[island]
    if not coordinates.items:
        return None
    rows = dense_rows(layout, island)
    kicks, drifts = rows * kick, rows * drift
    compliance = kicks @ drifts.T
    return IslandFactors(compliance, *find_factors(coordinates, compliance, step_rate), kicks, drifts)


def connection_coefficients(
    layout: Layout, kick: np.ndarray, drift: np.ndarray, step_rate: float
) -> ConnectionCoefficients | None:
    """Return the coefficients of all connections of a layout; None without any."""
    if not layout.connection_parts:
        return None
    begins = layout.islands.mode
    values: list[list[np.ndarray]] = [[] for _ in range(5)]
    for n in range(begins.size - 1):
        inside = slice(begins[n], begins[n + 1])
        factors = island_factors(layout, n, kick[inside], drift[inside], step_rate)
        shapes = layout.island_contact_shapes(n)
        empty = np.zeros((0, 0))
        moves = factors.contact_moves(shapes, kick[inside]) if factors is not None else empty
        matrices = factors[:3] if factors is not None else (empty,) * 3
        contacts = (shapes * kick[inside]) @ (shapes * drift[inside]).T
        for kept, matrix in zip(values, (*matrices, moves, contacts), strict=True):
            kept.append(matrix.ravel())
    compliance, per_extension, per_move, contact_moves, contact_compliance = map(np.concatenate, values)
    items = [item for coordinates in layout.coordinates for item in coordinates.items]
    rows = row_coefficients([part.row for part in layout.connection_parts], kick, drift)
    return ConnectionCoefficients(
        rows=rows,
        compliance=compliance,
        force_per_extension=per_extension,
        force_per_move=per_move,
        step_rate=np.full(len(items), step_rate),
        made_for_stiffness=np.array([item.stiffness for item in items]),
        made_for_damping=np.array([item.damping for item in items]),
        contact_moves=contact_moves,
        contact_compliance=contact_compliance,
    )


def connections(
    layout: Layout, samplerate: float, step: StepCoefficients, weight: np.ndarray | None, is_refined: bool
) -> Connections | None:
    """Return the connections of a layout; None without any.

    step:       coefficients of a sample that is one step
    weight:     of each mode; None if no mode has weight
    is_refined: True if samples are made of stages
    """
    if not layout.connection_parts:
        return None
    items = [item for coordinates in layout.coordinates for item in coordinates.items]
    unconnected = np.ones(int(layout.islands.mode[-1]))
    for b in layout.connected_body_numbers:
        unconnected[layout.global_modes(b)] = 0.0
    is_plain = _plain_islands(layout, weight, step.drag is not None)
    return Connections(
        rows=mode_shape_rows([part.row for part in layout.connection_parts]),
        coordinate=np.array([part.coordinate for part in layout.connection_parts], np.int64),
        coupling=np.concatenate([c.coupling.ravel() for c in layout.coordinates]),
        is_rigid=np.array([item.is_rigid for item in items], np.int64),
        is_unconnected=unconnected,
        is_plain=is_plain.astype(np.int64),
        contact_reach=contact_reach(layout, FLIGHT_FRAMES / samplerate),
        contact_reach_by_forces=contact_reach_by_forces(layout, step, is_plain & (not is_refined)),
    )


def _plain_islands(layout: Layout, weight: np.ndarray | None, has_drag: bool) -> np.ndarray:
    """True for each island whose modes have neither weight nor loss in the drift [islands]."""
    begins = layout.islands.mode
    loads = [weight is not None and weight[a:b].any() for a, b in pairwise(begins)]
    return np.array([not (has_drag or is_loaded) for is_loaded in loads])


# --- at rest


def lowest_energies(layout: Layout) -> np.ndarray:
    """Return the energy of the connected bodies of each island at rest, J [islands]. It is 0 without weight and without
    springs under load. It is minus infinity where finding it takes too long."""
    omega, weight, begins = layout.concatenate_modes("omega"), layout.weights(), layout.islands.mode
    lowest = []
    for n, coordinates in enumerate(layout.coordinates):
        inside = slice(begins[n], begins[n + 1])
        connected = [
            m for b in layout.bodies_of_island(n) if b in layout.connected_body_numbers for m in _indices(layout, b)
        ]
        load = weight[inside][connected]
        if not coordinates.items or not (load.any() or any(item.rest for item in coordinates.items)):
            lowest.append(0.0)
        elif len(connected) > MAX_MODES_AT_REST:
            lowest.append(-math.inf)
        else:
            lowest.append(
                _energy_at_rest(coordinates, dense_rows(layout, n)[:, connected], omega[inside][connected], load)
            )
    return np.array(lowest)


def _indices(layout: Layout, body: int) -> range:
    modes = layout.local_modes(body)
    return range(modes.start, modes.stop)


def _energy_at_rest(coordinates: Coordinates, rows: np.ndarray, omega: np.ndarray, load: np.ndarray) -> float:
    """Return the minimum of ½q·ω²·q + ½s·K·s - load·q with s = rows·q - rest, and s = 0 where rigid, J. Return minus
    infinity if there is none, as when a body falls for ever."""
    items, size = coordinates.items, omega.size
    stiffness = coordinates.coupling + np.diag([item.stiffness for item in items])
    rest, rigid = np.array([item.rest for item in items]), np.array([item.is_rigid for item in items])
    held = rows[rigid]
    matrix = np.zeros((size + len(held), size + len(held)))
    matrix[:size, :size] = np.diag(omega**2) + rows.T @ stiffness @ rows
    matrix[size:, :size], matrix[:size, size:] = held, held.T
    pull = np.concatenate([load + rows.T @ stiffness @ rest, rest[rigid]])
    solution, *_ = np.linalg.lstsq(matrix, pull, rcond=None)
    if np.max(np.abs(matrix @ solution - pull)) > 1e-9 * np.max(np.abs(pull)):
        return -math.inf
    q = solution[:size]
    s = rows @ q - rest
    return float(0.5 * np.sum((omega * q) ** 2) + 0.5 * s @ stiffness @ s - load @ q)


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
