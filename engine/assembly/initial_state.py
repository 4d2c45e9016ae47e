"""The state of a scene at time 0."""

from itertools import pairwise

import numpy as np

from engine.arithmetic.products import product
from engine.assembly.array_memory import ABSENT, allocate
from engine.assembly.connections import lowest_energies
from engine.assembly.felt import add_felt_numbers
from engine.assembly.friction import friction_points, initial_law_numbers
from engine.assembly.layout import Layout
from engine.assembly.mode_shape_rows import ShapeRow
from engine.assembly.tension import initial_tension
from engine.kernel.data.axes import Axis
from engine.kernel.data.enums import DRIVE_FRAMES, LANES, Row
from engine.kernel.data.model import Model
from engine.kernel.data.state import (
    ConnectionState,
    FreeFlightState,
    NearContacts,
    RefinementState,
    SavedMotion,
    Scratch,
    State,
)

AXES = frozenset(Axis)


def initial_state(layout: Layout, model: Model) -> State:
    """Return the state at time 0: bodies in the positions of the patch, and contacts and connections that follow from
    them."""
    counts, modes, contact = item_counts(model), layout.modes, model.contact
    given: dict[str, np.ndarray] = {}
    if contact is not ABSENT:
        closed = [point.stiffness > 0.0 for _, point in layout.islands.contact_points]
        exponent = np.array([layout.touching[k].exponent for k, _ in layout.islands.contact_points])
        given["exponent"] = exponent
        given["potential_coefficient"] = np.where(closed, contact.nominal_stiffness / (exponent + 1), 0.0)
        given["barrier"] = contact.nominal_barrier.copy()
        given["compression"] = _initial_compressions(layout) - given["barrier"]
        for slot in friction_points(layout):
            given["compression"][slot] = 0.0  # of the bristle
    coupling = model.step.contact is not ABSENT and model.step.contact.coupling is not ABSENT
    largest = int(np.diff(model.islands.contact).max())
    numbers = initial_law_numbers(layout)
    add_felt_numbers(layout, model.samplerate, numbers)
    state: State = allocate(
        State,
        counts,
        q=modes.q,
        p=modes.p,
        previous_velocity=np.array(
            [product(heard.row.phi, modes.p[heard.row.modes]) for heard in layout.points.pickups]
        ),
        drive=np.zeros((counts[Axis.DRIVE], DRIVE_FRAMES)) if model.drive is not ABSENT else ABSENT,
        connection=_initial_connections(layout, counts) if model.connection is not ABSENT else ABSENT,
        tension=initial_tension(layout, model.tension, counts) if model.tension is not ABSENT else ABSENT,
        scratch=allocate_scratch(counts[Axis.PARTITION], largest) if coupling else ABSENT,
        refinement=_initial_refinement(counts) if model.refinement is not None else None,
        flight=allocate(FreeFlightState, counts),
        law_numbers=numbers,
        **given,
    )
    return state


def _initial_refinement(counts: dict[Axis, int]) -> RefinementState:
    """Return the state of refined samples at time 0."""
    refinement: RefinementState = allocate(RefinementState, counts, saved=allocate(SavedMotion, counts))
    return refinement


def _initial_connections(layout: Layout, counts: dict[Axis, int]) -> ConnectionState:
    """Return the state of connections at time 0: their values in the patch, and the extensions that follow from the
    positions of bodies."""
    items = [item for coordinates in layout.islands.coordinates for item in coordinates.items]
    rest, of_islands = np.array([item.rest for item in items]), layout.modes.of_island
    rows = zip(layout.points.coordinate_rows, of_islands, strict=True)
    extension = np.concatenate([product(of_island, layout.modes.q[inside]) for of_island, inside in rows])
    rigid = np.array([item.is_rigid for item in items])
    state: ConnectionState = allocate(
        ConnectionState,
        counts,
        stiffness=np.array([item.stiffness for item in items]),
        damping=np.array([item.damping for item in items]),
        rest=rest,
        extension=np.where(rigid, 0.0, extension - rest),
        lowest_energy=lowest_energies(layout),
        near=allocate(NearContacts, counts),
    )
    return state


def item_counts(model: Model) -> dict[Axis, int]:
    """Return the number of items of each axis in a model."""
    islands = model.islands
    counts = {Axis(axis): int(begins[-1]) for axis, begins in islands._asdict().items() if axis in AXES}
    events = 0 if model.events is ABSENT else model.events.kind.size
    counts[Axis.DRIVE] = 0 if model.drive is ABSENT else model.drive.island.size
    counts |= {Axis.ISLAND: islands.mode.size - 1, Axis.PARTITION: islands.partition.size - 1, Axis.EVENT: events}
    return counts


def allocate_scratch(partitions: int, contacts: int) -> Scratch:
    """Allocate the scratch memory of each partition, for islands of at most `contacts` contacts."""
    lanes = -(-contacts // LANES) * LANES
    matrices = np.zeros((2, partitions, contacts, lanes))
    vectors = np.zeros((partitions, len(Row), lanes))
    return Scratch(vectors, *matrices, *np.zeros((2, partitions, contacts), np.int64))


def _initial_compressions(layout: Layout) -> np.ndarray:
    """Return the projected displacement of each contact, before its barrier is subtracted [contacts], m."""
    compressions, begins = [], layout.islands.contact_begins
    for inside, (first, last) in zip(layout.modes.of_island, pairwise(begins), strict=True):
        q = layout.modes.q[inside]
        for a, b in layout.points.contacts[first:last]:
            compressions.append(_displacement(a, q) + _displacement(b, q))
    return np.array(compressions)


def _displacement(row: ShapeRow, q: np.ndarray) -> float:
    """Return the displacement at a point. q: of the modes of its island"""
    return float(product(row.over_island(q.size), q)) if q[row.in_island].any() else 0.0
