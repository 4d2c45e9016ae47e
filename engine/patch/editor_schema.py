"""The JSON Schema of patches for editors: that of the models, with the old names of keys beside the new, and a key that
has no effect any more."""

from typing import Any

from engine.patch.json_schema import patch_schema
from engine.patch.precision_key import NOTE, PATH
from engine.patch.renamed_keys import old_keys


def editor_schema() -> dict[str, Any]:
    """JSON Schema of a patch, draft 7, in which old keys are allowed, and marked as deprecated."""
    schema = patch_schema()
    schema["definitions"]["Accuracy"]["properties"][PATH[1]] = {"deprecated": True, "description": NOTE}
    for model, renamed in old_keys().items():
        for old, new in renamed.items():
            _add_old_key(schema["definitions"][model], old, new)
    return schema


def _add_old_key(table: dict[str, Any], old: str, new: str) -> None:
    """Let a table have an old key in place of the new one, as far as rules of the table go, too."""
    table["properties"][old] = table["properties"][new] | {"deprecated": True, "description": f"old name of {new}"}
    rules: list[dict[str, Any]] = table.setdefault("allOf", [])
    choices = [rule["oneOf"] for rule in rules if {"required": [new]} in rule.get("oneOf", [])]
    for options in choices:
        options.append({"required": [old]})
    pairs = [rule["not"]["required"] for rule in rules if new in rule.get("not", {}).get("required", [])]
    rules += [{"not": {"required": [old if key == new else key for key in pair]}} for pair in pairs]
    if new in table["required"]:
        table["required"].remove(new)
        rules.append({"oneOf": [{"required": [new]}, {"required": [old]}]})
    elif not choices:
        rules.append({"not": {"required": [new, old]}})
