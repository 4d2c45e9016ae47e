"""Select the contacts of a scene that can have an effect: those that are stiff, now or after an event, and can
close."""

import math
from collections.abc import Iterable

import numpy as np

from engine.assembly.body_point import BodyPoint
from engine.assembly.coordinates import Coordinates
from engine.assembly.layout import Layout, acting_forces
from engine.bodies.body import ModalBody
from engine.patch.scene import Scene
from engine.patch.tables import ChangeEvent, SpringConnection, StrikeEvent


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
