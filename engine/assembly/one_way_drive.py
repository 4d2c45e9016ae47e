"""One-way drive: the points of bodies that ends of strings push, and the order in which islands must run."""

from typing import Any, NamedTuple

from engine.assembly.modal_system import ModalSystem
from engine.faults import BuildError, Fault
from engine.patch.scene import Scene
from engine.patch.tables import EndConnection


class DriveForce(NamedTuple):
    """The total force of the strings that drive one point of a body, as an external force."""

    body: str
    at: Any
    amplitude: float  # unused; other forces have one
    number: int  # of the point


class Drive(NamedTuple):
    """An end of a string that drives a body one way."""

    connection: int  # its number
    string: str
    end: float  # 0 or 1
    share: float  # of the string's force that drives the body
    body: str
    at: Any  # position on the body
    point: int  # number of the point that it drives


def find_drives(scene: Scene) -> list[Drive]:
    """Return the ends of strings that drive bodies one way. Those at one position of a body have the same point
    number."""
    drives: list[Drive] = []
    numbers: dict[tuple[str, str], int] = {}
    for k, c in enumerate(scene.connection):
        if isinstance(c, EndConnection) and c.one_way:
            point = numbers.setdefault((c.on, repr(c.on_at)), len(numbers))
            drives.append(Drive(k, c.body, c.at, c.share, c.on, c.on_at, point))
    return drives


def drive_forces(scene: Scene) -> list[DriveForce]:
    """Return the external forces by which strings drive bodies, one for each driven point, in the order of the point
    numbers."""
    forces: dict[int, DriveForce] = {}
    for drive in find_drives(scene):
        forces.setdefault(drive.point, DriveForce(drive.body, drive.at, 1.0, drive.point))
    return list(forces.values())


def order_islands(system: ModalSystem, island_of: list[int]) -> list[int]:
    """Renumber the islands so that those whose strings drive others come first. Return the island of each body.

    island_of: islands of the bodies before that
    Raises BuildError if an island drives itself, directly or through others.
    """
    drives, index = find_drives(system.scene), system.body_index
    if not drives:
        return island_of
    pairs = [(island_of[index[d.string]], island_of[index[d.body]]) for d in drives]
    depth = [0] * (max(island_of) + 1)
    for _ in range(len(depth)):
        for before, after in pairs:
            depth[after] = max(depth[after], depth[before] + 1)
    for drive, (before, after) in zip(drives, pairs, strict=True):
        if depth[after] <= depth[before] or max(depth) >= len(depth):
            message = f'"{drive.string}" drives "{drive.body}", which acts back on it through other bodies'
            raise BuildError(Fault(f"connection[{drive.connection}].one_way", f"{message}; give one_way = false"))
    first = list(range(len(depth)))  # of the islands that drive each other: so those of a voice stay together
    for _ in first:
        for before, after in pairs:
            first[before] = first[after] = min(first[before], first[after])
    order = sorted(range(len(depth)), key=lambda i: (first[i], depth[i], i))
    ranks = {island: n for n, island in enumerate(order)}
    return [ranks[island] for island in island_of]
