"""JSON Schema of a patch, for editors, generated from the models of its tables."""

from typing import Any

from engine.bodies import BODIES
from engine.patch.rig import RigTables
from engine.patch.scene_tables import SceneTables

FORMULA = "Formula"  # the definition of a text such as "= 2*radius"
OF_MATERIAL = {"required": ["material"]}
OF_DENSITY = {"required": ["density", "thickness"]}
GIVEN_BY_MATERIAL = "young", "density", "area_density"  # keys of bodies
SCHEMA_DRAFT = "http://json-schema.org/draft-07/schema#"  # the one that editors of TOML know


def patch_schema() -> dict[str, Any]:
    """JSON Schema of a patch, draft 7: complete but for what only the whole patch shows, such as names."""
    schema = SceneTables.model_json_schema(ref_template="#/definitions/{model}")
    tables = schema.pop("$defs")
    for table in tables.values():
        kind = table["properties"].pop("kind", None)
        if kind is not None:  # first, as one writes it
            name = kind["const"]
            table["properties"] = {"kind": {"const": name, "description": "what it is"}, **table["properties"]}
    bodies = {
        kind: tables[ref.rpartition("/")[2]]
        for kind, ref in schema["properties"]["body"]["items"]["discriminator"]["mapping"].items()
    }
    for kind, table in bodies.items():
        rules: list[dict[str, Any]] = [
            {"oneOf": [{"required": [key]} for key in keys]} for *keys, _ in BODIES[kind].EXACTLY_ONE_OF
        ]
        rules += [{"not": {"required": [a, b]}} for a, b in BODIES[kind].AT_MOST_ONE_OF]
        if "material" in table["properties"]:
            rules = [
                *_with_material(table),
                *({"anyOf": [rule, OF_MATERIAL]} if "oneOf" in rule else rule for rule in rules),
            ]
        if rules:
            table["allOf"] = rules
    needed = schema.pop("required")  # by a plain patch; an instrument may have them of each key
    schema["anyOf"] = [{"required": needed}, {"required": ["keyboard", "key"]}]
    head = {"$schema": SCHEMA_DRAFT, "title": "Patch", "description": "A patch of the FDH engine, in SI units."}
    return head | {key: _simplify(node) for key, node in {**schema, **head, "definitions": tables}.items()}


def _with_material(table: dict[str, Any]) -> list[dict[str, Any]]:
    """The rules for those required keys of a body that a material, or a density, may give instead; they are no longer
    required."""
    needed = [key for key in table["required"] if key in GIVEN_BY_MATERIAL]
    table["required"] = [key for key in table["required"] if key not in needed]
    others = [OF_MATERIAL] + [OF_DENSITY] * (needed == ["area_density"])
    return [{"anyOf": [{"required": needed}, *others]}] if needed else []


def rig_schema() -> dict[str, Any]:
    """JSON Schema of a rig, draft 7."""
    schema = RigTables.model_json_schema(ref_template="#/definitions/{model}")
    schema["definitions"] = schema.pop("$defs")
    simple: dict[str, Any] = _simplify(schema)
    return simple


def editor_schema() -> dict[str, Any]:
    """The same for editors: every number may be a formula of named values, too."""
    schema: dict[str, Any] = _allow_formulas(patch_schema())
    return schema


def _allow_formulas(node: Any) -> Any:
    """A schema in which a number may be a formula."""
    if isinstance(node, list):
        return [_allow_formulas(item) for item in node]
    if not isinstance(node, dict):
        return node
    if node.get("type") in ("number", "integer"):
        said = {key: node[key] for key in ("description", "default") if key in node}
        return said | {
            "anyOf": [{key: node[key] for key in node if key not in said}, {"$ref": f"#/definitions/{FORMULA}"}]
        }
    inner = {key: _allow_formulas(value) for key, value in node.items()}
    if "definitions" in inner:
        inner["definitions"][FORMULA] = {"type": "string", "pattern": "^\\s*="}
    return inner


def _simplify(node: Any) -> Any:
    """A schema without null, which TOML has not, without titles of keys, which nobody reads, and without defaults
    that are no plain value."""
    if isinstance(node, list):
        return [_simplify(item) for item in node]
    if not isinstance(node, dict):
        return node
    node = {k: _simplify_values(v) if k in ("properties", "definitions") else _simplify(v) for k, v in node.items()}
    if isinstance(node.get("title"), str):
        del node["title"]
    node.pop("discriminator", None)
    if "default" in node and not isinstance(node["default"], str | int | float):
        del node["default"]
    if {"type": "null"} in node.get("anyOf", []):
        options = [option for option in node.pop("anyOf") if option != {"type": "null"}]
        node |= options[0] if len(options) == 1 else {"anyOf": options}
    if "$ref" in node and len(node) > 1:  # draft 7 reads nothing beside a reference
        node["allOf"] = [{"$ref": node.pop("$ref")}]
    return node


def _simplify_values(nodes: dict[str, Any]) -> dict[str, Any]:
    """The schemas of a dictionary, each simplified; its keys are names, and may be "title" or "default"."""
    return {name: _simplify(node) for name, node in nodes.items()}


def resolve_ref(node: dict[str, Any], schema: dict[str, Any], kind: Any = None) -> dict[str, Any]:
    """The schema of the table that a node refers to, or the node itself; of several tables, the one of a kind."""
    if "oneOf" in node:
        tables = [resolve_ref(option, schema) for option in node["oneOf"]]
        return next((t for t in tables if t["properties"]["kind"]["const"] == kind), tables[0])
    ref = node.get("$ref") or next((part["$ref"] for part in node.get("allOf", []) if "$ref" in part), None)
    return schema["definitions"][ref.rpartition("/")[2]] if ref else node


def variants(node: dict[str, Any], schema: dict[str, Any]) -> dict[str, dict[str, Any]]:
    """The schemas of the tables of an array, by their `kind`; of the one sort there is, by ""."""
    options = node["items"].get("oneOf", [node["items"]])
    tables = [resolve_ref(option, schema) for option in options]
    return {table["properties"].get("kind", {}).get("const", ""): table for table in tables}
