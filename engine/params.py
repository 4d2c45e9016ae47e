"""A patch's own numbers, by the paths that options and knobs name them with: `body.hammer.velocity`, `event.0.time`."""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Any

from engine.describe import SECTIONS, alone, kinds, limits, schema, target, told
from engine.scene import Scene


@dataclass(frozen=True)
class Parameter:
    """One number of a patch."""

    path: str
    value: float
    unit: str  # "" where it has none
    range: str
    meaning: str
    live: bool  # whether it can be turned while it sounds


def params(scene: Scene) -> list[Parameter]:
    """Every number that a patch gives, in the order of its tables. A part's path has its name, or its place from 0."""
    whole, data = schema(), scene.model_dump(exclude_unset=True)
    turned = set(knobs(scene))
    found = list(_numbers("", data, alone(whole), whole))
    for section in SECTIONS:
        node, given = whole["properties"][section], data.get(section)
        if isinstance(given, dict):
            found += _numbers(f"{section}.", given, target(node, whole), whole)
        elif isinstance(given, list):
            sorts = kinds(node, whole)
            for i, part in enumerate(given):
                name = part.get("name") or i
                if f"{section}.{name}.gap" in turned:  # there without being given
                    part = {"gap": 0.0} | part
                found += _numbers(f"{section}.{name}.", part, sorts[part.get("kind", "")], whole)
    return [replace(p, live=p.path in turned) for p in found]


def knobs(scene: Scene, general: bool = False) -> list[str]:
    """What can be turned while a scene sounds: stiffness, and barrier or gap, of each contact that has a name; and its
    exponent, where laws are general."""
    found = []
    for contact in scene.contact:
        if contact.name is not None and contact.stiffness > 0.0:
            found.append(f"contact.{contact.name}.stiffness")
            found.append(f"contact.{contact.name}.{'gap' if contact.on else 'barrier'}")
            found += [f"contact.{contact.name}.exponent"] if general else []
    return found


def _numbers(prefix: str, part: dict[str, Any], table: dict[str, Any], whole: dict[str, Any]) -> Iterator[Parameter]:
    """The numbers of one table, and of the tables inside it."""
    for key, node in table["properties"].items():
        value, path = part.get(key), prefix + key
        if isinstance(value, dict) and "patternProperties" not in node:
            yield from _numbers(f"{path}.", value, target(node, whole), whole)
        elif isinstance(value, list) and value and isinstance(value[0], dict):
            for i, inner in enumerate(value):
                yield from _numbers(f"{path}.{i}.", inner, kinds(node, whole)[""], whole)
        else:
            meaning, unit = told(node.get("description", ""))
            for end, number in _leaves(value):
                yield Parameter(path + end, number, unit, limits(_item(node)), meaning, live=False)


def _leaves(value: Any) -> Iterator[tuple[str, float]]:
    """The numbers within a value, and what follows the path to it."""
    if isinstance(value, int | float):
        yield "", value
    elif isinstance(value, list | dict):
        for key, inner in enumerate(value) if isinstance(value, list) else value.items():
            yield from ((f".{key}{end}", number) for end, number in _leaves(inner))


def _item(node: dict[str, Any]) -> dict[str, Any]:
    """The schema of one number of a list, or of lists by name."""
    if "items" in node:
        return _item(node["items"])
    if "patternProperties" in node:
        return _item(next(iter(node["patternProperties"].values())))
    return _item(node["anyOf"][0]) if "anyOf" in node else node
