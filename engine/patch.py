"""TOML patches: text in, a validated `Scene` or located faults out."""

import difflib
import os
import re
import tomllib
import types
import typing
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from pydantic import BaseModel, ValidationError
from pydantic.fields import FieldInfo

from engine.files import MB, NoFile, content, is_folder
from engine.lines import TooDeep, Where, line_of, locate, statements
from engine.save import reason
from engine.scene import MANY, Scene
from engine.wording import one_line, shown

SHIPPED = Path(__file__).parent.parent / "patches"  # beside render.py
LARGEST = 1 * MB  # of a patch; what is larger takes seconds to read
MOST_FAULTS = 50  # told
FILE, WHAT, NAME = 400, 500, 80  # characters of a fault: of the file, of what is wrong, of a key
DIGITS = 4_000  # of a number; Python reads some more


@dataclass(frozen=True)
class Fault:
    """One thing wrong with a patch: where, what, and what would be right."""

    file: str
    line: int | None
    path: str
    what: str

    def __str__(self) -> str:
        file = one_line(self.file, FILE)
        where = file if self.line is None else f"{file}:{self.line}"
        what = one_line(self.what, WHAT)
        return f"{where} {self.path}: {what}" if self.path else f"{where}: {what}"


class PatchError(ValueError):
    """A patch that cannot be used; `faults` lists what is wrong with it: all of it, or the first of very much."""

    def __init__(self, faults: list[Fault]) -> None:
        super().__init__("\n".join(map(str, faults)))
        self.faults = faults


def load(path: str | Path) -> Scene:
    """Read a patch file. Raises PatchError, which lists every fault at once."""
    path = Path(path)
    file = str(path)
    text = text_of(path)
    if "\0" in text:
        raise PatchError([Fault(file, None, "", "not a text file; a patch is TOML in UTF-8")])
    data = _parsed(file, text)
    if not data:
        raise PatchError([Fault(file, None, "", "empty; render.py new NAME writes a patch to begin with")])
    return validated(data, path.parent, file, text)


def text_of(path: Path) -> str:
    """The text of a patch file; NUL if it is none. Raises PatchError."""
    try:
        return content(path, LARGEST).decode("utf-8-sig")  # Windows puts a mark there
    except UnicodeDecodeError:
        return "\0"
    except (OSError, NoFile) as error:
        raise PatchError([Fault(str(path), None, "", _unread(path, error))]) from None


def _parsed(file: str, text: str) -> dict[str, Any]:
    """A text as tables. Raises PatchError, if it is no TOML, or such as Python's reader stumbles over."""
    try:
        for _ in statements(text):  # which raises TooDeep
            pass
        return tomllib.loads(text)
    except TooDeep as error:
        raise PatchError([Fault(file, error.line, "", f"{error}; a patch needs three")]) from None
    except tomllib.TOMLDecodeError as error:
        raise PatchError([_syntax_fault(file, text, error)]) from None
    except ValueError:  # of int(), about which line it says nothing
        long = (number.start() for number in re.finditer("[0-9_]++", text) if len(number[0]) > DIGITS)
        line = text.count("\n", 0, next(long, 0)) + 1
        raise PatchError([Fault(file, line, "", f"a number of over {DIGITS} digits; as 1e9, for instance")]) from None


def validated(data: dict[str, Any], folder: Path, file: str, text: str) -> Scene:
    """A document as a Scene; files it names lie in the folder. Raises PatchError, with lines of the text."""
    try:
        return Scene.model_validate(data, context={"folder": folder})
    except ValidationError as error:
        raise PatchError(_told(file, text, error.errors(include_url=False))) from None


def _told(file: str, text: str, errors: list[Any]) -> list[Fault]:
    """Faults of a patch in the order of its lines: the first of them, and how many more there are."""
    lines = locate(text)
    ordered = sorted(((line_of(lines, _where(e)), e) for e in errors), key=lambda pair: pair[0])
    unknown: dict[Where, list[Any]] = {}
    for _, error in ordered:
        if error["type"] == "extra_forbidden":
            unknown.setdefault(_resolve(error)[0][:-1], []).append(error)
    faults: list[Fault] = []
    for n, (line, error) in enumerate(ordered):
        if len(faults) == MOST_FAULTS:
            more = f"at least {MANY}" if len(errors) >= MANY else len(errors) - n
            return [*faults, Fault(file, None, "", f"and {more} more faults; these are the first")]
        where = _resolve(error)[0]
        near = unknown.get(where[:-1], [])[:MOST_FAULTS] if error["type"] == "missing" else []
        if any(_meant(other) == where[-1] for other in near):
            continue  # it is there, misspelt
        faults.append(_fault(file, line, error))
    return faults


def located(path: str, found: list[tuple[str, str]]) -> list[Fault]:
    """What stands against building a patch, by its paths, with the lines of the file."""
    try:
        lines = locate(text_of(Path(path)))
    except (PatchError, ValueError):  # it is no longer what it was
        return [Fault(path, None, where, what) for where, what in found]
    return [
        Fault(
            path, line_of(lines, tuple(int(p) if p.isdecimal() else p for p in re.findall(r"\w+", where))), where, what
        )
        for where, what in found
    ]


def _unread(path: Path, error: OSError | NoFile) -> str:
    """Why a file cannot be read, and which was meant: one that is there and has a name like it."""
    folder = is_folder(path)
    if isinstance(error, NoFile) and not folder:
        return f"{error}; give a patch, a .toml file of at most {LARGEST / MB:g} MB"
    folders = [path] if folder else [path.parent, path.parent / "patches", Path("patches"), SHIPPED]
    there = [patch for place in folders if is_folder(place) for patch in sorted(place.glob("*.toml"))]
    if folder:
        return "is a folder; " + (
            f"give one of its patches, such as {there[0]}" if there else "give a patch, a .toml file"
        )
    what = "no such file" if isinstance(error, FileNotFoundError) else reason(error)
    named = {patch.stem: patch for patch in reversed(there)}  # the nearest folder comes first
    near = difflib.get_close_matches(path.stem[:NAME], named, 1, 0.7)
    if near:
        return f"{what}; did you mean {_brief(named[near[0]])}?"
    return f"{what}; give the path of a patch" + (f", such as {_brief(there[0])}" if there else ", a .toml file")


def _brief(path: Path) -> str:
    """A path from here, if it is shorter so."""
    try:
        return min(os.path.relpath(path), str(path), key=len)
    except (OSError, ValueError):  # this folder is gone, or on another drive
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


def _fault(file: str, line: int, error: Any) -> Fault:
    """A pydantic error as one line."""
    text = "".join(f"[{p}]" if isinstance(p, int) else f".{one_line(p, NAME)}" for p in _where(error)).lstrip(".")
    return Fault(file, line, text, _describe(error, *_resolve(error)))


def _where(error: Any) -> Where:
    """The path of the key that is wrong."""
    where = _resolve(error)[0]
    return (*where, "kind") if error["type"] == "union_tag_invalid" else where


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
    return next(iter(difflib.get_close_matches(str(where[-1])[:NAME], known, 1, 0.6)), "")


def nearest(word: str, known: list[str], before: str = "", after: str = "") -> str:
    """What may have been meant by an unknown word, with what stands around it; or all that is known."""
    near = difflib.get_close_matches(word[:NAME], known, 1, 0.6)
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
    key = one_line(str(where[-1]), NAME) if where else ""
    told = shown(value)
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
        tag = str(context.get("tag"))
        return f"unknown kind {shown(tag)}; {nearest(tag, list(models))}"
    if kind == "literal_error":
        return f"{told} is not known; expected {context.get('expected')}"
    if kind == "finite_number":
        return f"{told} is not a finite number; {_meaning(field)}"
    if kind in ("greater_than", "greater_than_equal", "less_than", "less_than_equal"):
        return f"{told} is out of range; {_meaning(field)}"
    if kind == "string_pattern_mismatch":
        return f"{told} is not a name; a letter, then letters, digits, _ or -"
    if kind in ("model_type", "model_attributes_type", "list_type", "dict_type") and len(where) < 3:
        listed = field is None or typing.get_origin(field.annotation) is list
        header = f"[[{where[0]}]]" if listed and where else f"[{key}]"
        return f"{told} is not a table; write {header}" if where else "not a table of keys"
    if kind in ("model_type", "model_attributes_type", "dict_type"):
        inner = _models(field.annotation).values() if field else ()
        needed = [k for m in inner for k, f in m.model_fields.items() if f.is_required()] or ["name"]
        return f"{told} is not a table; write {key} = {{ {', '.join(f'{k} = …' for k in needed)} }}"
    if kind == "list_type":
        return f"{told} is not a list; write {key} = [ … ]: {_meaning(field)}"
    if kind in ("too_short", "too_long"):
        wanted = context.get("min_length" if kind == "too_short" else "max_length")
        kept = "table" if isinstance(value, dict) else "list"
        return (
            f"{len(value)} in the {kept}, at {'least' if kind == 'too_short' else 'most'} {wanted}; {_meaning(field)}"
        )
    if kind.endswith(("_type", "_parsing")):
        wanted = {"float_type": "a number", "int_type": "a whole number", "string_type": 'text in "quotes"'}.get(
            kind, kind.removesuffix("_type")
        )
        return f"{told} is not {wanted}; {_meaning(field)}"
    return f"{error['msg']}; {_meaning(field)}"
