"""Contacts that can have an effect: those that are stiff, now or after an event, and can close; and bounds on how far
connected bodies can move contacts in a flight, per √(2E) of their energy E (docs/design.md, "Connections").
"""

import math

import numpy as np

from engine.arithmetic.elementary import square
from engine.arithmetic.linear import solve
from engine.arithmetic.plain_numbers import power
from engine.arithmetic.products import product
from engine.assembly.array_memory import ABSENT
from engine.assembly.contact_points import BodyPoint, contact_sides, offset
from engine.assembly.coordinates import Coordinates
from engine.assembly.external_forces import acting_forces
from engine.assembly.islands import Islands, find_islands
from engine.assembly.layout import Layout
from engine.assembly.modal_system import ModalSystem
from engine.kernel.data.enums import FLIGHT_FRAMES
from engine.kernel.data.model import StepCoefficients
from engine.patch.tables import ChangeEvent, SpringConnection, StrikeEvent

UNBOUNDED = 1e300  # m/√J; infinity times no energy would be no number


def contact_reach(layout: Layout, seconds: float) -> np.ndarray:
    """Bound how far connected bodies can close each contact in `seconds`, m per √(2E) of their energy, √J [contacts];
    in an island without connections, how far all bodies can.

    A displacement Φ·q of energy E changes no faster than √(2E·ΣΦ²), and is at most √(2E·C), with C its static
    compliance. Both follow from the Cauchy-Schwarz inequality, and hold for any springs of the connections.
    """
    reach = []
    for n, bodies in enumerate(layout.islands.bodies):
        shapes, (contacts, modes) = layout.points.contact_shapes[n].phi, layout.points.contact_shapes[n].moved
        size, modes_size = shapes.shape
        is_connected = np.full(modes_size, not layout.islands.coordinates[n].items)
        for b in layout.islands.coordinates_of_body.keys() & bodies:
            is_connected[layout.modes.in_island[b]] = True
        squares = np.where(is_connected[modes], square(shapes[contacts, modes]), 0.0)
        whole = np.bincount(contacts, squares * np.where(is_connected, _modal_compliances(layout, n), 0.0)[modes], size)
        limit = 2 * np.sqrt(_static_compliances(layout, n, shapes, whole))
        reach.append(np.minimum(seconds * np.sqrt(np.bincount(contacts, squares, size)), limit))
    return np.concatenate(reach)


def _modal_compliances(layout: Layout, island: int) -> np.ndarray:
    """Return 1/ω² of the modes of an island [modes], s²; infinite for free masses."""
    omega = layout.modes.omega[layout.modes.of_island[island]]
    return np.where(omega == 0.0, math.inf, 1 / square(np.where(omega == 0.0, 1.0, omega)))


def _static_compliances(layout: Layout, island: int, shapes: np.ndarray, whole: np.ndarray) -> np.ndarray:
    """Return Φ·H⁻¹·Φᵀ of each mode shape [shapes]. H is the stiffness of the modes with the ends of strings. The value
    is infinite if a free mass takes part.

    whole: ΣΦ²/ω² of the connected modes of each shape, infinite if a free mass is one
    """
    coupling, modal_compliance = layout.islands.coordinates[island].coupling, _modal_compliances(layout, island)
    ends = np.flatnonzero(np.any(coupling != 0.0, axis=1))
    rows, is_bound = layout.points.coordinate_rows[island][ends], np.isfinite(modal_compliance)
    held, weighted = coupling[np.ix_(ends, ends)], rows * np.where(is_bound, modal_compliance, 0.0)
    factor = solve(np.eye(ends.size) + product(product(held, weighted), rows.T), held)
    moved, has_free_end = product(weighted, shapes.T), np.any(rows[:, ~is_bound])
    whole = np.full_like(whole, math.inf) if has_free_end else whole
    return np.asarray(np.maximum(0.0, whole - np.sum(moved * product(factor, moved), axis=0)))


# --- by the forces of connections


def contact_reach_by_forces(layout: Layout, step: StepCoefficients, is_bounded: np.ndarray) -> np.ndarray:
    """Bound how much further each contact can close in a flight than its bodies alone would close it, m per √(2E) of
    the connected bodies, √J [contacts].

    A connection with the force f moves a contact by at most max|f| times the sum, over the steps that follow, of the
    size of the displacement per newton in one step. And f is at most √(2E·ℓ·H⁻¹·ℓᵀ), with ℓ the force per displacement.

    is_bounded: True for islands in which this holds, with single steps and without weight [islands]
    """
    reach = []
    for n, inside in enumerate(layout.modes.of_island):
        shapes, rows = layout.points.contact_shapes[n].phi, layout.points.coordinate_rows[n]
        if not len(shapes) or not len(rows):
            reach.append(np.zeros(len(shapes)))
        elif is_bounded[n] and not layout.islands.is_variable[n]:
            moves = _sums_of_moves(layout, n, _modes_after_push(step, inside))
            reach.append(np.minimum(product(moves, np.minimum(_largest_forces(layout, n), UNBOUNDED)), UNBOUNDED))
        else:
            reach.append(np.full(len(shapes), UNBOUNDED))
    return np.concatenate(reach)


def _largest_forces(layout: Layout, island: int) -> np.ndarray:
    """Return the largest force at each coordinate of an island, N per √(2E) of the connected bodies [coordinates]. It
    is infinite if a damper or a rigid joint takes part."""
    items, coupling = layout.islands.coordinates[island]
    rows = product(coupling, layout.points.coordinate_rows[island])
    whole = np.sum(np.where(rows != 0.0, _modal_compliances(layout, island), 0.0) * square(rows), axis=1)
    by_coupling = np.sqrt(_static_compliances(layout, island, rows, whole))
    forces = np.where(np.any(coupling != 0.0, axis=1), by_coupling, 0.0)
    forces += np.sqrt(np.array([item.stiffness for item in items]))
    return np.where([item.is_rigid or item.damping != 0.0 for item in items], math.inf, forces)


def _modes_after_push(step: StepCoefficients, inside: slice) -> np.ndarray:
    """Return the displacement of modes in each sample of a flight, per newton on their mode shapes in the first step
    [modes, samples]."""
    kick, drift = step.kick[inside], step.drift[inside]
    spring = np.zeros(kick.size) if step.spring_kick is ABSENT else step.spring_kick[inside]
    decay = np.ones(kick.size) if step.loss is ABSENT else step.loss.decay_factor[inside]
    q, p, moved = np.zeros(kick.size), np.zeros(kick.size), np.zeros((FLIGHT_FRAMES, kick.size))
    for n in range(FLIGHT_FRAMES):
        push = kick if n == 0 else 0.0
        p = decay * p - spring * q + push
        q = q + drift * p
        p = decay * (p - spring * q + push)
        moved[n] = q
    return moved.T


def _sums_of_moves(layout: Layout, island: int, moved: np.ndarray) -> np.ndarray:
    """Return the sum over all samples of the size of each contact's displacement per newton at each coordinate, m/N
    [contacts, coordinates].

    moved: displacement of modes in each sample [modes, samples]
    """
    islands, rows = layout.islands, layout.points.coordinate_rows[island]
    inside = slice(*islands.contact_begins[island : island + 2])
    sums = np.zeros((inside.stop - inside.start, len(rows)))
    points = zip(islands.contact_points[inside], layout.points.contacts[inside], strict=True)
    for k, ((contact, point), sides) in enumerate(points):
        moves = np.zeros((len(rows), moved.shape[1]))
        for side, row in zip(contact_sides(layout.touching[contact], point), sides, strict=True):
            number = -1 if side.body is None else layout.body_index[side.body]
            for coordinate in islands.coordinates_of_body.get(number, ()):
                moves[coordinate] += product(rows[coordinate, row.in_island] * row.phi, moved[row.in_island])
        sums[k] = np.sum(np.abs(moves), axis=1)
    return sums


def contacts_to_build(system: ModalSystem, live: bool = False) -> list[int]:
    """Return the numbers of the contacts, and of the friction, that are built. live: events may come that the scene
    does not name"""
    scene = system.scene
    stiff = {e.contact for e in scene.event if isinstance(e, ChangeEvent) and e.stiffness}
    contacts = [k for k, c in enumerate(system.touching) if c.stiffness > 0.0 or c.name in stiff]
    if live or not contacts:
        return contacts
    changed = {e.contact or e.connection for e in scene.event if isinstance(e, ChangeEvent)} - {None}
    driven = {f.body for f in acting_forces(scene)} | {e.body for e in scene.event if isinstance(e, StrikeEvent)}
    driven |= {c.body for c in scene.connection if c.name in changed or not isinstance(c, SpringConnection)}
    driven |= {system.touching[k].body for k in contacts if system.touching[k].name in changed}
    pressing = {f.contact for f in scene.friction} - {None}
    driven |= {f.body for f in scene.friction} | {c.body for c in scene.contact if c.name in pressing}
    if all({system.touching[k].body, system.touching[k].on} & driven for k in contacts):
        return contacts  # as of all that is driven
    islands, reachable = find_islands(system, contacts), list[int]()
    for n, of_island in enumerate(islands.contacts):
        reach = initial_reach(system, islands, n, driven) if of_island else 0.0
        reachable += [k for k in of_island if is_reachable(system, k, reach)]
    return sorted(reachable)


def initial_reach(system: ModalSystem, islands: Islands, island: int, driven: set[str]) -> float:
    """Return √(2E) of an island, from its energy E at time 0, √J; infinite if it has one of the bodies in `driven`, or
    weight."""
    scene, bodies = system.scene, [system.modal_bodies[b] for b in islands.bodies[island]]
    is_heavy = scene.gravity != 0.0 and any(body.gravity_participation.any() for body in bodies)
    if is_heavy or any(scene.body[b].name in driven for b in islands.bodies[island]):
        return math.inf
    energy = sum(float(np.sum(square(m.p) + square(m.omega * m.q))) / 2 for m in bodies)
    energy += _spring_energy(system, islands.coordinates[island])
    return math.sqrt(2 * (energy + sum(initial_contact_energy(system, k) for k in islands.contacts[island])))


def is_reachable(system: ModalSystem, k: int, reach: float) -> bool:
    """True if the energy of its island could ever close contact k. reach: √(2E) of the island, √J

    A displacement Φq of energy E is at most √(2E·Σ Φ²/ω²), by the Cauchy-Schwarz inequality. Both schemes keep to that
    bound, for they conserve E. In a driven island, all contacts count as reachable.
    """
    if reach == math.inf:
        return True
    contact = system.touching[k]
    for point in system.points_of(contact):
        compliance = sum(static_compliance(system, side) for side in contact_sides(contact, point)) if reach else 0.0
        if not reach * math.sqrt(compliance) * (1 + 1e-9) <= offset(contact, point):
            return True
    return False


def static_compliance(system: ModalSystem, point: BodyPoint) -> float:
    """Return the static compliance Σ Φ²/ω² at a point, m/N; infinite for a free mass."""
    if point.body is None:
        return 0.0
    phi, omega = system.shape_at(point), system.modal_bodies[system.body_index[point.body]].omega
    moved = phi != 0.0
    with np.errstate(over="ignore"):  # a mode may be extremely slow
        return math.inf if np.any(omega[moved] == 0.0) else float(np.sum(square(phi[moved] / omega[moved])))


def _spring_energy(system: ModalSystem, coordinates: Coordinates) -> float:
    """Return the energy that the springs of an island hold at time 0, J."""
    bodies = system.modal_bodies
    extensions = [
        sum(float(product(row, bodies[b].q)) for b, row in c.parts.items()) - c.rest for c in coordinates.items
    ]
    s = np.array(extensions)
    return float(product(product(0.5 * s, coordinates.stiffness()), s))


def initial_contact_energy(system: ModalSystem, k: int) -> float:
    """Return the energy that contact k holds at time 0, J."""
    contact, energy = system.touching[k], 0.0
    for point in system.points_of(contact):
        s = -offset(contact, point)
        for side in contact_sides(contact, point):
            if side.body is not None:
                s += float(product(system.shape_at(side), system.modal_bodies[system.body_index[side.body]].q))
        energy += point.stiffness * power(max(0.0, s), contact.exponent + 1) / (contact.exponent + 1)
    return energy
