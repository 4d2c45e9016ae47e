"""Faults that only the whole patch shows: names, places on bodies, keys that exclude or need each other."""

import math
from collections.abc import Iterator
from itertools import pairwise
from typing import Any, TypeGuard

from pydantic_core import InitErrorDetails, PydanticCustomError

from engine.lines import Where
from engine.parts import HARDEST, STEEPEST, hardest, number
from engine.wording import listed, shown

Faults = Iterator[InitErrorDetails]

LUMPED = ("mass", "oscillator")
LINES = ("string", "bar")
SHEETS = ("membrane", "plate")

# of each pair, exactly one is to be given
ONE_OF = {
    "oscillator": [("stiffness", "frequency", "stiffness in N/m or frequency in Hz")],
    "string": [
        ("density", "mass", "density in kg/m or mass in kg"),
        ("tension", "frequency", "tension in N or frequency in Hz"),
    ],
    "bar": [
        ("density", "mass", "density in kg/m or mass in kg"),
        ("bending", "frequency", "bending stiffness in N·m² or frequency in Hz"),
    ],
    "membrane": [
        ("radius", "size", "radius of a circle or size of a rectangle, in m"),
        ("tension", "frequency", "tension in N/m or frequency in Hz"),
    ],
    "plate": [("rigidity", "frequency", "rigidity in N·m or frequency in Hz")],
    "modes": [("file", "frequency", "a CSV file or a list of frequencies in Hz")],
}
# of each pair, at most one
NOT_BOTH = {
    "string": [("bending", "inharmonicity")],
    "modes": [("sigma", "t60")],
}


def fault(where: Where, value: Any, what: str, right: str) -> InitErrorDetails:
    """A fault of ours, in pydantic's form."""
    return InitErrorDetails(
        type=PydanticCustomError("scene", "{what}; {right}", {"what": what, "right": right}), loc=where, input=value
    )


def tables(data: dict[str, Any], key: str) -> Iterator[tuple[int, dict[str, Any]]]:
    """The tables under `key` that are tables; what is not is reported as a fault of structure."""
    found = data.get(key)
    if isinstance(found, list):
        yield from ((i, t) for i, t in enumerate(found) if isinstance(t, dict))


def given(table: dict[str, Any], key: str) -> bool:
    return table.get(key) is not None


def references(data: dict[str, Any]) -> Faults:
    """All of them."""
    bodies = {b["name"]: b for _, b in tables(data, "body") if isinstance(b.get("name"), str)}
    contacts = {c["name"]: c for _, c in tables(data, "contact") if isinstance(c.get("name"), str)}
    for key in ("body", "contact"):
        yield from _taken(data, key)
    for i, body in tables(data, "body"):
        yield from _body(("body", i), body)
    for key, field in (
        ("contact", "body"),
        ("contact", "on"),
        ("force", "body"),
        ("event", "body"),
        ("pickup", "body"),
    ):
        for i, table in tables(data, key):
            yield from _named((key, i, field), table.get(field), bodies, "body", "bodies")
    for i, body in tables(data, "body"):
        for j, support in tables(body, "support"):
            yield from _place(("body", i, "support", j, "at"), support, body, single=False)
    for i, contact in tables(data, "contact"):
        yield from _contact(("contact", i), contact, bodies)
    end = data.get("seconds", 2.0)
    for i, event in tables(data, "event"):
        time = event.get("time")
        if number(time) and number(end) and time >= end:
            yield fault(("event", i, "time"), time, "after the end", f"before {end:g} s, or more seconds")
        yield from _event(("event", i), event, bodies, contacts)
    for key in ("force", "event", "pickup"):
        for i, table in tables(data, key):
            everywhere = table.get("quantity") == "force" and not given(table, "at")
            if not everywhere and (key != "event" or table.get("kind") == "pluck"):
                yield from _place((key, i, "at"), table, bodies.get(str(table.get("body"))), single=True)


def _taken(data: dict[str, Any], key: str) -> Faults:
    seen: set[str] = set()
    for i, table in tables(data, key):
        name = table.get("name")
        if isinstance(name, str) and name in seen:
            yield fault((key, i, "name"), name, f"the name {shown(name)} is taken", f"give each {key} its own name")
        elif isinstance(name, str):
            seen.add(name)


def _named(where: Where, name: Any, known: dict[str, Any], what: str, several: str) -> Faults:
    if isinstance(name, str) and name not in known:
        yield fault(where, name, f"no {what} is named {shown(name)}", f"the {several} are {listed(known)}")


def _body(here: Where, body: dict[str, Any]) -> Faults:
    kind = body.get("kind")
    for a, b, right in ONE_OF.get(str(kind), []):
        if given(body, a) == given(body, b):
            what = f"both {a} and {b}" if given(body, a) else f"neither {a} nor {b}"
            yield fault(here, body, f"{what} given", f"give one of them: {right}")
    for a, b in NOT_BOTH.get(str(kind), []):
        if given(body, a) and given(body, b):
            yield fault((*here, b), body[b], f"both {a} and {b} given", "give one of them")
    if kind in LINES + SHEETS:
        yield from _decay(here, body)
    if kind == "modes":
        yield from _lists(here, body)
    ratios: Any = body.get("ratios")
    if kind == "bar" and _numbers(ratios) and (ratios[0] != 1 or any(a >= b for a, b in pairwise(ratios))):
        yield fault((*here, "ratios"), ratios, "these do not rise from 1", "the first is 1, each next one is higher")


def _decay(here: Where, body: dict[str, Any]) -> Faults:
    """T60 excludes the other losses, and must not make any mode grow."""
    times, at = body.get("t60"), body.get("t60_at")
    others = [k for k in ("sigma0", "sigma1", "sigma3", "b3") if body.get(k)]
    if times and others:
        yield fault((*here, "t60"), times, f"t60 and {others[0]} given", "give decay rates or times, not both")
    if not _numbers(times) or (at is not None and not _numbers(at)):
        return
    if len(times) == 2 and at is None:
        yield fault((*here, "t60"), times, "two times without frequencies", "give t60_at = [Hz, Hz]")
    elif at is not None and len(at) == 2 and len(times) == 2:
        (a, b), (long, short) = at, times
        if a >= b or short > long:
            right = "the higher frequency second, and its time not the longer: else some mode would never decay"
            yield fault((*here, "t60"), times, f"{long:g} s at {a:g} Hz and {short:g} s at {b:g} Hz", right)
        elif short < long * (a / b) ** 2:
            right = f"the second time at least {long * (a / b) ** 2:.3g} s"
            yield fault((*here, "t60"), times, "modes below the first frequency would grow", right)
    elif at is not None:
        yield fault((*here, "t60_at"), at, "frequencies without two times", "give t60 = [s, s]")


def _numbers(value: Any) -> TypeGuard[list[float]]:
    return isinstance(value, list) and bool(value) and all(number(x) and 0 < x < math.inf for x in value)


def _lists(here: Where, body: dict[str, Any]) -> Faults:
    """Lists of measured modes are equally long."""
    frequency, points = body.get("frequency"), body.get("points")
    if not isinstance(frequency, list):
        return
    count = len(frequency)
    lists: list[tuple[Where, Any]] = [((*here, k), body.get(k)) for k in ("sigma", "t60")]
    lists += [((*here, "points", k), v) for k, v in points.items()] if isinstance(points, dict) else []
    for where, values in lists:
        if isinstance(values, list) and len(values) != count:
            right = f"one for each of the {count} frequencies"
            yield fault(where, values, f"{len(values)} numbers for {count} modes", right)
    if not points:
        yield fault(here, body, "no points given", "give points.NAME = [one number per mode], a mode shape in 1/√kg")


def count_places(table: dict[str, Any], key: str, body: dict[str, Any] | None) -> int:
    """How many places a key lists on a body."""
    at = table.get(key)
    if not isinstance(at, list):
        return 1
    if body is not None and body.get("kind") in SHEETS and at and not isinstance(at[0], list):
        return 1
    return len(at)


def _place(where: Where, table: dict[str, Any], body: dict[str, Any] | None, single: bool) -> Faults:
    """The places a key lists are such as the body has."""
    if body is None or body.get("kind") not in (*LUMPED, *LINES, *SHEETS, "modes"):
        return
    kind, key = body.get("kind"), str(where[-1])
    if kind == "modes" and given(body, "file"):  # which could not be read
        return
    at = table.get(key)
    if kind in LUMPED:
        if at is not None:
            yield fault(where, at, f"{shown(body['name'])} is a {kind}, which has no places", "leave it out")
        return
    points = body.get("points")
    right = {
        "modes": f"one of its points: {listed(points if isinstance(points, dict) else {})}",
        "membrane": f"[x, y], fractions of {'the square around it' if given(body, 'radius') else 'its sides'}",
        "plate": "[x, y], fractions of its sides",
    }.get(str(kind), "a fraction of its length, 0 to 1")
    if at is None:
        yield fault(where[:-1], table, f"no place on {shown(body['name'])}", f"give {key} = {right}")
        return
    items = at if isinstance(at, list) and count_places(table, key, body) == len(at) and not _pair(at, kind) else [at]
    if single and len(items) > 1:
        yield fault(where, at, "several places", f"give one: {right}")
    for item in items:
        if kind in SHEETS:
            fits = isinstance(item, list) and len(item) == 2 and all(map(number, item))
        elif kind == "modes":
            fits = isinstance(points, dict) and isinstance(item, str) and item in points
        else:
            fits = number(item)
        if not fits:
            yield fault(where, at, f"{shown(item)} is no place on {shown(body['name'])}", right)
            return
        if kind in SHEETS and given(body, "radius") and math.hypot(2 * item[0] - 1, 2 * item[1] - 1) > 1:
            outside = f"{shown(item)} lies outside the circle of {shown(body['name'])}"
            yield fault(where, at, outside, "[x, y] are fractions of the square around it, with [0.5, 0.5] its middle")
            return


def _pair(at: list[Any], kind: Any) -> bool:
    return kind in SHEETS and bool(at) and not isinstance(at[0], list)


def _contact(here: Where, contact: dict[str, Any], bodies: dict[str, Any]) -> Faults:
    on, barrier, gap = given(contact, "on"), given(contact, "barrier"), given(contact, "gap")
    own, other = bodies.get(str(contact.get("body"))), bodies.get(str(contact.get("on")))
    profile = next((key for key in ("bridge", "frets") if given(contact, key)), None)
    if gap and not on:
        yield fault((*here, "gap"), contact["gap"], "gap without on", "a fixed barrier is placed by barrier, in m")
    if on and barrier:
        right = "a contact between two bodies has a gap, not a barrier"
        yield fault((*here, "barrier"), contact["barrier"], "on and barrier given", right)
    yield from _hard((*here, "stiffness"), contact.get("stiffness"), contact.get("exponent"))
    if profile:
        yield from _profile(here, contact, own, profile)
        return
    if not on and not barrier:
        right = "give the barrier's position in m, the other body's name, a bridge or frets"
        yield fault(here, contact, "neither barrier nor on given", right)
    yield from _place((*here, "at"), contact, own, single=False)
    if on:
        yield from _place((*here, "on_at"), contact, other, single=False)
        if contact["on"] == contact.get("body") and _same_place(contact, own):
            yield fault((*here, "on"), contact["on"], "a body cannot touch itself at one place", "name another body")
    elif given(contact, "on_at"):
        yield fault((*here, "on_at"), contact["on_at"], "on_at without on", "name the other body by on")
    count = count_places(contact, "at", own)
    several = count_places(contact, "on_at", other) if on else 1
    if count > 1 and several > 1 and several != count:
        right = "as many places on both bodies, or one on one of them"
        yield fault((*here, "on_at"), contact["on_at"], f"{several} places for {count} in at", right)
    for key in ("barrier", "gap"):
        value = contact.get(key)
        if isinstance(value, list) and len(value) != max(count, several):
            right = "as many as places, or one number for all"
            yield fault((*here, key), value, f"{len(value)} numbers for {max(count, several)} place(s)", right)


def _hard(where: Where, stiffness: Any, exponent: Any) -> Faults:
    """No contact is harder than the engine can keep account of."""
    if number(stiffness) and number(exponent) and 1.0 <= exponent <= STEEPEST:
        if stiffness > hardest(exponent):
            right = f"at most {hardest(exponent):.3g} N/m^{exponent:g}, {HARDEST:g} N at 1 mm"
            yield fault(where, stiffness, f"{stiffness:g} is harder than anything", right)


def _same_place(contact: dict[str, Any], body: dict[str, Any] | None) -> bool:
    """Whether a contact of a body with itself joins a place with itself."""
    own, other = (
        contact[key] if count_places(contact, key, body) > 1 else [contact.get(key)] for key in ("at", "on_at")
    )
    count = max(len(own), len(other))
    return any(a == b for a, b in zip(own * (count // len(own)), other * (count // len(other)), strict=False))


def _profile(here: Where, contact: dict[str, Any], own: dict[str, Any] | None, profile: str) -> Faults:
    """A bridge or frets stand instead of at and barrier, under a string or bar."""
    for key in ("at", "on", "on_at", "barrier", "gap", "bridge" if profile == "frets" else "frets"):
        if given(contact, key):
            yield fault((*here, key), contact[key], f"{profile} and {key} given", "give one of them")
    if own is not None and own.get("kind") not in LINES:
        yield fault((*here, profile), contact[profile], f"{shown(own['name'])} has no length", "a string or a bar has")
    frets = contact[profile]
    if profile == "bridge":
        if isinstance(frets, dict) and own is not None and own.get("kind") in LINES:
            yield from _bridge((*here, profile), frets, own)
        return
    if not isinstance(frets, dict):
        return
    if given(frets, "count") == given(frets, "at"):
        what = "both count and at given" if given(frets, "at") else "neither count nor at given"
        yield fault((*here, "frets"), frets, what, "give one of them: a number of frets, or their places")
        return
    count = frets["count"] if given(frets, "count") else len(frets["at"]) if isinstance(frets["at"], list) else 0
    height = frets.get("height")
    row = isinstance(height, list) and len(height) == 2 and number(count) and count > 2
    if isinstance(height, list) and len(height) != count and not row:
        right = f"{count}, or 2 for a straight row of more"
        yield fault((*here, "frets", "height"), height, f"{len(height)} heights for {count} frets", right)
    at = frets.get("at")
    if row and isinstance(at, list) and at[0] == at[-1]:
        right = "give a height for each"
        yield fault((*here, "frets", "height"), height, "no straight row: it begins and ends at one place", right)


def _bridge(where: Where, bridge: dict[str, Any], own: dict[str, Any]) -> Faults:
    at, width, length = bridge.get("at"), bridge.get("width"), own.get("length", 0.0)
    if all(map(number, (at, width, length))) and length > 0:
        half = width / length / 2
        if at - half < 0 or at + half > 1:
            right = f"{shown(own['name'])} is {length:g} m long"
            yield fault((*where, "width"), width, "the bridge reaches past the end", right)


def _event(here: Where, event: dict[str, Any], bodies: dict[str, Any], contacts: dict[str, Any]) -> Faults:
    kind, body = event.get("kind"), bodies.get(str(event.get("body")))
    if kind == "strike" and body is not None and body.get("kind") not in LUMPED:
        right = "throw a mass or an oscillator; a force or pluck moves other bodies"
        yield fault((*here, "body"), event["body"], f"{shown(event['body'])} is a {body.get('kind')}", right)
    if kind != "change":
        return
    yield from _named((*here, "contact"), event.get("contact"), contacts, "contact", "named contacts")
    if not any(given(event, key) for key in ("stiffness", "exponent", "barrier", "gap")):
        yield fault(here, event, "nothing changes", "give a new stiffness, exponent, barrier or gap")
    contact = contacts.get(str(event.get("contact")), {})
    stiffness, exponent = (event.get(key, contact.get(key)) for key in ("stiffness", "exponent"))
    key = "stiffness" if given(event, "stiffness") else "exponent"
    yield from _hard((*here, key), stiffness, exponent)
    for key, wrong in (("barrier", given(contact, "on")), ("gap", bool(contact) and not given(contact, "on"))):
        if given(event, key) and wrong:
            right = f"{shown(event['contact'])} has a {'gap' if key == 'barrier' else 'barrier'}"
            yield fault((*here, key), event[key], f"that contact has no {key}", right)
