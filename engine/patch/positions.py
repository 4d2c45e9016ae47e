"""Places on bodies that tables of a patch name: whether there are such. Tables are as they were read."""

from collections.abc import Iterator
from typing import Any

from pydantic_core import InitErrorDetails

from engine.bodies import BODIES, MeasuredBody
from engine.bodies.body import BodyTable
from engine.bodies.table import KeyPath, is_given, make_fault
from engine.wording import format_value

Faults = Iterator[InitErrorDetails]


def tables_of(data: dict[str, Any], section: str) -> Iterator[tuple[int, dict[str, Any]]]:
    """The tables of an array, with their numbers from 0; what is no table is passed over."""
    items = data.get(section)
    if isinstance(items, list):
        yield from ((i, item) for i, item in enumerate(items) if isinstance(item, dict))


def kind_of(body: dict[str, Any] | None) -> type[BodyTable] | None:
    """The kind of body that a table describes; None if it is not known."""
    return None if body is None else BODIES.get(str(body.get("kind")))


def count_positions(table: dict[str, Any], key: str, body: dict[str, Any] | None) -> int:
    """Count the positions on a body that a key lists."""
    at, kind = table.get(key), kind_of(body) or BodyTable
    return len(kind.split_positions(at)) if isinstance(at, list) else 1


def check_positions(path: KeyPath, table: dict[str, Any], body: dict[str, Any] | None, single: bool) -> Faults:
    """The positions that a key of a table lists are such as the body has. single: there is one of them only."""
    kind, key = kind_of(body), str(path[-1])
    if body is None or kind is None or (kind is MeasuredBody and is_given(body, "file")):  # which could not be read
        return
    at = table.get(key)
    if kind.IS_LUMPED:
        if at is not None:
            message = f"{format_value(body['name'])} is a {body['kind']}, which has no positions"
            yield make_fault(path, at, message, "leave it out")
        return
    remedy = kind.position_help(body)
    if at is None:
        yield make_fault(path[:-1], table, f"no position on {format_value(body['name'])}", f"give {key} = {remedy}")
        return
    positions = kind.split_positions(at)
    if single and len(positions) > 1:
        yield make_fault(path, at, "several positions", f"give one: {remedy}")
    for position in positions:
        if not kind.has_position(body, position):
            message = f"{format_value(position)} is not a position on {format_value(body['name'])}"
            yield make_fault(path, at, message, remedy)
            return
        if outside := kind.explain_outside(body, position):
            yield make_fault(path, at, *outside)
            return
