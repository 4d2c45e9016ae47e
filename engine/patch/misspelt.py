"""Misspelt keys and kinds of a patch. What else is wrong with it is found with these spelt right, so that one slip
gives one error, and not those of the key that is missing and of all that refer to it."""

import copy
import re
from collections.abc import Iterable, Iterator
from itertools import islice
from typing import Any, NamedTuple

from engine.bodies.table import KeyPath
from engine.patch.error_messages import locate_error, section_of_kind, similar_word, suggest_key, tag_of
from engine.patch.keyword_hints import explain_kind

MISFITS = ("missing", "extra_forbidden", "scene")  # errors of a table of another kind than was guessed
MAX_SLIPS = 50  # that are spelt right; more are a text of something else


class Slip(NamedTuple):
    """A misspelt word: the error that reports it, and what is to stand there.

    path: of the key, or of the value of a kind, in the document
    """

    error: Any
    path: KeyPath
    right: str


def find_slips(data: dict[str, Any], errors: Iterable[tuple[Any, KeyPath]]) -> list[Slip]:
    """The errors of a document that are misspelt words, and may have led to others. errors: with the paths of the keys
    to blame, in the document"""
    return list(islice((slip for error, path in errors for slip in _find_slip(data, error, path)), MAX_SLIPS))


def _find_slip(data: dict[str, Any], error: Any, path: KeyPath) -> Iterator[Slip]:
    """The misspelt word that an error is of, if it is one."""
    if error["type"] == "extra_forbidden" and (right := suggest_key(error)):
        yield Slip(error, path, right)
    elif error["type"] == "union_tag_invalid":
        location, tag = locate_error(error), tag_of(error)
        if explain_kind(section_of_kind(location.path), tag):  # a word for something else
            return
        if right := similar_word(tag, list(location.models)):
            yield Slip(error, path, right)
    elif error["type"] == "literal_error" and isinstance(error["input"], str):
        known = re.findall(r"'(\w+)'", error.get("ctx", {}).get("expected", ""))
        if right := similar_word(error["input"], known):
            yield Slip(error, path, right)
    elif error["type"] == "union_tag_not_found":
        table = _value_at(data, path)
        keys = {"kind", *(key for model in locate_error(error).models.values() for key in model.model_fields)}
        for key in table if isinstance(table, dict) else ():
            if key not in keys and similar_word(str(key), keys) == "kind":
                unknown = {"type": "extra_forbidden", "loc": (*error["loc"], key), "input": table[key], "msg": ""}
                yield Slip(unknown, (*path, key), "kind")
                return


def find_wrong_guesses(slips: list[Slip], errors: Iterable[tuple[Any, KeyPath]]) -> set[KeyPath]:
    """The paths of misspelt kinds whose tables are not of the kind that was guessed: keys are missing or unknown with
    it, or of another kind, or none of several ways to give something is there. errors: with the slips spelt right, and
    the paths to blame"""
    kinds = {slip.path[:-1]: slip for slip in slips if slip.error["type"] == "union_tag_invalid"}
    unfit = [path if error["type"] == "scene" else path[:-1] for error, path in errors if error["type"] in MISFITS]
    for slip in slips:
        if slip.error["type"] == "extra_forbidden" and (guess := kinds.get(slip.path[:-1])):
            models = locate_error(guess.error).models.values()
            unfit += [slip.path[:-1] for model in models if slip.path[-1] in model.model_fields]
    return {kinds[table].path for table in unfit if table in kinds}


def spell_right(data: dict[str, Any], slips: list[Slip]) -> dict[str, Any]:
    """A copy of a document with the misspelt words spelt right."""
    data = copy.deepcopy(data)
    for slip in slips:
        *table_path, key = slip.path
        table = _value_at(data, tuple(table_path))
        if not isinstance(table, dict) or key not in table:
            continue
        if slip.error["type"] == "extra_forbidden":
            table[slip.right] = _merge(table.get(slip.right), table.pop(key))
        else:
            table[key] = slip.right
    return data


def _merge(value: Any, other: Any) -> Any:
    """Merge the value of a key with that of a misspelt one beside it: of [[body]] and [[bdy]], the tables of both."""
    if isinstance(value, list) and isinstance(other, list):
        return value + other
    if isinstance(value, dict) and isinstance(other, dict):
        return value | {key: _merge(value.get(key), inner) for key, inner in other.items()}
    return other if value is None else value


def _value_at(data: Any, path: KeyPath) -> Any:
    """The value that a path leads to; None if there is none."""
    for key in path:
        if isinstance(data, dict):
            data = data.get(key)
        elif isinstance(data, list) and isinstance(key, int) and key < len(data):
            data = data[key]
        else:
            return None
    return data
