"""The score of a scene in the layout of the kernels: events sorted by island and time."""

import math
from typing import Any, NamedTuple

import numpy as np

from engine.arithmetic.plain_numbers import exp
from engine.assembly.array_memory import ABSENT
from engine.assembly.coordinates import stiffness_beside
from engine.assembly.external_forces import find_pluck_point
from engine.assembly.islands import begins_of
from engine.assembly.layout import Layout
from engine.kernel.data.enums import FRICTION_EVENTS, NO_END, UNUSED_SLOT, EventKind
from engine.kernel.data.model import Events, Model
from engine.kernel.data.state import State
from engine.patch.frames import nearest_frame
from engine.patch.friction import Friction
from engine.patch.live_parameters import GLIDED_KEYS
from engine.patch.tables import ChangeEvent, DampEvent, Event, LiftEvent, PluckEvent, StrikeEvent


class EventRow(NamedTuple):
    """An event of a score, of a queue or of a log."""

    kind: int  # EventKind
    island: int
    target_begin: int  # its modes, contacts, … : numbers within the island
    target_end: int
    start: int  # frame
    length: int  # frames
    value: float = 0.0
    value2: float = 0.0
    value3: float = 0.0
    note: int = 0  # the note that it belongs to, with whose end it is cancelled if it has not begun; 0: none
    is_release: bool = False  # whether it ends a note, and is never dropped

    @property
    def numbers(self) -> tuple[int, ...]:
        """All integers, in the order of engine.runtime.event_slots.EventSlot."""
        return *self[:6], self.note, int(self.is_release)

    @property
    def values(self) -> tuple[float, ...]:
        """The values."""
        return self[6:9]


def event_table(
    layout: Layout, stiffness: np.ndarray, samplerate: float, capacity: int = 0
) -> tuple[Events, np.ndarray]:
    """Return the events of a layout, or ABSENT without any, and the number of events of each island.

    stiffness: of each contact point, N/m^α; events give multiples of it
    capacity:  number of free slots on each island for further events
    """
    islands = range(len(layout.islands.bodies))
    rows = [row for event in layout.scene.event for row in event_rows(layout, event, stiffness, samplerate)]
    slots = [EventRow(EventKind.DAMP, n, 0, 0, UNUSED_SLOT, 0, 1.0) for n in islands]
    times = [1] * len(rows) + [capacity] * len(slots)  # of each row
    whole = np.repeat(np.array([row[:6] for row in rows + slots], np.int64), times, axis=0)
    values = np.repeat(np.array([row.values for row in rows + slots], float), times, axis=0)
    counts = np.bincount(whole[:, 1], minlength=len(islands))
    if not len(whole):
        return ABSENT, counts
    order = np.lexsort((whole[:, 4], whole[:, 1]))  # by island, then by time
    kind, _, target_begin, target_end, start, length = whole[order].T.copy()
    return Events(kind, start, start + length, target_begin, target_end, *values[order].T.copy()), counts


def event_rows(layout: Layout, event: Event, stiffness: np.ndarray, samplerate: float) -> list[EventRow]:
    """Return an event as rows of the score. A change of tables has none; nor has a pluck without a force.

    All that an event does is counted in frames from the frame at which it begins: so it is the same at any time.
    """
    if isinstance(event, StrikeEvent):
        return [_strike(layout, event, samplerate)]
    if isinstance(event, PluckEvent):
        return [_pluck(layout, event, samplerate)] if event.amplitude != 0.0 else []
    if isinstance(event, DampEvent):
        return [_damp(layout, event, samplerate)]
    if isinstance(event, LiftEvent):
        return [_lift(layout, event, samplerate)]
    if isinstance(event, ChangeEvent) and event.connection is not None:
        return _change_connection(layout, event, samplerate)
    if isinstance(event, ChangeEvent) and event.friction is not None:
        return _change_friction(layout, event, samplerate)
    if isinstance(event, ChangeEvent) and event.parameter is None:
        return _change_contact(layout, event, stiffness, samplerate)
    return []


def _strike(layout: Layout, event: StrikeEvent, samplerate: float) -> EventRow:
    number = layout.body_index[event.body]
    hammer: Any = layout.scene.body[number]
    start, modes, root = nearest_frame(event.time, samplerate), layout.modes.in_island[number], math.sqrt(hammer.mass)
    displacement = hammer.displacement if event.displacement is None else event.displacement
    island, position, momentum = layout.islands.of_body[number], displacement * root, event.velocity * root
    return EventRow(EventKind.STRIKE, island, modes.start, modes.stop, start, 1, position, momentum)


def _pluck(layout: Layout, event: PluckEvent, samplerate: float) -> EventRow:
    point = find_pluck_point(layout.islands.forces, event)
    island = layout.islands.of_body[layout.body_index[event.body]]
    place = point - sum(layout.islands.of_body[layout.body_index[f.body]] < island for f in layout.islands.forces)
    rise, fall = event.duration * samplerate, event.release * samplerate
    start, length = nearest_frame(event.time, samplerate), math.ceil(rise + fall)
    return EventRow(EventKind.PLUCK, island, place, place + 1, start, length, event.amplitude, rise, fall)


def _lift(layout: Layout, event: LiftEvent, samplerate: float) -> EventRow:
    number = layout.body_index[event.body]
    modes, island = layout.modes.in_island[number], layout.islands.of_body[number]
    return EventRow(EventKind.LIFT, island, modes.start, modes.stop, nearest_frame(event.time, samplerate), 1)


def _damp(layout: Layout, event: DampEvent, samplerate: float) -> EventRow:
    number = layout.body_index[event.body]
    modes, start = layout.modes.in_island[number], nearest_frame(event.time, samplerate)
    end = NO_END if event.duration is None else start + nearest_frame(event.duration, samplerate)
    # a decay rate σ takes the share 1 - exp(-2σh) of the energy; of a vibration, half is kinetic
    keep = exp(-2 * event.sigma / samplerate)
    island = layout.islands.of_body[number]
    return EventRow(EventKind.DAMP, island, modes.start, modes.stop, start, end - start, keep)


class ChangedNumber(NamedTuple):
    """A number of the kernel that changes glide: a value v of their rows makes it shift + v*unit."""

    array: np.ndarray
    place: int  # within the flat array
    shift: float = 0.0
    unit: float = 1.0


def find_changed_number(layout: Layout, model: Model, state: State, target: tuple[int, int, int]) -> ChangedNumber:
    """Return the number that a row of a change glides. target: the kind of the row, its island and its first target"""
    (kind, island, first), islands = target, layout.islands
    of_springs = {
        EventKind.CONNECTION_STIFFNESS: state.connection.stiffness,
        EventKind.CONNECTION_DAMPING: state.connection.damping,
        EventKind.CONNECTION_REST: state.connection.rest,
    }
    if kind in of_springs:
        springs = begins_of([len(coordinates.items) for coordinates in islands.coordinates])
        return ChangedNumber(of_springs[EventKind(kind)], int(springs[island]) + first)
    k = int(islands.contact_begins[island]) + first
    if kind in FRICTION_EVENTS:
        return ChangedNumber(state.law_numbers, k * state.law_numbers.shape[1] + FRICTION_EVENTS.index(kind))
    if kind == EventKind.BARRIER:
        return ChangedNumber(state.barrier, k, shift=float(model.contact.nominal_barrier[k]))
    unit = float(model.contact.nominal_stiffness[k] / (state.exponent[k] + 1.0))  # a stiffness, as laws count it
    return ChangedNumber(state.potential_coefficient, k, unit=unit)


def _frames(event: ChangeEvent, samplerate: float) -> tuple[int, int]:
    """Return the step in which a change begins, and how many steps it takes."""
    return nearest_frame(event.time, samplerate), max(1, nearest_frame(event.duration, samplerate))


def _change_contact(layout: Layout, event: ChangeEvent, stiffness: np.ndarray, samplerate: float) -> list[EventRow]:
    """Return the rows of a change of a contact."""
    k, contact = next((k, c) for k, c in enumerate(layout.scene.contact) if c.name == event.contact)
    slots = [slot for slot, (number, _) in enumerate(layout.islands.contact_points) if number == k]
    if not slots:
        return []
    island = layout.islands.of_body[layout.body_index[contact.body]]
    offset = int(layout.islands.contact_begins[island])
    first, last = slots[0] - offset, slots[-1] + 1 - offset
    values: list[tuple[EventKind, float]] = []
    if event.stiffness is not None:
        count = contact.bridge.points if contact.bridge is not None else 1
        values.append((EventKind.STIFFNESS, event.stiffness / count / stiffness[slots[0]]))
    if event.exponent is not None:
        values.append((EventKind.EXPONENT, event.exponent))
    moved = event.gap if contact.on is not None else event.barrier
    if moved is not None:
        sign = 1.0 if contact.on is not None or contact.side == "above" else -1.0
        point = layout.islands.contact_points[slots[0]][1]
        top = contact.bridge.height if contact.bridge is not None else point.offset
        values.append((EventKind.BARRIER, sign * (moved - top)))
    start, length = _frames(event, samplerate)
    return [EventRow(kind, island, first, last, start, length, value) for kind, value in values]


def _change_friction(layout: Layout, event: ChangeEvent, samplerate: float) -> list[EventRow]:
    """Return the rows of a change of friction."""
    tables = enumerate(layout.touching)
    k = next(k for k, table in tables if isinstance(table, Friction) and table.name == event.friction)
    slots = [slot for slot, (number, _) in enumerate(layout.islands.contact_points) if number == k]
    island = layout.islands.of_body[layout.body_index[layout.touching[k].body]]
    offset = int(layout.islands.contact_begins[island])
    first, last = slots[0] - offset, slots[-1] + 1 - offset
    start, length = _frames(event, samplerate)
    kinds = zip(FRICTION_EVENTS, GLIDED_KEYS["friction"], strict=True)
    values = [(kind, getattr(event, key)) for kind, key in kinds]
    return [EventRow(kind, island, first, last, start, length, value) for kind, value in values if value is not None]


def _change_connection(layout: Layout, event: ChangeEvent, samplerate: float) -> list[EventRow]:
    """Return the rows of a change of a spring, which has one coordinate."""
    (start, length), rows = _frames(event, samplerate), list[EventRow]()
    connections = layout.scene.connection
    for n, coordinates in enumerate(layout.islands.coordinates):
        for i, item in enumerate(coordinates.items):
            if item.connection is None or connections[item.connection].name != event.connection:
                continue
            stiffness = None if event.stiffness is None else stiffness_beside(item.excess, event.stiffness)
            for kind, value in (
                (EventKind.CONNECTION_STIFFNESS, stiffness),
                (EventKind.CONNECTION_DAMPING, event.damping_coefficient),
                (EventKind.CONNECTION_REST, event.rest),
            ):
                if value is not None:
                    rows.append(EventRow(kind, n, i, i + 1, start, length, value))
    return rows
