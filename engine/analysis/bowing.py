"""Formulas for the bow forces at which a string can be played (Schelleng, JASA 53, 1973), and for that from which the
textbook's curve of friction has several solutions (Friedlander, 1953)."""

import math
from typing import NamedTuple

from engine.assembly.friction import friction_points
from engine.assembly.layout import Layout
from engine.bodies.body import ModalBody
from engine.bodies.string import String
from engine.kernel.data.model import Model
from engine.patch.friction import Friction


class PlayingRange(NamedTuple):
    """Limits to the force of a bow on a string, N."""

    name: str
    lowest: float  # below it the string slips more than once a period
    highest: float  # above it the string does not slip each period
    several_solutions: float  # force from which friction that follows the slip within a step would have several


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


def friedlander_force(speed: float, difference: float, mobility: float) -> float:
    """Return the force v0/(Δμ·Y), N, from which the curve of friction has several solutions.

    speed: v0, m/s, of slip at which the coefficient is half-way; mobility: Y of the string under the bow, s/kg
    """
    return speed / (difference * mobility) if difference > 0.0 else math.inf


def playing_ranges(layout: Layout, model: Model) -> list[PlayingRange]:
    """Return the limits of each bow that moves over a string."""
    h, ranges = model.step.contact, list[PlayingRange]()
    if h is None or h.duration is None:
        return ranges
    for slot, bow in friction_points(layout).items():
        number, at = layout.body_index[bow.body], layout.islands.contact_points[slot][1].at
        string = layout.scene.body[number]
        if isinstance(string, String) and bow.velocity != 0.0:
            mobility = float(h.compliance[slot] / h.duration[slot])
            ranges.append(_playing_range(string, layout.modal_bodies[number], bow, at, mobility))
    return ranges


def _playing_range(string: String, modal: ModalBody, bow: Friction, at: float, mobility: float) -> PlayingRange:
    """Return the limits of a bow at a position of a string. mobility: Y there, s/kg"""
    impedance = math.sqrt(string.tension_and_bending()[0] * string.mass_per_length())
    omega, sigma = float(modal.omega[0]), float(modal.sigma[0])
    resistance = impedance * omega / (math.pi * sigma) if sigma > 0.0 else math.inf
    position, difference = min(at, 1.0 - at), bow.static - bow.dynamic
    lowest, highest = schelleng_forces(position, abs(bow.velocity), impedance, resistance, difference)
    name = bow.name or f"friction on {bow.body}"
    return PlayingRange(name, lowest, highest, friedlander_force(bow.speed, difference, mobility))
