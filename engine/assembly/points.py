"""Points: mode shapes where contacts, forces, pickups and connections act, over the modes of the kernels' arrays."""

from collections import Counter
from collections.abc import Iterator
from itertools import groupby
from typing import NamedTuple

import numpy as np

from engine.arithmetic.elementary import square
from engine.arithmetic.products import product
from engine.assembly.contact_points import (
    FEW_LINEAR_CONTACTS,
    KEPT_SINGULAR_VALUE,
    BasisUse,
    BodyPoint,
    contact_sides,
    truncate_shapes,
)
from engine.assembly.islands import Islands
from engine.assembly.modal_system import ModalSystem
from engine.assembly.mode_shape_rows import ShapeRow
from engine.assembly.modes import Modes, find_row
from engine.assembly.pickup_points import HeardPoint, heard_points
from engine.kernel.data.enums import MAX_RANK
from engine.patch.friction import Friction


class ConnectionPart(NamedTuple):
    """Row of a connection coordinate over bodies whose modes lie beside each other."""

    row: ShapeRow
    island: int
    coordinate: int  # counted from the first of their island
    pieces: dict[int, tuple[int, int]]  # of each body: its first entry in the row, and how many are reserved


class ContactShapes(NamedTuple):
    """Mode shapes of an island at its contacts, both sides of each together, and their basis."""

    phi: np.ndarray  # [contacts, modes of the island], 1/√kg
    moved: tuple[np.ndarray, np.ndarray]  # contacts and modes of the entries of phi that are not 0, contact by contact
    rank: int  # of the basis; 0: there is none
    basis_phi: np.ndarray  # [contacts, modes of the island], 1/√kg: what the basis is of; all bodies have a part in it
    basis_use: BasisUse


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
    """Return the rows of an island's contacts, and its mode shapes there. If they have a basis, they are those of the
    basis."""
    points = islands.contact_points[slice(*islands.contact_begins[island : island + 2])]
    sides = [contact_sides(system.touching[k], point) for k, point in points]
    rows = [(find_row(system, modes, a), find_row(system, modes, b)) for a, b in sides]
    size = modes.of_island[island].stop - modes.of_island[island].start
    phi = basis_phi = _join_sides(rows, size)
    rank, use = 0, BasisUse.NONE
    is_stretching = any(system.scene.body[b].find_stretching(np.empty(0)) is not None for b in islands.bodies[island])
    if (
        not (islands.is_variable[island] or is_stretching)
        and not any(isinstance(system.touching[k], Friction) for k, _ in points)
        and all(a.body != b.body for a, b in sides)
        and _may_have_basis(sides, rows)
    ):
        basis_phi, rank = truncate_shapes(phi)
    if rank:
        rows = [(a.cut_from(row), b.cut_from(row)) for (a, b), row in zip(rows, basis_phi, strict=True)]
        phi = _join_sides(rows, size)
        contacts = [system.touching[k] for k, _ in points]
        are_linear = all(c.exponent == 1.0 and c.loss == 0.0 for c in contacts)
        use = BasisUse.IF_CAPPED if are_linear and len(contacts) < FEW_LINEAR_CONTACTS else BasisUse.FIRST
    moved = np.divmod(np.flatnonzero(phi.ravel() != 0.0), size)  # np.nonzero takes five times as long
    return rows, ContactShapes(phi, moved, rank, basis_phi, use)


def _join_sides(rows: list[tuple[ShapeRow, ShapeRow]], size: int) -> np.ndarray:
    """Return the mode shapes at contacts, both sides together, over all modes of an island [contacts, size]."""
    phi = np.zeros((len(rows), size))
    for of_contact, sides in zip(phi, rows, strict=True):
        for side in sides:
            of_contact[side.in_island] += side.phi
    return phi


def _may_have_basis(sides: list[tuple[BodyPoint, BodyPoint]], rows: list[tuple[ShapeRow, ShapeRow]]) -> bool:
    """Return False if it is seen without a decomposition that the rank of the contacts is too large for a basis: a
    contact alone on a body moves as no others do."""
    touching = Counter(point.body for points in sides for point in points)
    squares = [[float(product(row.phi, row.phi)) for row in of_contact] for of_contact in rows]
    least = square(KEPT_SINGULAR_VALUE) * sum(map(sum, squares))  # at least that share of the largest singular value
    is_apart = [
        any(touching[point.body] == 1 and size > least for point, size in zip(points, of_contact, strict=True))
        for points, of_contact in zip(sides, squares, strict=True)
    ]
    return sum(is_apart) <= MAX_RANK + 1


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
