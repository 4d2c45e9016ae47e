"""Coordinates of connections: linear functions of the modes of the connected bodies, and their stiffness
(docs/design.md, "Connections").

A spring has one coordinate: its extension. Ends of strings at one point of a body have two: the displacement y of the
point, and the force w = Σ ωₙ·cₙ·aₙ of all strings that end there. A string that has modes aₙ with fixed ends holds

    V = Σ ½·(ωₙ·aₙ + cₙ·y)² + T/(2L)·y²,   cₙ = ωₙ·μ·φₙ'(L)/βₙ²

when its end is at y. With both ends moving, it holds Σ ½·(ωₙ·aₙ + c⁰ₙ·y₀ + c¹ₙ·y₁)² + T/(2L)·(y₁ - y₀)². The arrays
hold w/κ in place of w, with κ = Σ (Σ cₙ² + T/L) over the strings. It is a length, as y is: with numbers of unlike size
the factors would be less exact.

Connection coordinates of the air that sheets press on (docs/design.md, "Air").

Uniform pressure in a volume V stores the energy ½·(ρc²/V)·U². U is the volume that the walls displace, so the air is a
spring between the displaced volumes of sheets. In a box, a standing wave of amplitude a and shape ψ stores
½·(ω·a + y)², with y = √(ρc²/∫ψ² dV)·∬ ±w·ψ dA over the walls. The plug of air in the hole does the same with
uniform pressure. The terms of this square are the energy of a mode of the air, a cross term y·ω·a and a spring ½·y².
"""

import math
from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np

from engine.assembly.coordinates import Coordinate, Coordinates, compensate_springs
from engine.bodies import AirBox, String
from engine.bodies.air import BULK_MODULUS
from engine.bodies.body import ModalBody
from engine.bodies.distributed import DistributedBody
from engine.bodies.sheet import FlatSheet
from engine.patch.scene import Scene
from engine.patch.tables import AirConnection, ChangeEvent, Connection, EndConnection, SpringConnection

SMALLEST_SINGULAR_VALUE = 1e-5  # of the largest: beyond, a share of 1e-10 of the stiffness of a support is left out
REDUNDANT = 1e-9  # of a rigid joint: what is left of it beside others, below which they hold it already


def connected_pairs(scene: Scene, numbers: dict[str, int]) -> list[tuple[int, int]]:
    """Return the pairs of bodies that connections join, as numbers."""
    used = used_connections(scene)
    return [(numbers[c.body], numbers[c.on]) for k, c in enumerate(scene.connection) if k in used and c.on is not None]


def used_connections(scene: Scene) -> set[int]:
    """Return the numbers of the connections that are built: those that have an effect, now or after an event."""
    changed = changed_connections(scene)

    def joins(c: Connection) -> bool:
        if isinstance(c, SpringConnection):
            return bool(c.rigid or c.stiffness or c.damping_coefficient or c.name in changed)
        return not (isinstance(c, EndConnection) and c.one_way)  # which engine.assembly.one_way_drive has

    return {k for k, c in enumerate(scene.connection) if joins(c)}


def changed_connections(scene: Scene) -> set[str | None]:
    """Return the names of the connections that the score changes."""
    return {e.connection for e in scene.event if isinstance(e, ChangeEvent) and e.connection is not None}


def find_coordinates(
    scene: Scene,
    bodies: Sequence[ModalBody],
    numbers: dict[str, int],
    island_of: Sequence[int],
    step: float | None,
) -> list[Coordinates]:
    """Return the coordinates of each island.

    bodies, numbers: modes of the scene's bodies, and their numbers by name
    island_of:       the island of each body
    step:            length of the steps for which springs are compensated, s; None: they are not
    """
    count = max(island_of) + 1
    items: list[list[Coordinate]] = [[] for _ in range(count)]
    for coordinate in [*_of_supports(scene, bodies), *_of_springs(scene, bodies, numbers)]:
        items[island_of[next(iter(coordinate.parts))]].append(coordinate)
    ends = _StringEnds(scene, bodies, numbers)
    of_islands = []
    air: list[list[tuple[list[Coordinate], np.ndarray]]] = [[] for _ in range(count)]
    for group in air_coordinates(scene, bodies, numbers):
        air[island_of[next(iter(group[0][0].parts))]].append(group)
    for n in range(count):
        kept = _drop_redundant(items[n])
        groups = [(kept, np.zeros((len(kept), len(kept)))), *air[n], ends.of_island(n, island_of)]
        coordinates = Coordinates([item for group, _ in groups for item in group], _block_diagonal(groups))
        springs = any(item.stiffness or item.damping or item.is_rigid for item in coordinates.items)
        if step is not None and springs:
            coordinates = _compensated(scene, bodies, coordinates, step)
        of_islands.append(coordinates)
    return of_islands


def _block_diagonal(groups: Sequence[tuple[list[Coordinate], np.ndarray]]) -> np.ndarray:
    """Return the stiffness matrix of all groups; coordinates are coupled only within their group."""
    size, begin = sum(len(items) for items, _ in groups), 0
    coupling = np.zeros((size, size))
    for items, inner in groups:
        end = begin + len(items)
        coupling[begin:end, begin:end] = inner
        begin = end
    return coupling


def _compensated(scene: Scene, bodies: Sequence[ModalBody], coordinates: Coordinates, step: float) -> Coordinates:
    """Return coordinates whose springs give the right frequencies. Connections that have a name may change."""

    def omega_of(body: int) -> np.ndarray:
        return np.zeros(1) if scene.body[body].IS_LUMPED else bodies[body].omega

    numbers = [item.connection for item in coordinates.items]
    named = [n is not None and scene.connection[n].name is not None for n in numbers]
    return compensate_springs(coordinates, named, omega_of, step)


def _drop_redundant(items: list[Coordinate]) -> list[Coordinate]:
    """Return the coordinates without rigid ones that others hold already, as nothing determines their part of the
    force."""
    kept, held = list[Coordinate](), list[dict[int, np.ndarray]]()
    for item in items:
        if item.is_rigid:
            left, size = dict(item.parts), _norm(item.parts)
            for _ in range(2):  # once more, for what rounding has left
                for row in held:
                    share = sum(float(row[b] @ left[b]) for b in row if b in left)
                    left = {b: left.get(b, np.zeros(1)) - share * row.get(b, np.zeros(1)) for b in left | row}
            if _norm(left) <= REDUNDANT * size:
                continue
            length = _norm(left)
            held.append({b: values / length for b, values in left.items()})
        kept.append(item)
    return kept


def _norm(parts: dict[int, np.ndarray]) -> float:
    return float(np.sqrt(sum(float(np.sum(values**2)) for values in parts.values())))


def count_supports(body: Any) -> int:
    """Count the positions at which supports hold a body."""
    supports = body.support if isinstance(body, DistributedBody) else []
    return sum(len(body.split_positions(support.at)) for support in supports)


def _of_supports(scene: Scene, bodies: Sequence[ModalBody]) -> Iterator[Coordinate]:
    """Yield the coordinates of supports, which are springs and dampers to the ground."""
    for b, body in enumerate(scene.body):
        for j, support in enumerate(body.support if isinstance(body, DistributedBody) else ()):
            places = body.split_positions(support.at)
            if support.stiffness or support.damping_coefficient:
                for row in _independent_rows(np.array([bodies[b].shape(place) for place in places])):
                    yield Coordinate(
                        f"body[{b}].support[{j}]", None, {b: row}, support.stiffness, support.damping_coefficient
                    )


def _independent_rows(rows: np.ndarray) -> np.ndarray:
    """Return rows for positions that share a spring evenly [rows, modes]. Positions close together move alike, so there
    may be fewer rows than positions."""
    _, singular, shapes = np.linalg.svd(rows / math.sqrt(len(rows)), full_matrices=False)
    kept = singular > SMALLEST_SINGULAR_VALUE * singular[0]
    return np.asarray(singular[kept, None] * shapes[kept])


def _of_springs(scene: Scene, bodies: Sequence[ModalBody], numbers: dict[str, int]) -> Iterator[Coordinate]:
    """Yield the coordinates of springs, dampers and rigid joints."""
    used = used_connections(scene)
    for k, c in enumerate(scene.connection):
        if k in used and isinstance(c, SpringConnection):
            parts = {numbers[c.body]: _shape(scene, bodies, numbers[c.body], c.at)}
            if c.on is not None:
                on = numbers[c.on]
                parts[on] = parts.get(on, 0.0) - _shape(scene, bodies, on, c.on_at)
            yield Coordinate(f"connection[{k}]", k, parts, c.stiffness, c.damping_coefficient, c.rest, c.rigid)


def _shape(scene: Scene, bodies: Sequence[ModalBody], number: int, at: Any) -> np.ndarray:
    """Return the mode shapes of a body at the one position that a key gives."""
    return bodies[number].shape(scene.body[number].split_positions(at)[0])


class _StringEnds:
    """Ends of strings that can move, by the point of the body that carries them."""

    def __init__(self, scene: Scene, bodies: Sequence[ModalBody], numbers: dict[str, int]) -> None:
        self.scene, self.bodies = scene, bodies
        # by body and place: numbers of connection and string, which end, and the place
        self.points: dict[tuple[int, str], list[tuple[int, int, float, Any]]] = {}
        for k, c in enumerate(scene.connection):
            if isinstance(c, EndConnection) and not c.one_way:
                point = numbers[c.on], repr(c.on_at)
                self.points.setdefault(point, []).append((k, numbers[c.body], c.at, c.on_at))

    def of_island(self, island: int, island_of: Sequence[int]) -> tuple[list[Coordinate], np.ndarray]:
        """Return two coordinates of each point of an island, w and y, and their stiffness matrix."""
        points = [(on, ends) for (on, _), ends in self.points.items() if island_of[on] == island]
        items: list[Coordinate] = []
        coupling = np.zeros((2 * len(points), 2 * len(points)))
        ends_of: dict[int, list[tuple[int, float]]] = {}  # of a string: the coordinate y, and which end
        for n, (_, ends) in enumerate(points):
            for _, string, end, _ in ends:
                ends_of.setdefault(string, []).append((2 * n + 1, end))
        for string, moving in ends_of.items():
            for i, a in moving:
                for j, b in moving:
                    coupling[i, j] += end_stiffness(self.scene.body[string], self.bodies[string], a, b)
        for n, (on, ends) in enumerate(points):
            k, stiffness = ends[0][0], coupling[2 * n + 1, 2 * n + 1]
            rows: dict[int, Any] = {}
            for _, string, end, _ in ends:
                rows[string] = rows.get(string, 0.0) + self._row(string, end) / stiffness
            shape = _shape(self.scene, self.bodies, on, ends[0][3])
            items += [Coordinate(f"connection[{k}]", k, rows), Coordinate(f"connection[{k}]", k, {on: shape})]
            coupling[2 * n, 2 * n + 1] = coupling[2 * n + 1, 2 * n] = stiffness
        return items, coupling

    def _row(self, string: int, end: float) -> np.ndarray:
        return end_row(self.scene.body[string], self.bodies[string], end)


def end_row(string: Any, modal: ModalBody, end: float) -> np.ndarray:
    """Return String.end_row with zeros for residual and silent modes, which do not move the end [modes], N/(√kg·m)."""
    assert isinstance(string, String)
    count = modal.omega.size - modal.residual - modal.silent
    return np.pad(string.end_row(modal.omega[:count], end), (0, modal.residual + modal.silent))


def end_stiffness(string: Any, modal: ModalBody, a: float, b: float) -> float:
    """Return the stiffness in V between two ends a and b of a string, or of one end with itself, N/m: Σ cₙ·cₙ ± T/L."""
    tension = float(string.tension_and_bending()[0] / string.length)
    product = float(np.sum(end_row(string, modal, a) * end_row(string, modal, b) / modal.omega**2))
    return product + (tension if a == b else -tension)


def end_force_parts(
    scene: Scene, bodies: Sequence[ModalBody], numbers: dict[str, int], name: str, end: float
) -> list[tuple[int, np.ndarray]]:
    """Return the force of a string on its end (0 or 1), -∂V/∂y, as rows over the modes of the string and of the bodies
    that carry its ends [(number of the body, row [modes], N/(√kg·m))]."""
    string = scene.body[numbers[name]]
    modal = bodies[numbers[name]]
    parts = [(numbers[name], -end_row(string, modal, end))]
    for c in scene.connection:
        if isinstance(c, EndConnection) and c.body == name and not c.one_way:
            on = numbers[c.on]
            parts.append((on, -end_stiffness(string, modal, end, c.at) * _shape(scene, bodies, on, c.on_at)))
    return parts


def air_coordinates(
    scene: Scene, bodies: Sequence[ModalBody], numbers: dict[str, int]
) -> list[tuple[list[Coordinate], np.ndarray]]:
    """Return the coordinates of air and their stiffness matrix, in groups that are not coupled to each other.

    bodies, numbers: modes of the scene's bodies, and their numbers by name
    """
    groups = []
    walls: dict[int, list[tuple[int, AirConnection]]] = {}
    for k, c in enumerate(scene.connection):
        if not isinstance(c, AirConnection):
            continue
        on = None if c.on is None else numbers[c.on]
        if on is not None and isinstance(scene.body[on], AirBox):
            walls.setdefault(on, []).append((k, c))
        else:
            groups.append(([_closed_volume(scene, bodies, numbers, k, c)], np.zeros((1, 1))))
    for box, connections in walls.items():
        groups += _box(scene, bodies, numbers, box, connections)
    return groups


def _closed_volume(
    scene: Scene, bodies: Sequence[ModalBody], numbers: dict[str, int], k: int, c: AirConnection
) -> Coordinate:
    """Return the coordinate of uniform pressure between two sheets, or behind one: the mean displacement."""
    number = numbers[c.body]
    sheet = _sheet(scene, number)
    parts = {number: sheet.volume_row(bodies[number]) / sheet.area()}
    if c.on is not None:
        on = numbers[c.on]
        parts[on] = -_sheet(scene, on).volume_row(bodies[on]) / sheet.area()
    return Coordinate(f"connection[{k}]", k, parts, BULK_MODULUS * sheet.area() ** 2 / (c.volume or 1.0))


def _box(
    scene: Scene,
    bodies: Sequence[ModalBody],
    numbers: dict[str, int],
    number: int,
    connections: list[tuple[int, AirConnection]],
) -> list[tuple[list[Coordinate], np.ndarray]]:
    """Return the coordinates of the air in a box. A standing wave has two: its own part ω·a, and the part y of its
    walls. Uniform pressure has both if the box has a hole, else only the part of the walls."""
    box, modal = scene.body[number], bodies[number]
    assert isinstance(box, AirBox)
    k, plug = connections[0][0], int(box.hole is not None)
    rows: list[dict[int, np.ndarray]] = [{} for _ in range(modal.omega.size - plug + 1)]
    for _, c in connections:
        wall = numbers[c.body]
        for wave, row in enumerate(_wall_rows(box, modal, _sheet(scene, wall), bodies[wall], c.wall or "top")):
            rows[wave][wall] = rows[wave].get(wall, 0.0) + row
    scale = BULK_MODULUS * (box.size[0] * box.size[1]) ** 2 / box.volume()  # N/m: coordinates are lengths
    groups = []
    for wave, parts in enumerate(rows):
        walls = Coordinate(f"connection[{k}]", k, {b: row / np.sqrt(scale) for b, row in parts.items()})
        row = np.zeros(modal.omega.size)
        mode = wave - 1 + plug  # of uniform pressure: the plug of the hole
        if mode < 0:
            groups.append(([walls._replace(stiffness=scale)], np.zeros((1, 1))))
            continue
        row[mode] = modal.omega[mode] / np.sqrt(scale)
        air = Coordinate(f"connection[{k}]", k, {number: row})
        groups.append(([air, walls], scale * np.array([[0.0, 1.0], [1.0, 1.0]])))
    return groups


def _wall_rows(box: AirBox, modal: ModalBody, sheet: FlatSheet, wall: ModalBody, side: str) -> np.ndarray:
    """Return √(ρc²/Λ)·∬ ±Φ·ψ dA over a wall, positive outwards [1 + waves, modes of the wall]."""
    positions, areas, _ = sheet.area_quadrature(wall.omega.size)
    places = np.array(positions)
    pressure = box.wall_rows(modal.omega.size, places, 1.0 if side == "top" else 0.0) * areas[:, None]
    return np.asarray((1.0 if side == "top" else -1.0) * pressure.T @ wall.shape(places))


def _sheet(scene: Scene, number: int) -> FlatSheet:
    sheet = scene.body[number]
    assert isinstance(sheet, FlatSheet)
    return sheet
