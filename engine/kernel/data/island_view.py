"""One island of a Model and State, as a Model and State of its own.

Islands never couple (docs/design.md, sec. 3), so each is run alone. The views of an island are made once per chunk of
samples. The kernels then count all modes and contacts from 0, which spares them the handling of negative indices (14 →
9 ns per sample for a single oscillator). The axis of each array (engine.kernel.data.axes) tells how it is cut: one
expression does it for all of a Model, and is written for its types.
"""

from collections import namedtuple
from dataclasses import replace
from typing import Any

from engine.compiler.array_view import column_view, matrix_view, row_view, slice_view
from engine.compiler.overloads import is_none, overload_by_source
from engine.kernel.data.axes import SEGMENTED, Axis, Items, fields_of
from engine.kernel.data.model import Islands

ENDS = [f"{axis}_{end}" for axis in SEGMENTED for end in ("begin", "end")]
# begin and end of the items of an island, by axis; its number, that of its partition, and whether it is its first
IslandBounds: Any = namedtuple("IslandBounds", ["island", "partition", "is_first", *ENDS])  # type: ignore[misc]


def island_bounds(islands: Any, partition: int, i: int) -> Any:
    """Return the IslandBounds of island i. In compiled code only."""
    raise TypeError("island_bounds is for compiled code")


def island_model(model: Any, bounds: Any) -> Any:
    """Return one island of a Model. In compiled code only."""
    raise TypeError("island_model is for compiled code")


def island_state(state: Any, bounds: Any) -> Any:
    """Return one island of a State. The clock is that of its partition. In compiled code only."""
    raise TypeError("island_state is for compiled code")


NAMES: dict[str, Any] = {view.__name__: view for view in (slice_view, column_view, row_view, matrix_view)}


def write_view(kind: Any, value: str, names: dict[str, Any], row_axis: Axis | None = None) -> str:
    """Return the source of a record like `value`, each array cut to an island.

    kind:  Numba type of the record: it tells how many dimensions arrays have, and whether there are stages
    names: those of the classes are added
    """
    record = kind.instance_class
    names[record.__name__] = record
    parts = []
    for field, inner in zip(fields_of(record), kind.types, strict=True):
        part = f"{value}.{field.name}"
        if field.record is Islands or is_none(inner):
            part = "None"
        elif field.record is not None:
            part = write_view(inner, part, names, field.row_axis or row_axis)
        elif field.items is not None:
            axis = row_axis if field.items.axis is Axis.ROW and row_axis is not None else field.items.axis
            part = _cut(replace(field.items, axis=axis), part, inner.ndim)
        parts.append(part)
    return f"{record.__name__}({', '.join(parts)})"


def _cut(items: Items, array: str, dimensions: int) -> str:
    """Return the source of an island's part of an array. If its axis is in SEGMENTED and it has two dimensions, there
    is a row for each kind of stage in front, unless its items have columns."""
    axis = items.axis
    if axis in SEGMENTED:
        if items.columns:
            return f"row_view({array}, bounds.{axis}_begin)"
        if dimensions == 2:
            return f"column_view({array}, bounds.{axis}_begin)"
        return f"slice_view({array}, bounds.{axis}_begin, bounds.{axis}_end)"
    if axis in (Axis.ISLAND, Axis.PARTITION):
        number = f"bounds.{axis}"
        if dimensions == 1:
            return f"slice_view({array}, {number}, {number} + 1)"
        item = f"{array}[{number}]"
        return f"matrix_view({array}, {number})" if dimensions == 3 else f"slice_view({item}, 0, {item}.shape[0])"
    return f"column_view({array}, 0)" if dimensions == 2 else f"slice_view({array}, 0, {array}.shape[0])"


def _write_model(model: Any, bounds: Any) -> tuple[str, dict[str, Any]]:
    names = dict(NAMES)
    return write_view(model, "model", names), names


def _write_state(state: Any, bounds: Any) -> tuple[str, dict[str, Any]]:
    names = dict(NAMES)
    return write_view(state, "state", names), names


def _write_bounds(islands: Any, partition: Any, i: Any) -> tuple[str, dict[str, Any]]:
    parts = [f"islands.{axis}[{place}]" for axis in SEGMENTED for place in ("i", "i + 1")]
    is_first = "i == islands.partition[partition]"
    return f"IslandBounds(i, partition, {is_first}, {', '.join(parts)})", {"IslandBounds": IslandBounds}


overload_by_source(island_bounds, _write_bounds)
overload_by_source(island_model, _write_model)
overload_by_source(island_state, _write_state)
