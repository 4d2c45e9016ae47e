"""The score of a scene as the kernels read it: events sorted by island and time."""

import math
from typing import Any

import numpy as np

from engine.events import BEND, DAMP, FOREVER, MOVE, NEVER, STIFFEN, STRIKE
from engine.layout import Layout
from engine.model import Events
from engine.parts import Change, Damp, Event, Strike

Row = tuple[int, int, int, int, int, int, float, float]  # island, start, end, kind, first, last, a, b


def events(layout: Layout, base: np.ndarray, samplerate: float, room: int = 0) -> tuple[Events | None, np.ndarray]:
    """Events of a layout, None without any; and where those of each island begin.

    base: stiffness of each point of contact, N/m^α, of which events give multiples
    room: for how many more events to leave room on each island
    """
    rows = [row for event in layout.scene.event for row in rows_of(layout, event, base, samplerate)]
    rows += [(n, NEVER, NEVER, DAMP, 0, 0, 1.0, 0.0) for n in range(max(layout.island) + 1) for _ in range(room)]
    rows.sort(key=lambda row: row[:2])
    begin = np.searchsorted([row[0] for row in rows], np.arange(max(layout.island) + 2))
    if not rows:
        return None, begin
    columns: list[Any] = list(zip(*rows, strict=True))
    start, end, kind, first, last = (np.array(c, dtype=np.int64) for c in columns[1:6])
    return Events(kind, start, end, first, last, np.array(columns[6]), np.array(columns[7])), begin


def rows_of(layout: Layout, event: Event, base: np.ndarray, samplerate: float) -> list[Row]:
    """An event as rows of the score; none for a pluck, which is an external force."""
    if isinstance(event, Strike):
        return [_strike(layout, event, samplerate)]
    if isinstance(event, Damp):
        return [_damp(layout, event, samplerate)]
    if isinstance(event, Change):
        return _change(layout, event, base, samplerate)
    return []


def _strike(layout: Layout, event: Strike, samplerate: float) -> Row:
    number = layout.number[event.body]
    hammer: Any = layout.scene.body[number]
    start, mode = round(event.time * samplerate), layout.modes_of(number).start
    displacement = hammer.displacement if event.displacement is None else event.displacement
    root = math.sqrt(hammer.mass)
    return layout.island[number], start, start + 1, STRIKE, mode, mode + 1, displacement * root, event.velocity * root


def _damp(layout: Layout, event: Damp, samplerate: float) -> Row:
    number = layout.number[event.body]
    modes, start = layout.modes_of(number), round(event.time * samplerate)
    end = FOREVER if event.duration is None else round((event.time + event.duration) * samplerate)
    # a decay rate σ takes the share 1 - exp(-2σh) of the energy; of a vibration, half is kinetic
    keep = math.exp(-2 * event.sigma / samplerate)
    return layout.island[number], start, end, DAMP, modes.start, modes.stop, keep, 0.0


def _change(layout: Layout, event: Change, base: np.ndarray, samplerate: float) -> list[Row]:
    scene = layout.scene
    k = next(k for k, c in enumerate(scene.contact) if c.name == event.contact)
    contact = scene.contact[k]
    spots = [place for place, (number, _) in enumerate(layout.spot) if number == k]
    if not spots:
        return []
    island = layout.island[layout.number[contact.body]]
    offset = int(layout.islands.contact[island])
    first, last = spots[0] - offset, spots[-1] + 1 - offset
    start = round(event.time * samplerate)
    end = max(start + 1, round((event.time + event.duration) * samplerate))
    rows: list[Row] = []
    if event.stiffness is not None:
        points = contact.bridge.points if contact.bridge is not None else 1
        rows.append((island, start, end, STIFFEN, first, last, event.stiffness / points / base[spots[0]], 0.0))
    if event.exponent is not None:
        rows.append((island, start, end, BEND, first, last, event.exponent, 0.0))
    moved = event.gap if contact.on is not None else event.barrier
    if moved is not None:
        sign = 1.0 if contact.on is not None or contact.side == "above" else -1.0
        top = contact.bridge.height if contact.bridge is not None else layout.spot[spots[0]][1].offset
        rows.append((island, start, end, MOVE, first, last, sign * (moved - top), 0.0))
    return rows
