"""Rules that only the whole patch can break: names, positions on bodies, keys that exclude or need each other.

A patch is checked as it was read, before it is validated, so that all its faults are listed at once. What has the wrong
type is passed over here: that is a fault of structure, and pydantic reports it.
"""

from collections.abc import Iterator
from typing import Any

from pydantic_core import InitErrorDetails

from engine.bodies import String
from engine.bodies.distributed import DistributedBody
from engine.bodies.table import KeyPath, is_given, is_number, make_fault
from engine.patch.connection_rules import absent_in_connection, check_connections, find_rigid_joint
from engine.patch.event_rules import check_event, check_stiffness
from engine.patch.force_rules import check_force
from engine.patch.friction import absent_in_friction, check_friction
from engine.patch.live_parameters import GLIDED_KEYS
from engine.patch.pickup_rules import check_pickup
from engine.patch.positions import check_positions, count_positions, kind_of, tables_of
from engine.patch.restitution import check_restitution
from engine.wording import format_names, format_value

Faults = Iterator[InitErrorDetails]

BODY_KEYS = (
    *(("contact", "body"), ("contact", "on"), ("connection", "body"), ("connection", "on")),
    *(("friction", "body"), ("friction", "on")),
    *(("force", "body"), ("event", "body"), ("pickup", "body")),
)


def _named_tables(data: dict[str, Any], section: str) -> dict[str, dict[str, Any]]:
    """Return the tables of a section that have names, by these."""
    return {table["name"]: table for _, table in tables_of(data, section) if isinstance(table.get("name"), str)}


def check_rules(data: dict[str, Any]) -> Faults:
    """All faults of a document that break these rules."""
    bodies = _named_tables(data, "body")
    absent = {"contact": _absent_in_contact, "connection": absent_in_connection, "friction": absent_in_friction}
    sections = {section: (_named_tables(data, section), absent[section]) for section in GLIDED_KEYS}
    for section in ("body", "contact", "connection", "friction", "pickup"):
        yield from _check_unique(data, section)
    for i, body in tables_of(data, "body"):
        yield from _check_body(("body", i), body)
    yield from _check_bodies_exist(data, bodies)
    for i, body in tables_of(data, "body"):
        for j, support in tables_of(body, "support"):
            yield from check_positions(("body", i, "support", j, "at"), support, body, single=False)
        for key in ("displacement", "velocity"):
            if isinstance(body.get(key), dict) and is_given(body[key], "at"):
                yield from check_positions(("body", i, key, "at"), body[key], body, single=True)
    for i, contact in tables_of(data, "contact"):
        yield from _check_contact(("contact", i), contact, bodies)
    yield from check_connections(data, bodies)
    for i, friction in tables_of(data, "friction"):
        yield from check_friction(("friction", i), friction, bodies, sections["contact"][0])
        yield from _check_angle(("friction", i, "angle"), friction, bodies.get(str(friction.get("body"))))
    end = data.get("seconds", 2.0)
    for i, event in tables_of(data, "event"):
        time = event.get("time")
        if is_number(time) and is_number(end) and time >= end:
            yield make_fault(
                ("event", i, "time"), time, "after the end", f"give a time before {end:g} s, or more seconds"
            )
        yield from check_event(("event", i), event, bodies, sections)
        if event.get("kind") == "strike" and find_rigid_joint(event.get("body"), data):
            message = f"a rigid joint holds {format_value(event['body'])}, which cannot be launched"
            yield make_fault(("event", i, "body"), event["body"], message, "give the joint a stiffness, or use a force")
    for i, force in tables_of(data, "force"):
        yield from check_force(("force", i), force)
    for section in ("force", "event", "pickup"):
        for i, table in tables_of(data, section):
            target = bodies.get(str(table.get("body")))
            yield from _check_angle((section, i, "angle"), table, target)
            if section == "pickup":
                yield from check_pickup((section, i), table, target)
            elif section != "event" or table.get("kind") == "pluck":
                yield from check_positions((section, i, "at"), table, target, single=True)


def _check_angle(path: KeyPath, table: dict[str, Any], body: dict[str, Any] | None) -> Faults:
    """Only a string with two polarisations has another direction."""
    if not table.get("angle") or kind_of(body) is None or body is None:
        return
    if table.get("quantity") in ("force", "end_force"):
        yield make_fault(path, table["angle"], f"{table['quantity']} and angle are both given", "leave out the angle")
    elif kind_of(body) is not String:
        message = f"{format_value(body['name'])} is a {body['kind']}, which moves in one direction"
        yield make_fault(path, table["angle"], message, "leave out the angle; only a string can move in two")
    elif body.get("polarisations", 1) == 1:
        message = f"{format_value(body['name'])} moves in one direction"
        yield make_fault(path, table["angle"], message, "leave out the angle, or give the string polarisations = 2")


def has_length(body: dict[str, Any]) -> bool:
    """True if a table describes a string or a bar."""
    kind = kind_of(body)
    return kind is not None and kind.HAS_LENGTH


def _check_unique(data: dict[str, Any], section: str) -> Faults:
    """Each table of a section has a name of its own."""
    names: set[str] = set()
    for i, table in tables_of(data, section):
        name = table.get("name")
        if isinstance(name, str) and name in names:
            message, remedy = f"the name {format_value(name)} is taken", f"give each {section} its own name"
            yield make_fault((section, i, "name"), name, message, remedy)
        elif isinstance(name, str):
            names.add(name)


def _check_bodies_exist(data: dict[str, Any], bodies: dict[str, Any]) -> Faults:
    """Bodies that tables name are there; of those that are not, each is one fault, however many tables name it."""
    users: dict[str, list[KeyPath]] = {}
    for section, key in BODY_KEYS:
        for i, table in tables_of(data, section):
            if isinstance(table.get(key), str) and table[key] not in bodies:
                users.setdefault(table[key], []).append((section, i, key))
    for name, paths in users.items():
        message = f"no body is named {format_value(name)}"
        message += ", which several tables name" if len(paths) > 1 else ""
        yield make_fault(paths[0], name, message, f"the bodies are {format_names(bodies)}")


def _check_body(path: KeyPath, body: dict[str, Any]) -> Faults:
    """A body gives one key of each pair, and keeps the rules of its kind."""
    kind = kind_of(body)
    if kind is None:
        return
    for *keys, choice in kind.EXACTLY_ONE_OF:
        given = [key for key in keys if is_given(body, key)]
        if len(given) != 1:
            message = f"both {' and '.join(given[:2])} are given" if given else f"neither {' nor '.join(keys)} is given"
            yield make_fault(path, body, message, f"give one of them: {choice}")
    for a, b in kind.AT_MOST_ONE_OF:
        if is_given(body, a) and is_given(body, b):
            yield make_fault((*path, b), body[b], f"both {a} and {b} are given", "give one of them")
    yield from kind.faults(path, body)


def _check_contact(path: KeyPath, contact: dict[str, Any], bodies: dict[str, Any]) -> Faults:
    """A contact is with a barrier, a body, a bridge or frets, and gives the keys of that alone."""
    on, barrier, gap = is_given(contact, "on"), is_given(contact, "barrier"), is_given(contact, "gap")
    body = bodies.get(str(contact.get("body")))
    profile = next((key for key in ("bridge", "frets") if is_given(contact, key)), None)
    if gap and not on:
        remedy = "give the position of a fixed barrier by barrier, in m"
        yield make_fault((*path, "gap"), contact["gap"], "gap is given without on", remedy)
    if on and barrier:
        remedy = "a contact between two bodies has a gap, not a barrier"
        yield make_fault((*path, "barrier"), contact["barrier"], "on and barrier are both given", remedy)
    yield from check_stiffness((*path, "stiffness"), contact.get("stiffness"), contact.get("exponent"))
    other = next((key for key in ("restitution", "loss") if contact.get(key)), None)
    if other and is_given(contact, "relaxation"):
        yield make_fault((*path, other), contact[other], f"{other} and relaxation are both given", "give one of them")
    yield from check_restitution(path, contact, body)
    if profile:
        yield from _check_profile(path, contact, body, profile)
        return
    if not on and not barrier:
        remedy = "give the barrier's position in m, the other body's name, a bridge or frets"
        yield make_fault(path, contact, "neither barrier nor on is given", remedy)
    other_body = bodies.get(str(contact.get("on")))
    kinds = [kind_of(one) for one in (body, other_body) if one is not None]
    if contact.get("radius") and kinds and not any(kind is None or issubclass(kind, DistributedBody) for kind in kinds):
        message = "neither body has a shape between its points to take the mean of"
        yield make_fault((*path, "radius"), contact["radius"], message, "leave it out")
    yield from _check_contact_positions(path, contact, body, other_body)


def _check_contact_positions(
    path: KeyPath, contact: dict[str, Any], body: dict[str, Any] | None, other_body: dict[str, Any] | None
) -> Faults:
    """The points of a contact are on its bodies, and its lists are as long as these are many."""
    on = is_given(contact, "on")
    yield from check_positions((*path, "at"), contact, body, single=False)
    if on:
        yield from check_positions((*path, "on_at"), contact, other_body, single=False)
        if contact["on"] == contact.get("body") and _joins_same_position(contact, body):
            message = "a body cannot touch itself at one position"
            yield make_fault((*path, "on"), contact["on"], message, "name another body")
    elif is_given(contact, "on_at"):
        yield make_fault((*path, "on_at"), contact["on_at"], "on_at is given without on", "name the other body by on")
    count = count_positions(contact, "at", body)
    other_count = count_positions(contact, "on_at", other_body) if on else 1
    if count > 1 and other_count > 1 and other_count != count:
        remedy = "give as many positions on both bodies, or one on one of them"
        yield make_fault((*path, "on_at"), contact["on_at"], f"{other_count} positions for {count} in at", remedy)
    points = max(count, other_count)
    for key in ("barrier", "gap"):
        value = contact.get(key)
        if isinstance(value, list) and len(value) != points:
            remedy = "give one number for each position, or one for all"
            yield make_fault((*path, key), value, f"{len(value)} numbers for {points} position(s)", remedy)


def _absent_in_contact(contact: dict[str, Any]) -> dict[str, str]:
    """Return the key that a contact lacks, and what it has instead."""
    return {"barrier": "has a gap"} if is_given(contact, "on") else {"gap": "has a barrier"}


def _joins_same_position(contact: dict[str, Any], body: dict[str, Any] | None) -> bool:
    """True if a contact of a body with itself joins a position with itself."""
    at, on_at = (
        contact[key] if count_positions(contact, key, body) > 1 else [contact.get(key)] for key in ("at", "on_at")
    )
    count = max(len(at), len(on_at))
    return any(a == b for a, b in zip(at * (count // len(at)), on_at * (count // len(on_at)), strict=False))


def _check_profile(path: KeyPath, contact: dict[str, Any], body: dict[str, Any] | None, profile: str) -> Faults:
    """A bridge or frets stand under a string or bar, instead of at and barrier. profile: the key of the two."""
    for key in ("at", "on", "on_at", "barrier", "gap", "radius", "bridge" if profile == "frets" else "frets"):
        if is_given(contact, key):
            yield make_fault((*path, key), contact[key], f"{profile} and {key} are both given", "give one of them")
    if body is not None and kind_of(body) is not None and not has_length(body):
        message = f"{format_value(body['name'])} has no length"
        yield make_fault((*path, profile), contact[profile], message, "give a string or a bar")
    table = contact[profile]
    if not isinstance(table, dict):
        return
    if profile == "frets":
        yield from _check_frets((*path, profile), table)
    elif body is not None and has_length(body):
        yield from _check_bridge((*path, profile), table, body)


def _check_frets(path: KeyPath, frets: dict[str, Any]) -> Faults:
    """Frets are counted or placed, and their heights are one for all, one for each, or those of the two ends."""
    if is_given(frets, "count") == is_given(frets, "at"):
        message = "both count and at are given" if is_given(frets, "at") else "neither count nor at is given"
        yield make_fault(path, frets, message, "give one of them: a number of frets, or their positions")
        return
    count = frets["count"] if is_given(frets, "count") else len(frets["at"]) if isinstance(frets["at"], list) else 0
    at, height = frets.get("at"), frets.get("height")
    is_row = isinstance(height, list) and len(height) == 2 and is_number(count) and count > 2
    if isinstance(height, list) and len(height) != count and not is_row:
        remedy = f"give {count}, or 2 for a straight row"
        yield make_fault((*path, "height"), height, f"{len(height)} heights for {count} frets", remedy)
    if is_row and isinstance(at, list) and at[0] == at[-1]:
        message = "not a straight row: it begins and ends at one position"
        yield make_fault((*path, "height"), height, message, "give a height for each")


def _check_bridge(path: KeyPath, bridge: dict[str, Any], body: dict[str, Any]) -> Faults:
    """A bridge lies within its string or bar."""
    at, width, length = bridge.get("at"), bridge.get("width"), body.get("length", 0.0)
    if all(map(is_number, (at, width, length))) and length > 0:
        half = width / length / 2
        if at - half < 0 or at + half > 1:
            remedy = f"{format_value(body['name'])} is {length:g} m long"
            yield make_fault((*path, "width"), width, "the bridge extends beyond the end", remedy)
