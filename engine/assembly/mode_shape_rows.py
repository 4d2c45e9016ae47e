"""Mode shapes at points, as rows for the kernels (engine.kernel.data.model.ModeShapeRows)."""

from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np

from engine.kernel.data.model import ModeShapeRows, RowCoefficients

SIMD_WIDTH = 8  # modes that the processor takes at once


class ShapeRow(NamedTuple):
    """Mode shapes of consecutive modes at a point."""

    mode_begin: int  # counted from the first of their island
    mode_begin_of_all: int  # counted from the first of all
    phi: np.ndarray  # [modes], 1/√kg

    @property
    def modes(self) -> slice:
        """Modes of the row, counted from the first of all."""
        return slice(self.mode_begin_of_all, self.mode_begin_of_all + self.phi.size)

    @property
    def in_island(self) -> slice:
        """Modes of the row, counted from the first of their island."""
        return slice(self.mode_begin, self.mode_begin + self.phi.size)

    def over_island(self, size: int) -> np.ndarray:
        """Return the mode shapes over all modes of an island; they are zero for other bodies [size], 1/√kg."""
        phi = np.zeros(size)
        phi[self.in_island] = self.phi
        return phi


def mode_shape_rows(rows: Sequence[ShapeRow]) -> ModeShapeRows:
    """Return mode shapes Φ in the layout of the kernels. Each row begins in phi at the same alignment as its modes do
    among all modes, so that vector loads of both are aligned."""
    return ModeShapeRows(
        mode_begin=np.array([row.mode_begin for row in rows], dtype=np.uint32),
        mode_end=np.array([row.mode_begin + row.phi.size for row in rows], dtype=np.uint32),
        offset=np.array(list(_offsets(rows)), dtype=np.uint32),
        phi=place_entries(rows, [row.phi for row in rows]),
    )


def row_coefficients(rows: Sequence[ShapeRow], kick: np.ndarray, drift: np.ndarray) -> RowCoefficients:
    """Return t·Φ and v·Φ for rows. kick, drift: t and v [modes], s."""
    return RowCoefficients(
        kick_phi=place_entries(rows, [row.phi * kick[row.modes] for row in rows]),
        drift_phi=place_entries(rows, [row.phi * drift[row.modes] for row in rows]),
    )


def _offsets(rows: Sequence[ShapeRow]) -> Iterator[int]:
    """Yield the position of the first entry of each row."""
    end = 0
    for row in rows:
        offset = end + ((row.mode_begin_of_all - end) % SIMD_WIDTH if row.phi.size > 1 else 0)
        yield offset
        end = offset + row.phi.size


def place_entries(rows: Sequence[ShapeRow], values: Sequence[np.ndarray]) -> np.ndarray:
    """Join the values of rows, with zeros between them for alignment. A value is one number or several for each entry
    of phi."""
    offsets = list(_offsets(rows))
    size = max((offset + len(row) for offset, row in zip(offsets, values, strict=True)), default=0)
    entries = np.zeros((size, *(values[0].shape[1:] if values else ())))
    for offset, row in zip(offsets, values, strict=True):
        entries[offset : offset + len(row)] = row
    return entries
