"""Ranges of live parameters: within the range of the key, and no further than instruments go. A patch may set values
beyond; but a sound that glides there would lose its energy to rounding."""

import math
from functools import lru_cache
from typing import Any, NamedTuple

from pydantic import BaseModel

from engine.patch.number_format import format_number, split_unit
from engine.patch.tables import MAX_GRAVITY, Contact, max_stiffness

LEAST = {  # by key, in SI units; what may be 0 may still be 0
    **dict.fromkeys(("length", "radius", "size", "width", "height", "thickness"), 1e-6),
    "mass": 1e-12,
    "linear_density": 1e-12,
    "area_density": 1e-9,
    "density": 1.0,
    "volume": 1e-12,
    "tension": 1e-6,
    "bending_stiffness": 1e-20,
    "flexural_rigidity": 1e-20,
    "young": 1.0,
    "shear": 1.0,
    "frequency": 1e-3,
    "t60": 1e-6,
    "stiffness": 1e-6,
    "damping_coefficient": 1e-12,
}
FARTHEST = dict.fromkeys(("barrier", "gap", "rest"), 10.0)  # m, either way


class LiveRange(NamedTuple):
    """The range of a live parameter."""

    low: float
    high: float
    unit: str = ""
    is_open: bool = False  # at its low end
    may_be_zero: bool = False  # though that is below the low end

    def __contains__(self, value: object) -> bool:
        if not isinstance(value, int | float):
            return False
        return (value == 0.0 and self.may_be_zero) or (
            self.low <= value <= self.high and not (self.is_open and value == self.low)
        )

    def __str__(self) -> str:
        low, high = format_number(self.low), format_number(self.high)
        text = f"more than {low}, at most {high}" if self.is_open else f"{low} to {high}"
        return ("0, or " if self.may_be_zero else "") + text + (f" {self.unit}" if self.unit else "")


FACTORS = LiveRange(0.0, math.inf)  # of gains of channels


def live_range(scene: Any, section: str, number: int, keys: tuple[str | int, ...]) -> LiveRange:
    """Return the range of a number of a scene while it sounds. section, number, keys: as of LivePath"""
    if not section:
        return LiveRange(-MAX_GRAVITY, MAX_GRAVITY, "m/s²")
    table: BaseModel = getattr(scene, section)[number]
    limits = _range_of_key(type(table), keys)
    if isinstance(table, Contact) and keys == ("stiffness",):
        return limits._replace(high=max_stiffness(table.exponent))
    return limits


@lru_cache(1024)
def _range_of_key(model: type[BaseModel], keys: tuple[str | int, ...]) -> LiveRange:
    """Return the range of a number of a table, at any depth."""
    schema = _schema_of(model)
    node, unit = _find_number(schema, schema, keys, "") or ({}, "")
    low, high = node.get("minimum", -math.inf), node.get("maximum", math.inf)
    is_open = "exclusiveMinimum" in node
    low = node.get("exclusiveMinimum", low)
    if "exclusiveMaximum" in node:
        high = math.nextafter(node["exclusiveMaximum"], -math.inf)
    key = next(str(key) for key in reversed(keys) if isinstance(key, str))
    least, farthest = LEAST.get(key, -math.inf), FARTHEST.get(key, math.inf)
    may_be_zero = not is_open and low <= 0.0 < least
    if least > low:
        low, is_open = least, False
    return LiveRange(max(low, -farthest), min(high, farthest), unit, is_open, may_be_zero)


@lru_cache
def _schema_of(model: type[BaseModel]) -> dict[str, Any]:
    """The JSON Schema of a table, which takes 10 ms to make."""
    return model.model_json_schema()


def _find_number(
    schema: dict[str, Any], node: dict[str, Any], keys: tuple[str | int, ...], unit: str
) -> tuple[dict[str, Any], str] | None:
    """The schema of a number within a node, and its unit; None if there is none. unit: of what holds the node"""
    if "$ref" in node:
        node = schema["$defs"][node["$ref"].rpartition("/")[2]] | {"description": node.get("description", "")}
    unit = split_unit(node.get("description", ""))[1] or unit
    if not keys and node.get("type") == "number":
        return node, unit
    inner = [node["items"]] if keys and isinstance(keys[0], int) and "items" in node else []
    if keys and isinstance(keys[0], str):
        inner = [node["properties"][keys[0]]] if keys[0] in node.get("properties", {}) else []
        inner += node.get("patternProperties", {}).values()
    options = [*node.get("anyOf", []), *node.get("oneOf", []), *node.get("allOf", [])]
    numbers = [_find_number(schema, option, keys, unit) for option in options]
    numbers += [_find_number(schema, one, keys[1:], unit) for one in inner]
    return next((one for one in numbers if one is not None), None)
