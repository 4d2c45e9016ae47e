"""What a patch may hold, told from the models of its parts: a JSON Schema for editors, a reference for people.

A description is "meaning, unit; more" or "meaning, unit: more" (`told`); ranges and defaults are those of the fields.
"""

import math
import re
from collections.abc import Iterator
from dataclasses import astuple, dataclass
from typing import Any

from engine.references import NOT_BOTH, ONE_OF
from engine.scene import Scene

UNITS = (
    *("m", "kg", "s", "Hz", "N", "dB", "m/s", "m/s²", "m³/s", "1/s", "s/m", "1/√kg"),
    *("kg/m", "kg/m²", "kg/s", "N/m", "N·m", "N·m²", "N/m^exponent"),
)
UNIT = re.compile(rf", ({'|'.join(map(re.escape, sorted(UNITS, key=len, reverse=True)))})(?=[;:,]|$)")
DRAFT = "http://json-schema.org/draft-07/schema#"  # what editors of TOML know
PREFACE = """# Patches: every key

Written by `render.py reference > docs/patches.md` from the models in `engine/`; edit those.

A patch is a TOML file of tables: `[[body]]`, `[[contact]]`, `[[force]]`, `[[event]]` and `[[pickup]]`, each as often as
needed, and one `[accuracy]`. Keys outside any table come first. All is in SI units; unknown keys are refused.
A *place* is a fraction of a body's length from 0 to 1; `[x, y]`, fractions of the sides of a sheet; or the name of a
measured point.

`render.py new NAME` starts a patch, `render.py check PATCH` says all that is wrong with one, and
`render.py params PATCH` lists its numbers. Editors that know TOML schemas (Taplo, Even Better TOML) complete and check
keys where the first line of a patch is `#:schema` and the path of `patches/patch.schema.json`, as in those shipped.
"""


# arrays of tables and [accuracy], with the tables inside them
SECTIONS: dict[str, tuple[str, dict[str, str]]] = {
    "body": ("Bodies: `[[body]]`", {"[[body.support]]": "Support"}),
    "contact": ("Contacts: `[[contact]]`", {"bridge = { … }": "Bridge", "frets = { … }": "Frets"}),
    "force": ("Forces: `[[force]]`", {}),
    "event": ("Events: `[[event]]`", {}),
    "pickup": ("Pickups: `[[pickup]]`", {}),
    "accuracy": ("Accuracy: `[accuracy]`", {}),
}


@dataclass(frozen=True)
class Key:
    """One key of a table."""

    name: str
    unit: str  # "" where it has none
    range: str
    default: str  # "required", "" where absence is the default
    meaning: str


def schema() -> dict[str, Any]:
    """JSON Schema of a patch, draft 7: complete but for what only the whole patch shows, such as names."""
    whole = Scene.model_json_schema(ref_template="#/definitions/{model}")
    tables = whole.pop("$defs")
    for table in tables.values():
        kind = table["properties"].pop("kind", None)
        if kind is not None:  # first, as one writes it
            name = kind["const"]
            table["properties"] = {"kind": {"const": name, "description": "what it is"}, **table["properties"]}
    bodies = {
        kind: tables[ref.rpartition("/")[2]]
        for kind, ref in whole["properties"]["body"]["items"]["discriminator"]["mapping"].items()
    }
    for kind, table in bodies.items():
        one: list[dict[str, Any]] = [
            {"oneOf": [{"required": [a]}, {"required": [b]}]} for a, b, _ in ONE_OF.get(kind, [])
        ]
        one += [{"not": {"required": [a, b]}} for a, b in NOT_BOTH.get(kind, [])]
        if one:
            table["allOf"] = one
    told = {"$schema": DRAFT, "title": "Patch", "description": "A patch of the FDH engine, in SI units."}
    return told | {k: _plain(v) for k, v in {**whole, **told, "definitions": tables}.items()}


def _plain(node: Any) -> Any:
    """A schema without what TOML has not (null) and what nobody reads (titles of keys, empty defaults)."""
    if isinstance(node, list):
        return [_plain(item) for item in node]
    if not isinstance(node, dict):
        return node
    node = {k: _plain_keys(v) if k in ("properties", "definitions") else _plain(v) for k, v in node.items()}
    if isinstance(node.get("title"), str):
        del node["title"]
    node.pop("discriminator", None)
    if "default" in node and not isinstance(node["default"], str | int | float):
        del node["default"]
    if {"type": "null"} in node.get("anyOf", []):
        rest = [option for option in node.pop("anyOf") if option != {"type": "null"}]
        node |= rest[0] if len(rest) == 1 else {"anyOf": rest}
    if "$ref" in node and len(node) > 1:  # draft 7 reads nothing beside a reference
        node["allOf"] = [{"$ref": node.pop("$ref")}]
    return node


def _plain_keys(nodes: dict[str, Any]) -> dict[str, Any]:
    return {name: _plain(node) for name, node in nodes.items()}


def target(node: dict[str, Any], whole: dict[str, Any]) -> dict[str, Any]:
    """The schema of a table that a key refers to, or the key's own."""
    ref = node.get("$ref") or next((part["$ref"] for part in node.get("allOf", []) if "$ref" in part), None)
    return whole["definitions"][ref.rpartition("/")[2]] if ref else node


def kinds(node: dict[str, Any], whole: dict[str, Any]) -> dict[str, dict[str, Any]]:
    """The schemas of the tables of an array, by kind; of the one sort there is, by ""."""
    options = node["items"].get("oneOf", [node["items"]])
    found = [target(option, whole) for option in options]
    return {table["properties"].get("kind", {}).get("const", ""): table for table in found}


def told(description: str) -> tuple[str, str]:
    """Meaning and unit of a description; no unit is ""."""
    found = UNIT.search(description)
    return (description, "") if found is None else (description[: found.start()] + description[found.end() :], found[1])


def limits(node: dict[str, Any]) -> str:
    """The range of a key: of its items, if it is a list; or what it may be."""
    if "enum" in node:
        return ", ".join(map(str, node["enum"]))
    if node.get("type") == "array":
        least, most = node.get("minItems", 0), node.get("maxItems")
        count = "list" if most is None and least < 2 else f"list of {least} to {most}"
        count = f"list of {most}" if least == most else f"list of at most {most}" if most and not least else count
        inner = "" if "$ref" in node["items"] else limits(node["items"])
        return f"{count}, each {inner}" if inner else count
    if options := node.get("anyOf"):  # a place; or a number, or a list of them
        return "a place" if {"type": "string"} in options else limits(options[0]) + ", or a list"
    if "patternProperties" in node:
        return "lists by name"
    if "properties" in node or "allOf" in node:
        return "a table"
    if node.get("type") == "string":
        return "a name" if "pattern" in node else "text"
    whole = "whole, " if node.get("type") == "integer" else ""
    if "minimum" in node and "maximum" in node:
        return f"{whole}{short(node['minimum'])} to {short(node['maximum'])}"
    signs = (("minimum", "≥"), ("exclusiveMinimum", ">"), ("maximum", "≤"))
    return whole + ", ".join(f"{sign} {short(node[bound])}" for bound, sign in signs if bound in node)


def short(number: float) -> str:
    """A number as one writes it: 0.12, 1e-15, 20000, 4.5e9."""
    if math.isinf(number):
        return f"{number:g}"
    mantissa, exponent = f"{number:.9e}".split("e")
    brief = f"{mantissa.rstrip('0').rstrip('.')}e{int(exponent)}"
    plain = f"{number:.10g}"
    return brief if "e" in plain or len(plain) > len(brief) + 2 else plain


def key(name: str, node: dict[str, Any], required: bool) -> Key:
    """One key of a table, told."""
    meaning, unit = told(node.get("description", ""))
    default = "required" if required else f"{node['default']}" if "default" in node else ""
    if isinstance(node.get("default"), float):
        default = short(node["default"])
    return Key(name, unit, limits(node), default, meaning)


def keys(table: dict[str, Any]) -> Iterator[Key]:
    """The keys of a table, but for those of kinds and inner tables."""
    for name, node in table["properties"].items():
        if name != "kind":
            yield key(name, node, name in table.get("required", ()))


def alone(whole: dict[str, Any]) -> dict[str, Any]:
    """The keys of the patch itself, outside any table."""
    return {**whole, "properties": {k: v for k, v in whole["properties"].items() if k not in SECTIONS}}


def reference() -> str:
    """docs/patches.md."""
    whole = schema()
    text = [PREFACE, "## The patch itself", ""]
    text += _table(alone(whole))
    for name, (heading, inner) in SECTIONS.items():
        node = whole["properties"][name]
        text += ["", f"## {heading}", ""]
        sorts = kinds(node, whole) if "items" in node else {"": target(node, whole)}
        for kind, table in sorts.items():
            text += [f'### `kind = "{kind}"`', ""] if kind else []
            text += _told(table)
        for written, part in inner.items():
            text += [f"### `{written}`", "", *_told(whole["definitions"][part])]
    return re.sub(r"\n{3,}", "\n\n", "\n".join(text)).rstrip() + "\n"


def _told(table: dict[str, Any]) -> list[str]:
    """What a table is, which of its keys exclude each other, and all of them."""
    pairs = [[option["required"][0] for option in part["oneOf"]] for part in table.get("allOf", []) if "oneOf" in part]
    choices = " and ".join(f"either `{a}` or `{b}`" for a, b in pairs)
    what = " ".join(table["description"].split()) + (f" Give {choices}." if choices else "")
    return [what, "", *_table(table), ""]


def _table(table: dict[str, Any]) -> list[str]:
    """Rows of Markdown."""
    rows = ["| key | unit | range | default | meaning |", "| --- | --- | --- | --- | --- |"]
    for found in keys(table):
        cells = (f"`{found.name}`", *astuple(found)[1:])
        rows.append("| " + " | ".join(cell.replace("|", "\\|") for cell in cells) + " |")
    return rows
