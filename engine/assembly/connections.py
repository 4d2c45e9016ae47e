"""Connections in the layout of the kernels: rows, compliance, and the factors of their forces
(engine.kernel.interactions.connection_factors).

Connections that cannot be built are named by their paths in the patch.
"""

import math
from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np

from engine.arithmetic.elementary import square
from engine.arithmetic.products import product
from engine.assembly.array_memory import ABSENT
from engine.assembly.connection_coordinates import used_connections
from engine.assembly.contact_reach import contact_reach, contact_reach_by_forces
from engine.assembly.coordinates import Coordinate, Coordinates, IslandFactors, find_factors
from engine.assembly.islands import Islands
from engine.assembly.layout import Layout
from engine.assembly.modal_system import ModalSystem
from engine.assembly.mode_coefficients import ModeCoefficients
from engine.assembly.mode_shape_rows import mode_shape_rows, row_coefficients
from engine.bodies import Body
from engine.bodies.distributed import LineBody
from engine.faults import BuildError, Fault
from engine.kernel.data.enums import FLIGHT_FRAMES
from engine.kernel.data.model import ConnectionCoefficients, Connections, StepCoefficients
from engine.patch.accuracy import Accuracy
from engine.patch.scene import Scene
from engine.patch.tables import AirConnection, ChangeEvent, SpringConnection

BELOW_REST = 2.0**-30  # relative: as a bound, the energy at rest may be a little lower
MAX_MODES_AT_REST = 400  # of an island under load; with more, its energy at rest is not computed


def all_factors(layout: Layout, modes: ModeCoefficients, step_rate: float) -> list[IslandFactors | None]:
    """Return the factors of the connections of each island; None for an island without any.

    step_rate: one over the length of the step, 1/s; 0 if dampers act outside it
    """
    islands = zip(layout.islands.coordinates, layout.points.coordinate_rows, layout.modes.of_island, strict=True)
    return [
        find_factors(coordinates, rows, modes.kick[inside], modes.drift[inside], step_rate)
        if coordinates.items
        else None
        for coordinates, rows, inside in islands
    ]


class ContactMotion(NamedTuple):
    """Motion by one newton at each contact of an island, in a step."""

    compliance: np.ndarray  # contacts, if nothing were connected [contacts, contacts], m/N
    moves: np.ndarray  # coordinates of connections [coordinates, contacts], m/N


def contact_motions(
    layout: Layout, modes: ModeCoefficients, factors: Sequence[IslandFactors | None]
) -> list[ContactMotion]:
    """Return the motion by the contacts of each island. factors: of its connections"""
    motions = []
    for of_island, shapes, inside in zip(factors, layout.points.contact_shapes, layout.modes.of_island, strict=True):
        contacts, moved = shapes.moved
        kicks, drifts = np.zeros((2, *shapes.phi.shape))  # mostly: to write only what moves takes a third of the time
        for products, coefficient in ((kicks, modes.kick), (drifts, modes.drift)):
            products[contacts, moved] = shapes.phi[contacts, moved] * coefficient[inside][moved]
        moves = np.zeros((0, len(kicks))) if of_island is None else of_island.contact_moves(kicks)
        motions.append(ContactMotion(product(kicks, drifts.T), moves))
    return motions


def connection_coefficients(
    layout: Layout,
    modes: ModeCoefficients,
    factors: Sequence[IslandFactors | None],
    motions: Sequence[ContactMotion],
    step_rate: float,
) -> ConnectionCoefficients:
    """Return the coefficients of all connections of a layout; ABSENT without any. factors, motions: of each island"""
    parts = layout.points.connection_parts
    if not parts:
        return ABSENT
    present = [of_island for of_island in factors if of_island is not None]
    items = [item for coordinates in layout.islands.coordinates for item in coordinates.items]
    return ConnectionCoefficients(
        rows=row_coefficients([part.row for part in parts], modes.kick, modes.drift),
        compliance=np.concatenate([of_island.compliance.ravel() for of_island in present]),
        force_per_extension=np.concatenate([of_island.per_extension.T.ravel() for of_island in present]),
        force_per_move=np.concatenate([of_island.per_move.T.ravel() for of_island in present]),
        step_rate=np.full(len(items), step_rate),
        made_for_stiffness=np.array([item.stiffness for item in items]),
        made_for_damping=np.array([item.damping for item in items]),
        contact_moves=np.concatenate([motion.moves.T.ravel() for motion in motions]),
        contact_compliance=np.concatenate([motion.compliance.ravel() for motion in motions]),
    )


def connections(layout: Layout, samplerate: float, step: StepCoefficients, is_refined: bool) -> Connections:
    """Return the connections of a layout; ABSENT without any.

    step:       coefficients of a sample that is one step
    is_refined: True if samples are made of stages
    """
    parts, of_islands = layout.points.connection_parts, layout.islands.coordinates
    if not parts:
        return ABSENT
    unconnected = np.ones(layout.modes.omega.size)
    for b in layout.islands.coordinates_of_body:
        unconnected[layout.modes.of_body[b]] = 0.0
    # their modes have neither weight nor loss in the drift
    is_plain = np.array([step.drag is ABSENT and not layout.modes.weight[m].any() for m in layout.modes.of_island])
    return Connections(
        rows=mode_shape_rows([part.row for part in parts]),
        coordinate=np.array([part.coordinate for part in parts], np.int64),
        coupling=np.concatenate([c.coupling.ravel() for c in of_islands]),
        is_rigid=np.array([item.is_rigid for c in of_islands for item in c.items], np.int64),
        is_unconnected=unconnected,
        is_plain=is_plain.astype(np.int64),
        contact_reach=contact_reach(layout, FLIGHT_FRAMES / samplerate),
        contact_reach_by_forces=contact_reach_by_forces(layout, step, is_plain & (not is_refined)),
    )


# --- at rest


def lowest_energies(layout: Layout) -> np.ndarray:
    """Return the energy of the connected bodies of each island at rest, J [islands]. It is 0 without weight and without
    springs under load. It is minus infinity where finding it takes too long."""
    islands, modes, lowest = layout.islands, layout.modes, []
    for n, coordinates in enumerate(islands.coordinates):
        connected = [modes.in_island[b] for b in islands.bodies[n] if b in islands.coordinates_of_body]
        places = np.concatenate([np.zeros(0, np.int64), *(np.arange(m.start, m.stop) for m in connected)])
        omega, load = (values[modes.of_island[n]][places] for values in (modes.omega, modes.weight))
        if not coordinates.items or not (load.any() or any(item.rest for item in coordinates.items)):
            lowest.append(0.0)
        elif places.size > MAX_MODES_AT_REST:
            lowest.append(-math.inf)
        else:
            rows = layout.points.coordinate_rows[n][:, places]
            lowest.append(_energy_at_rest(coordinates, rows, omega, load))
    return np.array(lowest)


def _energy_at_rest(coordinates: Coordinates, rows: np.ndarray, omega: np.ndarray, load: np.ndarray) -> float:
    """Return the minimum of ½q·ω²·q + ½s·K·s - load·q with s = rows·q - rest, and s = 0 where rigid, J. Return minus
    infinity if there is none, as when a body falls for ever."""
    items, size = coordinates.items, omega.size
    stiffness = coordinates.stiffness()
    rest, rigid = np.array([item.rest for item in items]), np.array([item.is_rigid for item in items])
    held = rows[rigid]
    matrix = np.zeros((size + len(held), size + len(held)))
    matrix[:size, :size] = np.diag(square(omega)) + product(product(rows.T, stiffness), rows)
    matrix[size:, :size], matrix[:size, size:] = held, held.T
    pull = np.concatenate([load + product(product(rows.T, stiffness), rest), rest[rigid]])
    solution, *_ = np.linalg.lstsq(matrix, pull, rcond=None)
    if np.max(np.abs(product(matrix, solution) - pull)) > 1e-9 * np.max(np.abs(pull)):
        return -math.inf
    q = solution[:size]
    s = product(rows, q) - rest
    energy = 0.5 * np.sum(square(omega * q)) + product(product(0.5 * s, stiffness), s) - product(load, q)
    fraction, exponent = math.frexp(float(energy) - BELOW_REST * abs(float(energy)))
    return math.ldexp(math.floor(fraction / BELOW_REST) * BELOW_REST, exponent)  # LAPACK's last digits vary by machine


MAX_ISLAND_COORDINATES = 512  # of an island; what they move is a product of matrices in each step
MAX_GAP = 1e-12  # m, of a rigid joint, beside rounding
MAX_DAMPING_OUTSIDE = 0.1  # r·W·h/2 of a damper outside steps back in time: beyond, it would take too little
STILL = 1e-12  # of a body's largest mode shape: what moves less at a place does not move


def check_connections(system: ModalSystem, islands: Islands, accuracy: Accuracy, samplerate: float) -> None:
    """Raise BuildError if connections cannot be built; it names each of them."""
    faults = [*_find_still(system), *_find_apart(system)]
    items = [item for coordinates in islands.coordinates for item in coordinates.items]
    if accuracy.order > 2:
        faults += _find_overdamped(system.scene, items, accuracy, samplerate)
    for coordinates in islands.coordinates:
        if len(coordinates.items) > MAX_ISLAND_COORDINATES:
            message = f"with this one, more than {MAX_ISLAND_COORDINATES} connection coordinates join the same bodies"
            faults.append(Fault(coordinates.items[MAX_ISLAND_COORDINATES].path, f"{message}; use fewer connections"))
    if faults:
        raise BuildError(*faults)


def _find_still(system: ModalSystem) -> Iterator[Fault]:
    """Yield connections at positions that do not move, where they would have no effect."""
    scene = system.scene
    used = used_connections(scene)
    for k, connection in enumerate(scene.connection):
        if k not in used and not getattr(connection, "one_way", False):
            continue
        sides = [("at", connection.body)] if isinstance(connection, SpringConnection) else []
        if connection.on is not None and not isinstance(connection, AirConnection):
            sides += [("on_at", connection.on)]
        for key, name in sides:
            body = scene.body[system.body_index[name]]
            largest = np.max(np.abs(system.shape(name, getattr(connection, key))), initial=0.0)
            if not largest > STILL * _largest_shape(body):
                remedy = '; kind = "end" lets the end of a string move'
                message = f'"{name}" does not move there, so the connection would hold nothing; choose another position'
                message += remedy if isinstance(body, LineBody) and key == "at" else ""
                yield Fault(f"connection[{k}].{key}", message)


def _largest_shape(body: Body) -> float:
    """Estimate the largest mode shape of a body, 1/√kg."""
    mass = body.total_mass()
    return 1 / math.sqrt(mass) if 0.0 < mass < math.inf else 1e-300


def _find_apart(system: ModalSystem) -> Iterator[Fault]:
    """Yield rigid joints whose sides are apart, or move apart, at time 0."""
    for k, connection in enumerate(system.scene.connection):
        if not (isinstance(connection, SpringConnection) and connection.rigid):
            continue
        gap, speed, size = -connection.rest, 0.0, abs(connection.rest)
        for name, at, sign in ((connection.body, connection.at, 1.0), (connection.on, connection.on_at, -1.0)):
            if name is not None:
                modal, shape = system.modal_bodies[system.body_index[name]], system.shape(name, at)
                gap, speed = gap + sign * float(product(shape, modal.q)), speed + sign * float(product(shape, modal.p))
                size += float(product(np.abs(shape), np.abs(modal.q)))
        if abs(gap) > MAX_GAP + 1e-12 * size:
            message = f"the sides of this rigid joint are {abs(gap):.6g} m apart at time 0"
            remedy = f"give rest = {connection.rest + gap:.6g}, or start the bodies where they meet"
        elif abs(speed) > 1e-12:
            message = f"the sides of this rigid joint move apart at {speed:.6g} m/s at time 0"
            remedy = "give both the same velocity"
        else:
            continue
        yield Fault(f"connection[{k}].rigid", f"{message}; {remedy}")


def _find_overdamped(
    scene: Scene, items: Sequence[Coordinate], accuracy: Accuracy, samplerate: float
) -> Iterator[Fault]:
    """Yield dampers that are too strong to act outside of steps back in time."""
    events = [e for e in scene.event if isinstance(e, ChangeEvent) and e.damping_coefficient]
    changed = {e.connection: e.damping_coefficient or 0.0 for e in events}
    for item in items:
        name = scene.connection[item.connection].name if item.connection is not None else None
        damping = max(item.damping, changed.get(name, 0.0) if name is not None else 0.0)
        mobility = sum(float(np.sum(square(values))) for values in item.parts.values())  # W = Φ·Φᵀ, 1/kg
        limit = 2 * MAX_DAMPING_OUTSIDE * samplerate / max(mobility, 1e-300)
        if damping > limit:
            message = f"order {accuracy.order} has steps back in time, in which a damper would create energy"
            remedy = f"give at most {limit:.3g} kg/s here, or use order = 2 with substeps"
            yield Fault(f"{item.path}.damping_coefficient", f"{message}; {remedy}")
