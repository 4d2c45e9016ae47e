"""Bows in a patch: the table `[[bow]]`, a short form of `[[friction]]` and of the events that move it."""

from collections.abc import Iterator
from itertools import pairwise
from typing import Any, Literal

from pydantic import Field, ValidationError
from pydantic_core import InitErrorDetails

from engine.bodies.table import KeyPath, Name, Positions, Table, make_fault
from engine.patch.friction import Bristle, BristleDamping, Curve, Dynamic, Force, Memory, Speed, Static, Viscous
from engine.patch.tables import ANGLE, MAX_ENVELOPE_POINTS, MAX_SECONDS, Angle, EnvelopePoint, Seconds

MAX_STROKES = 1_000
JOINED = 1e-3  # s: strokes with less between them are one motion, in which the bow stays on the string
Faults = Iterator[InitErrorDetails]
Origins = dict[tuple[str, int], tuple[KeyPath, str]]
Envelope = list[EnvelopePoint]


class Stroke(Table):
    """A stroke of a bow. The bow is lifted at its end, unless another stroke begins there."""

    time: Seconds = Field(description="time of the stroke, s")
    duration: float = Field(gt=0.0, le=MAX_SECONDS, description="duration, s")
    direction: Literal["down", "up"] | None = Field(
        default=None, description="direction; if absent, against the stroke before; the first is down"
    )
    velocity: float | None = Field(default=None, ge=0.0, le=100.0, description="speed, m/s; that of the bow if absent")
    force: Force | None = Field(default=None, description="force, N; that of the bow if absent")
    attack: Seconds = Field(default=0.03, description="time in which speed and force are reached, s")
    release: Seconds = Field(default=0.03, description="time at its end in which the bow is slowed and lifted, s")
    velocity_envelope: Envelope | None = Field(
        default=None,
        min_length=1,
        max_length=MAX_ENVELOPE_POINTS,
        description="[[seconds after its start, factor of the speed], …], with glides between them; instead of attack"
        " and release",
    )
    force_envelope: Envelope | None = Field(
        default=None,
        min_length=1,
        max_length=MAX_ENVELOPE_POINTS,
        description="[[seconds after its start, factor of the force], …], likewise",
    )


class Bow(Table):
    """A bow on a body: short for a [[friction]] of the same name, with events for its strokes."""

    name: Name = Field(description="name of it, which events and controls use as that of a friction")
    body: Name = Field(description="body that is bowed")
    at: Positions = Field(default=None, description="position on the body: of a string, from one of its ends")
    angle: Angle = Field(default=0.0, description=f"direction in which it moves, rad; {ANGLE}")
    velocity: float = Field(
        default=0.0, ge=-100.0, le=100.0, description="velocity, m/s: that of a stroke, or of the bow all the time"
    )
    force: Force = Field(default=0.0, description="force that presses the bow on the body, N; likewise")
    static: Static
    dynamic: Dynamic
    speed: Speed
    memory: Memory
    curve: Curve
    viscous: Viscous
    bristle: Bristle
    bristle_damping: BristleDamping
    strokes: list[Stroke] = Field(
        default=[],
        max_length=MAX_STROKES,
        description="strokes in the order of time; without any, it moves all the time",
    )


def expand_bows(document: dict[str, Any], is_score_of_keys: bool, origins: Origins) -> tuple[dict[str, Any], list[Any]]:
    """Write the bows of a document out as friction and events; and list their faults. Bows with faults of structure
    stay, for pydantic to report them.

    is_score_of_keys: the events are those of the keys of an instrument, and bows have no strokes
    origins: where in the patch tables come from that were written out; those of the bows are added
    """
    bows, kept, faults = document.get("bow"), list[Any](), list[Any]()
    if not isinstance(bows, list):
        return document, faults
    frictions, events = (list(document.get(section) or []) for section in ("friction", "event"))
    end = document.get("seconds", 2.0)
    for i, table in enumerate(bows):
        path, key = origins.get(("bow", i), (("bow", i), ""))
        try:
            bow = Bow.model_validate(table)
        except ValidationError:
            origins["bow", len(kept)] = path, key
            kept.append(table)
            continue
        wrong = list(_check_strokes(path, bow, is_score_of_keys))
        faults += wrong
        origins["friction", len(frictions)] = path, key
        frictions.append(_friction_of(bow, table))
        for number, event in stroke_events(bow) if not wrong else ():
            is_start = event["time"] == bow.strokes[number].time
            if is_start or not isinstance(end, int | float) or event["time"] < end:  # its end may lie beyond
                origins["event", len(events)] = (*path, "strokes", number), key
                events.append(event)
    written = {"bow": kept, "friction": frictions, "event": events}
    return {k: v for k, v in document.items() if k not in written} | {k: v for k, v in written.items() if v}, faults


def _friction_of(bow: Bow, table: dict[str, Any]) -> dict[str, Any]:
    """Return the friction of a bow as a table: with strokes, the bow is lifted until the first."""
    lifted = {"velocity": 0.0, "force": 0.0} if bow.strokes else {"velocity": bow.velocity, "force": bow.force}
    return {key: value for key, value in table.items() if key != "strokes"} | lifted


def stroke_events(bow: Bow) -> Iterator[tuple[int, dict[str, Any]]]:
    """Yield the events of the strokes of a bow, each with the number of its stroke."""
    sign = -1.0
    for n, stroke in enumerate(bow.strokes):
        sign = {"down": 1.0, "up": -1.0, None: -sign}[stroke.direction]
        speed = bow.velocity if stroke.velocity is None else stroke.velocity
        force = bow.force if stroke.force is None else stroke.force
        is_lifted = n + 1 == len(bow.strokes) or bow.strokes[n + 1].time > _end(stroke) + JOINED
        glides: dict[tuple[float, float], dict[str, float]] = {}  # by when they begin and how long they take
        for key, full, envelope in (
            ("velocity", sign * speed, stroke.velocity_envelope),
            ("force", force, stroke.force_envelope),
        ):
            for begin, duration, factor in _glides(stroke, envelope, is_lifted):
                glides.setdefault((begin, duration), {})[key] = 0.0 + factor * full  # no -0
        for (begin, duration), values in glides.items():
            yield n, {"kind": "change", "time": begin, "friction": bow.name, "duration": duration} | values


def _glides(stroke: Stroke, envelope: Envelope | None, is_lifted: bool) -> Iterator[tuple[float, float, float]]:
    """Yield when each glide of a stroke begins, s, its duration, s, and the factor that it ends at."""
    if envelope is None:
        yield stroke.time, stroke.attack, 1.0
        if is_lifted:
            yield _end(stroke) - stroke.release, stroke.release, 0.0
        return
    before = 0.0
    for seconds, factor in envelope:
        yield stroke.time + before, seconds - before, factor
        before = seconds


def _end(stroke: Stroke) -> float:
    return stroke.time + stroke.duration


def _check_strokes(path: KeyPath, bow: Bow, is_score_of_keys: bool) -> Faults:
    """Strokes follow each other, and each has a speed, a force and the time for its attack and release."""
    if bow.strokes and is_score_of_keys:
        remedy = "move the bow by [[key.on]] and [[key.off]], events of kind change with its name as friction"
        yield make_fault((*path, "strokes"), "strokes", "the bow of an instrument has no strokes", remedy)
        return
    if bow.strokes and bow.velocity < 0.0:
        remedy = 'give the speed, and direction = "up" in the strokes'
        yield make_fault((*path, "velocity"), bow.velocity, "a bow with strokes has a negative velocity", remedy)
    for n, stroke in enumerate(bow.strokes):
        place = (*path, "strokes", n)
        for key in ("velocity", "force"):
            if getattr(stroke, key) is None and getattr(bow, key) == 0.0:
                remedy = f"give the stroke or the bow a {key}"
                yield make_fault((*place, key), None, f"the stroke has no {key}", remedy)
        yield from _check_envelopes(place, stroke)
    for n, (former, stroke) in enumerate(pairwise(bow.strokes), 1):
        if stroke.time < _end(former) - JOINED:
            message, remedy = f"the one before it ends at {_end(former):g} s", "give strokes in order, one at a time"
            yield make_fault((*path, "strokes", n, "time"), stroke.time, message, remedy)


def _check_envelopes(path: KeyPath, stroke: Stroke) -> Faults:
    """The attack, the release and the envelopes of a stroke fit into it."""
    given = [envelope for envelope in (stroke.velocity_envelope, stroke.force_envelope) if envelope is not None]
    if len(given) < 2 and stroke.attack + stroke.release > stroke.duration:
        message = f"attack and release take {stroke.attack + stroke.release:g} s, and the stroke {stroke.duration:g} s"
        yield make_fault((*path, "duration"), stroke.duration, message, "give a shorter attack or release")
    for key in ("velocity_envelope", "force_envelope"):
        points = getattr(stroke, key) or []
        times = [point[0] for point in points]
        if any(later <= earlier for earlier, later in pairwise(times)) or any(time < 0.0 for time in times):
            remedy = "start at 0 or later, each point later than the one before"
            yield make_fault((*path, key), points, "its times do not increase", remedy)
        elif times and times[-1] > stroke.duration:
            message = f"it goes on after the stroke, which takes {stroke.duration:g} s"
            yield make_fault((*path, key), points, message, "give earlier times, or a longer stroke")
        if any(point[1] < 0.0 for point in points):
            remedy = "give 0 or more; direction says which way it goes"
            yield make_fault((*path, key), points, "a factor is negative", remedy)
