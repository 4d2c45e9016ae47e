"""The state of a scene at time 0."""

import numpy as np

from engine.assembly.array_memory import allocate
from engine.assembly.connections import lowest_energies
from engine.assembly.contact_points import BodyPoint
from engine.assembly.contact_reach import dense_rows
from engine.assembly.layout import Layout
from engine.kernel.data.axes import Axis
from engine.kernel.data.enums import COLUMNS, DRIVE_FRAMES, LANES, Row
from engine.kernel.data.model import Model
from engine.kernel.data.state import ConnectionState, FreeFlightState, NearContacts, RefinementState, Scratch, State


def initial_state(layout: Layout, model: Model) -> State:
    """Return the state at time 0: bodies in the positions of the patch, and contacts and connections that follow from
    them."""
    counts, q, contact = item_counts(model), layout.concatenate_modes("q"), model.contact
    given: dict[str, np.ndarray] = {}
    if contact is not None:
        closed = [point.stiffness > 0.0 for _, point in layout.contact_points]
        exponent = np.array([layout.scene.contact[k].exponent for k, _ in layout.contact_points])
        given["exponent"] = exponent
        given["potential_coefficient"] = np.where(closed, contact.nominal_stiffness / (exponent + 1), 0.0)
        given["barrier"] = contact.nominal_barrier.copy()
        given["compression"] = _initial_compressions(layout, q) - given["barrier"]
    coupling = model.step.contact is not None and model.step.contact.coupling is not None
    largest = int(np.diff(model.islands.contact).max())
    state: State = allocate(
        State,
        counts,
        q=q,
        p=layout.concatenate_modes("p"),
        previous_velocity=np.array([_initial_velocity(layout, heard.point) for heard in layout.heard_points]),
        drive=np.zeros((counts[Axis.DRIVE], DRIVE_FRAMES)) if model.drive is not None else None,
        connection=_initial_connections(layout, counts, q) if model.connection is not None else None,
        scratch=allocate_scratch(counts[Axis.PARTITION], largest) if coupling else None,
        refinement=allocate(RefinementState, counts) if model.refinement is not None else None,
        flight=allocate(FreeFlightState, counts),
        **given,
    )
    return state


def _initial_velocity(layout: Layout, point: BodyPoint) -> float:
    """Return the velocity of a point at time 0, m/s."""
    if point.body is None:
        return 0.0
    return float(layout.mode_shape(point) @ layout.modal_bodies[layout.body_index[point.body]].p)


def _initial_connections(layout: Layout, counts: dict[Axis, int], q: np.ndarray) -> ConnectionState:
    """Return the state of connections at time 0: their values in the patch, and the extensions that follow from the
    positions of bodies."""
    items = [item for coordinates in layout.coordinates for item in coordinates.items]
    rest, extension = np.array([item.rest for item in items]), []
    for n in range(len(layout.coordinates)):
        extension += list(dense_rows(layout, n) @ q[layout.islands.mode[n] : layout.islands.mode[n + 1]])
    rigid = np.array([item.is_rigid for item in items])
    state: ConnectionState = allocate(
        ConnectionState,
        counts,
        stiffness=np.array([item.stiffness for item in items]),
        damping=np.array([item.damping for item in items]),
        rest=rest,
        extension=np.where(rigid, 0.0, np.array(extension) - rest),
        lowest_energy=lowest_energies(layout),
        near=allocate(NearContacts, counts),
    )
    return state


def item_counts(model: Model) -> dict[Axis, int]:
    """Return the number of items of each axis in a model."""
    islands = model.islands
    counts = {Axis(axis): int(begins[-1]) for axis, begins in islands._asdict().items() if axis in list(Axis)}
    events = 0 if model.events is None else model.events.kind.size
    counts[Axis.DRIVE] = 0 if model.drive is None else model.drive.island.size
    counts |= {Axis.ISLAND: islands.mode.size - 1, Axis.PARTITION: islands.partition.size - 1, Axis.EVENT: events}
    return counts


def allocate_scratch(partitions: int, contacts: int) -> Scratch:
    """Allocate the scratch memory of each partition, for islands of at most `contacts` contacts."""
    lanes = -(-contacts // LANES) * LANES
    matrices = np.zeros((2, partitions, contacts, lanes))
    vectors = np.zeros((partitions, len(Row), max(lanes, COLUMNS)))  # the reduced solve has up to so many sums
    return Scratch(vectors, *matrices, *np.zeros((3, partitions, contacts), np.int64))


def _initial_compressions(layout: Layout, q: np.ndarray) -> np.ndarray:
    """Return the projected displacement of each contact, before its barrier is subtracted [contacts], m."""
    mode, compression = layout.islands.mode, np.zeros(len(layout.contact_points))
    for slot, (a, b) in enumerate(layout.contact_rows):
        island = int(np.searchsorted(layout.islands.contact, slot, side="right")) - 1
        inside = q[mode[island] : mode[island + 1]]
        compression[slot] = layout.dense_mode_shape(a, island) @ inside + layout.dense_mode_shape(b, island) @ inside
    return compression
