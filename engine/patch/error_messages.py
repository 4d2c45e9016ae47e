"""Errors of pydantic in the words of a patch: which key is wrong, in what way, and what would be right."""

import difflib
import types
import typing
from collections.abc import Iterable
from typing import Any, NamedTuple

from pydantic import BaseModel, ValidationError
from pydantic.fields import FieldInfo

from engine.bodies.table import KeyPath
from engine.patch.keyword_hints import PAGES, explain_key, explain_kind
from engine.patch.scene_tables import SceneTables
from engine.wording import describe_range, format_value, join_with_or, to_one_line

MAX_KEY_CHARACTERS = 80  # of a key in a message
MAX_NEAREST = 3  # kinds that are named for an unknown one

TYPE_NAMES = {"float_type": "a number", "int_type": "a whole number", "string_type": 'text in "quotes"'}


class Location(NamedTuple):
    """The position of an error in a patch."""

    path: KeyPath
    models: dict[str, type[BaseModel]]  # those whose key it is, by kind; of the one there is, by ""
    field: FieldInfo | None


def locate_error(error: Any, of: type[BaseModel] = SceneTables) -> Location:
    """Find the path in the patch of an error, the models whose key it is, and its field. of: the model of the whole

    Pydantic puts a table's kind into the path, after its number; our own errors do not.
    """
    path: KeyPath = ()
    models: dict[str, type[BaseModel]] = {"": of}
    field: FieldInfo | None = None
    inner = models
    for part in error["loc"]:
        follows_table = bool(path) and (isinstance(path[-1], int) or not _is_list(field))
        if error["type"] != "scene" and len(inner) > 1 and part in inner and follows_table:
            inner = {part: inner[part]}
            continue
        if isinstance(part, str):
            models = inner
            field = next((m.model_fields[part] for m in models.values() if part in m.model_fields), None)
            inner = _models_by_kind(field.annotation) if field else {}
        path += (part,)
    is_key = isinstance(path[-1:] and path[-1], str) and not error["type"].startswith("union_tag")
    return Location(path, models if is_key else inner, field)


def _is_list(field: FieldInfo | None) -> bool:
    """True if a field holds a list."""
    return field is not None and typing.get_origin(field.annotation) is list


def _models_by_kind(annotation: Any) -> dict[str, type[BaseModel]]:
    """The models that an annotation admits, by their `kind`."""
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        kind = annotation.model_fields.get("kind")
        return {typing.get_args(kind.annotation)[0] if kind else "": annotation}
    if typing.get_origin(annotation) in (list, typing.Union, types.UnionType, typing.Annotated):
        return {k: m for a in typing.get_args(annotation) for k, m in _models_by_kind(a).items()}
    return {}


def path_to_blame(error: Any) -> KeyPath:
    """The path of the key that is wrong: for an unknown kind, that of `kind` and not of its table."""
    path = locate_error(error).path
    return (*path, "kind") if error["type"] == "union_tag_invalid" else path


def format_path(path: KeyPath) -> str:
    """A path as messages have it: body[0].mass."""
    parts = (f"[{p}]" if isinstance(p, int) else f".{to_one_line(p, MAX_KEY_CHARACTERS)}" for p in path)
    return "".join(parts).lstrip(".")


def suggest_key(error: Any) -> str:
    """The known key that an unknown one most resembles, or ""."""
    path, models, _ = locate_error(error)
    known = [key for model in models.values() for key in model.model_fields]
    return similar_word(str(path[-1]), known)


def similar_word(word: str, known: Iterable[str]) -> str:
    """The known word that an unknown one most resembles, or begins with (`young_modulus`), or that begins with it
    (`bending`); or ""."""
    word, words = word[:MAX_KEY_CHARACTERS], list(known)
    if close := difflib.get_close_matches(word, words, 1, 0.6):
        return close[0]
    if begins := [begin for begin in words if word.startswith(f"{begin}_")]:
        return max(begins, key=len)
    return min((longer for longer in words if longer.startswith(f"{word}_")), key=len, default="")


def suggestion(word: str, known: list[str], prefix: str = "", suffix: str = "") -> str:
    """A question whether the known word most like an unknown one was meant, or the list of all known words.

    prefix, suffix: what stands around the word
    """
    similar = similar_word(word, known)
    return f'did you mean "{prefix}{similar}{suffix}"?' if similar else "the known ones are " + ", ".join(known)


def describe_value_error(model: type[BaseModel], key: str, value: Any) -> str:
    """Describe the error in one value of a table whose other keys are optional; "" if it is valid."""
    try:
        model.model_validate({key: value})
    except ValidationError as error:
        return describe_error(error.errors()[0], Location((key,), {"": model}, model.model_fields[key]))
    return ""


def describe_error(error: Any, location: Location) -> str:
    """Describe an error and its remedy."""
    if error["type"] == "scene":  # of our own checks
        return str(error["msg"])
    return (
        _describe_key_error(error, location)
        or _describe_table_error(error, location)
        or _describe_length_error(error, location)
        or _describe_scalar_error(error, location)
        or f"{error['msg']}; {_describe_field(location.field)}"
    )


def _describe_key_error(error: Any, location: Location) -> str:
    """Describe the error of a key or a kind that is missing or unknown; "" if it is something else."""
    kind, (path, models, field) = error["type"], location
    if kind == "extra_forbidden":
        known = list(dict.fromkeys(key for model in models.values() for key in model.model_fields))
        section = str(path[0]) if len(path) > 1 else ""
        return (
            f"unknown key; {explain_key(section, _last_key(path), list(models)) or suggestion(_last_key(path), known)}"
        )
    if kind == "missing":
        return f"this key is missing; give it: {_describe_field(field)}"
    if kind == "union_tag_not_found":
        return f"kind is missing; give one of {', '.join(models)}"
    if kind == "union_tag_invalid":
        tag, section = tag_of(error), section_of_kind(path)
        return f"unknown kind {format_value(tag)}; {explain_kind(section, tag) or _nearest_kinds(tag, models, section)}"
    return ""


def tag_of(error: Any) -> str:
    """The unknown kind that an error is of."""
    return str(error.get("ctx", {}).get("tag"))


def section_of_kind(path: KeyPath) -> str:
    """The section, or the key of a table within one, whose kinds are meant at the path of a table."""
    return next(str(part) for part in reversed(path) if isinstance(part, str))


def _nearest_kinds(tag: str, kinds: Iterable[str], section: str) -> str:
    """The known kinds most like an unknown one, or all of them, and the page that describes them."""
    near = difflib.get_close_matches(tag[:MAX_KEY_CHARACTERS], list(kinds), MAX_NEAREST, 0.6)
    page = f" ({PAGES[section]})" if section in PAGES else ""
    if near:
        return f"did you mean {join_with_or(map(format_value, near))}?{page}"
    return f"the known ones are {', '.join(kinds)}{page}"


def _describe_table_error(error: Any, location: Location) -> str:
    """Describe a value that takes the place of a table or a list; "" if the error is something else."""
    kind, value, (path, _, field) = error["type"], format_value(error["input"]), location
    is_table = kind in ("model_type", "model_attributes_type", "dict_type")
    if (is_table or kind == "list_type") and len(path) < 3:
        is_array = field is None or typing.get_origin(field.annotation) is list
        header = f"[[{_header(path)}]]" if is_array and path else f"[{_last_key(path)}]"
        return f"{value} is not a table; write {header}" if path else "this is not a table of keys"
    if is_table:
        inner = list(_models_by_kind(field.annotation).values()) if field else []
        fields = inner[0].model_fields if inner else {}
        needed = [k for k, f in fields.items() if f.is_required()] or list(fields)[:2] or ["name"]
        return f"{value} is not a table; write {_last_key(path)} = {{ {', '.join(f'{k} = …' for k in needed)} }}"
    if kind == "list_type":
        return f"{value} is not a list; write {_last_key(path)} = [ … ]: {_describe_field(field)}"
    return ""


def _header(path: KeyPath) -> str:
    """The name of a section, such as body or key.on."""
    return ".".join(str(part) for part in path if not isinstance(part, int))


def _describe_length_error(error: Any, location: Location) -> str:
    """Describe the number of items that a list or a table must have; "" if the error is something else."""
    kind, items, path = error["type"], error["input"], location.path
    if kind not in ("too_short", "too_long"):
        return ""
    if kind == "too_short" and not items and len(path) < 3:
        return f"this is empty; give at least one [[{_last_key(path)}]]"
    container = "table" if isinstance(items, dict) else "list"
    bound, key = ("at least", "min_length") if kind == "too_short" else ("at most", "max_length")
    limit = error.get("ctx", {}).get(key)
    count = f"{len(items)} item{'s' * (len(items) != 1)}"
    return f"the {container} has {count}; give {bound} {limit}: {_describe_field(location.field)}"


def _describe_scalar_error(error: Any, location: Location) -> str:
    """Describe the error of a number, a text or a word; "" if it is something else."""
    kind, value = error["type"], format_value(error["input"])
    if kind == "literal_error":
        return f"{value} is not known; expected {error.get('ctx', {}).get('expected')}"
    if kind == "finite_number":
        return f"{value} is not a finite number; {_describe_field(location.field)}"
    if kind in ("greater_than", "greater_than_equal", "less_than", "less_than_equal"):
        return f"{value} is out of range; {_describe_field(location.field)}"
    if kind == "string_pattern_mismatch":
        return f"{value} is not a name; a name is a letter, then letters, digits, _ or -"
    if kind.endswith(("_type", "_parsing")):
        wanted = TYPE_NAMES.get(kind, kind.removesuffix("_type"))
        return f"{value} is not {wanted}; {_describe_field(location.field)}"
    return ""


def _describe_field(field: FieldInfo | None) -> str:
    """Describe the values of a field, with their range."""
    if field is None:
        return ""
    names = ("ge", "gt", "le", "lt")
    limits = {name: getattr(item, name) for item in field.metadata for name in names if hasattr(item, name)}
    return ", ".join(text for text in (field.description, describe_range(**limits)) if text)


def _last_key(path: KeyPath) -> str:
    """The last part of a path; "" of the patch as a whole."""
    return to_one_line(str(path[-1]), MAX_KEY_CHARACTERS) if path else ""
