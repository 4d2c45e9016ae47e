"""TOML patches: text in, a validated `Scene` or located faults out."""

import difflib
import os
import re
import tomllib
import types
import typing
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from pydantic import BaseModel, ValidationError
from pydantic.fields import FieldInfo

from engine.references import Where
from engine.scene import Scene

SHIPPED = Path(__file__).parent.parent / "patches"  # beside render.py


@dataclass(frozen=True)
class Fault:
    """One thing wrong with a patch: where, what, and what would be right."""

    file: str
    line: int | None
    path: str
    what: str

    def __str__(self) -> str:
        where = self.file if self.line is None else f"{self.file}:{self.line}"
        return f"{where} {self.path}: {self.what}" if self.path else f"{where}: {self.what}"


class PatchError(ValueError):
    """A patch that cannot be used; `faults` lists all that is wrong with it."""

    def __init__(self, faults: list[Fault]) -> None:
        super().__init__("\n".join(map(str, faults)))
        self.faults = faults


def load(path: str | Path) -> Scene:
    """Read a patch file. Raises PatchError, which lists every fault at once."""
    path = Path(path)
    file = str(path)
    try:
        text = path.read_bytes().decode("utf-8-sig")  # Windows puts a mark there
    except OSError as error:
        raise PatchError([Fault(file, None, "", _unread(path, error))]) from None
    except UnicodeDecodeError:
        text = "\0"
    if "\0" in text:
        raise PatchError([Fault(file, None, "", "not a text file; a patch is TOML in UTF-8")])
    try:
        data = tomllib.loads(text)
    except tomllib.TOMLDecodeError as error:
        raise PatchError([_syntax_fault(file, text, error)]) from None
    if not data:
        raise PatchError([Fault(file, None, "", "empty; render.py new NAME writes a patch to begin with")])
    return validated(data, path.parent, file, text)


def validated(data: dict[str, Any], folder: Path, file: str, text: str) -> Scene:
    """A document as a Scene; files it names lie in the folder. Raises PatchError, with lines of the text."""
    try:
        return Scene.model_validate(data, context={"folder": folder})
    except ValidationError as error:
        lines = locate(text)
        errors = error.errors(include_url=False)
        meant = {(*_resolve(e)[0][:-1], _meant(e)) for e in errors if e["type"] == "extra_forbidden"}
        faults = [_fault(file, lines, e) for e in errors if e["type"] != "missing" or _resolve(e)[0] not in meant]
        raise PatchError(sorted(faults, key=lambda f: f.line or 0)) from None


def _unread(path: Path, error: OSError) -> str:
    """Why a file cannot be read, and which was meant: one that is there and has a name like it."""
    folders = [path] if path.is_dir() else [path.parent, path.parent / "patches", Path("patches"), SHIPPED]
    there = [patch for folder in folders for patch in sorted(folder.glob("*.toml"))]
    if path.is_dir():
        return "is a folder; " + (
            f"give one of its patches, such as {there[0]}" if there else "give a patch, a .toml file"
        )
    what = "no such file" if isinstance(error, FileNotFoundError) else (error.strerror or str(error)).lower()
    named = {patch.stem: patch for patch in reversed(there)}  # the nearest folder comes first
    near = difflib.get_close_matches(path.stem, named, 1, 0.7)
    if near:
        return f"{what}; did you mean {_brief(named[near[0]])}?"
    return f"{what}; give the path of a patch" + (f", such as {_brief(there[0])}" if there else ", a .toml file")


def _brief(path: Path) -> str:
    """A path from here, if it is shorter so."""
    try:
        return min(os.path.relpath(path), str(path), key=len)
    except ValueError:  # on another drive
        return str(path)


# what Python's reader says, and what would be right
HINTS = {
    "Cannot overwrite": "a key is given twice, or a table is [body] once and [[body]] elsewhere: write [[body]]",
    "twice": "the same table stands there twice; write [[body]], [[contact]] and so on, which may be many",
    "Expected newline": "one number or text for each key: 6.0 and not 6,0; the unit goes into a comment, after #",
}


def _syntax_fault(file: str, text: str, error: tomllib.TOMLDecodeError) -> Fault:
    message = str(error)
    found = re.search(r" \(at line (\d+), column (\d+)\)$", message)
    line = int(found[1]) if found else text.count("\n") + 1
    column = f" at column {found[2]}" if found else ""
    what = message[: found.start()] if found else message.removesuffix(" (at end of document)")
    right = next((hint for sign, hint in HINTS.items() if sign in what), 'write key = value, with text in "quotes"')
    return Fault(file, line, "", f"not valid TOML{column} ({what}); {right}")


def locate(text: str) -> dict[Where, int]:
    """Line of every key and table of a valid TOML text, by path: ("body", 0, "mass") → 7."""
    rows = text.splitlines()
    lines: dict[Where, int] = {(): 1}
    table: Where = ()
    counts: dict[Where, int] = {}
    i = 0
    while i < len(rows):
        for end in range(i + 1, len(rows) + 1):  # a statement ends where it first parses
            try:
                statement = tomllib.loads("\n".join(rows[i:end]))
                break
            except tomllib.TOMLDecodeError:
                continue
        else:
            return lines
        if rows[i].lstrip().startswith("["):
            table = _open_table(statement, counts)
            lines.setdefault(table, i + 1)
            if isinstance(table[-1], int):  # the first of an array stands for it
                lines.setdefault(table[:-1], i + 1)
        else:
            for path in _paths(statement):
                lines.setdefault(table + path, i + 1)
        i = end
    return lines


def _open_table(statement: dict[str, Any], counts: dict[Where, int]) -> Where:
    """The path a header opens; arrays of tables are counted."""
    path: Where = ()
    value: Any = statement
    while isinstance(value, dict) and value:
        key, value = next(iter(value.items()))
        path += (key,)
        if isinstance(value, list):  # [[array]]
            counts[path] = counts.get(path, -1) + 1
            value = value[0]
        if path in counts:
            path += (counts[path],)
    return path


def _paths(value: Any) -> Iterator[Where]:
    """All paths within a value."""
    items: Any = value.items() if isinstance(value, dict) else enumerate(value) if isinstance(value, list) else ()
    for key, inner in items:
        yield (key,)
        yield from ((key, *rest) for rest in _paths(inner))


def _fault(file: str, lines: dict[Where, int], error: Any) -> Fault:
    """A pydantic error as one line."""
    where, models, field = _resolve(error)
    what = _describe(error, where, models, field)
    if error["type"] == "union_tag_invalid":
        where += ("kind",)
    at = where
    while at not in lines:
        at = at[:-1]
    text = "".join(f"[{p}]" if isinstance(p, int) else f".{p}" for p in where).lstrip(".")
    return Fault(file, lines[at], text, what)


def wrong_value(model: type[BaseModel], key: str, value: Any) -> str:
    """What is wrong with one value of a part whose other keys are optional; nothing if it is right."""
    try:
        model.model_validate({key: value})
    except ValidationError as error:
        return _describe(error.errors()[0], (key,), {"": model}, model.model_fields[key])
    return ""


def _models(annotation: Any) -> dict[str, type[BaseModel]]:
    """The models an annotation admits, by their `kind`."""
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        kind = annotation.model_fields.get("kind")
        return {typing.get_args(kind.annotation)[0] if kind else "": annotation}
    if typing.get_origin(annotation) in (list, typing.Union, types.UnionType, typing.Annotated):
        return {k: m for a in typing.get_args(annotation) for k, m in _models(a).items()}
    return {}


def _resolve(error: Any) -> tuple[Where, dict[str, type[BaseModel]], FieldInfo | None]:
    """Path in the patch of an error, the models whose key it is, and its field.

    Pydantic puts a table's kind into the path, after its number; our own errors do not.
    """
    where: Where = ()
    models: dict[str, type[BaseModel]] = {"": Scene}
    field: FieldInfo | None = None
    inner = models
    for part in error["loc"]:
        if error["type"] != "scene" and len(inner) > 1 and part in inner and isinstance(where[-1], int):
            inner = {part: inner[part]}
            continue
        if isinstance(part, str):
            models = inner
            field = next((m.model_fields[part] for m in models.values() if part in m.model_fields), None)
            inner = _models(field.annotation) if field else {}
        where += (part,)
    return where, models if isinstance(where[-1:] and where[-1], str) else inner, field


def _meant(error: Any) -> str:
    """The known key that an unknown one most resembles, or nothing."""
    where, models, _ = _resolve(error)
    known = [k for m in models.values() for k in m.model_fields]
    return next(iter(difflib.get_close_matches(str(where[-1]), known, 1, 0.6)), "")


def nearest(word: str, known: list[str], before: str = "", after: str = "") -> str:
    """What may have been meant by an unknown word, with what stands around it; or all that is known."""
    near = difflib.get_close_matches(word, known, 1, 0.6)
    return f'did you mean "{before}{near[0]}{after}"?' if near else "known here: " + ", ".join(known)


def _meaning(field: FieldInfo | None) -> str:
    """What a field holds, with its range."""
    if field is None:
        return ""
    text = field.description or ""
    for constraint in field.metadata:
        for symbol, attribute in (("≥", "ge"), (">", "gt"), ("≤", "le"), ("<", "lt")):
            if (limit := getattr(constraint, attribute, None)) is not None:
                text += f", {symbol} {limit:g}"
    return text


def _describe(error: Any, where: Where, models: dict[str, type[BaseModel]], field: FieldInfo | None) -> str:
    """What is wrong, and what would be right."""
    kind, value, context = error["type"], error["input"], error.get("ctx", {})
    key = str(where[-1]) if where else ""
    shown = f'"{value}"' if isinstance(value, str) else str(value).lower() if isinstance(value, bool) else f"{value}"
    if len(shown) > 60:
        shown = shown[:57] + "..."
    if kind == "scene":
        return str(error["msg"])
    if kind == "extra_forbidden":
        known = list(dict.fromkeys(k for m in models.values() for k in m.model_fields))
        return f"unknown key; {nearest(key, known)}"
    if kind == "missing":
        return f"missing; {_meaning(field)}"
    if kind == "too_short" and not value and len(where) < 3:
        return f"empty; give at least one [[{key}]]"
    if kind == "union_tag_not_found":
        return f"kind missing; one of {', '.join(models)}"
    if kind == "union_tag_invalid":
        return f'unknown kind "{context.get("tag")}"; {nearest(str(context.get("tag")), list(models))}'
    if kind == "literal_error":
        return f"{shown} is not known; expected {context.get('expected')}"
    if kind == "finite_number":
        return f"{shown} is not a finite number; {_meaning(field)}"
    if kind in ("greater_than", "greater_than_equal", "less_than", "less_than_equal"):
        return f"{shown} is out of range; {_meaning(field)}"
    if kind == "string_pattern_mismatch":
        return f"{shown} is not a name; a letter, then letters, digits, _ or -"
    if kind in ("model_type", "model_attributes_type", "list_type", "dict_type") and len(where) < 3:
        listed = field is None or typing.get_origin(field.annotation) is list
        header = f"[[{where[0]}]]" if listed and where else f"[{key}]"
        return f"{shown} is not a table; write {header}" if where else "not a table of keys"
    if kind in ("model_type", "model_attributes_type", "dict_type"):
        inner = _models(field.annotation).values() if field else ()
        needed = [k for m in inner for k, f in m.model_fields.items() if f.is_required()] or ["name"]
        return f"{shown} is not a table; write {key} = {{ {', '.join(f'{k} = …' for k in needed)} }}"
    if kind == "list_type":
        return f"{shown} is not a list; write {key} = [ … ]: {_meaning(field)}"
    if kind in ("too_short", "too_long"):
        wanted = context.get("min_length" if kind == "too_short" else "max_length")
        return f"{len(value)} in the list, at {'least' if kind == 'too_short' else 'most'} {wanted}; {_meaning(field)}"
    if kind.endswith(("_type", "_parsing")):
        wanted = {"float_type": "a number", "int_type": "a whole number", "string_type": 'text in "quotes"'}.get(
            kind, kind.removesuffix("_type")
        )
        return f"{shown} is not {wanted}; {_meaning(field)}"
    return f"{error['msg']}; {_meaning(field)}"
