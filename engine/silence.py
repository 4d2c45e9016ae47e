"""Why a render is silent, where that can be known."""

import math
from typing import Any

import numpy as np

from engine.bodies import modal
from engine.parts import Change, Contact, Force, Mass, Membrane, Modes, Oscillator, Pickup, Plate, PluckAgain, Strike
from engine.save import SILENCE
from engine.scene import Scene, joined

LOWEST = 8  # modes are looked at: where none of them moves, none does
NODE = 1e-9  # a shape this much smaller than elsewhere is rounding
ELSEWHERE = 0.137, 0.29, 0.41  # places at no simple fraction


def why(scene: Scene, stats: dict[str, Any]) -> str | None:
    """What makes a take silent, and what would make it sound; None if it sounds. stats: as of `engine.offline.Take`.

    What is heard or pushed at nodes alone is silent, though rounding leaves something there to be heard.
    """
    heard = [p for p in scene.pickup if p.gain != 0.0]
    nodes = [p for p in heard if p.quantity != "force" and still(scene, p.body, p.at)]
    seconds = stats["seconds"]
    if seconds * stats["samplerate"] < 1.5 and stats["peak"] <= SILENCE:
        return "it has one sample, before anything has moved; give more seconds"
    acting = [f for f in _forces(scene, seconds) if not still(scene, f.body, f.at)]
    moved = _moved(scene, seconds) + [f.body for f in acting]
    rests = not moved and stats["energy"]["initial"] == 0.0
    if stats["peak"] > SILENCE and len(nodes) < len(heard) and not rests:
        return None
    if not heard:
        return "every pickup has gain = 0; give one another gain"
    if rests:
        return _nothing(scene, seconds)
    return "; and ".join(dict.fromkeys(_unheard(scene, p, moved, stats, p in nodes) for p in heard))


def deaf(scene: Scene) -> bool:
    """Whether no pickup can hear anything but rounding."""
    return all(p.gain == 0.0 or (p.quantity != "force" and still(scene, p.body, p.at)) for p in scene.pickup)


def still(scene: Scene, name: str, at: Any) -> bool:
    """Whether a place is a node of every mode of a body, such as the end of a string."""
    body = next(b for b in scene.body if b.name == name)
    if at is None or isinstance(body, Mass | Oscillator):
        return False
    others: list[Any] = list(ELSEWHERE)
    if isinstance(body, Modes):
        others = list(body.points or {})
    elif isinstance(body, Membrane | Plate):
        others = [[x, 0.47] for x in ELSEWHERE]
    if not isinstance(body, Modes):
        body = body.model_copy(update={"modes": min(body.modes or LOWEST, LOWEST), "support": []})
    shape = modal(body).shape
    return bool(np.max(np.abs(shape(at))) <= NODE * max(np.max(np.abs(shape(place))) for place in others))


def _forces(scene: Scene, seconds: float) -> list[Force | PluckAgain]:
    """The forces and plucks that begin before the end."""
    found: list[Force | PluckAgain] = [f for f in scene.force if f.amplitude != 0.0 and f.start < seconds]
    return found + [e for e in scene.event if isinstance(e, PluckAgain) and e.amplitude != 0.0 and e.time < seconds]


def _struck(scene: Scene, seconds: float) -> list[str]:
    """The hammers that are thrown by an event before the end."""
    return [e.body for e in scene.event if isinstance(e, Strike) and e.time < seconds]


def _moved(scene: Scene, seconds: float) -> list[str]:
    """Bodies that move by themselves, by gravity, by a strike, or by a contact that changes."""
    found = []
    for body in scene.body:
        if isinstance(body, Mass | Oscillator):
            displaced = isinstance(body, Oscillator) and body.displacement != 0.0
            if body.velocity != 0.0 or displaced or scene.gravity != 0.0:
                found.append(body.name)
    changed = {e.contact for e in scene.event if isinstance(e, Change) and e.time < seconds}
    found += [end for c in scene.contact if c.name in changed for end in (c.body, c.on) if end]  # that may push
    return found + _struck(scene, seconds)


def _nothing(scene: Scene, seconds: float) -> str:
    """Why nothing moves."""
    if at_nodes := _forces(scene, seconds):
        first = at_nodes[0]
        return f'"{first.body}" is pushed at {first.at} alone, where it never moves; another place'
    times = [f.start for f in scene.force if f.amplitude != 0.0]
    times += [e.time for e in scene.event if isinstance(e, Strike | PluckAgain)]
    if times:
        return f"nothing happens before {min(times):g} s, and it ends at {seconds:g} s; give more seconds"
    right = "give a mass a velocity, or add a [[force]] or an [[event]]"
    return f"nothing moves at the start, and no force or strike acts; {right}"


def _unheard(scene: Scene, pickup: Pickup, moved: list[str], stats: dict[str, Any], at_node: bool) -> str:
    """Why one pickup hears nothing."""
    name = pickup.body
    if at_node:
        return f'the pickup on "{name}" is at {pickup.at}, where it never moves; another place'
    reached = joined(scene, name)
    contacts = [c for c in scene.contact if c.body in reached and c.stiffness > 0.0]
    if pickup.quantity == "force" and not any(name in (c.body, c.on) for c in contacts):
        return f'nothing touches "{name}", whose contact forces are heard; another quantity, or a [[contact]]'
    if moved and not reached & set(moved):
        others = ", ".join(f'"{n}"' for n in dict.fromkeys(moved))
        return f'"{name}" is heard, and what moves ({others}) has no contact with it; add a [[contact]] between them'
    touched = any(n for regime, n in stats["newton"]["regimes"].items() if regime != "free")
    if contacts and not touched:
        first = next((c for c in contacts if {c.body, c.on} & set(moved)), contacts[0])
        return "no contact ever closes: " + _apart(scene, first, moved, stats["seconds"])
    return "no pickup moves; another place or quantity"


def _apart(scene: Scene, contact: Contact, moved: list[str], seconds: float) -> str:
    """What keeps a contact open."""
    bodies = {b.name: b for b in scene.body}
    first, other = (contact.body, contact.on) if contact.body in moved else (contact.on, contact.body)
    target = f'"{other}"' if other else "the barrier"
    far = f'"{first or other}" does not come near enough to {target} in {seconds:g} s'
    right = "more velocity, less distance, or more seconds"
    flying, resting = bodies.get(first or ""), bodies.get(other or "")
    acted = [*(f.body for f in _forces(scene, seconds)), *_struck(scene, seconds)]
    if not isinstance(flying, Mass) or flying.damping or first in acted or other in moved or contact.bridge:
        return f"{far}; {right}"
    offset = contact.gap if contact.on else contact.barrier
    if isinstance(offset, list):
        return f"{far}; {right}"
    up = (1.0 if contact.side == "above" else -1.0) * (1.0 if first == contact.body else -1.0)  # towards the other
    away = up * ((offset or 0.0) if contact.on is None else 0.0) + ((offset or 0.0) if contact.on else 0.0)
    place = resting.displacement if isinstance(resting, Mass | Oscillator) else 0.0
    distance = away - up * (flying.displacement - place)
    time = _flight(distance, up * flying.velocity, -up * scene.gravity)
    if math.isinf(time) and up * flying.velocity <= 0.0:
        return f'"{first}" moves away from {target}; turn its velocity round, or the side of the contact'
    if math.isinf(time):
        return f'"{first}" turns back before it reaches {target}; more velocity, or less distance'
    if time > seconds:
        return f'"{first}" needs {time:.3g} s to reach {target}, and it ends at {seconds:g} s; {right}'
    return f"{far}; {right}"


def _flight(distance: float, speed: float, pull: float) -> float:
    """When a distance is flown under a constant acceleration, s; infinite if never."""
    if distance <= 0.0:
        return 0.0
    if pull == 0.0:
        return distance / speed if speed > 0.0 else math.inf
    under = speed**2 + 2 * pull * distance
    if under < 0.0:
        return math.inf
    roots = [(-speed + sign * math.sqrt(under)) / pull for sign in (1.0, -1.0)]
    return min((t for t in roots if t > 0.0), default=math.inf)
