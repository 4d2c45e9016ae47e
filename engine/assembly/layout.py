"""Index layout: the island of each part of a scene, and its position in the kernels' arrays, which are sorted by
island."""

from collections.abc import Iterable, Sequence
from functools import cached_property
from itertools import groupby
from typing import Any, NamedTuple

import numpy as np

from engine.assembly.connection_coordinates import connected_pairs, find_coordinates
from engine.assembly.contact_points import (
    FEW_LINEAR_CONTACTS,
    BasisUse,
    BodyPoint,
    ContactPoint,
    contact_points,
    contact_sides,
    offset,
    truncate_shapes,
)
from engine.assembly.coordinates import Coordinates
from engine.assembly.external_forces import acting_forces
from engine.assembly.one_way_drive import drive_forces, find_drives, order_islands
from engine.assembly.pickup_points import DrivePickup, HeardPoint, drive_pickups, heard_points
from engine.assembly.subsystems import connected_components, estimate_cost, partition_islands
from engine.bodies.body import ModalBody
from engine.kernel.data.enums import LANES
from engine.kernel.data.model import Islands
from engine.patch.scene import Scene
from engine.patch.tables import ChangeEvent, Contact, Pickup

MIN_ALIGNED_MODES = 16  # of a connected body: from so many on, it begins and ends where vectors do


class ShapeRow(NamedTuple):
    """Mode shapes of consecutive modes at a point."""

    mode_begin: int  # counted from the first of their island
    mode_begin_of_all: int  # counted from the first of all
    phi: np.ndarray  # [modes], 1/√kg


class ConnectionPart(NamedTuple):
    """Row of a connection coordinate over bodies whose modes lie beside each other."""

    row: ShapeRow
    coordinate: int  # counted from the first of their island
    pieces: dict[int, tuple[int, int]]  # of each body: its first entry in the row, and how many are reserved


class Layout:
    """Island of each body, contact, force and pickup, and its slot in the kernels' arrays.

    scene:        the scene
    modal_bodies: its bodies as modes
    contacts:     numbers of the contacts that are built
    variable:     names of the connections that may change
    step:         length of the steps for which springs are compensated, s; None: they are not
    """

    def __init__(
        self,
        scene: Scene,
        modal_bodies: list[ModalBody],
        contacts: list[int],
        variable: frozenset[str] = frozenset(),
        step: float | None = None,
    ) -> None:
        self.scene, self.modal_bodies, self.variable, self.step = scene, modal_bodies, variable, step
        self.body_index = {body.name: i for i, body in enumerate(scene.body)}
        self.forces = acting_forces(scene)
        joined = [scene.contact[k] for k in contacts]
        pairs = [(self.body_index[c.body], self.body_index[c.on]) for c in joined if c.on is not None]
        pairs += connected_pairs(scene, self.body_index)
        self.island_of_body = order_islands(scene, connected_components(len(scene.body), pairs), self.body_index)
        # those that the same coordinates hold lie beside each other
        self.body_order = sorted(range(len(scene.body)), key=lambda b: (self.island_of_body[b], self.coordinates_of(b)))
        touching = self._sort_by_island(contacts, [c.body for c in scene.contact])
        self.contact_points = [(k, point) for k in touching for point in self.points_of(scene.contact[k])]
        self.force_order = self._sort_by_island(range(len(self.forces)), [f.body for f in self.forces])

    def _sort_by_island(self, items: Iterable[int], bodies: Sequence[str]) -> list[int]:
        """Sort items by the island of the body that each belongs to."""
        return sorted(items, key=lambda i: self.island_of_body[self.body_index[bodies[i]]])

    # --- where things are

    def points_of(self, contact: Contact) -> list[ContactPoint]:
        """Return the points of a contact."""
        on = None if contact.on is None else self.scene.body[self.body_index[contact.on]]
        return contact_points(contact, self.scene.body[self.body_index[contact.body]], on)

    def contact_sides(self, k: int, point: ContactPoint) -> tuple[BodyPoint, BodyPoint]:
        """Return the two body points that a point of contact k joins, each with the sign of its part in the
        compression."""
        return contact_sides(self.scene.contact[k], point)

    def offset(self, k: int, point: ContactPoint) -> float:
        """Return the offset that is subtracted from the projected displacement at a point of contact k, m."""
        return offset(self.scene.contact[k], point)

    @cached_property
    def contact_rows(self) -> list[tuple[BodyPoint, BodyPoint]]:
        """The two sides of each contact point, in the kernels' order. If their island has a basis, they have its mode
        shapes."""
        rows = [self.contact_sides(k, point) for k, point in self.contact_points]
        for n, (shapes, rank) in enumerate(self.contact_shapes):
            first = self.islands.contact[n]
            for slot in range(first, first + len(shapes)) if rank else ():
                a, b = rows[slot]
                rows[slot] = self._with_shape(a, shapes[slot - first]), self._with_shape(b, shapes[slot - first])
        return rows

    def _with_shape(self, point: BodyPoint, phi: np.ndarray) -> BodyPoint:
        """Return the point with its body's part of the given mode shapes [modes of the island]."""
        return point if point.body is None else point._replace(phi=phi[self.local_modes(self.body_index[point.body])])

    @cached_property
    def contact_shapes(self) -> list[tuple[np.ndarray, int]]:
        """Mode shapes of each island at its contacts [contacts, modes], and the rank of their basis; 0 if there is
        none."""
        found, begins = [], self.islands.contact
        for n in range(begins.size - 1):
            points = self.contact_points[begins[n] : begins[n + 1]]
            sides = [self.contact_sides(k, point) for k, point in points]
            phi = self._shapes_at(sides, n)
            joins_itself = any(a.body == b.body for a, b in sides)
            found.append((phi, 0) if joins_itself or self.is_variable(n) else truncate_shapes(phi))
        return found

    def _shapes_at(self, sides: Sequence[tuple[BodyPoint, BodyPoint]], island: int) -> np.ndarray:
        """Return the mode shapes of an island at contacts, both sides together [contacts, modes]."""
        phi = [self.dense_mode_shape(a, island) + self.dense_mode_shape(b, island) for a, b in sides]
        return np.array(phi).reshape(len(sides), int(np.diff(self.islands.mode)[island]))

    def island_contact_shapes(self, island: int) -> np.ndarray:
        """Return the mode shapes of an island at its contacts, as the kernels have them [contacts, modes]."""
        first, last = self.islands.contact[island : island + 2]
        return self._shapes_at(self.contact_rows[first:last], island)

    @cached_property
    def basis_uses(self) -> list[BasisUse]:
        """Condition for the use of the basis of each island's contacts."""
        begins, uses = self.islands.contact, list[BasisUse]()
        for n, (_, rank) in enumerate(self.contact_shapes):
            contacts = [self.scene.contact[k] for k, _ in self.contact_points[begins[n] : begins[n + 1]]]
            are_linear = all(c.exponent == 1.0 and c.loss == 0.0 for c in contacts)
            few = are_linear and len(contacts) < FEW_LINEAR_CONTACTS
            uses.append(BasisUse.NONE if rank == 0 else BasisUse.IF_CAPPED if few else BasisUse.FIRST)
        return uses

    def point_of(self, table: Any) -> BodyPoint:
        """Return the point of a body at which a force or a pickup acts."""
        body = self.scene.body[self.body_index[table.body]]
        return BodyPoint(table.body, body.split_positions(table.at)[0], 1.0)

    @cached_property
    def force_points(self) -> list[BodyPoint]:
        """Point at which each external force acts, in the kernels' order."""
        return [self.point_of(self.forces[j]) for j in self.force_order]

    @cached_property
    def heard_points(self) -> list[HeardPoint]:
        """Points of all pickups, and of the one-way drives of strings, in the kernels' order."""
        pickups: list[Pickup | DrivePickup] = [*self.scene.pickup, *drive_pickups(self.scene)]
        order = self._sort_by_island(range(len(pickups)), [p.body for p in pickups])
        return [h for i in order for h in heard_points(self.scene, self.modal_bodies, self.body_index, pickups[i])]

    # --- connections

    @cached_property
    def coordinates(self) -> list[Coordinates]:
        """Coordinates of the connections of each island."""
        return find_coordinates(self.scene, self.modal_bodies, self.body_index, self.island_of_body, self.step)

    def is_variable(self, island: int) -> bool:
        """True if connections of an island may change."""
        numbers = [item.connection for item in self.coordinates[island].items]
        return any(n is not None and self.scene.connection[n].name in self.variable for n in numbers)

    @cached_property
    def connected_body_numbers(self) -> set[int]:
        """Numbers of the bodies that have connections."""
        return set(self._coordinates_of_bodies)

    @cached_property
    def _coordinates_of_bodies(self) -> dict[int, tuple[int, ...]]:
        """Coordinates of each connected body, counted from the first of its island."""
        found: dict[int, tuple[int, ...]] = {}
        for coordinates in self.coordinates:
            for number, item in enumerate(coordinates.items):
                found |= {body: (*found.get(body, ()), number) for body in item.parts}
        return found

    def coordinates_of(self, body: int) -> tuple[int, ...]:
        """Return the coordinates of a body's connections, counted from the first of its island."""
        return self._coordinates_of_bodies.get(body, ())

    @cached_property
    def _held_alike(self) -> list[list[list[int]]]:
        """Groups of connected bodies of each island, in the kernels' order. The bodies of a group lie beside each other
        and have the same coordinates."""
        groups: list[list[list[int]]] = [[] for _ in self.coordinates]
        key = lambda b: (self.island_of_body[b], self.coordinates_of(b))
        for (island, numbers), bodies in groupby(self.body_order, key):
            if numbers:
                groups[island].append(list(bodies))
        return groups

    @cached_property
    def connection_parts(self) -> list[ConnectionPart]:
        """Rows of connection coordinates, in the order of their modes. Bodies that lie beside each other and have the
        same coordinates share a row, since each row takes time in a step."""
        return [
            self._connection_part(n, bodies, number)
            for n, groups in enumerate(self._held_alike)
            for bodies in groups
            for number in self.coordinates_of(bodies[0])
        ]

    def _connection_part(self, island: int, bodies: list[int], number: int) -> ConnectionPart:
        """Return the row of a coordinate over bodies beside each other. It is zero for modes of no body, between them
        and in the last vector."""
        begin = self.local_modes(bodies[0]).start
        phi = np.zeros(self.local_modes(bodies[-1]).start + self._room_of(bodies[-1]) - begin)
        pieces = {b: (self.local_modes(b).start - begin, self._room_of(b)) for b in bodies}
        for b, (first, _) in pieces.items():
            values = self.coordinates[island].items[number].parts[b]
            phi[first : first + values.size] = values
        return ConnectionPart(ShapeRow(begin, self.global_modes(bodies[0]).start, phi), number, pieces)

    @cached_property
    def is_damped(self) -> bool:
        """True if connections have dampers, or may get them."""
        items = [item for coordinates in self.coordinates for item in coordinates.items]
        changed = any(isinstance(e, ChangeEvent) and e.damping_coefficient for e in self.scene.event)
        return changed or bool(self.variable) or any(item.damping for item in items)

    def bodies_of_island(self, island: int) -> list[int]:
        """Return the numbers of the scene's bodies in an island."""
        return [b for b in range(len(self.scene.body)) if self.island_of_body[b] == island]

    # --- islands

    @cached_property
    def islands(self) -> Islands:
        """First item of each island in all arrays. Those of contact bases and of events are 0, as these are built
        later."""
        scene = self.scene
        body = self._segment_begins(b.name for b in scene.body)
        mode = self._mode_begins[body]
        contact = self._segment_begins(scene.contact[k].body for k, _ in self.contact_points)
        free = np.flatnonzero(self.free_mass_modes)
        joined, contacts = np.array([len(c.items) for c in self.coordinates]), np.diff(contact)
        parts = [sum(len(self.coordinates_of(bodies[0])) for bodies in groups) for groups in self._held_alike]
        return Islands(
            mode=mode,
            contact=contact,
            basis=np.zeros(body.size, dtype=np.int64),
            compliance=_begins(contacts**2),
            connection=_begins(joined),
            connection_pair=_begins(joined**2),
            connection_contact=_begins(joined * contacts),
            connection_part=_begins(parts),
            force=self._segment_begins(self.forces[j].body for j in self.force_order),
            event=np.zeros(body.size, dtype=np.int64),
            pickup=self._segment_begins(heard.pickup.body for heard in self.heard_points),
            body=body,
            free_mass=np.searchsorted(free, mode).astype(np.int64),
            partition=self._keep_together(partition_islands(estimate_cost(self.mode_counts, np.diff(contact)))),
        )

    def _keep_together(self, partition: np.ndarray) -> np.ndarray:
        """Return the first island of each partition, without partitions that would separate islands of a one-way
        drive."""
        for drive in find_drives(self.scene):
            first, last = (self.island_of_body[self.body_index[name]] for name in (drive.string, drive.body))
            partition = partition[(partition <= first) | (partition > last)]
        return partition

    @cached_property
    def driven_islands(self) -> np.ndarray | None:
        """Island of each point that strings drive [points]; None without any."""
        forces = drive_forces(self.scene)
        return np.array([self.island_of_body[self.body_index[f.body]] for f in forces]) if forces else None

    @cached_property
    def free_mass_modes(self) -> np.ndarray:
        """True for modes of free masses, which have no restoring force and no connection [modes], bool."""
        free = np.asarray(self.concatenate_modes("omega") == 0.0)
        for b in self.connected_body_numbers:
            free[self.global_modes(b)] = False
        return free

    def _segment_begins(self, bodies: Iterable[str]) -> np.ndarray:
        """Return the first item of each island, given the body of every item [islands + 1]."""
        owners = np.array([self.island_of_body[self.body_index[name]] for name in bodies], dtype=np.int64)
        counts = np.bincount(owners, minlength=max(self.island_of_body) + 1)
        return np.concatenate([[0], np.cumsum(counts)]).astype(np.int64)

    # --- modes

    @cached_property
    def _mode_begins(self) -> np.ndarray:
        """First mode of each body, in the kernels' order, and the number of all modes.

        Connected bodies with many modes begin, and end, where vectors of their island do. Between them there may be
        modes of no body. Nothing moves these, and no pickup depends on them.
        """
        begins, at, first, island = list[int](), 0, 0, -1
        for b in self.body_order:
            if self.island_of_body[b] != island:
                island, first = self.island_of_body[b], at
            at += -(at - first) % self._vector_of(b)
            begins.append(at)
            at += self._room_of(b)
        return np.array([*begins, at], dtype=np.int64)

    def _vector_of(self, number: int) -> int:
        """Return the number of modes of a body that are processed at once because of its connections; 1 with few modes,
        or without connections."""
        is_large = self.modal_bodies[number].omega.size >= MIN_ALIGNED_MODES
        return LANES if is_large and number in self.connected_body_numbers else 1

    def _room_of(self, number: int) -> int:
        """Return the number of modes that are reserved for a body; it has at most that many."""
        size = self.modal_bodies[number].omega.size
        return size + -size % self._vector_of(number)

    @cached_property
    def mode_counts(self) -> np.ndarray:
        """Number of modes of the bodies of each island [islands]."""
        sizes = [body.omega.size for body in self.modal_bodies]
        return np.bincount(self.island_of_body, sizes).astype(np.int64)

    @cached_property
    def _slot_of_body(self) -> dict[int, int]:
        """Slot of each of the scene's bodies in the kernels' order."""
        return {number: slot for slot, number in enumerate(self.body_order)}

    def global_modes(self, number: int) -> slice:
        """Return the modes of one of the scene's bodies, counted from the first of all."""
        begin = int(self._mode_begins[self._slot_of_body[number]])
        return slice(begin, begin + self.modal_bodies[number].omega.size)

    def local_modes(self, number: int) -> slice:
        """Return the modes of one of the scene's bodies, counted from its island's first."""
        modes, begin = self.global_modes(number), int(self.islands.mode[self.island_of_body[number]])
        return slice(modes.start - begin, modes.stop - begin)

    def weights(self) -> np.ndarray:
        """Return the force of gravity on each mode, √kg·m/s²."""
        return -self.scene.gravity * self.concatenate_modes("gravity_participation")

    def concatenate_modes(self, field: str) -> np.ndarray:
        """Return a field of the modal bodies over all modes. Modes of no body are like the mode before them, but at
        rest."""
        values = np.zeros(int(self._mode_begins[-1]))
        for slot, b in enumerate(self.body_order):
            modes = getattr(self.modal_bodies[b], field)
            begin, end = self._mode_begins[slot : slot + 2]
            values[begin : begin + modes.size] = modes
            if field == "omega":
                values[begin + modes.size : end] = max(modes[-1], 1.0)
            elif field == "sigma":
                values[begin + modes.size : end] = modes[-1]
        return values

    def mode_shape(self, point: BodyPoint) -> np.ndarray:
        """Return the mode shapes of a body at a point, times the factor of the point [modes], 1/√kg; empty without a
        body."""
        if point.body is None:
            return np.empty(0)
        if point.phi is not None:
            return point.phi
        return point.factor * self.modal_bodies[self.body_index[point.body]].shape(point.position)

    def row(self, point: BodyPoint) -> ShapeRow:
        """Return the mode shapes at a point, with the position of their modes in the arrays."""
        if point.body is None:
            return ShapeRow(0, 0, np.empty(0))
        number = self.body_index[point.body]
        return ShapeRow(self.local_modes(number).start, self.global_modes(number).start, self.mode_shape(point))

    def dense_mode_shape(self, point: BodyPoint, island: int) -> np.ndarray:
        """Return the mode shapes at a point over all modes of an island; they are zero for other bodies [modes],
        1/√kg."""
        phi = np.zeros(int(self.islands.mode[island + 1] - self.islands.mode[island]))
        if point.body is not None:
            phi[self.local_modes(self.body_index[point.body])] = self.mode_shape(point)
        return phi


def _begins(counts: Any) -> np.ndarray:
    """Return the first position of each block if blocks of the given sizes follow each other, and the end of the
    last."""
    return np.concatenate([[0], np.cumsum(counts)]).astype(np.int64)
