"""Several copies of a scene beside each other, each at a pitch of its own."""

from typing import Any

from engine.assembly.build import build
from engine.bodies import Bar, Body, Mass, Oscillator, String, Tube
from engine.bodies.distributed import DistributedBody
from engine.patch.scene import Scene, connected_bodies
from engine.patch.tables import Force, HalfSineForce, PluckEvent, PluckForce, PulseForce, StrikeEvent


def joined_bodies(scene: Scene, name: str) -> set[str]:
    """The names of a body and of all bodies that connections join with it, directly or through others."""
    names, size = {name}, 0
    while size < len(names):
        size = len(names)
        for c in scene.connection:
            if c.on is not None and names & {c.body, c.on}:
                names |= {c.body, c.on}
    return names


def sounding_bodies(scene: Scene) -> list[str]:
    """The bodies whose pitch is that of the scene: those with a pickup; and where strings, bars or tubes are joined
    with these, as with a board or the air in it, these alone."""
    names: list[str] = []
    for pickup in scene.pickup:
        joined = joined_bodies(scene, pickup.body)
        names += [b.name for b in scene.body if b.name in joined and isinstance(b, String | Bar | Tube)] or [
            pickup.body
        ]
    return list(dict.fromkeys(names))


def retune(scene: Scene, ratio: float, names: set[str] | None = None) -> Scene:
    """The scene with some bodies at another pitch: those named, or else those that sound."""
    chosen = set(sounding_bodies(scene)) if names is None else names
    return scene.model_copy(update={"body": [b.retuned(ratio) if b.name in chosen else b for b in scene.body]})


def tuned_bodies(scene: Scene, name: str) -> set[str]:
    """The bodies that get the pitch of a note for one of them: that one, and those with a pickup joined to it."""
    return (connected_bodies(scene, name) & set(sounding_bodies(scene))) | {name}


def with_chosen_residuals(scene: Scene, samplerate: float) -> Scene:
    """The scene with residual modes where its own pitch wants them: so all pitches of a voice have as many."""
    modal = build(scene, samplerate).layout.modal_bodies
    bodies = [
        body.model_copy(update={"residual": found.residual > 0}) if isinstance(body, DistributedBody) else body
        for body, found in zip(scene.body, modal, strict=True)
    ]
    return scene.model_copy(update={"body": bodies})


def at_rest(body: Body) -> Body:
    """The body without what the patch gives it at time 0; hammers stay where they are."""
    still: dict[str, Any] = {"velocity": 0.0} if isinstance(body, Mass | Oscillator) else {}
    if isinstance(body, DistributedBody):
        still = {"displacement": None, "velocity": None}
    return body.model_copy(update=still)


def replicate(scene: Scene, voices: int) -> Scene:
    """So many copies of a scene beside each other, all at rest: no score, plucks and hammers that wait to be told.
    Copy n of body `b` is `b_n`; contacts likewise."""
    joining = ("contact", "connection", "friction", "pickup")
    parts: dict[str, list[Any]] = {section: [] for section in ("body", *joining, "force")}
    waiting = [f.model_copy(update={"start": 0.0}) for b in scene.body for f in plucks(scene, b.name)]
    for n in range(voices):
        for body in scene.body:
            parts["body"].append(at_rest(body).model_copy(update={"name": f"{body.name}_{n}"}))
        for section in joining:
            for joined in getattr(scene, section):
                keys = ("name", "body", "on", "contact")
                names = {key: f"{name}_{n}" for key in keys if (name := getattr(joined, key, None))}
                parts[section].append(joined.model_copy(update=names))
        parts["force"] += [f.model_copy(update={"body": f"{f.body}_{n}"}) for f in waiting]
    return scene.model_copy(update=parts | {"event": []})


def plucks(scene: Scene, name: str) -> list[Force]:
    """The forces that pluck or strike a body and are then over; if there is none, the first pluck of the score."""
    forces: list[Force] = [
        f for f in scene.force if f.body == name and isinstance(f, PluckForce | PulseForce | HalfSineForce)
    ]
    pluck_events = [e for e in scene.event if isinstance(e, PluckEvent) and e.body == name]
    return forces or [PluckForce(kind="pluck", **e.model_dump(exclude={"kind", "time"})) for e in pluck_events[:1]]


def strikers(scene: Scene, name: str) -> list[str]:
    """The hammers that are thrown at a body."""
    ends = [{c.body, c.on} for c in scene.contact if name in (c.body, c.on)]
    return [hammer for hammer in striker_velocities(scene) if hammer != name and any(hammer in both for both in ends)]


def striker_velocities(scene: Scene) -> dict[str, float]:
    """The hammers of a scene and their velocities: masses and oscillators that are thrown, at first or by an event."""
    forces = {b.name: b.velocity for b in scene.body if isinstance(b, Mass | Oscillator) and b.velocity}
    for event in scene.event:
        if isinstance(event, StrikeEvent):
            forces.setdefault(event.body, event.velocity)
    return forces
