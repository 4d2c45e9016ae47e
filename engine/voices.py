"""Several copies of a scene, each at a pitch of its own, and how the tables of one are made those of another pitch."""

from collections.abc import Iterator
from typing import Any

import numpy as np

from engine.layout import Layout
from engine.model import Model, Rows
from engine.parts import (
    Bar,
    Body,
    Force,
    HalfSine,
    Mass,
    Membrane,
    Modes,
    Oscillator,
    Plate,
    Pluck,
    PluckAgain,
    Pulse,
    Strike,
    String,
)
from engine.scene import Scene

# what makes a body's pitch, and how it goes with the ratio of frequencies
PITCH: dict[type, dict[str, int]] = {
    String: {"frequency": 1, "tension": 2, "bending": 2},
    Bar: {"frequency": 1, "bending": 2},
    Membrane: {"frequency": 1, "tension": 2},
    Plate: {"frequency": 1, "rigidity": 2},
    Oscillator: {"frequency": 1, "stiffness": 2},
    Modes: {"frequency": 1},
}


def tuned(scene: Scene, ratio: float, names: set[str] | None = None) -> Scene:
    """The scene with some bodies at another pitch: those named, or else those that are heard."""
    chosen = {p.body for p in scene.pickup} if names is None else names
    return scene.model_copy(update={"body": [_tuned(b, ratio) if b.name in chosen else b for b in scene.body]})


def _tuned(body: Body, ratio: float) -> Any:
    changed: dict[str, Any] = {}
    for key, power in PITCH.get(type(body), {}).items():
        value = getattr(body, key)
        if isinstance(value, list):
            changed[key] = [v * ratio**power for v in value]
        elif value is not None:
            changed[key] = value * ratio**power
    return body.model_copy(update=changed)


def polyphonic(scene: Scene, voices: int) -> Scene:
    """So many copies of a scene beside each other, all at rest: no score, plucks and hammers that wait to be told.
    Copy n of body `b` is `b_n`; contacts likewise."""
    parts: dict[str, list[Any]] = {"body": [], "contact": [], "pickup": [], "force": []}
    waiting = [f.model_copy(update={"start": 0.0}) for b in scene.body for f in plucks(scene, b.name)]
    for n in range(voices):
        for body in scene.body:
            still = {"velocity": 0.0} if isinstance(body, Mass | Oscillator) else {}
            parts["body"].append(body.model_copy(update={"name": f"{body.name}_{n}"} | still))
        for contact in scene.contact:
            names = {key: f"{name}_{n}" for key in ("name", "body", "on") if (name := getattr(contact, key))}
            parts["contact"].append(contact.model_copy(update=names))
        parts["pickup"] += [p.model_copy(update={"body": f"{p.body}_{n}"}) for p in scene.pickup]
        parts["force"] += [f.model_copy(update={"body": f"{f.body}_{n}"}) for f in waiting]
    return scene.model_copy(update=parts | {"event": []})


def plucks(scene: Scene, name: str) -> list[Force]:
    """The forces that pluck or strike a body and are then over; if there is none, the first pluck of the score."""
    found: list[Force] = [f for f in scene.force if f.body == name and isinstance(f, Pluck | Pulse | HalfSine)]
    again = [e for e in scene.event if isinstance(e, PluckAgain) and e.body == name]
    return found or [Pluck(kind="pluck", **e.model_dump(exclude={"kind", "time"})) for e in again[:1]]


def strikers(scene: Scene, name: str) -> list[str]:
    """The hammers that are thrown at a body."""
    ends = [{c.body, c.on} for c in scene.contact if name in (c.body, c.on)]
    return [hammer for hammer in thrown(scene) if hammer != name and any(hammer in both for both in ends)]


def thrown(scene: Scene) -> dict[str, float]:
    """The hammers of a scene and their velocities: masses and oscillators that are thrown, at first or by an event."""
    found = {b.name: b.velocity for b in scene.body if isinstance(b, Mass | Oscillator) and b.velocity}
    for event in scene.event:
        if isinstance(event, Strike):
            found.setdefault(event.body, event.velocity)
    return found


def copies(to: tuple[Model, Layout], of: tuple[Model, Layout], voice: int) -> np.ndarray:
    """What has to be copied so that a voice of a polyphonic model is as the only one of another: addresses to copy
    to and from, and how many numbers [n, 3]. Modes that the other has not, for they would be above what the sample
    rate carries, are made such that nothing moves or hears them."""
    found = [(a.ctypes.data, b.ctypes.data, b.size) for a, b in _pairs(to, of, voice) if b.size]
    return np.array(found, np.int64).reshape(-1, 3)


NOTHING, ONES = np.zeros(20_000), np.ones(20_000)


def _pairs(to: tuple[Model, Layout], of: tuple[Model, Layout], voice: int) -> Iterator[tuple[np.ndarray, np.ndarray]]:
    """Arrays to write and arrays to read."""
    (poly, wide), (single, narrow) = to, of
    bodies, islands = len(narrow.scene.body), max(narrow.island) + 1
    for b in range(bodies):
        here, there = wide.place_of(voice * bodies + b), narrow.place_of(b)
        count = min(here.stop - here.start, there.stop - there.start)
        for slot in ("modes", "spring", "loss", "drag"):
            ours, theirs = getattr(poly, slot), getattr(single, slot)
            if theirs is not None and ours is None:
                raise ValueError(f"the voices have no room for its {slot}")
            if theirs is None and ours is not None:
                theirs = type(ours)(*((ONES, NOTHING) if slot in ("loss", "drag") else (NOTHING,) * len(ours)))
            for a, x in zip(ours or (), theirs or (), strict=True):
                yield a[here.start : here.start + count], x[there.start : there.start + count]
    for i in range(islands):
        n = voice * islands + i
        for kind in ("contact", "force", "pickup", "body"):
            ours, theirs = (getattr(model.islands, kind) for model in (poly, single))
            for a, x in zip(_all_rows(poly, kind), _all_rows(single, kind), strict=True):
                for r in range(theirs[i + 1] - theirs[i]):
                    yield from _rows(a, x, int(ours[n]) + r, int(theirs[i]) + r)
        if poly.contact is not None and single.contact is not None:
            here, there = (slice(*model.islands.contact[[m, m + 1]]) for model, m in ((poly, n), (single, i)))
            yield poly.contact.compliance[here], single.contact.compliance[there]
            yield poly.contact.beneath[here], single.contact.beneath[there]
        if poly.coupling is not None and single.coupling is not None:
            here, there = (slice(*c.begin[[m, m + 1]]) for c, m in ((poly.coupling, n), (single.coupling, i)))
            yield poly.coupling.matrix[here], single.coupling.matrix[there]


def _all_rows(model: Model, kind: str) -> list[Rows]:
    """The rows of a model that go with its contacts, pickups or bodies."""
    if kind == "contact":
        ends = [model.contact.rows if model.contact is not None else None, model.partner]
        return [rows for rows in ends if rows is not None]
    if kind == "force":
        return [model.force.rows] if model.force is not None else []
    return [model.pickups.rows if kind == "pickup" else model.bodies]


def _rows(to: Rows, of: Rows, r: int, s: int) -> Iterator[tuple[np.ndarray, np.ndarray]]:
    """A row of shapes, kicks and drifts."""
    begin, size = int(to.at[r]), int(to.last[r]) - int(to.first[r])
    start, count = int(of.at[s]), min(size, int(of.last[s]) - int(of.first[s]))
    for a, x in ((to.shape, of.shape), (to.kick, of.kick), (to.drift, of.drift)):
        yield a[begin : begin + count], x[start : start + count]
        yield a[begin + count : begin + size], NOTHING[: size - count]
