"""Points of friction (bench.ruler.contact_ruler.problem) for the collocation of bench.ruler.reference: their law
and events.

While a point is stuck its bristle bends with the slip of the surfaces; while it slides, on a side of 1 or -1, the bend
is side·N·μ(θ)/k, and θ has a differential equation of its own. Both are smooth. A point slides when its bend would
exceed that bound, and sticks when its slip would change sign.
"""

from typing import Any, NamedTuple

import numpy as np

from bench.ruler.contact_ruler.problem import Friction, Problem


class Rubbing(NamedTuple):
    """The points of friction of a problem in one precision."""

    shapes: np.ndarray  # [points, modes]
    law: Friction


class Bristles(NamedTuple):
    """Where the bristles are [..., points]."""

    bend: np.ndarray  # m
    remembered: np.ndarray  # θ, m/s
    side: np.ndarray  # 0 where stuck, else that on which it slides, 1 or -1


def as_rubbing(problem: Problem, kind: type) -> Rubbing:
    """The points of friction of a problem in one precision; none if it has none."""
    if problem.rubbed is None or problem.friction is None:
        return Rubbing(np.zeros((0, problem.omega.size), kind), Friction(*np.zeros((7, 0), kind)))
    return Rubbing(problem.rubbed.astype(kind), Friction(*problem.friction.astype(kind)))


def at_rest(rubbing: Rubbing) -> Bristles:
    """The bristles at time 0."""
    nothing = np.zeros_like(rubbing.law.force)
    return Bristles(nothing, nothing, np.zeros(nothing.size, int))


def reach(law: Friction, remembered: np.ndarray) -> np.ndarray:
    """How far a bristle may bend, m [..., points]."""
    coefficient = law.dynamic + (law.static - law.dynamic) * law.speed / (law.speed + remembered)
    return np.asarray(law.force * coefficient / law.bristle)


def reach_slope(law: Friction, remembered: np.ndarray) -> np.ndarray:
    """Its derivative by θ, s [..., points]."""
    weakening = law.force * (law.static - law.dynamic) / law.bristle
    return np.asarray(-weakening * law.speed / (law.speed + remembered) ** 2)


def slip_speed(law: Friction, bristles: Bristles, slip: np.ndarray) -> np.ndarray:
    """Speed at which sliding bristles slip, with a sign that turns when they stick, m/s. slip: of the surfaces"""
    shrinking = reach_slope(law, bristles.remembered) / law.memory
    return np.asarray((bristles.side * slip + shrinking * bristles.remembered) / (1 + shrinking))


def rates(law: Friction, bristles: Bristles, slip: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Rates of the bend, m/s, and of θ, m/s². slip: of the surfaces, m/s [..., points]"""
    is_stuck = bristles.side == 0
    speed = np.where(is_stuck, 0, slip_speed(law, bristles, slip))
    of_remembered = (speed - bristles.remembered) / law.memory
    of_bound = bristles.side * reach_slope(law, bristles.remembered) * of_remembered
    return np.where(is_stuck, slip, of_bound), of_remembered


def friction_forces(law: Friction, bristles: Bristles) -> np.ndarray:
    """Forces, N [..., points]."""
    is_stuck = bristles.side == 0
    bend = np.where(is_stuck, bristles.bend, bristles.side * reach(law, bristles.remembered))
    return np.asarray(law.bristle * bend)


def excess_of(law: Friction, bristles: Bristles, slip: np.ndarray) -> np.ndarray:
    """What is above 0 when a point has changed: the bend beyond the bound, m; the speed the wrong way, m/s."""
    beyond = np.abs(bristles.bend) - reach(law, bristles.remembered)
    return np.where(bristles.side == 0, beyond, -slip_speed(law, bristles, slip))


def excess_and_slope(
    law: Friction, bristles: Bristles, slip: np.ndarray, acceleration: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """The same, without the factor of the speed that is always positive, and its rate [points]. acceleration: of the
    surfaces, m/s²"""
    side, remembered = bristles.side, bristles.remembered
    bend_rate, rate = rates(law, bristles, slip)
    slope = reach_slope(law, remembered)
    excess = excess_of(law, bristles, slip) * np.where(side == 0, 1, 1 + slope / law.memory)
    of_beyond = np.sign(bristles.bend) * bend_rate - slope * rate
    of_shrinking = slope * (1 - 2 * remembered / (law.speed + remembered)) * rate / law.memory
    return excess, np.where(side == 0, of_beyond, -(side * acceleration + of_shrinking))


def turn(law: Friction, bristles: Bristles, point: int) -> Bristles:
    """The bristles after a point has begun to slide, or to stick."""
    bend, side = bristles.bend.copy(), bristles.side.copy()
    if side[point] == 0:
        side[point] = 1 if bend[point] > 0 else -1
    else:
        bend[point] = (side * reach(law, bristles.remembered))[point]
        side[point] = 0
    return Bristles(bend, bristles.remembered, side)


def stored_in(law: Friction, bristles: Bristles) -> Any:
    """Energy of the bristles, J."""
    return np.sum(friction_forces(law, bristles) ** 2 / (2 * law.bristle))
