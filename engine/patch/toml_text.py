"""Patches as text: a scene becomes a patch file that is read as the same scene."""

import json
import os
from pathlib import Path
from typing import Any

import tomlkit
from tomlkit.items import AoT, Item, Table

from engine.patch.parameters import list_parameters
from engine.patch.scene_tables import SceneTables

FIRST = ("name", "kind")  # keys, as one writes them
FILE = "file"  # the key of a file that lies beside the patch
Units = dict[str, str]


def write_toml(scene: SceneTables, folder: Path | None = None) -> str:
    """Return the text of a patch, with units as comments. Files that it names are relative to a folder, or absolute if
    there is none. Raises ValueError, which names what of the scene cannot be written."""
    data = _document(scene, folder)
    units = {} if scene.instrument else {p.path: p.unit for p in list_parameters(scene) if p.unit}
    document = tomlkit.document()
    tables = {name: value for name, value in data.items() if _is_section(value)}
    for name, value in data.items():
        if name not in tables:
            document.add(name, _with_unit(tomlkit.item(value), units.get(name, "")))
    for name, value in tables.items():
        document.add(name, _section(value, name, units))
    return tomlkit.dumps(document)


def write_json(scene: SceneTables, folder: Path | None = None) -> str:
    """Return a patch as JSON; otherwise as `write_toml`."""
    return json.dumps(_document(scene, folder), indent=1, ensure_ascii=False) + "\n"


def _document(scene: SceneTables, folder: Path | None) -> dict[str, Any]:
    """The document of a scene, with the paths of its files from a folder."""
    if gains := [channel + 1 for channel in range(scene.channels) if scene.output_gain(channel) != 1.0]:
        names = ", ".join(map(str, gains))
        raise ValueError(f"the gain of channels {names} was set by a session, and is no part of a patch")
    moved: dict[str, Any] = _with_files(_plain(scene.document), scene.folder, folder)
    return {key: value for key, value in moved.items() if value != []}


def _plain(value: Any) -> Any:
    """A value of a document as TOML has it: without None, with lists in place of tuples."""
    if isinstance(value, dict):
        return {str(key): _plain(inner) for key, inner in value.items() if inner is not None}
    if isinstance(value, list | tuple):
        return [_plain(inner) for inner in value]
    return value


def _with_files(value: Any, source: Path, folder: Path | None) -> Any:
    """A document with the paths of its files from another folder."""
    if isinstance(value, list):
        return [_with_files(inner, source, folder) for inner in value]
    if not isinstance(value, dict):
        return value
    moved = {key: _with_files(inner, source, folder) for key, inner in value.items()}
    if isinstance(file := moved.get(FILE), str):
        path = os.path.abspath(source / file)
        moved[FILE] = Path(path if folder is None else os.path.relpath(path, folder)).as_posix()
    return moved


def _is_section(value: Any) -> bool:
    return isinstance(value, dict) or (isinstance(value, list) and bool(value) and isinstance(value[0], dict))


def _section(value: Any, name: str, units: Units) -> Item:
    """A table of a patch, or an array of them, such as [accuracy], [[body]] and [key] with its [[key.body]]."""
    if isinstance(value, list):
        tables = AoT([])
        for n, table in enumerate(value):
            tables.append(_table(table, f"{name}.{table.get('name') or n}", units))
        return tables
    if value and all(isinstance(inner, list) and _is_section(inner) for inner in value.values()):
        outer = tomlkit.table(is_super_table=True)
        for key, inner in value.items():
            outer.add(key, _section(inner, f"{name}.{key}", units))
        return outer
    return _table(value, name, units)


def _table(values: dict[str, Any], name: str, units: Units) -> Table:
    """A table with everything in it on one line each."""
    table = tomlkit.table()
    for key in sorted(values, key=lambda key: key not in FIRST):
        value = values[key]
        table.add(key, _with_unit(_value(value), units.get(f"{name}.{key}", "")))
    return table


def _value(value: Any) -> Any:
    if isinstance(value, dict):
        inline = tomlkit.inline_table()
        for key, inner in value.items():
            inline.add(key, _value(inner))
        return inline
    if isinstance(value, list):
        array = tomlkit.array()
        array.extend(_value(inner) for inner in value)
        return array
    return tomlkit.item(value)


def _with_unit(item: Item, unit: str) -> Item:
    if unit:
        item.comment(unit)
    return item
