"""Tables of free flight (engine.kernel.modes.free_flight): powers of the map of one step, and the pickup signals and
losses over them (docs/design.md, "Free flight").

A step of a mode on which nothing acts is (q, p, w) → S·(q, p, w), with w its weight, and S [3, 3] the product of loss,
kicks and drift. The powers of S are found by squaring, in twice the precision of a float64.
"""

from collections.abc import Sequence
from functools import reduce

import numpy as np

from engine.arithmetic.double_double import Pair, add, as_pair, multiply
from engine.arithmetic.elementary import square
from engine.arithmetic.products import product
from engine.assembly.array_memory import ABSENT
from engine.assembly.mode_shape_rows import place_entries
from engine.assembly.pickup_points import HeardPoint
from engine.kernel.data.enums import FLIGHT_FRAMES, FLIGHT_PART, Quantity
from engine.kernel.data.model import (
    FlightLoss,
    FlightWeight,
    FreeFlight,
    FreeMotion,
    FreeMotionResidue,
    ModalLoss,
    StepCoefficients,
)

Q, P, W = 0, 1, 2  # rows and columns of a linear map [rows, columns, modes] of (q, p, w)


def build_free_flight(
    step: StepCoefficients,
    omega: np.ndarray,
    weight: np.ndarray,
    pickups: Sequence[HeardPoint],
    samplerate: float,
) -> FreeFlight:
    """Return the tables of free flight for a step.

    omega, weight: of each mode, rad/s and √kg·m/s²
    pickups:       in the order of the model
    """
    span, is_free = FLIGHT_FRAMES / samplerate, omega == 0.0
    single, lost = map_of_step(step, has_weight=weight is not ABSENT)
    power, frames = single, 1
    part = single
    while frames < FLIGHT_FRAMES:
        backwards = np.swapaxes(power.high, 0, 1)
        lost = lost + multiply_maps(multiply_maps(backwards, lost), power.high)  # over the second half
        power, frames = matrix_product(power, power), 2 * frames
        part = power if frames == FLIGHT_PART else part
    return FreeFlight(
        motion=FreeMotion(*free_entries(power.high)),
        motion_low=FreeMotionResidue(*free_entries(power.low)),
        part=FreeMotion(*free_entries(part.high)),
        bound_per_speed=np.minimum(span, 2 / np.where(is_free, 1 / span, omega)),
        bound_per_weight=np.where(is_free, 0.5 * square(span), 0.0),
        loss=FlightLoss(lost[Q, Q], 2 * lost[Q, P], lost[P, P]) if lost.any() else ABSENT,
        weight=flight_weight(power, lost, weight, pickup_values_of_weight(single.high, weight, pickups))
        if weight is not ABSENT
        else ABSENT,
        pickup_tables=pickup_tables(single.high, pickups),
    )


def map_of_step(step: StepCoefficients, has_weight: bool) -> tuple[Pair, np.ndarray]:
    """Return the map of a step of modes on which nothing acts, and the energy that it takes as a quadratic form of (q,
    p, w), J. Coefficients and order are those of engine.kernel.modes.mode_step.free_step."""
    size = 3 if has_weight else 2
    unit = np.repeat(np.eye(size)[:, :, None], step.kick.size, axis=2)
    q, p, *w = [as_pair(row) for row in unit]
    lost = np.zeros((size, size, step.kick.size))

    def add_times(row: Pair, factor: np.ndarray, other: Pair) -> Pair:
        return add(row, multiply(as_pair(factor), other))

    def kick(p: Pair) -> Pair:
        p = p if step.spring_kick is ABSENT else add_times(p, -step.spring_kick, q)
        return add_times(p, step.kick, w[0]) if w else p

    def lose(loss: ModalLoss, p: Pair) -> Pair:
        if loss is ABSENT:
            return p
        lost[...] += loss.dissipation_factor * p.high[:, None] * p.high[None, :]
        return multiply(as_pair(loss.decay_factor), p)

    p = kick(lose(step.loss, p))
    q = add_times(q, step.drift, p)
    p = lose(step.loss, kick(lose(step.drag, p)))
    rows = [q, p, *w]
    return Pair(np.array([row.high for row in rows]), np.array([row.low for row in rows])), lost


def matrix_product(a: Pair, b: Pair) -> Pair:
    """Return the product a·b of two maps."""
    terms = multiply(Pair(a.high[:, :, None], a.low[:, :, None]), Pair(b.high[None], b.low[None]))  # [i, k, j, modes]
    first, *others = (Pair(terms.high[:, k], terms.low[:, k]) for k in range(a.high.shape[1]))
    return reduce(add, others, first)


def multiply_maps(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Return the product a·b of matrices of each mode [rows, columns, modes]."""
    return np.asarray(np.sum(a[:, :, None] * b, axis=1))


def free_entries(matrix: np.ndarray) -> list[np.ndarray]:
    """Return the entries of a map that belong to q and p, in the order of FreeMotion."""
    return [matrix[i, j].copy() for i in (Q, P) for j in (Q, P)]


def flight_weight(whole: Pair, lost: np.ndarray, weight: np.ndarray, pickup_values: np.ndarray) -> FlightWeight:
    """Return the effects of weight over a flight whose map and losses are given."""
    push = multiply(Pair(whole.high[P, W], whole.low[P, W]), as_pair(weight))
    return FlightWeight(
        q=whole.high[Q, W] * weight,
        p=push.high,
        p_low=push.low,
        lost_per_q=2 * lost[Q, W] * weight,
        lost_per_p=2 * lost[P, W] * weight,
        lost=lost[W, W] * square(weight),
        pickup_values=pickup_values,
    )


def map_row(pickup: HeardPoint) -> int:
    """Return the row of a map that gives the signal of a pickup: Q for a displacement, else P."""
    return Q if pickup.quantity is Quantity.DISPLACEMENT else P


def pickup_values_of_weight(step: np.ndarray, weight: np.ndarray, pickups: Sequence[HeardPoint]) -> np.ndarray:
    """Return the pickup signals of bodies that fall from rest [pickups, FLIGHT_FRAMES]."""
    fallen = np.zeros((FLIGHT_FRAMES, 2, weight.size))
    for frame in range(1, FLIGHT_FRAMES):
        fallen[frame] = np.sum(step[:W, :W] * fallen[frame - 1], axis=1) + step[:W, W] * weight
    rows = [product(fallen[:, map_row(pickup), pickup.row.modes], pickup.row.phi) for pickup in pickups]
    return np.array(rows).reshape(len(pickups), FLIGHT_FRAMES)


def pickup_tables(step: np.ndarray, pickups: Sequence[HeardPoint]) -> np.ndarray:
    """Return the signal of each mode at a pickup in each frame of a part of a flight, per displacement and per momentum
    at its start."""
    power, powers = np.repeat(np.eye(2)[:, :, None], step.shape[2], axis=2), []
    for _ in range(FLIGHT_PART):
        powers.append(power)
        power = multiply_maps(step[:W, :W], power)
    frames = np.array(powers)  # [frame, row, column, mode]
    values = []
    for pickup in pickups:
        per_q, per_p = (frames[:, map_row(pickup), column, pickup.row.modes].T for column in (Q, P))
        values.append(pickup.row.phi[:, None] * np.hstack([per_q, per_p]))
    return place_entries([pickup.row for pickup in pickups], values)
