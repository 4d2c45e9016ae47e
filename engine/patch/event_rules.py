"""Rules of events: what can be struck, and what a change can change. Tables are as they were read."""

from collections.abc import Callable, Iterator, Mapping
from typing import Any

from pydantic_core import InitErrorDetails

from engine.bodies.table import KeyPath, is_given, is_number, make_fault
from engine.patch.live_parameters import GLIDED_KEYS
from engine.patch.positions import kind_of
from engine.patch.tables import MAX_EXPONENT, MAX_FORCE_AT_1_MM, max_stiffness
from engine.wording import format_names, format_value, join_with_or

Faults = Iterator[InitErrorDetails]
Named = Mapping[str, dict[str, Any]]  # tables by their names
FindAbsent = Callable[[dict[str, Any]], dict[str, str]]  # keys that a table lacks, and what it has or is instead


def check_event(
    path: KeyPath, event: dict[str, Any], bodies: Named, sections: Mapping[str, tuple[Named, FindAbsent]]
) -> Faults:
    """A strike moves a lumped body; a change is of one thing that has a name. sections: those of GLIDED_KEYS"""
    kind, body = event.get("kind"), bodies.get(str(event.get("body")))
    if kind == "strike" and body is not None and kind_of(body) is not None and not _is_lumped(body):
        message = f"{format_value(event['body'])} is a {body.get('kind')}"
        remedy = "launch a mass or an oscillator; use a force or pluck for other bodies"
        yield make_fault((*path, "body"), event["body"], message, remedy)
    if kind != "change":
        return
    given = [key for key in (*GLIDED_KEYS, "parameter") if is_given(event, key)]
    if len(given) != 1:
        none = f"no {join_with_or(GLIDED_KEYS)} is given"
        message = f"both {' and '.join(given[:2])} are given" if given else none
        yield make_fault(path, event, message, "name the one that changes")
    elif given == ["parameter"]:
        yield from _check_parameter(path, event)
    else:
        yield from _check_glide(path, event, given[0], *sections[given[0]])


def _check_parameter(path: KeyPath, event: dict[str, Any]) -> Faults:
    """The new number of a live parameter is its value."""
    if not is_given(event, "value"):
        yield make_fault(path, event, "no value is given", "give the value that it glides to")
    for key in _given_keys(event):
        message = f"parameter and {key} are both given"
        yield make_fault((*path, key), event[key], message, "give the new number as value")


def _check_glide(path: KeyPath, event: dict[str, Any], section: str, named: Named, find_absent: FindAbsent) -> Faults:
    """A table that changes has a name, and the keys that are to change."""
    keys, name = GLIDED_KEYS[section], event[section]
    if is_given(event, "value"):
        yield make_fault(path, event, "value is given", f"a {section} has a {keys[0]} and other keys")
    for key in _given_keys(event):
        if key not in keys:
            yield make_fault((*path, key), event[key], f"a {section} has no {key}", f"give {join_with_or(keys)}")
    if not any(is_given(event, key) for key in keys):
        yield make_fault(path, event, "nothing changes", f"give a new {join_with_or(keys)}")
    if isinstance(name, str) and name not in named:
        message, remedy = f"no {section} is named {format_value(name)}", f"the named ones are {format_names(named)}"
        yield make_fault((*path, section), name, message, remedy)
    table = named.get(str(name), {})
    if "exponent" in keys:
        stiffness, exponent = (event.get(key, table.get(key)) for key in ("stiffness", "exponent"))
        key = "stiffness" if is_given(event, "stiffness") else "exponent"
        yield from check_stiffness((*path, key), stiffness, exponent)
    for key, reason in (find_absent(table) if table else {}).items():
        if is_given(event, key):
            message, remedy = f"that {section} has no {key}", f"{format_value(name)} {reason}"
            yield make_fault((*path, key), event[key], message, remedy)


def _given_keys(event: dict[str, Any]) -> list[str]:
    """Return the keys of an event that glide something."""
    return [key for key in dict.fromkeys(sum(GLIDED_KEYS.values(), ())) if is_given(event, key)]


def _is_lumped(body: dict[str, Any]) -> bool:
    """True if a table describes a mass or an oscillator."""
    kind = kind_of(body)
    return kind is not None and kind.IS_LUMPED


def check_stiffness(path: KeyPath, stiffness: Any, exponent: Any) -> Faults:
    """No contact is harder than energy can be accounted for (`max_stiffness`)."""
    if is_number(stiffness) and is_number(exponent) and 1.0 <= exponent <= MAX_EXPONENT:
        if stiffness > max_stiffness(exponent):
            remedy = f"at most {max_stiffness(exponent):.3g} N/m^{exponent:g}, {MAX_FORCE_AT_1_MM:g} N at 1 mm"
            yield make_fault(path, stiffness, f"{stiffness:g} is stiffer than any material", remedy)
