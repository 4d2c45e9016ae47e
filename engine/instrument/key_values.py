"""Values that differ from key to key: formulas, and tables of values at some keys or for ranges of keys."""

import re
from collections.abc import Iterator, Mapping
from functools import lru_cache
from itertools import pairwise
from typing import Any

from engine.arithmetic.plain_numbers import exp, log
from engine.bodies.table import KeyPath, is_number
from engine.instrument.formula import FormulaError, evaluate, is_formula, parse
from engine.instrument.key_names import RANGE_SEPARATOR, note_frequency, note_name, parse_key, parse_keys

UNKNOWN = re.compile(r": unknown (?:name|function) (\w+)$")


class KeyValueError(ValueError):
    """A value of the patch that has none for a key; `path` is where in the table it stands, `unknown` the name or
    function that its formula wants and that does not exist, or ""."""

    def __init__(self, path: KeyPath, value: Any, message: str, remedy: str) -> None:
        super().__init__(f"{message}; {remedy}")
        self.path, self.value, self.message, self.remedy = path, value, message, remedy
        match = UNKNOWN.search(message)
        self.unknown = match[1] if match else ""


def names_of_key(key: int, frequency: float, a4: float) -> dict[str, float]:
    """Return the names that formulas can use for a key: its MIDI number, its number on a piano, its frequency, and that
    in equal temperament, Hz."""
    return {"key": float(key), "n": float(key - 20), "f": frequency, "equal": note_frequency(key, a4)}


def is_key_table(value: Any) -> bool:
    """True if a value is a table by key: {A0 = 1.0, C8 = 2.0}, or by ranges of keys, {"A0..B1" = 1, "C2..C8" = 2}."""
    return isinstance(value, dict) and bool(value) and all(_is_key_or_range(name) for name in value)


@lru_cache(4096)
def _is_key_or_range(text: str) -> bool:
    try:
        return bool(parse_keys(text))
    except ValueError:
        return False


def value_at_key(value: Any, key: int, names: Mapping[str, float], path: KeyPath = ()) -> Any:
    """A value of the patch as it is at a key: formulas are evaluated, tables by key are read, and what they are part of
    is kept.

    names: what formulas may use
    path:  of the value, for errors
    Raises KeyValueError.
    """
    if is_formula(value):
        try:
            return evaluate(value, names)
        except FormulaError as error:
            raise _formula_fault(path, value, f"at key {note_name(key)}: {error}") from None
    if is_key_table(value):
        return _read_key_table(value, key, names, path)
    if isinstance(value, dict):
        return {name: value_at_key(inner, key, names, (*path, name)) for name, inner in value.items()}
    if isinstance(value, list):
        return [value_at_key(inner, key, names, (*path, i)) for i, inner in enumerate(value)]
    return value


def wrong_formulas(value: Any, path: KeyPath = ()) -> Iterator[KeyValueError]:
    """Yield the faults of formulas in a value that no key can have. path: of the value"""
    if is_formula(value):
        try:
            parse(value)
        except FormulaError as error:
            yield _formula_fault(path, value, str(error))
    elif isinstance(value, dict | list):
        for name, inner in value.items() if isinstance(value, dict) else enumerate(value):
            yield from wrong_formulas(inner, (*path, name))


def _formula_fault(path: KeyPath, formula: str, text: str) -> KeyValueError:
    """Make the fault of a formula, with the remedy if the text has one."""
    message, _, remedy = text.partition("; ")
    return KeyValueError(path, formula, message, remedy or "a formula that has a value at every key")


def _read_key_table(table: dict[str, Any], key: int, names: Mapping[str, float], path: KeyPath) -> Any:
    """The value of a table by key: of the range that has the key, or between the keys on both sides of it."""
    if any(RANGE_SEPARATOR in name for name in table):
        for name, value in table.items():
            if key in parse_keys(name):
                return value_at_key(value, key, names, (*path, name))
        raise KeyValueError(
            path, table, f"no range contains key {note_name(key)}", "ranges for all keys of the instrument"
        )
    points = sorted((parse_key(name), value_at_key(value, key, names, (*path, name))) for name, value in table.items())
    if key <= points[0][0]:
        return points[0][1]
    for (low, below), (high, above) in pairwise(points):
        if key <= high:
            return _interpolate(below, above, (key - low) / (high - low), path, table)
    return points[-1][1]


def _interpolate(below: Any, above: Any, share: float, path: KeyPath, table: Any) -> Any:
    """Between two values: positive numbers by a constant ratio, others and those of a list, such as places, along a
    line."""
    if is_number(below) and is_number(above):
        if below > 0.0 and above > 0.0:
            return exp((1 - share) * log(below) + share * log(above))
        return (1 - share) * below + share * above
    if isinstance(below, list) and isinstance(above, list) and len(below) == len(above):
        numbers = [*below, *above]
        if all(is_number(x) for x in numbers):
            return [(1 - share) * a + share * b for a, b in zip(below, above, strict=True)]
    raise KeyValueError(
        path, table, "these values cannot be interpolated", "give numbers, or a table by ranges of keys"
    )
