"""Warnings of a render: bodies that begin inside others, and reasons not to trust the result."""

import math
from collections.abc import Iterator
from typing import Any

import numpy as np

from engine.assembly.contact_points import contact_points
from engine.assembly.refinement import local_limit
from engine.bodies import Mass, Oscillator
from engine.kernel.data.state import State
from engine.offline.statistics import NewtonStatistics, capped_samples
from engine.patch.accuracy import Accuracy
from engine.patch.scene import Scene
from engine.patch.tables import Contact, StrikeEvent

MAX_INITIAL_ENERGY_SHARE = (
    0.01  # of the energy of its motion: what a hammer may hold in a contact at first without a word
)
MAX_ENERGY_ERROR = 1e-9  # of the largest energy held: errors beyond are no rounding
MAX_CAPPED_SHARE = 0.05  # of the samples in contact: more capped solves are audible
MAX_FDH_DAMPING = 0.15  # σh: beyond, the paper's scheme moves a damped body too far


def warnings(scene: Scene) -> list[str]:
    """Hammers that are thrown from inside what they are to strike, at first or by an event."""
    bodies = {b.name: b for b in scene.body}
    messages: list[str] = []
    for body in scene.body:
        if isinstance(body, Mass | Oscillator) and body.velocity:
            messages += _warn_of_hammer_inside(scene, bodies, body, body.displacement, body.velocity, "")
    for event in scene.event:
        hammer = bodies[event.body] if isinstance(event, StrikeEvent) else None
        if isinstance(event, StrikeEvent) and isinstance(hammer, Mass | Oscillator):
            begin = hammer.displacement if event.displacement is None else event.displacement
            when = f" when struck at {event.time:g} s"
            messages += _warn_of_hammer_inside(scene, bodies, hammer, begin, event.velocity, when)
    return list(dict.fromkeys(messages))


def _warn_of_hammer_inside(
    scene: Scene, bodies: dict[str, Any], hammer: Mass | Oscillator, begin: float, velocity: float, when: str
) -> Iterator[str]:
    for contact in scene.contact:
        if hammer.name not in (contact.body, contact.on) or contact.stiffness == 0.0:
            continue
        depth, hammer_share, offset = _initial_compression(bodies, contact, hammer.name, begin)
        n = contact.exponent + 1
        energy = contact.stiffness / n * max(0.0, depth) ** n
        if energy > MAX_INITIAL_ENERGY_SHARE * 0.5 * hammer.mass * velocity**2:
            other = contact.on if contact.body == hammer.name else contact.body
            target = f'"{other}"' if other else "its barrier"
            times = energy / (0.5 * hammer.mass * velocity**2) if velocity else math.inf
            held = f"which holds {energy:.2g} J, {times:.2g} times the energy of its motion"
            right = _suggest_sign(contact, begin, depth, hammer_share, offset)
            yield f'"{hammer.name}" begins {depth:.3g} m inside {target}{when}, {held}; {right}'


def _initial_compression(
    bodies: dict[str, Any], contact: Contact, hammer: str, begin: float
) -> tuple[float, float, float]:
    """Compression at time 0, the hammer's own share of it, and what is subtracted."""
    sign = 1.0 if contact.side == "above" else -1.0
    on = None if contact.on is None else bodies[contact.on]
    point = contact_points(contact, bodies[contact.body], on)[0]
    offset = point.offset
    offset = -offset if contact.on is None and contact.side == "below" else offset
    depth = hammer_share = 0.0
    for name, at, factor in ((contact.body, point.at, sign), (contact.on, point.on_at, -sign)):
        if name is not None:
            place = begin if name == hammer else bodies[name].initial_displacement(at)
            depth += factor * place
            hammer_share += factor * begin if name == hammer else 0.0
    return depth - offset, hammer_share, offset


def _suggest_sign(contact: Contact, begin: float, depth: float, hammer_share: float, offset: float) -> str:
    """Suggest the number or side whose sign was likely wrong."""
    if hammer_share > 0.0 and depth - 2 * hammer_share <= 0.0:
        return f"displacement = {-begin:g} is likely meant"
    key, value = ("gap", contact.gap) if contact.on is not None else ("barrier", contact.barrier)
    if offset < 0.0 and depth + 2 * offset <= 0.0 and isinstance(value, float):
        return f"{key} = {-value:g} is likely meant"
    return f'side = "{"below" if contact.side == "above" else "above"}" is likely meant, or another {key}'


def explain_doubts(newton: NewtonStatistics, energy_error: float, finite: bool) -> list[str]:
    """Why the motion or the energies of a render cannot be vouched for; empty where they can.

    energy_error: relative to the largest energy held
    finite:       whether all samples are
    """
    reasons = []
    if not finite:
        reasons.append("samples are not finite")
    if newton.reversed_steps:
        reasons.append(f"the forces of {newton.reversed_steps} steps were not found, and the motion was reversed there")
    if newton.loose_tensions:
        reasons.append(f"the tensions of {newton.loose_tensions} steps were not found to the last digits")
    if not math.isfinite(energy_error):
        reasons.append("the energies are not finite")
    elif energy_error > MAX_ENERGY_ERROR:
        reasons.append(f"the energy error is {energy_error:.1e} of the maximum stored energy")
    outcomes = newton.solve_outcomes
    if outcomes.capped > MAX_CAPPED_SHARE * outcomes.solved:
        share = outcomes.capped / outcomes.solved
        reasons.append(
            f"{share:.0%} of the contact solves reached the iteration limit (they create no energy, but the forces are"
            " not those of the law); give more substeps, or accuracy.iterations"
        )
    return reasons


def warn_of_strong_loss(state: State, order: int) -> list[str]:
    """Warn of samples of order 4 or 6 that were computed at order 2, because their contact damping was too strong."""
    if state.refinement is None:
        return []
    samples, in_contact = int(state.refinement.samples_of_strong_loss.sum()), int(state.contact_samples.sum())
    if samples == 0:
        return []
    reason = "contact damping is too strong for higher orders there"
    remedy = "give more substeps, or order 2"
    share = min(1.0, samples / max(1, in_contact))  # some of these samples end without contact
    return [f"order {order} was reduced to order 2 in {share:.0%} of the samples in contact: {reason}; {remedy}"]


def warn_of_capped_samples(state: State, accuracy: Accuracy) -> list[str]:
    """Warn of samples that err by more than `max_error` allows."""
    if state.refinement is None or accuracy.max_error is None:
        return []
    samples, largest = capped_samples(state), float(state.refinement.largest_error.max())
    if samples == 0:
        return []
    limit, most = f"max_error = {accuracy.max_error:g}", f"max_substeps = {accuracy.max_substeps}"
    reason = (
        f"{samples} samples are too coarse for {limit}, by a factor of {largest / local_limit(accuracy):.2g} at most"
    )
    return [f"{reason}; give more than {most}, or a larger max_error"]


def explain_build_doubts(scene: Scene, layout: Any, model: Any) -> list[str]:
    """List the doubts that are known before anything has moved: damping that is too strong for the step."""
    rate, reasons = model.samplerate, list[str]()
    if scene.accuracy.scheme == "fdh":
        heavy = [
            b.name
            for b, m in zip(scene.body, layout.modal_bodies, strict=True)
            if (m.sigma > MAX_FDH_DAMPING * rate).any()
        ]
        if heavy:
            reasons.append(f'the paper\'s scheme moves heavily damped bodies too far ("{heavy[0]}"); scheme = "exact"')
    damped = {b.name: b for b in scene.body if isinstance(b, Mass) and b.damping_rate > rate and scene.gravity != 0.0}
    steps = model.step if model.refinement is None else model.refinement.stages
    compliance = np.atleast_2d(steps.contact.compliance).max(axis=0)
    for slot, (k, point) in enumerate(layout.islands.contact_points if damped else ()):
        contact = scene.contact[k]
        body = damped.get(contact.body) if contact.on is None else None
        if body is not None and compliance[slot] * _static_slope(point.stiffness, contact, body, scene.gravity) > 1.0:
            remedy = "a higher sample rate, or substeps"
            reasons.append(f'"{body.name}" is damped within a step, and pressed on a stop too hard for it; {remedy}')
    return list(dict.fromkeys(reasons))


def _static_slope(stiffness: float, contact: Contact, body: Any, gravity: float) -> float:
    """Slope of a contact's force where it carries the weight of a body, N/m."""
    weight = body.mass * abs(gravity)
    return contact.exponent * stiffness * (weight / stiffness) ** (1 - 1 / contact.exponent) if stiffness else 0.0
