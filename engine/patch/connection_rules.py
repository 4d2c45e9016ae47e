"""Rules that only the whole patch can break, of connections: what they join, and what may change of them."""

from collections.abc import Iterator
from typing import Any

from pydantic_core import InitErrorDetails

from engine.bodies import AirBox, String
from engine.bodies.sheet import FlatSheet
from engine.bodies.table import KeyPath, is_given, is_number, make_fault
from engine.patch.live_parameters import GLIDED_KEYS
from engine.patch.positions import check_positions, kind_of, tables_of
from engine.wording import format_value

Faults = Iterator[InitErrorDetails]


def check_connections(data: dict[str, Any], bodies: dict[str, Any]) -> Faults:
    """All faults of the connections of a document. bodies: its bodies by name"""
    ends: set[tuple[str, float | None]] = set()
    walls: set[tuple[str, str]] = set()
    for i, table in tables_of(data, "connection"):
        path: KeyPath = ("connection", i)
        if any(isinstance(table.get(key), str) and table[key] not in bodies for key in ("body", "on")):
            continue  # a fault by itself; what else would be wrong may follow from it
        if table.get("kind", "spring") == "end":
            yield from _check_end(path, table, bodies)
            at = table.get("at")
            end = (str(table.get("body")), float(at) if at is not None and is_number(at) else None)
            if end in ends:
                yield make_fault(
                    (*path, "at"), table.get("at"), "that end is already attached", "give one connection for each end"
                )
            ends.add(end)
        elif table.get("kind", "spring") == "spring":
            yield from _check_spring(path, table, bodies)
        elif table.get("kind") == "air":
            yield from _check_air(path, table, bodies)
            wall = str(table.get("on")), str(table.get("wall", "top"))
            if kind_of(bodies.get(wall[0])) is AirBox and wall in walls:
                yield make_fault(
                    (*path, "wall"), wall[1], f"another body is already its {wall[1]}", "give the other wall"
                )
            walls.add(wall)


def _check_air(path: KeyPath, table: dict[str, Any], bodies: dict[str, Any]) -> Faults:
    """Air is pressed by a sheet, and is that of a box or has a volume."""
    body, on = bodies.get(str(table.get("body"))), bodies.get(str(table.get("on")))
    kind, on_kind = kind_of(body), kind_of(on)
    for key, table_of, one in (("body", body, kind), ("on", on, on_kind)):
        is_box = key == "on" and one is AirBox
        if table_of is not None and one is not None and not (is_box or issubclass(one, FlatSheet)):
            message = f"{format_value(table[key])} is of kind {format_value(table_of.get('kind'))}"
            yield make_fault(
                (*path, key),
                table[key],
                f"{message}, which cannot be next to air",
                "give a membrane, a plate or a soundboard",
            )
    if is_given(table, "on") and table["on"] == table.get("body"):
        yield make_fault((*path, "on"), table["on"], "both sides are the same body", "name another body")
    if on is not None and on_kind is None:
        return  # a fault by itself; whether there is a volume or a wall depends on it
    is_sheet_below = on_kind is None or issubclass(on_kind, FlatSheet)
    if (is_sheet_below or on_kind is AirBox) and (on_kind is AirBox) == is_given(table, "volume"):
        remedy = "the air of a box has its own" if on_kind is AirBox else "give its volume in m³"
        where = (*path, "volume") if is_given(table, "volume") else path
        yield make_fault(
            where, table.get("volume"), f"{'a' if is_given(table, 'volume') else 'no'} volume is given", remedy
        )
    if on_kind is AirBox and body is not None and kind is not None and is_given(body, "radius"):
        message = f"{format_value(table['body'])} is a circle, which cannot be a wall of a box"
        yield make_fault((*path, "body"), table["body"], message, "give it a size, or give a volume without a box")
    if is_given(table, "wall") and on_kind is not AirBox:
        yield make_fault(
            (*path, "wall"), table["wall"], "a wall is given without a box", 'give on = a body of kind = "air"'
        )


def _check_end(path: KeyPath, table: dict[str, Any], bodies: dict[str, Any]) -> Faults:
    """The end of a string rides on another body."""
    string, at = bodies.get(str(table.get("body"))), table.get("at")
    if string is not None and kind_of(string) is not None and kind_of(string) is not String:
        message = f"{format_value(table['body'])} is a {string.get('kind')}, which has no ends"
        yield make_fault(
            (*path, "body"), table["body"], message, 'only a string has ends; kind = "spring" joins other bodies'
        )
    if is_number(at) and at not in (0, 1):
        yield make_fault((*path, "at"), at, f"{format_value(at)} is not an end", "give 0 or 1")
    if is_given(table, "on") and table["on"] == table.get("body"):
        yield make_fault((*path, "on"), table["on"], "a string cannot carry its own end", "name another body")
        return
    yield from check_positions((*path, "on_at"), table, bodies.get(str(table.get("on"))), single=True)


def _check_spring(path: KeyPath, table: dict[str, Any], bodies: dict[str, Any]) -> Faults:
    """A spring holds two places, or a place and the ground, and is stiff, damped or rigid."""
    rigid, on = table.get("rigid") is True, is_given(table, "on")
    given = [key for key in ("stiffness", "damping_coefficient") if is_given(table, key) and (table[key] or not rigid)]
    if not rigid and not given:
        yield make_fault(
            path, table, "it has no effect", "give a stiffness in N/m, a damping_coefficient in kg/s, or rigid = true"
        )
    if rigid and given:
        message = f"rigid and {given[0]} are both given"
        yield make_fault(
            (*path, given[0]), table[given[0]], message, "a rigid joint has no stiffness; give one of them"
        )
    body = bodies.get(str(table.get("body")))
    yield from check_positions((*path, "at"), table, body, single=True)
    if on:
        yield from check_positions((*path, "on_at"), table, bodies.get(str(table["on"])), single=True)
        if table["on"] == table.get("body") and table.get("at") == table.get("on_at"):
            message = "it joins a position to itself"
            yield make_fault((*path, "on"), table["on"], message, "give another body, or another position on_at")
    elif is_given(table, "on_at"):
        yield make_fault((*path, "on_at"), table["on_at"], "on_at is given without on", "name the other body by on")


def absent_in_connection(connection: dict[str, Any]) -> dict[str, str]:
    """Return the keys that glide of springs alone, and what another connection is instead."""
    kinds = {"end": "the end of a string", "air": "air"}
    what = "a rigid joint" if connection.get("rigid") is True else kinds.get(str(connection.get("kind", "spring")))
    return {} if what is None else dict.fromkeys(GLIDED_KEYS["connection"], f"is {what}")


def find_rigid_joint(name: Any, data: dict[str, Any]) -> bool:
    """True if a rigid joint holds a body."""
    joints = [table for _, table in tables_of(data, "connection") if table.get("rigid") is True]
    return any(name in (table.get("body"), table.get("on")) for table in joints)
