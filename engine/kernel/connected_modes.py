"""One mode, or eight, of what is connected: a step, and how far it moves the connections, in it and in the next."""

from typing import Any, NamedTuple

import numpy as np

from engine.compiler.decorators import INT64_0, inline, noinline
from engine.compiler.lanes import EightFrom, FewFrom, lane_sum, multiply_add, number_at, put_number, splat
from engine.kernel.codes import LANES
from engine.kernel.modes import apply_loss, begin_step_mode, end_step_mode_pushed, kick_by_force, kick_by_spring
from engine.kernel.sums import lanes_of


class Acting(NamedTuple):
    """What acts on modes beside their own springs and connections; None where it does not."""

    weight: Any  # of each mode
    pushes: Any  # that contacts give each mode in half a kick


@inline
def step_mode(weight, h, compensation, push, m, q, p):
    """A step of mode m that takes `push`, if there is one, in each half of its kick. Returns the energy lost, the
    momentum with which it has drifted, and that with which it would drift in the next step."""
    x = number_at(q, m)
    half, lost_first = begin_step_mode(h, weight, compensation, m, x, number_at(p, m))
    half = kick_by_force(push, half)
    moved, left, lost_later = end_step_mode_pushed(h, push, weight, compensation, m, x, half)
    coming = coming_momentum(weight, h, compensation, m, moved, left)  # before they are written, or all is read again
    put_number(q, m, moved)
    put_number(p, m, left)
    return lost_first + lost_later, half, coming


@inline
def coming_momentum(weight, h, compensation, m, q, p):
    """The momentum of mode m in the coming drift, if nothing else acts: as engine.kernel.modes.begin_step_mode, that
    changes nothing."""
    left, _ = apply_loss(h.loss, m, p)
    if weight is not None:
        left = left + (number_at(h.kick, m) * number_at(weight, m) - number_at(compensation, m))
    return kick_by_spring(h.spring_kick, m, q, left)


@inline
def add_step(sums, stepped, drift_phi):
    """Add how far modes move a connection, and will, whose v·Φ are given."""
    return multiply_add(drift_phi, stepped[1], sums[0]), multiply_add(drift_phi, stepped[2], sums[1])


@inline
def keep_sums(joined, i, sums):
    """Add what modes have moved coordinate i by, and will, in lanes."""
    joined.move[i] += lane_sum(sums[0])
    joined.free_move[i] += lane_sum(sums[1])


@inline
def push_of(pushes, m):
    """What contacts give mode m, or eight, in half a kick; None where there are none."""
    if pushes is None:
        return None
    return number_at(pushes, m)


@inline
def add_push(pushes, m, push):
    """What connections and contacts give mode m, or eight, in half a kick."""
    if pushes is None:
        return push
    return push + number_at(pushes, m)


# --- how far a point will move


@inline
def coming_move(coefficients, weight, h, place, m, state):
    """What mode m, or eight, adds to it. place: of the first in its row"""
    q, p = number_at(state.q, m), number_at(state.p, m)
    return number_at(coefficients.drift_phi, place) * coming_momentum(weight, h, state.kick_compensation, m, q, p)


@noinline
def coming_move_at_row(rows, coefficients, weight, h, r, state):
    """How far the coming drift moves the point of row r if nothing but the springs of its modes acts, m."""
    first, row = np.int64(rows.mode_begin[r]), np.int64(rows.offset[r])
    count, total = np.int64(rows.mode_end[r]) - first, splat(0.0)
    whole = lanes_of(count)
    for k in range(INT64_0, whole, LANES):
        total = total + coming_move(coefficients, weight, h, EightFrom(row + k), EightFrom(first + k), state)
    if whole < count:
        place, m = FewFrom(row + whole, count - whole), FewFrom(first + whole, count - whole)
        total = total + coming_move(coefficients, weight, h, place, m, state)
    return lane_sum(total)
