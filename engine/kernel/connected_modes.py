"""A step of one connected mode, or of eight, and how far it moves the connections, in this step and in the next."""

import numpy as np

from engine.compiler.decorators import INT64_0, inline, noinline
from engine.compiler.lanes import EightFrom, FewFrom, lane_sum, multiply_add, number_at, splat
from engine.kernel.codes import LANES
from engine.kernel.modes import (
    apply_loss,
    begin_step_mode,
    end_step_mode,
    kick_by_force,
    kick_by_spring,
    motion_of,
    put_motion,
)
from engine.kernel.sums import lanes_of


@inline
def step_mode(h, push, m, motion):
    """Step mode m; `push`, if there is one, is added to its momentum in each half-kick. Returns the energy lost, the
    momentum of its drift, and the momentum with which it would drift in the next step."""
    x = number_at(motion.q, m)
    half, lost_first = begin_step_mode(h, motion.compensation, m, x, number_at(motion.p, m))
    half = kick_by_force(push, half)
    moved, left, lost_later = end_step_mode(h, push, motion.compensation, m, x, half)
    coming = coming_momentum(h, motion.compensation, m, moved, left)  # before they are written, or all is read again
    put_motion(motion, m, moved, left)
    return lost_first + lost_later, half, coming


@inline
def coming_momentum(h, compensation, m, q, p):
    """Return the momentum of mode m in the coming drift, if nothing else acts. Unlike
    engine.kernel.modes.begin_step_mode, this changes nothing."""
    left, _ = apply_loss(h.loss, m, p)
    return kick_by_spring(h.spring_kick, m, q, add_weight_kick(h.weight_kick, compensation, m, left))


@inline
def add_weight_kick(weight_kick, compensation, m, p):
    """Return the momentum after half a kick by weight. Unlike engine.kernel.modes.kick_by_weight, this carries no
    rounding."""
    if weight_kick is None:
        return p
    return p + (number_at(weight_kick, m) - number_at(compensation, m))


@inline
def add_step(sums, stepped, drift_phi):
    """Return the sums with the moves of a connection by modes added, in this step and in the next. Its v·Φ are
    given."""
    return multiply_add(drift_phi, stepped[1], sums[0]), multiply_add(drift_phi, stepped[2], sums[1])


@inline
def keep_sums(joined, i, sums):
    """Add sums over modes, in lanes, to how far coordinate i moves in this step and in the next."""
    joined.move[i] += lane_sum(sums[0])
    joined.free_move[i] += lane_sum(sums[1])


@inline
def push_of(pushes, m):
    """Return the momentum that contacts give mode m, or eight, in half a kick; None where there are no contacts."""
    if pushes is None:
        return None
    return number_at(pushes, m)


@inline
def add_push(pushes, m, push):
    """Return the momentum that connections and contacts give mode m, or eight, in half a kick."""
    if pushes is None:
        return push
    return push + number_at(pushes, m)


# --- how far a point will move


@inline
def coming_move(coefficients, h, place, m, motion):
    """Return how far mode m, or eight, moves a point in the coming drift, m. place: of the first of these in its row"""
    q, p = number_at(motion.q, m), number_at(motion.p, m)
    return number_at(coefficients.drift_phi, place) * coming_momentum(h, motion.compensation, m, q, p)


@noinline
def coming_move_at_row(rows, coefficients, h, r, state):
    """Return how far the coming drift moves the point of row r, m, if nothing but the springs of its modes acts."""
    first, row = np.int64(rows.mode_begin[r]), np.int64(rows.offset[r])
    count, total, motion = np.int64(rows.mode_end[r]) - first, splat(0.0), motion_of(state)
    whole = lanes_of(count)
    for k in range(INT64_0, whole, LANES):
        total = total + coming_move(coefficients, h, EightFrom(row + k), EightFrom(first + k), motion)
    if whole < count:
        place, m = FewFrom(row + whole, count - whole), FewFrom(first + whole, count - whole)
        total = total + coming_move(coefficients, h, place, m, motion)
    return lane_sum(total)
