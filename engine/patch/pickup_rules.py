"""Rules of pickups that no key shows alone. Tables are as they were read."""

from collections.abc import Iterator
from typing import Any

from pydantic_core import InitErrorDetails

from engine.bodies import AirBox, String, Tube
from engine.bodies.table import KeyPath, is_given, make_fault
from engine.patch.positions import check_positions, kind_of
from engine.wording import format_value

Faults = Iterator[InitErrorDetails]

QUANTITY_UNITS = {
    "displacement": "m",
    "velocity": "m/s",
    "acceleration": "m/s²",
    "pressure": "Pa",
    **dict.fromkeys(("force", "end_force"), "N"),
}


def check_pickup(path: KeyPath, pickup: dict[str, Any], body: dict[str, Any] | None) -> Faults:
    """A pickup has the keys of what it hears. body: the table of its body"""
    kind, has_place = kind_of(body), is_given(pickup, "at")
    quantity = pickup.get("quantity") or (kind.HEARD if kind is not None else None)
    if is_given(pickup, "pan") and pickup.get("channel", 1) != 1:
        message = "pan and channel are both given"
        yield make_fault((*path, "pan"), pickup["pan"], message, "pan acts between channels 1 and 2; give one of them")
    if is_given(pickup, "distance") and quantity != "pressure":
        remedy = 'only quantity = "pressure" has a distance'
        yield make_fault((*path, "distance"), pickup["distance"], "a distance is given without a pressure", remedy)
    if quantity == "pressure" and body is not None and kind is not None and not kind.HAS_AREA:
        message = f"{format_value(body['name'])} is a {body['kind']}, which has no area"
        yield make_fault((*path, "quantity"), quantity, message, "give a membrane or a plate")
    elif quantity == "pressure" and kind is AirBox and body is not None and not is_given(body, "hole"):
        message = f"{format_value(pickup['body'])} has no hole, and does not radiate"
        yield make_fault((*path, "body"), pickup["body"], message, "give it a hole, or place the pickup on its walls")
    elif quantity == "pressure" and kind is Tube and has_place:
        message = "the pressure of a tube is always that of its mouth"
        yield make_fault((*path, "at"), pickup["at"], message, "leave it out; other quantities have a position")
    elif quantity == "end_force":
        yield from _check_end(path, pickup, body)
    elif quantity == "tension":
        yield from _check_tension(path, pickup, body)
    elif quantity not in ("force", "pressure") or has_place:
        yield from check_positions((*path, "at"), pickup, body, single=False)


def _check_tension(path: KeyPath, pickup: dict[str, Any], body: dict[str, Any] | None) -> Faults:
    """The tension of a body is the same all over it, and rises where it stretches."""
    kind = kind_of(body)
    if is_given(pickup, "at"):
        message = "the tension of a body is the same all over it"
        yield make_fault((*path, "at"), pickup["at"], message, "leave it out; other quantities have a position")
    if body is not None and kind is not None and not any(body.get(key) for key in kind.STRETCHED_BY):
        message = f"{format_value(pickup['body'])} does not stretch, and its tension stays the same"
        keys = " or ".join(kind.STRETCHED_BY)
        remedy = f"give it {keys}" if keys else "only strings, membranes and plates stretch"
        yield make_fault((*path, "quantity"), pickup["quantity"], message, remedy)


def _check_end(path: KeyPath, pickup: dict[str, Any], body: dict[str, Any] | None) -> Faults:
    """The force on its end is that of a string."""
    at = pickup.get("at")
    if body is not None and kind_of(body) is not None and kind_of(body) is not String:
        message = f"{format_value(pickup['body'])} is a {body.get('kind')}, which has no ends"
        yield make_fault((*path, "quantity"), pickup["quantity"], message, "only a string has ends")
    elif isinstance(at, bool) or at not in (0, 1):
        message = "no end is given" if at is None else f"{format_value(at)} is not an end"
        yield make_fault((*path, "at") if at is not None else path, at, message, "give at = 0 or 1")
