"""Formulas for the bow forces at which a string can be played (Schelleng, JASA 53, 1973), and for that from which the
textbook's curve of friction has several solutions (Friedlander, 1953)."""

import math
from typing import Any, NamedTuple

import numpy as np

from engine.assembly.friction import friction_points
from engine.assembly.layout import Layout
from engine.bodies.body import ModalBody
from engine.bodies.string import String
from engine.kernel.data.model import Model
from engine.patch.friction import Friction
from engine.patch.tables import ChangeEvent, EndConnection, Event


class PlayingRange(NamedTuple):
    """A velocity and a force that a bow has, and the limits to its force at that velocity, N."""

    name: str
    velocity: float  # m/s
    force: float
    lowest: float  # below it the string slips more than once a period
    highest: float  # above it the string does not slip each period
    several_solutions: float  # force from which friction that follows the slip at once would have several


def schelleng_forces(
    position: float, velocity: float, impedance: float, resistance: float, difference: float
) -> tuple[float, float]:
    """Return the lowest and the highest bow force, N: Z²·v/(2β²·R·Δμ) and 2·Z·v/(β·Δμ).

    position:   β, of the bow from the nearer end, a fraction of the length
    velocity:   v of the bow, m/s
    impedance:  Z = √(T·μ) of the string, kg/s
    resistance: R, kg/s, of the end of the string: with the loss of its first partial, 2·Z·f1/σ1
    difference: Δμ, of the coefficients of friction at rest and in slip
    """
    if difference == 0.0:
        return math.inf, math.inf
    highest = 2 * impedance * velocity / (position * difference)
    lowest = impedance**2 * velocity / (2 * position**2 * resistance * difference) if resistance > 0.0 else math.inf
    return lowest, highest


def friedlander_force(speed: float, difference: float, impedance: float) -> float:
    """Return the force 2·Z·v0/Δμ, N, from which the curve of friction has several solutions on an ideal string.

    speed: v0, m/s, of slip at which the coefficient is half-way; impedance: Z = √(T·μ) of the string, kg/s
    """
    return 2.0 * impedance * speed / difference if difference > 0.0 else math.inf


def playing_ranges(layout: Layout) -> list[PlayingRange]:
    """Return the limits of each bow that moves over a string, for each velocity and force that it comes to."""
    ranges = list[PlayingRange]()
    for slot, bow in friction_points(layout).items():
        number, at = layout.body_index[bow.body], layout.islands.contact_points[slot][1].at
        string = layout.scene.body[number]
        if isinstance(string, String) and bow.force is not None:
            resistance = end_resistance(layout, number)
            for velocity, force in motions_of_bow(layout.scene.event, bow):
                limits = _limits(string, bow, at, velocity, resistance)
                ranges.append(PlayingRange(bow.name or f"friction on {bow.body}", velocity, force, *limits))
    return ranges


def motions_of_bow(events: list[Event], bow: Friction) -> list[tuple[float, float]]:
    """Return the speeds and forces that a bow has or comes to by its events, each pair once; without those in which it
    rests or is lifted."""
    moves = [e for e in events if isinstance(e, ChangeEvent) and e.friction == bow.name and bow.name is not None]
    velocity, force = bow.velocity, bow.force or 0.0
    motions = [(abs(velocity), force)]
    for time in sorted({move.time for move in moves}):
        for move in (m for m in moves if m.time == time):
            velocity = velocity if move.velocity is None else move.velocity
            force = force if move.force is None else move.force
        motions.append((abs(velocity), force))
    return [motion for motion in dict.fromkeys(motions) if all(motion)]


def end_resistance(layout: Layout, number: int) -> float:
    """Return the resistance of the end of a string at its first partial, kg/s: that which its loss amounts to, and that
    of the bodies that carry its ends, whose conductances add up.

    number: of the string among the bodies
    """
    string, modal = layout.scene.body[number], layout.modal_bodies[number]
    omega = float(modal.omega[0])
    conductance = math.pi * float(modal.sigma[0]) / (omega * string_impedance(string))
    for end in layout.scene.connection:
        if isinstance(end, EndConnection) and end.body == string.name and not end.one_way:
            body = layout.modal_bodies[layout.body_index[end.on]]
            conductance += end.share**2 * conductance_at(body, body.shape(end.on_at), omega)
    return 1.0 / conductance if conductance > 0.0 else math.inf


def conductance_at(modal: ModalBody, shape: np.ndarray, omega: float) -> float:
    """Return the real part of the mobility of a body, s/kg, where its modes have a shape [modes], 1/√kg, at an angular
    frequency, rad/s."""
    mobility = shape**2 * 1j * omega / (modal.omega**2 - omega**2 + 2j * modal.sigma * omega)
    return float(np.sum(mobility).real)


def string_impedance(string: Any) -> float:
    """Return Z = √(T·μ) of a string, kg/s."""
    return math.sqrt(string.tension_and_bending()[0] * string.mass_per_length())


def _limits(string: String, bow: Friction, at: float, velocity: float, resistance: float) -> tuple[float, float, float]:
    """Return Schelleng's lowest and highest force, and Friedlander's, N, of a bow at a position of a string.

    resistance: of its end, kg/s
    """
    position, difference = min(at, 1.0 - at), bow.static - bow.dynamic
    impedance = string_impedance(string)
    lowest, highest = schelleng_forces(position, velocity, impedance, resistance, difference)
    return lowest, highest, friedlander_force(bow.speed, difference, impedance)


# --- what `fdh inspect` prints


def describe_friction(layout: Layout, model: Model) -> list[str]:
    """Return a line for each velocity and force of each bow on a string, with the limits to its force; and one for each
    friction whose force is that of a contact."""
    lines = [_describe_range(motion) for motion in playing_ranges(layout)]
    when = _steps_of_press(layout, model)
    return lines + [
        f"friction under {contact}: pressed by the force of this contact in {step}" for contact, step in when
    ]


def _steps_of_press(layout: Layout, model: Model) -> list[tuple[str, str]]:
    """Return the contacts that press, and the step whose force counts."""
    steps: dict[str, str] = {}
    for table in friction_points(layout).values():
        if table.contact is not None:
            island = layout.islands.of_body[layout.body_index[table.body]]
            steps[table.contact] = "the same step" if model.contact.friction.is_apart[island] else "the step before"
    return list(steps.items())


def _describe_range(motion: PlayingRange) -> str:
    """Describe a velocity and a force of a bow, beside the limits."""
    place = "within" if motion.lowest <= motion.force <= motion.highest else "below"
    place = "above" if motion.force > motion.highest else place
    limits = "no playing range: static equals dynamic"
    if math.isfinite(motion.highest):
        limits = f"{place} Schelleng's {motion.lowest:.2g} to {motion.highest:.2g} N"
        limits += f" (Friedlander's is {motion.several_solutions:.2g} N)"
    return f"{motion.name}: {motion.force:.3g} N at {motion.velocity:.3g} m/s, {limits}"
