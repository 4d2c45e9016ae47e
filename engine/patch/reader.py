"""Patches are read here: a TOML file in, a validated `Scene` or located faults out."""

import difflib
import json
import re
import tomllib
import warnings
from collections.abc import Iterable
from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple, TypeVar

from pydantic import ValidationError

from engine.bodies.table import KeyPath
from engine.faults import Fault, PatchError, PatchWarning
from engine.files import MB, SHIPPED_PATCHES, UnreadableFile, find_patch, is_folder, read_bytes, shortest_name
from engine.instrument.expansion import Expansion, is_instrument
from engine.instrument.key_writer import Origins
from engine.output_files import error_reason
from engine.patch.bow import expand_bows
from engine.patch.error_messages import (
    MAX_KEY_CHARACTERS,
    describe_error,
    format_path,
    locate_error,
    path_to_blame,
)
from engine.patch.misspelt import Slip, find_slips, find_wrong_guesses, spell_right
from engine.patch.precision_key import NOTE, PATH, remove_precision
from engine.patch.scene_tables import MAX_FAULTS_COLLECTED, SceneTables
from engine.patch.toml_lines import NestedTooDeep, locate_keys, nearest_line, split_statements
from engine.wording import program_name, to_one_line

MAX_PATCH_BYTES = 1 * MB  # a larger patch takes seconds to read
MAX_FAULTS_LISTED = 50
MAX_SPELLINGS = 3  # how often misspelt words are spelt right, to find others
DOCUMENT = "scene"  # what faults call a patch that was read from no file
MAX_NUMBER_DIGITS = 4_000  # Python reads some more

S = TypeVar("S", bound=SceneTables)

# what Python's TOML reader says, and what would be right
SYNTAX_REMEDIES = {
    "Cannot overwrite": "a key is given twice, or a table is [body] once and [[body]] elsewhere: write [[body]]",
    "twice": "the same table is given twice; write [[body]], [[contact]] and so on, which can be repeated",
    "Expected newline": "give one number or text for each key: 6.0, not 6,0; write units in a comment, after #",
}


class Document(NamedTuple):
    """A patch or a rig that was read, and is still to be validated; as of `validate_document`."""

    data: dict[str, Any]
    folder: Path
    file: str
    text: str


def read_document(path: str | Path | dict[str, Any]) -> Document:
    """Read a patch or a rig as `fdh.load` does."""
    if isinstance(path, dict):
        return Document(path, Path(), DOCUMENT, "")
    if not isinstance(path, str | Path):
        raise TypeError(
            f'{to_one_line(repr(path), 60)} is not a path; give one, or a shipped name: fdh.load("tanpura")'
        )
    path = find_patch(path)
    text = read_text(path)
    data = _parse_json(str(path), text) if path.suffix.lower() == ".json" else _parse_toml(str(path), text)
    if not data:
        raise PatchError([Fault("", f"empty; {program_name()} new NAME writes a first patch", str(path))])
    if remove_precision(data):
        note = Fault(format_path(PATH), NOTE, str(path), nearest_line(locate_keys(text), PATH))
        warnings.warn(str(note), PatchWarning, stacklevel=3)  # where `fdh.load` is called
    return Document(data, path.parent, str(path), "" if path.suffix.lower() == ".json" else text)


def read_text(path: Path) -> str:
    """Read the text of a patch file. Raises PatchError if it cannot be read, or is no text."""
    try:
        text = read_bytes(path, MAX_PATCH_BYTES).decode("utf-8-sig")  # Windows puts a mark there
    except UnicodeDecodeError:
        text = "\0"
    except (OSError, UnreadableFile) as error:
        raise PatchError([Fault("", _describe_read_error(path, error), str(path))]) from None
    if "\0" in text:
        raise PatchError([Fault("", "not a text file; a patch is TOML in UTF-8", str(path))])
    return text


def validate_document(kind: type[S], data: dict[str, Any], folder: Path, file: str, text: str) -> S:
    """Make a scene of a document. Raises PatchError.

    kind:   the class of the scene
    folder: where the files lie that the document names
    file:   the name of the patch in faults
    text:   the TOML that the document was read from, for the lines of faults; "" if there is none
    """
    result = _validate(kind, data, folder)
    if isinstance(result, SceneTables):
        return result
    faults = _make_faults(file, text, _explain_slips(kind, data, folder, result))
    raise PatchError(faults if text else [replace(fault, line=None) for fault in faults])


def validate_expansion(kind: type[S], document: Any, folder: Path, expansion: Expansion) -> S:
    """Make a scene of an instrument that is written out for other keys or another score. Raises PatchError, with paths
    of its document."""
    result = _validate(kind, document, folder, expansion)
    if isinstance(result, SceneTables):
        return result
    raise PatchError([replace(fault, line=None) for fault in _make_faults(DOCUMENT, "", result)])


def _explain_slips(
    kind: type[S], data: dict[str, Any], folder: Path, errors: "list[BlamedError]"
) -> "list[BlamedError]":
    """The errors of a document, without those that misspelt words have led to. An unknown kind that is no misspelt one
    of its table is left as it is, so that nothing is said of another kind's keys."""
    unknown_kinds: set[KeyPath] = set()
    while True:
        spelt, result, misspelt = data, errors, list[Slip]()
        for _ in range(MAX_SPELLINGS):
            found = find_slips(spelt, ((blamed.error, blamed.path) for blamed in result))
            slips = [slip for slip in found if slip.path not in unknown_kinds]
            if not slips:
                break
            misspelt += slips
            spelt = spell_right(spelt, slips)
            validated = _validate(kind, spelt, folder)
            result = [] if isinstance(validated, SceneTables) else validated
        wrong = find_wrong_guesses(misspelt, ((blamed.error, blamed.path) for blamed in result))
        if not wrong:
            return [BlamedError(slip.error, slip.path, "") for slip in misspelt] + result
        unknown_kinds |= wrong


class BlamedError(NamedTuple):
    """An error of a document, with the path of the key to blame, as the patch has it.

    key: of an instrument, of which a table was written out; "" if it is none
    """

    error: Any
    path: KeyPath
    key: str


def _validate(
    kind: type[S], data: dict[str, Any], folder: Path, expansion: Expansion | None = None
) -> S | list[BlamedError]:
    """Make a scene of a document, or list what is wrong with it. expansion: of an instrument, if not its own score's"""
    origins: Origins = {}
    context = {"folder": folder, "origins": origins, "expansion": expansion}
    try:
        return kind.model_validate(data, context=context)
    except ValidationError as error:
        return _once_each(_blame(e, origins) for e in error.errors(include_url=False))


def locate_faults(file: str, faults: list[Fault]) -> list[Fault]:
    """Add the file and the lines of a patch to faults that have only the paths of its keys."""
    try:
        text, origins = read_text(Path(file)), Origins()
        lines = locate_keys(text)
        document = tomllib.loads(text)
        if not is_instrument(document):
            expand_bows(document, False, origins)
    except (PatchError, ValueError):  # the file was changed since
        return [replace(fault, file=file) for fault in faults]
    located = []
    for fault in faults:
        path = _parse_path(fault.path)
        table = origins.get((str(path[0]), int(path[1]))) if len(path) > 1 and isinstance(path[1], int) else None
        place = (*table[0], *path[2:]) if table else path
        named = fault.path if place == path else format_path(place)
        located.append(replace(fault, path=named, file=file, line=nearest_line(lines, place)))
    return located


def _parse_path(path: str) -> KeyPath:
    """The keys of a path such as body[0].mass."""
    return tuple(int(part) if part.isdecimal() else part for part in re.findall(r"\w+", path))


def _parse_toml(file: str, text: str) -> dict[str, Any]:
    """Parse a text. Raises PatchError, also for TOML that Python's reader does not survive."""
    try:
        for _ in split_statements(text):  # raises NestedTooDeep
            pass
        return tomllib.loads(text)
    except NestedTooDeep as error:
        raise PatchError([Fault("", f"{error}; a patch needs three", file, error.line)]) from None
    except tomllib.TOMLDecodeError as error:
        raise PatchError([_make_syntax_fault(file, text, error)]) from None
    except ValueError:  # of int(), which does not say where
        long = (number.start() for number in re.finditer("[0-9_]++", text) if len(number[0]) > MAX_NUMBER_DIGITS)
        line = text.count("\n", 0, next(long, 0)) + 1
        message = f"a number of over {MAX_NUMBER_DIGITS} digits; as 1e9, for instance"
        raise PatchError([Fault("", message, file, line)]) from None


def _parse_json(file: str, text: str) -> dict[str, Any]:
    """Parse a text. Raises PatchError."""
    try:
        data = json.loads(text)
    except (ValueError, RecursionError) as error:
        line = getattr(error, "lineno", None)
        raise PatchError([Fault("", f"not valid JSON ({getattr(error, 'msg', error)})", file, line)]) from None
    if not isinstance(data, dict):
        raise PatchError([Fault("", 'not a patch; write an object, such as {"body": […], "pickup": […]}', file)])
    return data


def _make_syntax_fault(file: str, text: str, error: tomllib.TOMLDecodeError) -> Fault:
    """The fault of a text that is no TOML."""
    message = str(error)
    position = re.search(r" \(at line (\d+), column (\d+)\)$", message)
    line = int(position[1]) if position else text.count("\n") + 1
    column = f" at column {position[2]}" if position else ""
    message = message[: position.start()] if position else message.removesuffix(" (at end of document)")
    default = 'write key = value, with text in "quotes"'
    remedy = next((remedy for words, remedy in SYNTAX_REMEDIES.items() if words in message), default)
    return Fault("", f"not valid TOML{column} ({message}); {remedy}", file, line)


def _blame(error: Any, origins: Origins) -> BlamedError:
    """Find the key to blame for an error. origins: of the tables of an instrument that were written out"""
    path = path_to_blame(error)
    if len(path) < 2 or (table := (str(path[0]), path[1])) not in origins:
        return BlamedError(error, path, "")
    origin, key = origins[table]
    return BlamedError(error, (*origin, *path[2:]), key)


def _once_each(errors: Iterable[BlamedError]) -> list[BlamedError]:
    """The errors without those that other keys of an instrument have alike."""
    seen, kept = set(), []
    for blamed in errors:
        kind = blamed.path, blamed.error["type"]
        if not blamed.key or kind not in seen:
            kept.append(blamed)
        seen.add(kind)
    return kept


def _make_faults(file: str, text: str, errors: list[BlamedError]) -> list[Fault]:
    """The faults of a patch in the order of its lines: the first of them, and how many more there are."""
    lines = locate_keys(text)
    ordered = sorted(((nearest_line(lines, blamed.path), blamed) for blamed in errors), key=lambda pair: pair[0])
    faults: list[Fault] = []
    for n, (line, blamed) in enumerate(ordered):
        if len(faults) == MAX_FAULTS_LISTED:
            rest = f"at least {MAX_FAULTS_COLLECTED}" if len(errors) >= MAX_FAULTS_COLLECTED else len(errors) - n
            return [*faults, Fault("", f"and {rest} more errors; these are the first", file)]
        message = describe_error(blamed.error, locate_error(blamed.error))
        message += f" (key {blamed.key})" if blamed.key else ""
        faults.append(Fault(format_path(blamed.path), message, file, line))
    return faults


def _describe_read_error(path: Path, error: OSError | UnreadableFile) -> str:
    """Why a file cannot be read, and which may have been meant: a patch whose name is like it."""
    folder = is_folder(path)
    if isinstance(error, UnreadableFile) and not folder:
        return f"{error}; give a patch, a .toml file of at most {MAX_PATCH_BYTES / MB:g} MB"
    folders = [path] if folder else [path.parent, path.parent / "patches", Path("patches"), SHIPPED_PATCHES]
    patches = [patch for place in folders if is_folder(place) for patch in sorted(place.glob("*.toml"))]
    if folder:
        example = f"one of its patches, such as {patches[0]}" if patches else "a patch, a .toml file"
        return f"is a folder; give {example}"
    missing = "no such file" if path.suffix or len(path.parts) > 1 else "no such file or shipped patch"
    message = missing if isinstance(error, FileNotFoundError) else error_reason(error)
    by_name = {patch.stem: patch for patch in reversed(patches)}  # of one name, that in the nearest folder
    similar = difflib.get_close_matches(path.stem[:MAX_KEY_CHARACTERS], by_name, 1, 0.7)
    if similar:
        return f"{message}; did you mean {shortest_name(by_name[similar[0]])}?"
    example = f"such as {shortest_name(patches[0])}" if patches else "a .toml file"
    return f"{message}; give a patch, {example}"
