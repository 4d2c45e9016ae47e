"""One note of a patch without a keyboard, as a scene: what a voice of a player sounds like, alone and rendered."""

from typing import Any

from engine.live.voice_allocator import (
    NOMINAL_VELOCITY,
    RELEASE_DAMPER,
    VELOCITY_EXPONENT,
    PitchedBody,
    nearest_body,
    pitched_bodies,
)
from engine.live.voices import at_rest, plucks, retune, sounding_bodies, striker_velocities, tuned_bodies
from engine.patch.scene import Scene
from engine.patch.tables import DampEvent, Event, Force, StrikeEvent


def scene_of_voice(scene: Scene, key: int, velocity: int, hold: float, seconds: float) -> Scene:
    """The scene in which the body whose pitch is nearest sounds a note, tuned to it, and all else is at rest.

    hold: how long the key is down, s; seconds: how long the scene is
    Raises MidiError if nothing in it can be tuned.
    """
    body = nearest_body(pitched_bodies(scene), key)
    tuned = retune(scene, body.ratio(key), tuned_bodies(scene, body.body))
    share = (velocity / NOMINAL_VELOCITY) ** VELOCITY_EXPONENT
    changed: dict[str, Any] = {"seconds": seconds, "body": [at_rest(b) for b in tuned.body]}
    changed["force"] = plucks_of_note(scene, body, share)
    changed["event"] = [*strikes_of_note(scene, body, share), *(dampers(scene, hold) if hold < seconds else [])]
    return tuned.model_copy(update=changed)


def plucks_of_note(scene: Scene, body: PitchedBody, share: float) -> list[Force]:
    """The plucks of a body, now, so many times as strong."""
    return [
        force.model_copy(update={"start": 0.0, "amplitude": force.amplitude * share})
        for force in plucks(scene, body.body)
    ]


def strikes_of_note(scene: Scene, body: PitchedBody, share: float) -> list[Event]:
    """The hammers of a body thrown now, from where the patch throws them first, so many times as fast."""
    velocities, strikes = striker_velocities(scene), list[Event]()
    for hammer in body.hammers:
        is_thrown_first = any(b.name == hammer and getattr(b, "velocity", None) for b in scene.body)
        throws = [e for e in scene.event if isinstance(e, StrikeEvent) and e.body == hammer]
        place = None if is_thrown_first else throws[0].displacement
        event = {"time": 0.0, "body": hammer, "velocity": velocities[hammer] * share}
        event |= {} if place is None else {"displacement": place}
        strikes.append(StrikeEvent.model_validate({"kind": "strike"} | event))
    return strikes


def dampers(scene: Scene, time: float) -> list[Event]:
    """Return the damping events of a key that is released."""
    sigma, duration = RELEASE_DAMPER
    names = sounding_bodies(scene)
    return [DampEvent(kind="damp", time=time, body=name, sigma=sigma, duration=duration) for name in names]
