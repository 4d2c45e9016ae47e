"""The score of a scene in the layout of the kernels: events sorted by island and time."""

import math
from typing import Any

import numpy as np

from engine.assembly.coordinates import stiffness_beside
from engine.assembly.layout import Layout
from engine.kernel.data.enums import NO_END, UNUSED_SLOT, EventKind
from engine.kernel.data.model import Events
from engine.patch.frames import nearest_frame
from engine.patch.tables import ChangeEvent, DampEvent, Event, StrikeEvent

EventRow = tuple[
    int, int, int, int, int, int, float, float
]  # island, start, end, kind, target_begin, target_end, value, value2


def event_table(
    layout: Layout, stiffness: np.ndarray, samplerate: float, capacity: int = 0
) -> tuple[Events | None, np.ndarray]:
    """Return the events of a layout, or None without any, and the position of the first event of each island.

    stiffness: of each contact point, N/m^α; events give multiples of it
    capacity:  number of free slots on each island for further events
    """
    rows = [row for event in layout.scene.event for row in event_rows(layout, event, stiffness, samplerate)]
    rows += [
        (n, UNUSED_SLOT, UNUSED_SLOT, EventKind.DAMP, 0, 0, 1.0, 0.0)
        for n in range(max(layout.island_of_body) + 1)
        for _ in range(capacity)
    ]
    rows.sort(key=lambda row: row[:2])
    begin = np.searchsorted([row[0] for row in rows], np.arange(max(layout.island_of_body) + 2))
    if not rows:
        return None, begin
    columns: list[Any] = list(zip(*rows, strict=True))
    start, end, kind, target_begin, target_end = (np.array(c, dtype=np.int64) for c in columns[1:6])
    value, value2 = np.array(columns[6]), np.array(columns[7])
    return Events(kind, start, end, target_begin, target_end, value, value2), begin


def event_rows(layout: Layout, event: Event, stiffness: np.ndarray, samplerate: float) -> list[EventRow]:
    """Return an event as rows of the score. A pluck has none, as it is an external force; nor has a change of
    tables."""
    if isinstance(event, StrikeEvent):
        return [_strike(layout, event, samplerate)]
    if isinstance(event, DampEvent):
        return [_damp(layout, event, samplerate)]
    if isinstance(event, ChangeEvent) and event.parameter is None:
        of_connection = event.connection is not None
        return (
            _change_connection(layout, event, samplerate)
            if of_connection
            else _change(layout, event, stiffness, samplerate)
        )
    return []


def _strike(layout: Layout, event: StrikeEvent, samplerate: float) -> EventRow:
    number = layout.body_index[event.body]
    hammer: Any = layout.scene.body[number]
    start, mode = nearest_frame(event.time, samplerate), layout.local_modes(number).start
    displacement = hammer.displacement if event.displacement is None else event.displacement
    root = math.sqrt(hammer.mass)
    return (
        layout.island_of_body[number],
        start,
        start + 1,
        EventKind.STRIKE,
        mode,
        mode + 1,
        displacement * root,
        event.velocity * root,
    )


def _damp(layout: Layout, event: DampEvent, samplerate: float) -> EventRow:
    number = layout.body_index[event.body]
    modes, start = layout.local_modes(number), nearest_frame(event.time, samplerate)
    end = NO_END if event.duration is None else nearest_frame(event.time + event.duration, samplerate)
    # a decay rate σ takes the share 1 - exp(-2σh) of the energy; of a vibration, half is kinetic
    keep = math.exp(-2 * event.sigma / samplerate)
    return layout.island_of_body[number], start, end, EventKind.DAMP, modes.start, modes.stop, keep, 0.0


def _change(layout: Layout, event: ChangeEvent, stiffness: np.ndarray, samplerate: float) -> list[EventRow]:
    scene = layout.scene
    k = next(k for k, c in enumerate(scene.contact) if c.name == event.contact)
    contact = scene.contact[k]
    slots = [slot for slot, (number, _) in enumerate(layout.contact_points) if number == k]
    if not slots:
        return []
    island = layout.island_of_body[layout.body_index[contact.body]]
    offset = int(layout.islands.contact[island])
    first, last = slots[0] - offset, slots[-1] + 1 - offset
    start = nearest_frame(event.time, samplerate)
    end = max(start + 1, nearest_frame(event.time + event.duration, samplerate))
    rows: list[EventRow] = []
    if event.stiffness is not None:
        count = contact.bridge.points if contact.bridge is not None else 1
        ratio = event.stiffness / count / stiffness[slots[0]]
        rows.append((island, start, end, EventKind.STIFFNESS, first, last, ratio, 0.0))
    if event.exponent is not None:
        rows.append((island, start, end, EventKind.EXPONENT, first, last, event.exponent, 0.0))
    moved = event.gap if contact.on is not None else event.barrier
    if moved is not None:
        sign = 1.0 if contact.on is not None or contact.side == "above" else -1.0
        top = contact.bridge.height if contact.bridge is not None else layout.contact_points[slots[0]][1].offset
        rows.append((island, start, end, EventKind.BARRIER, first, last, sign * (moved - top), 0.0))
    return rows


def _change_connection(layout: Layout, event: ChangeEvent, samplerate: float) -> list[EventRow]:
    """Return the rows of a change of a spring, which has one coordinate."""
    start, rows = nearest_frame(event.time, samplerate), list[EventRow]()
    end = max(start + 1, nearest_frame(event.time + event.duration, samplerate))
    for n, coordinates in enumerate(layout.coordinates):
        for i, item in enumerate(coordinates.items):
            if item.connection is None or layout.scene.connection[item.connection].name != event.connection:
                continue
            stiffness = None if event.stiffness is None else stiffness_beside(item.excess, event.stiffness)
            for kind, value in (
                (EventKind.CONNECTION_STIFFNESS, stiffness),
                (EventKind.CONNECTION_DAMPING, event.damping_coefficient),
                (EventKind.CONNECTION_REST, event.rest),
            ):
                if value is not None:
                    rows.append((n, start, end, kind, i, i + 1, value, 0.0))
    return rows
