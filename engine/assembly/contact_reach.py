"""Contacts that can have an effect: those that are stiff, now or after an event, and can close; and bounds on how far
connected bodies can move contacts in a flight, per √(2E) of their energy E (docs/design.md, "Connections").
"""

import math
from collections.abc import Iterable

import numpy as np

from engine.assembly.contact_points import BodyPoint
from engine.assembly.coordinates import Coordinates
from engine.assembly.external_forces import acting_forces
from engine.assembly.layout import Layout
from engine.bodies.body import ModalBody
from engine.kernel.data.enums import FLIGHT_FRAMES
from engine.kernel.data.model import StepCoefficients
from engine.patch.scene import Scene
from engine.patch.tables import ChangeEvent, SpringConnection, StrikeEvent

UNBOUNDED = 1e300  # m/√J; infinity times no energy would be no number


def dense_rows(layout: Layout, island: int) -> np.ndarray:
    """Return the rows of an island's coordinates over all its modes [coordinates, modes]."""
    items = layout.coordinates[island].items
    rows = np.zeros((len(items), int(layout.islands.mode[island + 1] - layout.islands.mode[island])))
    for row, item in zip(rows, items, strict=True):
        for body, values in item.parts.items():
            row[layout.local_modes(body)] = values
    return rows


def contact_reach(layout: Layout, seconds: float) -> np.ndarray:
    """Bound how far connected bodies can close each contact in `seconds`, m per √(2E) of their energy, √J [contacts].

    A displacement Φ·q of energy E changes no faster than √(2E·ΣΦ²), and is at most √(2E·C), with C its static
    compliance. Both follow from the Cauchy-Schwarz inequality, and hold for any springs of the connections.
    """
    omega, begins, reach = layout.concatenate_modes("omega"), layout.islands.mode, []
    for n in range(begins.size - 1):
        shapes, inside = layout.island_contact_shapes(n), omega[begins[n] : begins[n + 1]]
        if not layout.coordinates[n].items:
            reach.append(np.zeros(len(shapes)))
            continue
        for b in layout.bodies_of_island(n):
            if b not in layout.connected_body_numbers:
                shapes[:, layout.local_modes(b)] = 0.0
        limit = np.array([2 * math.sqrt(c) for c in _static_compliances(layout, n, shapes, inside)])
        reach.append(np.minimum(seconds * np.sqrt(np.sum(shapes**2, axis=1)), limit.reshape(-1)))
    return np.concatenate(reach)


def _static_compliances(layout: Layout, island: int, shapes: np.ndarray, omega: np.ndarray) -> list[float]:
    """Return Φ·H⁻¹·Φᵀ of each mode shape. H is the stiffness of the modes with the ends of strings. The value is
    infinite if a free mass takes part."""
    coupling = layout.coordinates[island].coupling
    ends = np.flatnonzero(np.any(coupling != 0.0, axis=1))
    rows, compliances = dense_rows(layout, island)[ends], []
    free = omega == 0.0
    modal_compliance = 1 / np.where(free, 1.0, omega) ** 2
    held = coupling[np.ix_(ends, ends)]
    factor = np.linalg.solve(np.eye(ends.size) + held @ (rows * modal_compliance) @ rows.T, held)
    for phi in shapes:
        if np.any(phi[free] != 0.0) or (ends.size and np.any(rows[:, free])):
            compliances.append(math.inf)
            continue
        moved = (rows * modal_compliance) @ phi
        compliances.append(max(0.0, float(phi * modal_compliance @ phi - moved @ factor @ moved)))
    return compliances


# --- by the forces of connections


def contact_reach_by_forces(layout: Layout, step: StepCoefficients, is_bounded: np.ndarray) -> np.ndarray:
    """Bound how much further each contact can close in a flight than its bodies alone would close it, m per √(2E) of
    the connected bodies, √J [contacts].

    A connection with the force f moves a contact by at most max|f| times the sum, over the steps that follow, of the
    size of the displacement per newton in one step. And f is at most √(2E·ℓ·H⁻¹·ℓᵀ), with ℓ the force per displacement.

    is_bounded: True for islands in which this holds, with single steps and without weight [islands]
    """
    reach = []
    for n in range(layout.islands.mode.size - 1):
        shapes, items = layout.island_contact_shapes(n), layout.coordinates[n].items
        if not len(shapes) or not items:
            reach.append(np.zeros(len(shapes)))
        elif is_bounded[n] and not layout.is_variable(n):
            inside = slice(layout.islands.mode[n], layout.islands.mode[n + 1])
            forces = np.minimum(_largest_forces(layout, n, layout.concatenate_modes("omega")[inside]), UNBOUNDED)
            moves = _sums_of_moves(shapes, dense_rows(layout, n), _modes_after_push(step, inside))
            reach.append(np.minimum(moves @ forces, UNBOUNDED))
        else:
            reach.append(np.full(len(shapes), UNBOUNDED))
    return np.concatenate(reach)


def _largest_forces(layout: Layout, island: int, omega: np.ndarray) -> np.ndarray:
    """Return the largest force at each coordinate of an island, N per √(2E) of the connected bodies [coordinates]. It
    is infinite if a damper or a rigid joint takes part."""
    items, coupling = layout.coordinates[island].items, layout.coordinates[island].coupling
    stiffness = np.array([item.stiffness for item in items])
    rows = coupling @ dense_rows(layout, island)
    by_coupling = np.sqrt(_static_compliances(layout, island, rows, omega))
    forces = np.where(np.any(coupling != 0.0, axis=1), by_coupling, 0.0) + np.sqrt(stiffness)
    return np.where([item.is_rigid or item.damping != 0.0 for item in items], math.inf, forces)


def _modes_after_push(step: StepCoefficients, inside: slice) -> np.ndarray:
    """Return the displacement of modes in each sample of a flight, per newton on their mode shapes in the first step
    [modes, samples]."""
    kick, drift = step.kick[inside], step.drift[inside]
    spring = np.zeros(kick.size) if step.spring_kick is None else step.spring_kick[inside]
    decay = np.ones(kick.size) if step.loss is None else step.loss.decay_factor[inside]
    q, p, moved = np.zeros(kick.size), np.zeros(kick.size), np.zeros((FLIGHT_FRAMES, kick.size))
    for n in range(FLIGHT_FRAMES):
        push = kick if n == 0 else 0.0
        p = decay * p - spring * q + push
        q = q + drift * p
        p = decay * (p - spring * q + push)
        moved[n] = q
    return moved.T


def _sums_of_moves(shapes: np.ndarray, rows: np.ndarray, moved: np.ndarray) -> np.ndarray:
    """Return the sum over all samples of the size of each contact's displacement per newton at each coordinate, m/N
    [contacts, coordinates].

    shapes: at contacts [contacts, modes]; rows: of coordinates [coordinates, modes]
    """
    sums = np.zeros((len(shapes), len(rows)))
    for k, phi in enumerate(shapes):
        used = np.flatnonzero(phi)
        held = np.flatnonzero(np.any(rows[:, used] != 0.0, axis=1))
        sums[k, held] = np.sum(np.abs((rows[np.ix_(held, used)] * phi[used]) @ moved[used]), axis=1)
    return sums


def contacts_to_build(scene: Scene, modal_bodies: list[ModalBody], live: bool = False) -> list[int]:
    """Return the numbers of the contacts that are built. live: events may come that the scene does not name"""
    stiff = {e.contact for e in scene.event if isinstance(e, ChangeEvent) and e.stiffness}
    contacts = [k for k, c in enumerate(scene.contact) if c.stiffness > 0.0 or c.name in stiff]
    if live:
        return contacts
    layout = Layout(scene, modal_bodies, contacts)
    reach = initial_reach(layout, contacts)
    return [k for k in contacts if is_reachable(layout, k, reach)]


def initial_reach(layout: Layout, contacts: Iterable[int]) -> dict[int, float]:
    """Return √(2E) of each island with contacts, from its energy E at time 0, √J; infinite if it is driven."""
    scene, island_of, bodies_of = layout.scene, layout.island_of_body, dict[int, list[int]]()
    for b in range(len(scene.body)):
        bodies_of.setdefault(island_of[b], []).append(b)
    contacts_of: dict[int, list[int]] = {}
    for k in contacts:
        contacts_of.setdefault(island_of[layout.body_index[scene.contact[k].body]], []).append(k)
    driven = {f.body for f in acting_forces(scene)} | {e.body for e in scene.event if isinstance(e, StrikeEvent)}
    changed = {e.contact or e.connection for e in scene.event if isinstance(e, ChangeEvent)} - {None}
    reach: dict[int, float] = {}
    for island, inside in contacts_of.items():
        bodies, names = (
            [layout.modal_bodies[b] for b in bodies_of[island]],
            {scene.body[b].name for b in bodies_of[island]},
        )
        has_changes = any(c.name in changed and c.body in names for c in scene.connection)
        has_ends = any(not isinstance(c, SpringConnection) and c.body in names for c in scene.connection)
        heavy = scene.gravity != 0.0 and any(body.gravity_participation.any() for body in bodies)
        pushed = any(scene.body[b].name in driven for b in bodies_of[island])
        if heavy or pushed or has_ends or has_changes or any(scene.contact[k].name in changed for k in inside):
            reach[island] = math.inf
            continue
        energy = sum(float(np.sum(m.p**2 + (m.omega * m.q) ** 2)) / 2 for m in bodies)
        energy += _spring_energy(layout, layout.coordinates[island])
        reach[island] = math.sqrt(2 * (energy + sum(initial_contact_energy(layout, k) for k in inside)))
    return reach


def is_reachable(layout: Layout, k: int, reach_of_island: dict[int, float]) -> bool:
    """True if the energy of its island could ever close contact k.

    A displacement Φq of energy E is at most √(2E·Σ Φ²/ω²), by the Cauchy-Schwarz inequality. Both schemes keep to that
    bound, for they conserve E. In a driven island, all contacts count as reachable.
    """
    contact = layout.scene.contact[k]
    reach = reach_of_island[layout.island_of_body[layout.body_index[contact.body]]]
    if reach == math.inf:
        return True
    for point in layout.points_of(contact):
        compliance = sum(static_compliance(layout, side) for side in layout.contact_sides(k, point)) if reach else 0.0
        if not reach * math.sqrt(compliance) * (1 + 1e-9) <= layout.offset(k, point):
            return True
    return False


def static_compliance(layout: Layout, point: BodyPoint) -> float:
    """Return the static compliance Σ Φ²/ω² at a point, m/N; infinite for a free mass."""
    if point.body is None:
        return 0.0
    phi, omega = layout.mode_shape(point), layout.modal_bodies[layout.body_index[point.body]].omega
    moved = phi != 0.0
    with np.errstate(over="ignore"):  # a mode may be extremely slow
        return math.inf if np.any(omega[moved] == 0.0) else float(np.sum((phi[moved] / omega[moved]) ** 2))


def _spring_energy(layout: Layout, coordinates: Coordinates) -> float:
    """Return the energy that the springs of an island hold at time 0, J."""
    bodies, items = layout.modal_bodies, coordinates.items
    s = np.array([sum(float(row @ bodies[b].q) for b, row in item.parts.items()) - item.rest for item in items])
    stiffness = coordinates.coupling + np.diag([item.stiffness for item in items])
    return float(0.5 * s @ stiffness @ s)


def initial_contact_energy(layout: Layout, k: int) -> float:
    """Return the energy that contact k holds at time 0, J."""
    contact, energy = layout.scene.contact[k], 0.0
    for point in layout.points_of(contact):
        s = -layout.offset(k, point)
        for side in layout.contact_sides(k, point):
            if side.body is not None:
                s += float(layout.mode_shape(side) @ layout.modal_bodies[layout.body_index[side.body]].q)
        energy += point.stiffness * max(0.0, s) ** (contact.exponent + 1) / (contact.exponent + 1)
    return energy
