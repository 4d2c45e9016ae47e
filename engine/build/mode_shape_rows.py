"""Mode shapes at points, as rows for the kernels (engine.kernel.model.ModeShapeRows)."""

from collections.abc import Iterator, Sequence

import numpy as np

from engine.build.layout import BodyPoint, Layout
from engine.kernel.model import ModeShapeRows, RowCoefficients

SIMD_WIDTH = 4  # modes that the processor takes at once


def mode_shape_rows(layout: Layout, points: Sequence[BodyPoint]) -> ModeShapeRows:
    """Shapes Φ at points. Each row begins in phi as its modes do among all, so that vector loads of both are
    aligned."""
    places = list(_row_places(layout, points))
    return ModeShapeRows(
        mode_begin=np.array([begin for begin, _, _, _ in places], dtype=np.uint32),
        mode_end=np.array([begin + phi.size for begin, _, _, phi in places], dtype=np.uint32),
        offset=np.array([offset for _, offset, _, _ in places], dtype=np.uint32),
        phi=_entries(places, [phi for _, _, _, phi in places]),
    )


def row_coefficients(
    layout: Layout, points: Sequence[BodyPoint], kick: np.ndarray, drift: np.ndarray
) -> RowCoefficients:
    """t·Φ and v·Φ of the same rows. kick, drift: t and v [modes], s."""
    places = list(_row_places(layout, points))
    chosen = [slice(first, first + phi.size) for _, _, first, phi in places]
    return RowCoefficients(
        kick_phi=_entries(places, [phi * kick[modes] for modes, (_, _, _, phi) in zip(chosen, places, strict=True)]),
        drift_phi=_entries(places, [phi * drift[modes] for modes, (_, _, _, phi) in zip(chosen, places, strict=True)]),
    )


Place = tuple[int, int, int, np.ndarray]  # first mode in its island, offset in phi, first of all modes, Φ


def _row_places(layout: Layout, points: Sequence[BodyPoint]) -> Iterator[Place]:
    """Where each row lies."""
    end = 0
    for point in points:
        phi = layout.mode_shape(point)
        if point.body is None:
            yield 0, end, 0, phi
            continue
        number = layout.body_index[point.body]
        first = layout.global_modes(number).start
        offset = end + ((first - end) % SIMD_WIDTH if phi.size > 1 else 0)
        yield layout.local_modes(number).start, offset, first, phi
        end = offset + phi.size


def _entries(places: Sequence[Place], rows: Sequence[np.ndarray]) -> np.ndarray:
    """Entries of rows one after the other, zeros between them."""
    size = max((offset + row.size for (_, offset, _, _), row in zip(places, rows, strict=True)), default=0)
    entries = np.zeros(size)
    for (_, offset, _, _), row in zip(places, rows, strict=True):
        entries[offset : offset + row.size] = row
    return entries
