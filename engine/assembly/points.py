"""Points: mode shapes where contacts, forces, pickups and connections act, over the modes of the kernels' arrays."""

from collections.abc import Iterator
from itertools import groupby
from typing import NamedTuple

import numpy as np

from engine.assembly.contact_points import contact_sides
from engine.assembly.islands import Islands
from engine.assembly.modal_system import ModalSystem
from engine.assembly.mode_shape_rows import ShapeRow
from engine.assembly.modes import Modes, find_row
from engine.assembly.pickup_points import HeardPoint, heard_points


class ConnectionPart(NamedTuple):
    """Row of a connection coordinate over bodies whose modes lie beside each other."""

    row: ShapeRow
    island: int
    coordinate: int  # counted from the first of their island
    pieces: dict[int, tuple[int, int]]  # of each body: its first entry in the row, and how many are reserved


class ContactShapes(NamedTuple):
    """Mode shapes of an island at its contacts, both sides of each together."""

    phi: np.ndarray  # [contacts, modes of the island], 1/√kg
    moved: tuple[np.ndarray, np.ndarray]  # contacts and modes of the entries of phi that are not 0, contact by contact


class Points(NamedTuple):
    """Mode shapes at all points, in the order of the kernels' arrays."""

    contacts: list[tuple[ShapeRow, ShapeRow]]  # on both bodies of each contact point
    contact_shapes: list[ContactShapes]  # of each island
    forces: list[ShapeRow]
    pickups: list[HeardPoint]  # of all pickups, and of the one-way drives of strings
    connection_parts: list[ConnectionPart]
    coordinate_rows: list[np.ndarray]  # of the connections of each island [coordinates, modes of the island]


def find_points(system: ModalSystem, islands: Islands, modes: Modes) -> Points:
    """Return the points of a scene."""
    of_islands = [_contacts_of_island(system, islands, modes, n) for n in range(len(islands.bodies))]
    return Points(
        contacts=[row for rows, _ in of_islands for row in rows],
        contact_shapes=[shapes for _, shapes in of_islands],
        forces=[find_row(system, modes, system.point_of(force)) for force in islands.forces],
        pickups=heard_points(system, islands, modes),
        connection_parts=list(_connection_parts(islands, modes)),
        coordinate_rows=[_coordinate_rows(islands, modes, n) for n in range(len(islands.bodies))],
    )


def _contacts_of_island(
    system: ModalSystem, islands: Islands, modes: Modes, island: int
) -> tuple[list[tuple[ShapeRow, ShapeRow]], ContactShapes]:
    """Return the rows of an island's contacts, and its mode shapes there."""
    points = islands.contact_points[slice(*islands.contact_begins[island : island + 2])]
    sides = [contact_sides(system.touching[k], point) for k, point in points]
    rows = [(find_row(system, modes, a), find_row(system, modes, b)) for a, b in sides]
    size = modes.of_island[island].stop - modes.of_island[island].start
    phi = _join_sides(rows, size)
    moved = np.divmod(np.flatnonzero(phi.ravel() != 0.0), size)  # np.nonzero takes five times as long
    return rows, ContactShapes(phi, moved)


def _join_sides(rows: list[tuple[ShapeRow, ShapeRow]], size: int) -> np.ndarray:
    """Return the mode shapes at contacts, both sides together, over all modes of an island [contacts, size]."""
    phi = np.zeros((len(rows), size))
    for of_contact, sides in zip(phi, rows, strict=True):
        for side in sides:
            of_contact[side.in_island] += side.phi
    return phi


def _coordinate_rows(islands: Islands, modes: Modes, island: int) -> np.ndarray:
    """Return the rows of an island's coordinates over all its modes [coordinates, modes]."""
    items, inside = islands.coordinates[island].items, modes.of_island[island]
    rows = np.zeros((len(items), inside.stop - inside.start))
    for row, item in zip(rows, items, strict=True):
        for body, values in item.parts.items():
            row[modes.in_island[body]] = values
    return rows


def _connection_parts(islands: Islands, modes: Modes) -> Iterator[ConnectionPart]:
    """Yield the rows of connection coordinates, in the order of their modes. Bodies that lie beside each other and have
    the same coordinates share a row, since each row takes time in a step. It is zero for modes of no body, between them
    and in the last vector."""
    key = lambda b: (islands.of_body[b], islands.coordinates_of_body.get(b, ()))
    for (island, numbers), group in groupby(islands.body_order, key):
        bodies = list(group)
        begins = {b: modes.in_island[b].start - modes.in_island[bodies[0]].start for b in bodies}
        for number in numbers:
            phi = np.zeros(begins[bodies[-1]] + modes.room[bodies[-1]])
            for b, begin in begins.items():
                values = islands.coordinates[island].items[number].parts[b]
                phi[begin : begin + values.size] = values
            row = ShapeRow(modes.in_island[bodies[0]].start, modes.of_body[bodies[0]].start, phi)
            yield ConnectionPart(row, island, number, {b: (begin, modes.room[b]) for b, begin in begins.items()})
