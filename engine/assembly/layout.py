"""Layout of a scene in the kernels' arrays: three records, made one after the other. Islands: who is where; modes: the
numbers of all bodies side by side; points: mode shapes where something acts."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np

from engine.arithmetic.elementary import square
from engine.assembly.contact_points import BodyPoint
from engine.assembly.islands import Islands, begins_of
from engine.assembly.modal_system import ModalSystem
from engine.assembly.mode_shape_rows import ShapeRow
from engine.assembly.modes import Modes, find_row
from engine.assembly.one_way_drive import find_drives
from engine.assembly.points import Points
from engine.assembly.subsystems import estimate_cost, partition_islands
from engine.kernel.data import model
from engine.kernel.data.axes import SEGMENTED, Axis


@dataclass(frozen=True)
class Layout(ModalSystem):
    """A scene with its bodies as modes, and the place of each of its parts in the kernels' arrays."""

    islands: Islands
    modes: Modes
    points: Points

    def row(self, point: BodyPoint) -> ShapeRow:
        """Return the mode shapes at a point, with the position of their modes in the arrays."""
        return find_row(self, self.modes, point)

    def count_by_island(self, bodies: Iterable[str]) -> np.ndarray:
        """Count the items of each island, given the name of the body that each belongs to [islands]."""
        owners = [self.islands.of_body[self.body_index[name]] for name in bodies]
        return np.bincount(np.array(owners, np.int64), minlength=len(self.islands.bodies))


def segment_arrays(layout: Layout, event_counts: np.ndarray, pair_counts: Sequence[int]) -> model.Islands:
    """Return the first item of each island on each axis of the arrays.

    event_counts, pair_counts: of events, and of pairs of points on bodies that stretch [islands]
    """
    islands, points = layout.islands, layout.points
    contacts = np.diff(islands.contact_begins)
    connections = np.array([len(coordinates.items) for coordinates in islands.coordinates])
    parts = np.array([part.island for part in points.connection_parts], np.int64)
    counts = {
        Axis.MODE: [modes.stop - modes.start for modes in layout.modes.of_island],
        Axis.CONTACT: contacts,
        Axis.COMPLIANCE: square(contacts),
        Axis.CONNECTION: connections,
        Axis.CONNECTION_PAIR: square(connections),
        Axis.CONNECTION_CONTACT: connections * contacts,
        Axis.CONNECTION_PART: np.bincount(parts, minlength=contacts.size),
        Axis.PAIR_ON_BODY: pair_counts,
        Axis.FORCE: layout.count_by_island(force.body for force in islands.forces),
        Axis.EVENT: event_counts,
        Axis.PICKUP: layout.count_by_island(heard.pickup.body for heard in points.pickups),
        Axis.BODY: [len(bodies) for bodies in islands.bodies],
        Axis.HEAVY_MODE: [m.stop - m.start if layout.modes.weight[m].any() else 0 for m in layout.modes.of_island],
        Axis.FREE_MASS: [np.count_nonzero(layout.modes.is_free[modes]) for modes in layout.modes.of_island],
    }
    partition = partition_islands(estimate_cost(islands.mode_counts, contacts))
    for drive in find_drives(layout.scene):  # both of its islands are in one partition
        first, last = (islands.of_body[layout.body_index[name]] for name in (drive.string, drive.body))
        partition = partition[(partition <= first) | (partition > last)]
    return model.Islands(**{axis: begins_of(counts[axis]) for axis in SEGMENTED}, partition=partition)
