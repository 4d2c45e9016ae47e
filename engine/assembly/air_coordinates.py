"""Connection coordinates of the air that sheets press on (docs/design.md, "Air").

Uniform pressure in a volume V stores the energy ½·(ρc²/V)·U². U is the volume that the walls displace, so the air is a
spring between the displaced volumes of sheets. In a box, a standing wave of amplitude a and shape ψ stores
½·(ω·a + y)², with y = √(ρc²/∫ψ² dV)·∬ ±w·ψ dA over the walls. The plug of air in the hole does the same with
uniform pressure. The terms of this square are the energy of a mode of the air, a cross term y·ω·a and a spring ½·y².
"""

from collections.abc import Sequence

import numpy as np

from engine.assembly.coordinates import Coordinate
from engine.bodies import AirBox
from engine.bodies.air import BULK_MODULUS
from engine.bodies.body import ModalBody
from engine.bodies.sheet import FlatSheet
from engine.patch.scene import Scene
from engine.patch.tables import AirConnection


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
