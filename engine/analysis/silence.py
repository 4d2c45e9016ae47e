"""Why a rendering is silent, where that can be known."""

import math
from typing import Any

import numpy as np

from engine.bodies import Mass, MeasuredBody, Oscillator
from engine.bodies.sheet import SheetBody
from engine.offline.statistics import SimulationStatistics
from engine.output_files import SILENT_PEAK
from engine.patch.friction import Friction
from engine.patch.scene import Scene, connected_bodies
from engine.patch.tables import ChangeEvent, Contact, Force, Pickup, PluckEvent, StrikeEvent

MODES_EXAMINED = 8  # a position where none of the lowest moves is a node of all
NODE_THRESHOLD = 1e-9  # a shape this much smaller than elsewhere is rounding
RUBBING = "velocity", "force"  # what a surface needs to rub
HEARD_AT_NODES = "force", "end_force", "tension"  # quantities that are there where nothing moves
GENERIC_POSITIONS = 0.137, 0.29, 0.41  # at no simple fraction, and so at no node of a low mode


def explain_silence(
    scene: Scene, seconds: float, samplerate: int, peak: float, simulated: SimulationStatistics
) -> str | None:
    """Explain why a rendering is silent and what would make it sound; return None if it is not silent.

    samplerate: Hz
    peak:       its largest absolute sample

    A scene whose pickups or forces are all at nodes counts as silent, although rounding leaves a small signal.
    """
    audible = [p for p in scene.pickup if p.gain != 0.0]
    at_nodes = [p for p in audible if p.quantity not in HEARD_AT_NODES and is_node(scene, p.body, p.at)]
    if seconds * samplerate < 1.5 and peak <= SILENT_PEAK:
        return "it is one sample long, and nothing has moved; give more seconds"
    effective = [f for f in _acting_forces(scene, seconds) if not is_node(scene, f.body, f.at)]
    moving = _moving_bodies(scene, seconds) + [f.body for f in effective]
    is_at_rest = not moving and simulated.energy.initial == 0.0
    if peak > SILENT_PEAK and len(at_nodes) < len(audible) and not is_at_rest:
        return None
    if not audible:
        return "every pickup has gain = 0; change a gain"
    if is_at_rest:
        return _explain_no_motion(scene, seconds)
    has_touched = simulated.newton.solve_outcomes.solved > 0
    explanations = [
        _explain_node(p) if p in at_nodes else _explain_pickup(scene, p, moving, has_touched, seconds) for p in audible
    ]
    return "; and ".join(dict.fromkeys(explanations))


def is_inaudible(scene: Scene) -> bool:
    """True if all pickups are at positions where nothing but rounding can reach them."""
    audible = [p for p in scene.pickup if p.gain != 0.0]
    return all(p.quantity not in HEARD_AT_NODES and is_node(scene, p.body, p.at) for p in audible)


def is_node(scene: Scene, name: str, at: Any) -> bool:
    """True if a position is a node of every mode of a body, such as the end of a string."""
    body = next(b for b in scene.body if b.name == name)
    if at is None or isinstance(body, Mass | Oscillator):
        return False
    if len(body.split_positions(at)) > 1:
        return all(is_node(scene, name, place) for place in body.split_positions(at))
    positions: list[Any] = list(GENERIC_POSITIONS)
    if isinstance(body, MeasuredBody):
        positions = list(body.points or {})
    elif isinstance(body, SheetBody):
        positions = [[x, 0.47] for x in GENERIC_POSITIONS]
    if not isinstance(body, MeasuredBody):
        modes = min(body.modes or MODES_EXAMINED, MODES_EXAMINED)
        body = body.model_copy(update={"modes": modes, "support": [], "displacement": None, "velocity": None})
    shape = body.modal_body().shape
    largest = max(np.max(np.abs(shape(position))) for position in positions)
    return bool(np.max(np.abs(shape(at))) <= NODE_THRESHOLD * largest)


def _acting_forces(scene: Scene, seconds: float) -> list[Force | PluckEvent]:
    """The forces and plucks that begin before the end (s)."""
    forces: list[Force | PluckEvent] = [f for f in scene.force if f.amplitude != 0.0 and f.start < seconds]
    return forces + [e for e in scene.event if isinstance(e, PluckEvent) and e.amplitude != 0.0 and e.time < seconds]


def _struck_bodies(scene: Scene, seconds: float) -> list[str]:
    """The hammers that an event throws before the end (s)."""
    return [e.body for e in scene.event if isinstance(e, StrikeEvent) and e.time < seconds]


def _moving_bodies(scene: Scene, seconds: float) -> list[str]:
    """Bodies that move before the end (s): from the start, by gravity, by a strike, by a contact that changes, or by a
    connection that changes or is stretched."""
    names = []
    for body in scene.body:
        if isinstance(body, Mass | Oscillator):
            held = isinstance(body, Oscillator) or any(body.name in (c.body, c.on) for c in scene.connection)
            is_displaced = held and body.displacement != 0.0
            if body.velocity != 0.0 or is_displaced or scene.gravity != 0.0:
                names.append(body.name)
        elif getattr(body, "displacement", None) or getattr(body, "velocity", None):
            names.append(body.name)
    changed = {e.contact or e.connection for e in scene.event if isinstance(e, ChangeEvent) and e.time < seconds} - {
        None
    }
    # what changes may push both its bodies
    joining = [c for c in [*scene.contact, *scene.connection] if c.name in changed]
    joining += [c for c in scene.connection if getattr(c, "rest", 0.0) != 0.0 and not getattr(c, "rigid", False)]
    names += [body for c in joining for body in (c.body, c.on) if body]
    names += [f.body for f in scene.friction if all(_comes_to(scene, f, key, seconds) for key in RUBBING)]
    return names + _struck_bodies(scene, seconds)


def _comes_to(scene: Scene, friction: Friction, key: str, seconds: float) -> bool:
    """True if a surface that rubs has a velocity or a force before the end (s)."""
    if friction.on is not None or getattr(friction, key):
        return friction.on is None
    changes = (e for e in scene.event if isinstance(e, ChangeEvent) and e.friction == friction.name and friction.name)
    return any(getattr(e, key) for e in changes if e.time < seconds) or (
        key == "force" and friction.contact is not None
    )


def _explain_no_motion(scene: Scene, seconds: float) -> str:
    """Why nothing moves before the end (s)."""
    if forces := _acting_forces(scene, seconds):  # all of them at nodes
        first = forces[0]
        return f'"{first.body}" is only pushed at {first.at}, where it never moves; give another position'
    for friction in scene.friction:
        lacking = [key for key in RUBBING if not _comes_to(scene, friction, key, seconds)]
        if friction.on is None and lacking:
            name = f'the bow "{friction.name}"' if friction.name else f'what rubs "{friction.body}"'
            return f"{name} has no {' and no '.join(lacking)} before {seconds:g} s; give it a velocity and a force"
    times = [f.start for f in scene.force if f.amplitude != 0.0]
    times += [e.time for e in scene.event if isinstance(e, StrikeEvent | PluckEvent)]
    if times:
        return f"nothing happens before {min(times):g} s, and it ends at {seconds:g} s; give more seconds"
    remedy = "give a body a velocity or a displacement, or add a [[force]] or an [[event]]"
    return f"nothing moves at the start, and no force or strike acts; {remedy}"


def _explain_node(pickup: Pickup) -> str:
    """A pickup at a node hears nothing."""
    return f'the pickup on "{pickup.body}" is at {pickup.at}, where it never moves; give another position'


def _explain_pickup(scene: Scene, pickup: Pickup, moving: list[str], has_touched: bool, seconds: float) -> str:
    """Why one pickup hears nothing to the end (s). moving: the bodies that move by themselves"""
    name = pickup.body
    connected = connected_bodies(scene, name)
    contacts = [c for c in scene.contact if c.body in connected and c.stiffness > 0.0]
    rubbed = {name for f in scene.friction for name in (f.body, f.on)}
    if pickup.quantity == "force" and not any(name in (c.body, c.on) for c in contacts) and name not in rubbed:
        return (
            f'nothing touches "{name}", whose contact forces a pickup measures; give another quantity, or a [[contact]]'
        )
    if moving and not connected & set(moving):
        names = ", ".join(f'"{n}"' for n in dict.fromkeys(moving))
        remedy = "add a [[contact]] or a [[connection]]"
        return f'the pickup is on "{name}", which the moving bodies ({names}) do not reach; {remedy}'
    if contacts and not has_touched:
        first = next((c for c in contacts if {c.body, c.on} & set(moving)), contacts[0])
        return "no contact ever closes: " + _explain_open_contact(scene, first, moving, seconds)
    return "no pickup moves; give another position or quantity"


def _explain_open_contact(scene: Scene, contact: Contact, moving: list[str], seconds: float) -> str:
    """Explain why a contact stays open until the end (s)."""
    mover, target = (contact.body, contact.on) if contact.body in moving else (contact.on, contact.body)
    target_name = f'"{target}"' if target else "the barrier"
    remedy = "give more velocity, less distance, or more seconds"
    default = f'"{mover or target}" does not come near enough to {target_name} in {seconds:g} s; {remedy}'
    flight = _free_flight(scene, contact, mover, target, moving, seconds)
    if flight is None:
        return default
    time, speed = flight
    if math.isinf(time) and speed <= 0.0:
        return f'"{mover}" moves away from {target_name}; reverse its velocity, or the side of the contact'
    if math.isinf(time):
        return f'"{mover}" turns back before it reaches {target_name}; give more velocity, or less distance'
    if time > seconds:
        return f'"{mover}" needs {time:.3g} s to reach {target_name}, and it ends at {seconds:g} s; {remedy}'
    return default


def _free_flight(
    scene: Scene, contact: Contact, mover: str | None, target: str | None, moving: list[str], seconds: float
) -> tuple[float, float] | None:
    """Time (s) that a mass flies to what it is to touch, and its first velocity (m/s) towards that; None if its flight
    is not known from its start."""
    bodies = {b.name: b for b in scene.body}
    mass, resting = bodies.get(mover or ""), bodies.get(target or "")
    acted_on = [*(f.body for f in _acting_forces(scene, seconds)), *_struck_bodies(scene, seconds)]
    offset = contact.gap if contact.on else contact.barrier
    if not isinstance(mass, Mass) or mass.damping_rate or mover in acted_on or target in moving:
        return None
    if contact.bridge or isinstance(offset, list):
        return None
    direction = (1.0 if contact.side == "above" else -1.0) * (1.0 if mover == contact.body else -1.0)
    offset = offset or 0.0
    target_distance = direction * offset if contact.on is None else offset  # from 0, in that direction
    rest_position = resting.displacement if isinstance(resting, Mass | Oscillator) else 0.0
    distance = target_distance - direction * (mass.displacement - rest_position)
    speed = direction * mass.velocity
    return _time_of_flight(distance, speed, -direction * scene.gravity), speed


def _time_of_flight(distance: float, velocity: float, acceleration: float) -> float:
    """Time (s) to fly a distance (m) under a constant acceleration (m/s²); infinite if it is never reached."""
    if distance <= 0.0:
        return 0.0
    if acceleration == 0.0:
        return distance / velocity if velocity > 0.0 else math.inf
    discriminant = velocity**2 + 2 * acceleration * distance
    if discriminant < 0.0:
        return math.inf
    roots = [(-velocity + sign * math.sqrt(discriminant)) / acceleration for sign in (1.0, -1.0)]
    return min((t for t in roots if t > 0.0), default=math.inf)
