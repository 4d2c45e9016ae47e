"""Islands: who is where. Bodies, contacts, forces and coordinates of connections, in the order of the kernels' arrays,
which are sorted by island."""

from typing import Any, NamedTuple

import numpy as np

from engine.assembly.connection_coordinates import connected_pairs, find_coordinates
from engine.assembly.contact_points import ContactPoint
from engine.assembly.coordinates import Coordinates
from engine.assembly.external_forces import ExternalForces, acting_forces
from engine.assembly.modal_system import ModalSystem
from engine.assembly.one_way_drive import order_islands
from engine.assembly.subsystems import connected_components


class Islands(NamedTuple):
    """The island of each body, and what belongs to each island."""

    of_body: list[int]  # island of each of the scene's bodies
    bodies: list[list[int]]  # numbers of the scene's bodies in each island
    body_order: list[int]  # numbers of the scene's bodies, in the order of the arrays
    mode_counts: np.ndarray  # of the bodies of each island
    coordinates: list[Coordinates]  # of the connections of each island
    coordinates_of_body: dict[int, tuple[int, ...]]  # of each connected body, counted from the first of its island
    is_variable: list[bool]  # whether connections of each island may change: those with a name
    contacts: list[list[int]]  # numbers of the contacts of each island that are built
    contact_points: list[tuple[int, ContactPoint]]  # all points, with the number of their contact
    contact_begins: np.ndarray  # first contact point of each island, and the number of all [islands + 1]
    forces: ExternalForces  # all external forces


def find_islands(system: ModalSystem, contacts: list[int], step: float | None = None) -> Islands:
    """Return the islands of a scene.

    contacts: numbers of the contacts that are built
    step:     length of the steps for which springs are compensated, s; None: they are not
    """
    scene, index = system.scene, system.body_index
    joined = [system.touching[k] for k in contacts]
    pairs = [(index[c.body], index[c.on]) for c in joined if c.on is not None] + connected_pairs(system)
    pressing = {c.name: c.body for c in scene.contact}
    pairs += [(index[f.body], index[pressing[f.contact]]) for f in scene.friction if f.contact is not None]
    of_body = order_islands(system, connected_components(len(scene.body), pairs))
    bodies: list[list[int]] = [[] for _ in range(max(of_body) + 1)]
    for b, island in enumerate(of_body):
        bodies[island].append(b)
    contacts_of: list[list[int]] = [[] for _ in bodies]
    for k in contacts:
        contacts_of[of_body[index[system.touching[k].body]]].append(k)
    points = [[(k, point) for k in inside for point in system.points_of(system.touching[k])] for inside in contacts_of]
    coordinates = find_coordinates(system, of_body, step)
    coordinates_of_body: dict[int, tuple[int, ...]] = {}
    for found in coordinates:
        for number, item in enumerate(found.items):
            coordinates_of_body |= {b: (*coordinates_of_body.get(b, ()), number) for b in item.parts}
    names = [{scene.connection[i.connection].name for i in c.items if i.connection is not None} for c in coordinates]
    return Islands(
        of_body=of_body,
        bodies=bodies,
        # those that the same coordinates hold lie beside each other
        body_order=sorted(range(len(of_body)), key=lambda b: (of_body[b], coordinates_of_body.get(b, ()))),
        mode_counts=np.bincount(of_body, [body.omega.size for body in system.modal_bodies]).astype(np.int64),
        coordinates=coordinates,
        coordinates_of_body=coordinates_of_body,
        # the same live and in a rendering, whatever the score changes, so that both have the same samples
        is_variable=[bool(of_island - {None}) for of_island in names],
        contacts=contacts_of,
        contact_points=[point for inside in points for point in inside],
        contact_begins=begins_of([len(inside) for inside in points]),
        forces=sorted(acting_forces(scene), key=lambda force: of_body[index[force.body]]),
    )


def begins_of(counts: Any) -> np.ndarray:
    """Return the first position of each block if blocks of the given sizes follow each other, and the end of the
    last."""
    return np.concatenate([[0], np.cumsum(counts)]).astype(np.int64)
