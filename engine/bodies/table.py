"""Tables of a patch: their common base, the types of their values, and how their faults are reported."""

import math
from typing import Annotated, Any, TypeGuard

from pydantic import AfterValidator, BaseModel, ConfigDict, Field, WithJsonSchema
from pydantic_core import InitErrorDetails, PydanticCustomError

from engine.wording import format_value

MAX_POSITIONS = 512  # in a list

KeyPath = tuple[str | int, ...]  # such as ("body", 0, "mass")

Name = Annotated[str, Field(pattern=r"^[A-Za-z][A-Za-z0-9_-]*$", max_length=64)]
Metres = Annotated[float, Field(ge=-1e6, le=1e6)]
Displacement = Annotated[float, Field(ge=-1e3, le=1e3)]
Velocity = Annotated[float, Field(ge=-1e4, le=1e4)]
Positive = Annotated[float, Field(gt=0.0, le=1e6)]
NotNegative = Annotated[float, Field(ge=0.0, le=1e6)]
Fraction = Annotated[float, Field(ge=0.0, le=1.0)]


class Table(BaseModel):
    """A table of a patch: unknown keys, NaN and infinity are refused, and nothing changes later."""

    model_config = ConfigDict(extra="forbid", strict=True, allow_inf_nan=False, frozen=True)


def is_number(value: Any) -> TypeGuard[float]:
    """True if a value is a number; True and False do not count as numbers."""
    return isinstance(value, int | float) and not isinstance(value, bool)


def are_positive(value: Any) -> TypeGuard[list[float]]:
    """True if a value of a patch is a list of positive numbers."""
    return isinstance(value, list) and bool(value) and all(is_number(x) and 0 < x < math.inf for x in value)


def is_given(table: dict[str, Any], key: str) -> bool:
    """True if a table has a value under a key."""
    return table.get(key) is not None


def make_fault(path: KeyPath, value: Any, message: str, remedy: str) -> InitErrorDetails:
    """A fault that a check of ours found, in the form in which pydantic reports it with its own.

    message: what is wrong; remedy: what would be right
    """
    error = PydanticCustomError("scene", "{message}; {remedy}", {"message": message, "remedy": remedy})
    return InitErrorDetails(type=error, loc=path, input=value)


def validate_positions(value: Any) -> Any:
    """A position on a body, a list of them, or None. Raises PydanticCustomError."""
    if value is None:
        return None
    items = value if isinstance(value, list) else [value]
    if len(items) > MAX_POSITIONS:
        sizes = {"count": len(items), "most": MAX_POSITIONS}
        raise PydanticCustomError("scene", "{count} positions; at most {most}", sizes)
    items = [x for item in items for x in (item if isinstance(item, list) else [item])]
    if not items or not all(isinstance(x, str) or (is_number(x) and 0.0 <= x <= 1.0) for x in items):
        message = (
            "{value} is not a position on a body; give a fraction of its length, [x, y] fractions, a point's name, "
        )
        raise PydanticCustomError("scene", message + "or a list of these", {"value": format_value(value)})
    return value


def validate_metres(value: Any) -> Any:
    """A number, a list of numbers, or None. Raises PydanticCustomError."""
    if value is None:
        return None
    items = value if isinstance(value, list) else [value]
    if len(items) > MAX_POSITIONS:
        sizes = {"count": len(items), "most": MAX_POSITIONS}
        raise PydanticCustomError("scene", "{count} positions; at most {most}", sizes)
    if not items or not all(is_number(x) and abs(x) <= 1e6 for x in items):
        message = "{value} is not a position; give a number in m, or a list of numbers"
        raise PydanticCustomError("scene", message, {"value": format_value(value)})
    return value


# the same as JSON Schema, for editors (engine.patch.json_schema)
_FRACTION = {"type": "number", "minimum": 0.0, "maximum": 1.0}
_PAIR = {"type": "array", "items": _FRACTION, "minItems": 2, "maxItems": 2}
_POSITION: list[dict[str, Any]] = [_FRACTION, {"type": "string"}, _PAIR]
_METRES = {"type": "number", "minimum": -1e6, "maximum": 1e6}
_LIST = {"type": "array", "minItems": 1, "maxItems": MAX_POSITIONS}
Positions = Annotated[
    Any,
    AfterValidator(validate_positions),
    WithJsonSchema({"anyOf": [*_POSITION, _LIST | {"items": {"anyOf": _POSITION}}]}),
]
Offsets = Annotated[
    Any, AfterValidator(validate_metres), WithJsonSchema({"anyOf": [_METRES, _LIST | {"items": _METRES}]})
]
