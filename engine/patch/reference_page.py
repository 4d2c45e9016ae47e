"""The page docs/patches.md, which lists every key of a patch, generated from its JSON Schema.

A description is "meaning, unit; more" or "meaning, unit: more" (`split_unit`); ranges and defaults are those of the
fields.
"""

import re
from collections.abc import Iterator
from dataclasses import astuple, dataclass
from typing import Any

from engine.bodies.decay import DECAY_LAWS
from engine.bodies.initial_shape import INITIAL_SHAPES
from engine.bodies.materials import MATERIALS
from engine.patch.json_schema import patch_schema, resolve_ref, rig_schema, variants
from engine.patch.number_format import format_number, split_unit

REFERENCE_PREFACE = """# Patches: every key

Written by `fdh reference > docs/patches.md` from the models in `engine/`; edit those.

A patch is a TOML file of tables: `[[body]]`, `[[contact]]`, `[[force]]`, `[[event]]` and `[[pickup]]`, each as often as
needed, and one `[accuracy]`; an instrument has a `[keyboard]` ([instruments](instruments.md)). Keys outside any table
come first. All values are in SI units. Unknown keys are errors.
A *position* is a fraction of a body's length from 0 to 1; `[x, y]`, fractions of the sides of a membrane or plate; or
the name of a measured point.

`fdh new NAME` starts a patch, `fdh check PATCH` lists all its errors, and
`fdh params PATCH` lists its numbers. Editors that know TOML schemas (Taplo, Even Better TOML) complete and check
keys if the first line of a patch is `#:schema` and the path of `patches/patch.schema.json`, as in those shipped.
"""

MATERIALS_PREFACE = """A material gives a body what its table does not: Young's modulus E, Poisson's ratio ν, density
and loss factor η; wood has E along its grain (the x of a plate) and across it. What is held or radiates loses more than
its material does: give a `decay` if it rings too long. Sources: a, Fletcher & Rossing, The Physics of Musical
Instruments (1998), ch. 22; b, Cremer, Heckl & Petersson, Structure-Borne Sound (2005), ch. 4; c, Ashby, Materials
Selection in Mechanical Design (2011), appendix A, the middle of the range; d, USDA Wood Handbook (2010), ch. 5."""

RIG_PREFACE = """A rig is a file of its own, of instruments that are played together
([instruments](instruments.md#rigs)). It may have an `[accuracy]` and `[midi]`, as a patch."""

# arrays of tables and [accuracy]: their headings; and the tables inside them with the names of their models, where one
# key has several
SECTIONS: dict[str, tuple[str, dict[str, str]]] = {
    "body": (
        "Bodies: `[[body]]`",
        {"[[body.support]]": "Support", "cords = { … }": "Cords"}
        | {"ribs = { … }": "Ribs", "[[body.bridges]]": "GluedBridge", "hole = { … }": "Hole"}
        | {f'decay = {{ kind = "{kind}", … }}': law.__name__ for kind, law in DECAY_LAWS.items()}
        | {
            f'displacement, velocity = {{ kind = "{kind}", … }}': shape.__name__
            for kind, shape in INITIAL_SHAPES.items()
        },
    ),
    "contact": ("Contacts: `[[contact]]`", {}),
    "connection": ("Connections: `[[connection]]`", {}),
    "friction": ("Friction: `[[friction]]`", {}),
    "bow": ("Bows: `[[bow]]`", {"strokes = [{ … }]": "Stroke"}),
    "force": ("Forces: `[[force]]`", {}),
    "event": ("Events: `[[event]]`", {}),
    "pickup": ("Pickups: `[[pickup]]`", {}),
    "tremolo": ("Tremolo: `[tremolo]`", {}),
    "control": ("Controls: `[[control]]`", {}),
    "midi": ("MIDI: `[midi]`", {}),
    "keyboard": ("The keys of an instrument: `[keyboard]`", {}),
    "key": ("Tables of each key: `[[key.body]]` and others", {}),
    "note": ("Notes of an instrument: `[[note]]`", {}),
    "pedal": ("Pedals of an instrument: `[[pedal]]`", {}),
    "accuracy": ("Accuracy: `[accuracy]`", {}),
}

PICTURES = {  # below the tables of some sections
    "contact": "![Displacements are positive upwards; at, side, barrier and gap of a contact](contact_signs.png)"
}


INTRODUCTIONS = {  # above the tables of some sections
    "event": """An event takes effect at the frame nearest to its time, and lasts a whole number of frames. One rule
decides where events overlap, in a score, in live sound, in pages and in C, however early or late they become known:

- A glide ends where a newer one of the same target begins, and that one starts from the value reached.
- Of two dampers on a body the newer counts; one that lasts longer goes on after it.
- Strikes and plucks leave each other alone: each has its own strength, rise and release.
- What begins later is newer; of events that begin at one frame, what comes later in the patch, or was told later.""",
}


@dataclass(frozen=True)
class KeyRow:
    """One key of a table, as a row of the page."""

    name: str
    unit: str  # "" where it has none
    range: str
    default: str  # "required", or "" where absence is the default
    meaning: str


def reference_page() -> str:
    """The text of docs/patches.md, in Markdown."""
    schema = patch_schema()
    lines = [REFERENCE_PREFACE, "## The patch itself", ""]
    lines += _markdown_rows(top_level(schema))
    for name, (heading, inner) in SECTIONS.items():
        node = schema["properties"][name]
        lines += ["", f"## {heading}", ""]
        lines += [INTRODUCTIONS[name], ""] if name in INTRODUCTIONS else []
        tables = variants(node, schema) if "items" in node else {"": resolve_ref(node, schema)}
        for kind, table in tables.items():
            lines += [f'### `kind = "{kind}"`', ""] if kind else []
            lines += _table_section(table)
        lines += [PICTURES[name], ""] if name in PICTURES else []
        inner = inner or {title: model for table in tables.values() for title, model in _inner_tables(table)}
        for title, model in inner.items():
            lines += [f"### `{title}`", "", *_table_section(schema["definitions"][model])]
        lines += _materials() if name == "body" else []
    rig = rig_schema()
    own = {**rig, "properties": {key: rig["properties"][key] for key in ("title", "seconds")}}
    lines += ["", "## Rigs", "", RIG_PREFACE, "", *_markdown_rows(own), "", "### Parts: `[[part]]`", ""]
    lines += _table_section(rig["definitions"]["RigPart"])
    return re.sub(r"\n{3,}", "\n\n", "\n".join(lines)).rstrip() + "\n"


def _materials() -> list[str]:
    """Lines that list the materials."""
    lines = ['### `material = "…"`', "", MATERIALS_PREFACE, ""]
    lines += ["| material | E, GPa | ν | density, kg/m³ | η | source |", "| --- | --- | --- | --- | --- | --- |"]
    for name, material in MATERIALS.items():
        young = " and ".join(f"{modulus / 1e9:.3g}" for modulus in (material.young, material.across) if modulus)
        numbers = f"{material.poisson:g}", f"{material.density:.4g}", f"{material.loss_factor:g}"
        cells = (young, *numbers, material.source)
        lines.append("| " + " | ".join((f"`{name}`", *cells)) + " |")
    return [*lines, ""]


def _inner_tables(table: dict[str, Any]) -> Iterator[tuple[str, str]]:
    """Yield the keys of a table that are tables, as a patch writes them, with the names of their models."""
    for key, node in table["properties"].items():
        options = [node, *node.get("anyOf", []), *node.get("allOf", [])]
        for model in [option["$ref"].rpartition("/")[2] for option in options if "$ref" in option]:
            yield f"{key} = {{ … }}", model


def top_level(schema: dict[str, Any]) -> dict[str, Any]:
    """The schema with only those keys of a patch that stand outside any table."""
    return {**schema, "properties": {k: v for k, v in schema["properties"].items() if k not in SECTIONS}}


def _table_section(table: dict[str, Any]) -> list[str]:
    """Lines that say what a table is and which of its keys exclude each other, and list all of them."""
    rules = [rule["anyOf"][0] if "anyOf" in rule else rule for rule in table.get("allOf", [])]  # or of a material
    sets = [[option["required"][0] for option in rule["oneOf"]] for rule in rules if "oneOf" in rule]
    choices = " and ".join("either " + " or ".join(f"`{key}`" for key in keys) for keys in sets)
    text = " ".join(table["description"].split()) + (f" Give {choices}." if choices else "")
    return [text, "", *_markdown_rows(table), ""]


def _markdown_rows(table: dict[str, Any]) -> list[str]:
    """The keys of a table as a table of Markdown."""
    rows = ["| key | unit | range | default | meaning |", "| --- | --- | --- | --- | --- |"]
    for row in key_rows(table):
        cells = (f"`{row.name}`", *astuple(row)[1:])
        rows.append("| " + " | ".join(cell.replace("|", "\\|") for cell in cells) + " |")
    return rows


def key_rows(table: dict[str, Any]) -> Iterator[KeyRow]:
    """The keys of a table, but for its kind."""
    for name, node in table["properties"].items():
        if name != "kind":
            yield key_row(name, node, name in table.get("required", ()))


def key_row(name: str, node: dict[str, Any], required: bool) -> KeyRow:
    """The row of one key, from its schema."""
    meaning, unit = split_unit(node.get("description", ""))
    default = "required" if required else f"{node['default']}" if "default" in node else ""
    if isinstance(node.get("default"), float):
        default = format_number(node["default"])
    return KeyRow(name, unit, format_range(node), default, meaning)


def format_range(node: dict[str, Any]) -> str:
    """The range of a key in words: of its items, if it is a list; or the words that it may be."""
    if "enum" in node:
        return ", ".join(map(str, node["enum"]))
    if node.get("type") == "array":
        items = "" if "$ref" in node["items"] else format_range(node["items"])
        length = _format_length(node.get("minItems", 0), node.get("maxItems"))
        return f"{length}, each {items}" if items else length
    if options := node.get("anyOf"):  # a position; or a number, or a list of them
        return "a position" if {"type": "string"} in options else format_range(options[0]) + ", or a list"
    if "patternProperties" in node:
        return "lists by name"
    if "properties" in node or "allOf" in node or "oneOf" in node:
        return "a table"
    if node.get("type") == "string":
        return "a name" if "pattern" in node else "text"
    integer = "whole, " if node.get("type") == "integer" else ""
    if "minimum" in node and "maximum" in node:
        return f"{integer}{format_number(node['minimum'])} to {format_number(node['maximum'])}"
    signs = (("minimum", "≥"), ("exclusiveMinimum", ">"), ("maximum", "≤"))
    return integer + ", ".join(f"{sign} {format_number(node[bound])}" for bound, sign in signs if bound in node)


def _format_length(least: int, most: int | None) -> str:
    """Describe the number of items of a list in words."""
    if most is not None and least == most:
        return f"list of {most}"
    if most and not least:
        return f"list of at most {most}"
    return "list" if most is None and least < 2 else f"list of {least} to {most}"
