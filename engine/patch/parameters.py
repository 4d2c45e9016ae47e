"""The numbers of a patch, by the paths that options and live controls use: `body.hammer.velocity`, `event.0.time`."""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Any

from engine.bodies.table import is_number
from engine.instrument.formula import is_formula
from engine.patch.json_schema import patch_schema, resolve_ref, variants
from engine.patch.labels import labels_of
from engine.patch.live_parameters import live_paths, value_at
from engine.patch.live_ranges import live_range
from engine.patch.named_values import VALUES, NamedValues
from engine.patch.number_format import split_unit
from engine.patch.reference_page import SECTIONS, format_range, top_level
from engine.patch.scene_tables import SceneTables


@dataclass(frozen=True)
class Parameter:
    """One number of a patch.

    path:    as `Scene.replace` takes it, and `--vary`
    value:   in its unit
    unit:    "" where it has none
    range:   what it may be, in words; of a live parameter, what it may be while the patch is played
    meaning: from the reference of patches
    live:    whether it can be changed while the patch is played, by `Player.set`
    label:   its name for people, if the patch gives one
    """

    path: str
    value: float
    unit: str
    range: str
    meaning: str
    live: bool
    label: str = ""


def list_parameters(scene: SceneTables) -> list[Parameter]:
    """Every number that a patch gives, in the order of its tables.

    A path names a table by its name, or by its number from 0 where it has none.
    """
    schema, data = patch_schema(), scene.model_dump(exclude_unset=True, exclude={"labels"})
    paths, defaults = live_paths(scene), dict[tuple[str, int], dict[str, float]]()
    for path in paths.values():  # what can be changed is listed where the patch leaves its default, too
        if path.is_glided or path.is_level:
            defaults.setdefault(path[:2], {})[str(path.keys[0])] = value_at(scene, path)
    parameters = list(_table_parameters("", data, top_level(schema), schema))
    for section in SECTIONS:
        node, value = schema["properties"][section], data.get(section)
        if isinstance(value, dict):
            parameters += _table_parameters(f"{section}.", value, resolve_ref(node, schema), schema)
        elif isinstance(value, list):
            tables = variants(node, schema)
            for i, table in enumerate(value):
                name = table.get("name") or i
                taken = {"barrier"} if table.keys() & {"frets", "bridge"} else set()  # they give the heights
                table |= {
                    key: default
                    for key, default in defaults.get((section, i), {}).items()
                    if key not in taken and table.get(key) is None
                }
                parameters += _table_parameters(
                    f"{section}.{name}.", table, tables[table.get("kind") or next(iter(tables))], schema
                )
    named = NamedValues(dict(scene.values)).numbers
    meaning = "named value, which formulas use"
    given = [name for name, value in scene.values.items() if not is_formula(value)]
    parameters += [Parameter(f"{VALUES}.{name}", named[name], "", "any number", meaning, False) for name in given]
    labels = labels_of(scene, paths)

    def as_live(parameter: Parameter) -> Parameter:
        limits = live_range(scene, *paths[parameter.path][:3])._replace(unit="")
        return replace(parameter, live=True, range=str(limits), label=labels.get(parameter.path, ""))

    return [as_live(p) if p.path in paths else p for p in parameters]


def _table_parameters(
    prefix: str, values: dict[str, Any], table: dict[str, Any], schema: dict[str, Any]
) -> Iterator[Parameter]:
    """The numbers of one table, and of the tables inside it. table: its schema; prefix: of its paths."""
    for key, node in table["properties"].items():
        value, path = values.get(key), prefix + key
        if isinstance(value, dict) and "patternProperties" not in node:
            yield from _table_parameters(f"{path}.", value, resolve_ref(node, schema, value.get("kind")), schema)
        elif isinstance(value, list) and value and isinstance(value[0], dict):
            for i, inner in enumerate(value):
                yield from _table_parameters(f"{path}.{i}.", inner, variants(node, schema)[""], schema)
        else:
            meaning, unit = split_unit(node.get("description", ""))
            for suffix, number in _numbers_within(value):
                limits = format_range(_number_schema(node)) or "any number"  # a parameter that it is of may have others
                yield Parameter(path + suffix, number, unit, limits, meaning, live=False)


def _numbers_within(value: Any) -> Iterator[tuple[str, float]]:
    """The numbers within a value, each with what follows the path of the value in its own path."""
    if is_number(value):
        yield "", value
    elif isinstance(value, list | dict):
        for key, inner in enumerate(value) if isinstance(value, list) else value.items():
            yield from ((f".{key}{suffix}", number) for suffix, number in _numbers_within(inner))


def _number_schema(node: dict[str, Any]) -> dict[str, Any]:
    """The schema of one number of a list, or of lists by name."""
    if "items" in node:
        return _number_schema(node["items"])
    if "patternProperties" in node:
        return _number_schema(next(iter(node["patternProperties"].values())))
    return _number_schema(node["anyOf"][0]) if "anyOf" in node else node
