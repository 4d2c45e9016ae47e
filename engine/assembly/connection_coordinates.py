"""Coordinates of connections: linear functions of the modes of the connected bodies, and their stiffness
(docs/design.md, "Connections").

A spring has one coordinate: its extension. Ends of strings at one point of a body have two: the displacement y of the
point, and the force w = Σ ωₙ·cₙ·aₙ of all strings that end there. A string that has modes aₙ with fixed ends holds

    V = Σ ½·(ωₙ·aₙ + cₙ·y)² + T/(2L)·y²,   cₙ = ωₙ·μ·φₙ'(L)/βₙ²

when its end is at y. With both ends moving, it holds Σ ½·(ωₙ·aₙ + c⁰ₙ·y₀ + c¹ₙ·y₁)² + T/(2L)·(y₁ - y₀)². Where it
stretches (engine.kernel.interactions.tension), its length is measured from the line between its ends:
Σ κₙ·(aₙ + c̃ₙ·y)² + y²/L, c̃ₙ = μ·φₙ'(L)/βₙ². Each such end has a third coordinate, the slope Σ κₙ·c̃ₙ·aₙ, here over
Σ κₙ·c̃ₙ² + 1/L, which makes it a length. An end with a `share` x follows x·y: in all of this x·y is in place of y, and
a string with two polarisations has the modes of both, which follow y·cos θ and y·sin θ (engine.bodies.string).

The arrays hold w/κ in place of w, with κ = Σ (Σ cₙ² + T/L) over the strings. It is a length, as y is: with numbers of
unlike size the factors would be less exact.

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

from engine.arithmetic.elementary import square
from engine.arithmetic.linear import singular_vectors
from engine.arithmetic.products import product
from engine.assembly.coordinates import Coordinate, Coordinates, compensate_springs
from engine.assembly.modal_system import ModalSystem
from engine.bodies import AirBox, String
from engine.bodies.air import BULK_MODULUS
from engine.bodies.body import ModalBody
from engine.bodies.distributed import DistributedBody
from engine.bodies.sheet import FlatSheet
from engine.bodies.stretching import Stretching
from engine.patch.scene import Scene
from engine.patch.tables import AirConnection, ChangeEvent, Connection, EndConnection, SpringConnection

SMALLEST_SINGULAR_VALUE = 1e-5  # of the largest: beyond, a share of 1e-10 of the stiffness of a support is left out
SMALLEST_SHARE = 1e-6  # of a displacement that an end follows: with less, it is fixed
REDUNDANT = 1e-9  # of a rigid joint: what is left of it beside others, below which they hold it already


def connected_pairs(system: ModalSystem) -> list[tuple[int, int]]:
    """Return the pairs of bodies that connections join, as numbers."""
    used, numbers = used_connections(system.scene), system.body_index
    joined = [c for k, c in enumerate(system.scene.connection) if k in used]
    return [(numbers[c.body], numbers[c.on]) for c in joined if c.on is not None]


def used_connections(scene: Scene) -> set[int]:
    """Return the numbers of the connections that are built: those that have an effect, now or after an event."""
    changed = changed_connections(scene)

    def joins(c: Connection) -> bool:
        if isinstance(c, SpringConnection):
            return bool(c.rigid or c.stiffness or c.damping_coefficient or c.name in changed)
        return not isinstance(c, EndConnection) or (not c.one_way and abs(c.share) > SMALLEST_SHARE)

    return {k for k, c in enumerate(scene.connection) if joins(c)}


def moving_ends(scene: Scene) -> Iterator[tuple[int, EndConnection]]:
    """Yield the ends of strings that bodies carry, with their numbers; engine.assembly.one_way_drive has others."""
    used = used_connections(scene)
    yield from ((k, c) for k, c in enumerate(scene.connection) if k in used and isinstance(c, EndConnection))


def changed_connections(scene: Scene) -> set[str | None]:
    """Return the names of the connections that the score changes."""
    return {e.connection for e in scene.event if isinstance(e, ChangeEvent) and e.connection is not None}


def find_coordinates(system: ModalSystem, island_of: Sequence[int], step: float | None) -> list[Coordinates]:
    """Return the coordinates of each island.

    island_of: the island of each body
    step:      length of the steps for which springs are compensated, s; None: they are not
    """
    count = max(island_of) + 1
    springs: list[list[Coordinate]] = [[] for _ in range(count)]
    groups: list[list[Coordinates]] = [[] for _ in range(count)]
    for item in [*_of_supports(system), *_of_springs(system)]:
        springs[island_of[next(iter(item.parts))]].append(item)
    for group in [*air_coordinates(system), *_string_ends(system, island_of)]:
        groups[island_of[next(iter(group.items[0].parts))]].append(group)
    found = [_join([_uncoupled(_drop_redundant(items)), *more]) for items, more in zip(springs, groups, strict=True)]
    return found if step is None else [_compensated(system, coordinates, step) for coordinates in found]


def _uncoupled(items: list[Coordinate]) -> Coordinates:
    """Return coordinates that no stiffness couples."""
    return Coordinates(items, np.zeros((len(items), len(items))))


def _join(groups: Sequence[Coordinates]) -> Coordinates:
    """Return all coordinates of groups; they are coupled only within their group."""
    joined, begin = _uncoupled([item for group in groups for item in group.items]), 0
    for group in groups:
        end = begin + len(group.items)
        joined.coupling[begin:end, begin:end] = group.coupling
        begin = end
    return joined


def _compensated(system: ModalSystem, coordinates: Coordinates, step: float) -> Coordinates:
    """Return coordinates whose springs give the right frequencies. Connections that have a name may change."""
    if not any(item.stiffness or item.damping or item.is_rigid for item in coordinates.items):
        return coordinates
    scene = system.scene

    def omega_of(body: int) -> np.ndarray:
        return np.zeros(1) if scene.body[body].IS_LUMPED else system.modal_bodies[body].omega

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
                    share = sum(float(product(row[b], left[b])) for b in row if b in left)
                    left = {b: left.get(b, np.zeros(1)) - share * row.get(b, np.zeros(1)) for b in left | row}
            if _norm(left) <= REDUNDANT * size:
                continue
            length = _norm(left)
            held.append({b: values / length for b, values in left.items()})
        kept.append(item)
    return kept


def _norm(parts: dict[int, np.ndarray]) -> float:
    return float(np.sqrt(sum(float(np.sum(square(values))) for values in parts.values())))


def _of_supports(system: ModalSystem) -> Iterator[Coordinate]:
    """Yield the coordinates of supports, which are springs and dampers to the ground."""
    for b, (body, modal) in enumerate(zip(system.scene.body, system.modal_bodies, strict=True)):
        for j, support in enumerate(body.support if isinstance(body, DistributedBody) else ()):
            if support.stiffness or support.damping_coefficient:
                shapes = np.array([modal.shape(place) for place in body.split_positions(support.at)])
                for row in _independent_rows(shapes):
                    path, damping = f"body[{b}].support[{j}]", support.damping_coefficient
                    yield Coordinate(path, None, {b: row}, support.stiffness, damping)


def _independent_rows(rows: np.ndarray) -> np.ndarray:
    """Return rows for positions that share a spring evenly [rows, modes]. Positions close together move alike, so there
    may be fewer rows than positions."""
    _, singular, shapes = singular_vectors(rows / math.sqrt(len(rows)))
    kept = singular > SMALLEST_SINGULAR_VALUE * singular[0]
    return np.asarray(singular[kept, None] * shapes[kept])


def _of_springs(system: ModalSystem) -> Iterator[Coordinate]:
    """Yield the coordinates of springs, dampers and rigid joints."""
    used = used_connections(system.scene)
    for k, c in enumerate(system.scene.connection):
        if k in used and isinstance(c, SpringConnection):
            parts = {system.body_index[c.body]: system.shape(c.body, c.at)}
            if c.on is not None:
                on = system.body_index[c.on]
                parts[on] = parts.get(on, 0.0) - system.shape(c.on, c.on_at)
            yield Coordinate(f"connection[{k}]", k, parts, c.stiffness, c.damping_coefficient, c.rest, c.rigid)


def _string_ends(system: ModalSystem, island_of: Sequence[int]) -> Iterator[Coordinates]:
    """Yield the coordinates of the ends of strings that can move: of each island, two for each point that carries ends,
    w and y."""
    islands: dict[int, dict[tuple[str, str], list[tuple[int, EndConnection]]]] = {}  # ends by the point
    for k, c in moving_ends(system.scene):
        points = islands.setdefault(island_of[system.body_index[c.on]], {})
        points.setdefault((c.on, repr(c.on_at)), []).append((k, c))
    for points in islands.values():
        coupling = np.zeros((2 * len(points), 2 * len(points)))
        ends_of: dict[str, list[tuple[int, EndConnection]]] = {}  # of a string: the coordinate y, and the end
        for y, ends in zip(range(1, len(coupling), 2), points.values(), strict=True):
            for _, c in ends:
                ends_of.setdefault(c.body, []).append((y, c))
        row_of = {(c.body, c.at): c.share * end_row(system, c.body, c.at) for e in points.values() for _, c in e}
        for string, moving in ends_of.items():
            for i, a in moving:
                for j, b in moving:
                    rows_of_both = row_of[string, a.at], row_of[string, b.at]
                    coupling[i, j] += end_stiffness(system, string, *rows_of_both, a.share * b.share, a.at == b.at)
        items: list[Coordinate] = []
        for y, ends in zip(range(1, len(coupling), 2), points.values(), strict=True):
            rows: dict[int, Any] = {}
            for _, c in ends:
                number = system.body_index[c.body]
                rows[number] = rows.get(number, 0.0) + row_of[c.body, c.at] / coupling[y, y]
            k, c = ends[0]
            shape = {system.body_index[c.on]: system.shape(c.on, c.on_at)}
            items += [Coordinate(f"connection[{k}]", k, parts) for parts in (rows, shape)]
            coupling[y - 1, y] = coupling[y, y - 1] = coupling[y, y]
        for y, ends in zip(range(1, len(coupling), 2), points.values(), strict=True):
            for k, c in ends:
                if (row := slope_row(system, c)) is not None:
                    behind, parts = len(items) - y, {system.body_index[c.body]: row}
                    items.append(Coordinate(f"connection[{k}]", k, parts, slope_of=(k, behind)))
        yield Coordinates(items, np.pad(coupling, (0, len(items) - len(coupling))))


def find_stretching(system: ModalSystem, name: str) -> Stretching | None:
    """Return what stretches a body; its κ are of all its modes, 0 of residual and silent ones."""
    number = system.body_index[name]
    modal = system.modal_bodies[number]
    more = modal.residual + modal.silent
    stretching = system.scene.body[number].find_stretching(modal.omega[: modal.omega.size - more])
    return None if stretching is None else stretching._replace(kappa=np.concatenate([stretching.kappa, np.zeros(more)]))


def stretch_of_ends(system: ModalSystem, a: EndConnection, b: EndConnection) -> float:
    """Return what displacements of the bodies at two ends of a string, or at one, stretch it, per product, 1/m."""
    stretching = find_stretching(system, a.body)
    assert stretching is not None
    return a.share * b.share * stretch_between(system, a.body, stretching.kappa, a.at, b.at)


def stretch_between(system: ModalSystem, name: str, kappa: np.ndarray, a: float, b: float) -> float:
    """Return what displacements of two ends of a string stretch it, per product, 1/m: Σ κₙ·c̃ₙ·c̃ₙ ± 1/L."""
    string, fourth = system.scene.body[system.body_index[name]], square(squared_omega(system, name))
    assert isinstance(string, String)
    total = float(np.sum(kappa * end_row(system, name, a) * end_row(system, name, b) / fourth))
    return total + (1.0 if a == b else -1.0) / string.length


def squared_omega(system: ModalSystem, name: str) -> np.ndarray:
    """Return ω² of the modes of a body [modes], 1/s²."""
    return np.asarray(square(system.modal_bodies[system.body_index[name]].omega))


def slope_row(system: ModalSystem, end: EndConnection) -> np.ndarray | None:
    """Return x·Σ κₙ·c̃ₙ·aₙ over x²·(Σ κₙ·c̃ₙ² + 1/L) as a row over the modes of a string [modes], 1/√kg; None if it does
    not stretch."""
    stretching = find_stretching(system, end.body)
    if stretching is None:
        return None
    weighted = stretching.kappa * (end.share * end_row(system, end.body, end.at)) / squared_omega(system, end.body)
    return np.asarray(weighted / stretch_of_ends(system, end, end))


def end_row(system: ModalSystem, name: str, end: float) -> np.ndarray:
    """Return String.end_row with zeros for residual and silent modes, which do not move the end [modes], N/(√kg·m)."""
    string, modal = system.scene.body[system.body_index[name]], system.modal_bodies[system.body_index[name]]
    assert isinstance(string, String)
    more = modal.residual + modal.silent
    return np.concatenate([string.end_row(modal.omega[: modal.omega.size - more], end), np.zeros(more)])


def end_stiffness(system: ModalSystem, name: str, a: np.ndarray, b: np.ndarray, shares: float, is_same: bool) -> float:
    """Return the stiffness in V between two ends of a string, or of one end with itself, N/m: Σ cₙ·cₙ ± x·x·T/L.

    a, b: rows of the ends, with their shares x; shares: the product of both
    """
    string, omega = system.scene.body[system.body_index[name]], system.modal_bodies[system.body_index[name]].omega
    assert isinstance(string, String)
    tension = float(shares * string.end_tension() / string.length)
    total = float(np.sum(a * b / square(omega)))
    return total + (tension if is_same else -tension)


def end_force_parts(system: ModalSystem, name: str, end: float) -> list[tuple[str, np.ndarray]]:
    """Return the force of a string on its end (0 or 1), -∂V/∂y, as rows over the modes of the string and of the bodies
    that carry its ends [(name of the body, row [modes], N/(√kg·m))]."""
    row = end_row(system, name, end)
    parts = [(name, -row)]
    for _, c in moving_ends(system.scene):
        if c.body == name:
            other = c.share * end_row(system, name, c.at)
            stiffness = end_stiffness(system, name, row, other, c.share, end == c.at)
            parts.append((c.on, -stiffness * system.shape(c.on, c.on_at)))
    return parts


def end_pull_parts(system: ModalSystem, name: str, end: float) -> list[tuple[str, np.ndarray]]:
    """Return what adds to the force of a string on its end (0 or 1) as its tension rises, per N of the rise, in the
    same parts [(name of the body, row [modes], 1/(√kg·m))]; none of a string that does not stretch."""
    stretching = find_stretching(system, name)
    if stretching is None:
        return []
    kappa = stretching.kappa
    parts = [(name, -kappa * end_row(system, name, end) / squared_omega(system, name))]
    for _, c in moving_ends(system.scene):
        if c.body == name:
            stretch = c.share * stretch_between(system, name, kappa, end, c.at)
            parts.append((c.on, -stretch * system.shape(c.on, c.on_at)))
    return parts


def air_coordinates(system: ModalSystem) -> Iterator[Coordinates]:
    """Yield the coordinates of air, in groups that are not coupled to each other."""
    walls: dict[int, list[tuple[int, AirConnection]]] = {}
    for k, c in enumerate(system.scene.connection):
        if isinstance(c, AirConnection):
            on = None if c.on is None else system.body_index[c.on]
            if on is not None and isinstance(system.scene.body[on], AirBox):
                walls.setdefault(on, []).append((k, c))
            else:
                yield _uncoupled([_closed_volume(system, k, c)])
    for box, connections in walls.items():
        yield from _box(system, box, connections)


def _closed_volume(system: ModalSystem, k: int, c: AirConnection) -> Coordinate:
    """Return the coordinate of uniform pressure between two sheets, or behind one: the mean displacement."""
    sheet, modal = _sheet(system, c.body)
    area, parts = sheet.area(), {system.body_index[c.body]: sheet.volume_row(modal) / sheet.area()}
    if c.on is not None:
        other, modal = _sheet(system, c.on)
        parts[system.body_index[c.on]] = -other.volume_row(modal) / area
    return Coordinate(f"connection[{k}]", k, parts, BULK_MODULUS * square(area) / (c.volume or 1.0))


def _box(system: ModalSystem, number: int, connections: list[tuple[int, AirConnection]]) -> Iterator[Coordinates]:
    """Yield the coordinates of the air in a box. A standing wave has two: its own part ω·a, and the part y of its
    walls. Uniform pressure has both if the box has a hole, else only the part of the walls."""
    box, modal = system.scene.body[number], system.modal_bodies[number]
    assert isinstance(box, AirBox)
    k, plug = connections[0][0], int(box.hole is not None)
    rows: list[dict[int, np.ndarray]] = [{} for _ in range(modal.omega.size - plug + 1)]
    for _, c in connections:
        wall = system.body_index[c.body]
        for wave, row in enumerate(_wall_rows(box, modal, *_sheet(system, c.body), c.wall or "top")):
            rows[wave][wall] = rows[wave].get(wall, 0.0) + row
    scale = BULK_MODULUS * square(box.size[0] * box.size[1]) / box.volume()  # N/m: coordinates are lengths
    for wave, parts in enumerate(rows):
        walls = Coordinate(f"connection[{k}]", k, {b: row / np.sqrt(scale) for b, row in parts.items()})
        mode = wave - 1 + plug  # of uniform pressure: the plug of the hole
        if mode < 0:
            yield _uncoupled([walls._replace(stiffness=scale)])
            continue
        row = np.zeros(modal.omega.size)
        row[mode] = modal.omega[mode] / np.sqrt(scale)
        air = Coordinate(f"connection[{k}]", k, {number: row})
        yield Coordinates([air, walls], scale * np.array([[0.0, 1.0], [1.0, 1.0]]))


def _wall_rows(box: AirBox, modal: ModalBody, sheet: FlatSheet, wall: ModalBody, side: str) -> np.ndarray:
    """Return √(ρc²/Λ)·∬ ±Φ·ψ dA over a wall, positive outwards [1 + waves, modes of the wall]."""
    positions, areas, _ = sheet.area_quadrature(wall.omega.size)
    places = np.array(positions)
    pressure = box.wall_rows(modal.omega.size, places, 1.0 if side == "top" else 0.0) * areas[:, None]
    return np.asarray(product((1.0 if side == "top" else -1.0) * pressure.T, wall.shape(places)))


def _sheet(system: ModalSystem, name: str) -> tuple[FlatSheet, ModalBody]:
    """Return a sheet and its modes."""
    sheet = system.scene.body[system.body_index[name]]
    assert isinstance(sheet, FlatSheet)
    return sheet, system.modal_bodies[system.body_index[name]]
