"""One island of a Model and State, as a Model and State of its own.

Islands never couple (docs/design.md, sec. 3), so each is run alone. The views of an island are made once per chunk of
samples. The kernels then count all modes and contacts from 0, which spares them the handling of negative indices (14 →
9 ns per sample for a single oscillator). The axis of each array (engine.kernel.data.axes) tells how it is cut: one
expression does it for all of a Model, and is written for its types.
"""

from dataclasses import replace
from typing import Any, NamedTuple

from engine.compiler.array_view import column_view, matrix_view, row_view, slice_view
from engine.compiler.decorators import inline
from engine.compiler.overloads import is_none, overload_by_source
from engine.kernel.data.axes import SEGMENTED, Axis, Items, fields_of
from engine.kernel.data.laws import Law
from engine.kernel.data.model import Islands


class IslandBounds(NamedTuple):
    """Begin and end of the items of an island, by axis (SEGMENTED); its number, and that of its partition."""

    island: int
    partition: int
    is_first: bool  # of its partition
    mode_begin: int
    mode_end: int
    contact_begin: int
    contact_end: int
    basis_begin: int
    basis_end: int
    compliance_begin: int
    compliance_end: int
    connection_begin: int
    connection_end: int
    connection_pair_begin: int
    connection_pair_end: int
    connection_contact_begin: int
    connection_contact_end: int
    connection_part_begin: int
    connection_part_end: int
    force_begin: int
    force_end: int
    event_begin: int
    event_end: int
    pickup_begin: int
    pickup_end: int
    body_begin: int
    body_end: int
    free_mass_begin: int
    free_mass_end: int


def island_model(model: Any, state: Any, bounds: Any) -> Any:
    """Return one island of a Model; its contacts have the stiffness and the exponents of the State. In compiled code
    only."""
    raise TypeError("island_model is for compiled code")


def island_state(state: Any, bounds: Any) -> Any:
    """Return one island of a State. The clock is that of its partition. In compiled code only."""
    raise TypeError("island_state is for compiled code")


NAMES: dict[str, Any] = {view.__name__: view for view in (slice_view, column_view, row_view, matrix_view)}


def write_view(kind: Any, value: str, names: dict[str, Any], row_axis: Axis | None = None) -> str:
    """Return the source of a record like `value`, each array cut to an island.

    kind:  Numba type of the record: it tells which fields are None, and how many dimensions arrays have
    names: those of the classes are added
    """
    record = kind.instance_class
    names[record.__name__] = record
    parts = []
    for field, inner in zip(fields_of(record), kind.types, strict=True):
        part = f"{value}.{field.name}"
        if field.record is Islands or is_none(inner):
            part = "None"
        elif field.record is Law:
            names[inner.instance_class.__name__] = inner.instance_class
            part = f"{inner.instance_class.__name__}({_cut(Items(Axis.CONTACT), 'state.potential_coefficient', 1)},"
            part += f" {_cut(Items(Axis.CONTACT), 'state.exponent', 1)})"
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


def _write_model(model: Any, state: Any, bounds: Any) -> tuple[str, dict[str, Any]]:
    names = dict(NAMES)
    return write_view(model, "model", names), names


def _write_state(state: Any, bounds: Any) -> tuple[str, dict[str, Any]]:
    names = dict(NAMES)
    return write_view(state, "state", names), names


overload_by_source(island_model, _write_model)
overload_by_source(island_state, _write_state)


@inline
def island_bounds(islands, partition, i):
    """Return the IslandBounds of island i."""
    return IslandBounds(
        i,
        partition,
        i == islands.partition[partition],
        islands.mode[i],
        islands.mode[i + 1],
        islands.contact[i],
        islands.contact[i + 1],
        islands.basis[i],
        islands.basis[i + 1],
        islands.compliance[i],
        islands.compliance[i + 1],
        islands.connection[i],
        islands.connection[i + 1],
        islands.connection_pair[i],
        islands.connection_pair[i + 1],
        islands.connection_contact[i],
        islands.connection_contact[i + 1],
        islands.connection_part[i],
        islands.connection_part[i + 1],
        islands.force[i],
        islands.force[i + 1],
        islands.event[i],
        islands.event[i + 1],
        islands.pickup[i],
        islands.pickup[i + 1],
        islands.body[i],
        islands.body[i + 1],
        islands.free_mass[i],
        islands.free_mass[i + 1],
    )
