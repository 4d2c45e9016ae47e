"""The tables of a library in C by which events are made: rows, keys, and controls, which are pads and sliders."""

import math
import struct

import numpy as np

from engine.export.row_recorder import Key, Law, Pad, Rows, Slider
from engine.live.event_rows import MAX_SCALE

MAX_VELOCITY = 1e4  # m/s, of a hammer: that of engine.bodies.table.Velocity
NO_GROUP = -1
ROW = struct.Struct("<8q3d")  # numbers and values
CONTROL = struct.Struct("<3q7d")  # rows, range and law of a pad or a slider


class EventTables:
    """Tables of constant numbers, as `fdh.c` declares them.

    rows, keys, controls: their bytes
    """

    def __init__(self) -> None:
        self.rows, self.keys, self.controls = bytearray(), bytearray(), bytearray()

    def add_key(self, key: Key, groups: list[float]) -> None:
        """Add a key. groups: those of all keys, each once"""
        group = NO_GROUP if key.group is None else groups.index(key.group)
        on, off = ([self._add(rows) for rows in each] for each in (key.on, key.off))
        off = off if len(off) > 1 else off * len(on)
        spans = [*on, *off, *(self._add(rows) for rows in (key.damp[-1], key.lift, key.steal))]
        self.keys += np.array([key.number, group, *(number for span in spans for number in span)], np.int64).tobytes()

    def add_pad(self, pad: Pad) -> None:
        """Add a pad, whose rows are those of a hammer at 1 m/s, or of a pluck as strong as in the patch."""
        place, low = (7, -MAX_VELOCITY) if pad.is_hammer else (6, math.ulp(0.0))
        at_zero = [[*row[:place], 0.0, *row[place + 1 :]] for row in pad.rows]
        (begin, count), (begin_at_one, _) = self._add(at_zero), self._add(pad.rows)
        self.controls += CONTROL.pack(
            begin, begin_at_one, count, low, MAX_VELOCITY if pad.is_hammer else MAX_SCALE, *Law()
        )

    def add_slider(self, slider: Slider) -> None:
        """Add a slider."""
        begin, count = self._add(slider.rows)
        self.controls += CONTROL.pack(begin, begin, count, slider.low, slider.high, *slider.law)

    def _add(self, rows: Rows) -> tuple[int, int]:
        """Add rows; return where they begin, and how many they are."""
        begin = len(self.rows) // ROW.size
        for row in rows:
            self.rows += ROW.pack(*map(int, [*row[:6], *row[9:]]), *row[6:9])
        return begin, len(rows)
