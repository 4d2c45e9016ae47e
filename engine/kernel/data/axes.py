"""Axes of arrays: their items are modes, contacts, islands, … The axis is declared once, in the type of the field that
holds the array. Views of an island, alignment, allocation and copies are derived from it."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from enum import StrEnum
from types import NoneType, UnionType
from typing import Annotated, Any, NamedTuple, Union, get_args, get_origin, get_type_hints

import numpy as np


class Axis(StrEnum):
    """Kind of the items of an array. The items of one island lie beside each other."""

    MODE = "mode"
    CONTACT = "contact"
    COMPLIANCE = "compliance"  # matrices of the contacts of each island, one after the other, row by row
    CONNECTION = "connection"  # coordinates of connections
    CONNECTION_PAIR = "connection_pair"  # matrices of the connections of each island, row by row
    CONNECTION_CONTACT = "connection_contact"  # matrices [connections, contacts] of each island, row by row
    CONNECTION_PART = "connection_part"  # what each body has in a connection
    FORCE = "force"
    EVENT = "event"
    PAIR_ON_BODY = "pair_on_body"  # pairs of points on bodies that stretch
    PICKUP = "pickup"
    BODY = "body"
    FREE_MASS = "free_mass"
    HEAVY_MODE = "heavy_mode"  # modes of islands that gravity acts on
    DRIVE = "drive"  # points of bodies that ends of strings drive, which they do not act back on
    ROW = "row"  # of mode shapes: the axis of the field that holds the record
    ISLAND = "island"
    PARTITION = "partition"
    SHAPE = "shape"  # entries of mode shapes at points; shared by all islands
    SHARED = "shared"


SEGMENTED = (
    *(Axis.MODE, Axis.CONTACT, Axis.COMPLIANCE),
    *(Axis.CONNECTION, Axis.CONNECTION_PAIR, Axis.CONNECTION_CONTACT, Axis.CONNECTION_PART),
    *(Axis.PAIR_ON_BODY, Axis.FORCE, Axis.EVENT, Axis.PICKUP, Axis.BODY, Axis.FREE_MASS, Axis.HEAVY_MODE),
)


@dataclass(frozen=True)
class Items:
    """Layout of an array: its axis, and how each item is stored."""

    axis: Axis
    dtype: Any = np.float64
    columns: int = 0  # of each item; 0: one number
    extra: int = 0  # items beyond those of the axis: 1 where each item has a begin, and the next is its end
    neutral: float = 0.0  # of an item that does nothing
    is_shape: bool = False  # of modes at a point: 0 for a mode that does not act there


PerMode = Annotated[np.ndarray, Items(Axis.MODE)]
PerModeFactor = Annotated[np.ndarray, Items(Axis.MODE, neutral=1.0)]
PerHeavyMode = Annotated[np.ndarray, Items(Axis.HEAVY_MODE)]
PerModeShape = Annotated[np.ndarray, Items(Axis.MODE, is_shape=True)]
PerContact = Annotated[np.ndarray, Items(Axis.CONTACT)]
PerContactInt = Annotated[np.ndarray, Items(Axis.CONTACT, np.int64)]
PerCompliance = Annotated[np.ndarray, Items(Axis.COMPLIANCE)]
PerConnection = Annotated[np.ndarray, Items(Axis.CONNECTION)]
PerConnectionInt = Annotated[np.ndarray, Items(Axis.CONNECTION, np.int64)]
PerConnectionPair = Annotated[np.ndarray, Items(Axis.CONNECTION_PAIR)]
PerConnectionContact = Annotated[np.ndarray, Items(Axis.CONNECTION_CONTACT)]
PerConnectionPart = Annotated[np.ndarray, Items(Axis.CONNECTION_PART)]
PerConnectionPartInt = Annotated[np.ndarray, Items(Axis.CONNECTION_PART, np.int64)]
PerForce = Annotated[np.ndarray, Items(Axis.FORCE)]
PerForceInt = Annotated[np.ndarray, Items(Axis.FORCE, np.int64)]
PerEvent = Annotated[np.ndarray, Items(Axis.EVENT)]
PerEventInt = Annotated[np.ndarray, Items(Axis.EVENT, np.int64)]
PerPickup = Annotated[np.ndarray, Items(Axis.PICKUP)]
PerPickupInt = Annotated[np.ndarray, Items(Axis.PICKUP, np.int64)]
PerDriveInt = Annotated[np.ndarray, Items(Axis.DRIVE, np.int64)]
PerFreeMassInt = Annotated[np.ndarray, Items(Axis.FREE_MASS, np.int64)]
PerRowInt = Annotated[np.ndarray, Items(Axis.ROW, np.uint32)]
PerShape = Annotated[np.ndarray, Items(Axis.SHAPE)]
PerIsland = Annotated[np.ndarray, Items(Axis.ISLAND)]
PerIslandInt = Annotated[np.ndarray, Items(Axis.ISLAND, np.int64)]
PerIslandBool = Annotated[np.ndarray, Items(Axis.ISLAND, np.bool_)]
Shared = Annotated[np.ndarray, Items(Axis.SHARED)]
SharedInt = Annotated[np.ndarray, Items(Axis.SHARED, np.int64)]


class Field(NamedTuple):
    """A field of a record: an array, a record, or a number."""

    name: str
    items: Items | None  # of an array
    record: Any  # the NamedTuple class of a record
    row_axis: Axis | None  # of a record of mode shapes: what its rows are


FIELDS: dict[Any, tuple[Field, ...]] = {}  # of the records read so far; to read is a fifth of the time before a sound


def fields_of(record: Any) -> tuple[Field, ...]:
    """Return the fields of a record, a NamedTuple class, as its types declare them."""
    if record in FIELDS:
        return FIELDS[record]
    fields = []
    for name, hint in get_type_hints(record, include_extras=True).items():
        options = get_args(hint) if get_origin(hint) in (Union, UnionType) else (hint,)
        plain = [option for option in options if option is not NoneType]
        notes = [note for option in plain for note in (get_args(option)[1:] if get_origin(option) is Annotated else ())]
        kinds = [get_args(option)[0] if get_origin(option) is Annotated else option for option in plain]
        items = next((note for note in notes if isinstance(note, Items)), None)
        inner = next((kind for kind in kinds if hasattr(kind, "_fields")), None)
        fields.append(Field(name, items, inner, next((note for note in notes if isinstance(note, Axis)), None)))
    FIELDS[record] = tuple(fields)
    return FIELDS[record]


def map_arrays(change: Callable[[np.ndarray, Items], np.ndarray], value: Any, row_axis: Axis | None = None) -> Any:
    """Return a record like `value`, each array replaced by the result of `change`. Fields that are None stay None.

    row_axis: axis of the rows of mode shapes, where `value` is a record of these
    """
    record: Any = type(value)
    fields = {field.name: field for field in fields_of(record)}
    changed = {}
    for name, item in zip(value._fields, value, strict=True):
        field = fields[name]
        if isinstance(item, np.ndarray) and field.items is not None:
            axis = row_axis if field.items.axis is Axis.ROW and row_axis is not None else field.items.axis
            changed[name] = change(item, field.items if axis is field.items.axis else replace(field.items, axis=axis))
        elif hasattr(item, "_fields"):
            changed[name] = map_arrays(change, item, field.row_axis or row_axis)
        else:
            changed[name] = item
    return type(value)(**changed)


def arrays_of(value: Any) -> Iterator[np.ndarray]:
    """Yield all arrays of a record, those of the records in it too."""
    for item in value:
        if isinstance(item, np.ndarray):
            yield item
        elif hasattr(item, "_fields"):
            yield from arrays_of(item)


def pair_arrays(record: Any, ours: Any, theirs: Any) -> Iterator[tuple[Items, np.ndarray, np.ndarray]]:
    """Yield the arrays of one record with those of another at the same place. record: the class of both"""
    for field in fields_of(record):
        mine, other = getattr(ours, field.name), getattr(theirs, field.name)
        if field.items is not None:
            yield field.items, mine, other
        elif field.record is not None:
            yield from pair_arrays(field.record, mine, other)
