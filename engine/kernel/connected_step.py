"""A step of an island whose connections alone act: in one pass over the modes.

The pass kicks and drifts each mode, and finds at once how the next drift would move the connections
(`ConnectionState.free_move`): so the forces of the next step are known before its pass. Every number between two passes
is that at a sample.
"""

import numpy as np

from engine.compiler.decorators import FALSE, INT64_0, INT64_1, inline, noinline
from engine.compiler.lanes import (
    EightFrom,
    FewFrom,
    lane_sum,
    load_lanes,
    multiply_add,
    number_at,
    put_number,
    splat,
    store_lanes,
)
from engine.kernel.codes import LANES
from engine.kernel.connection_factors import update_factors
from engine.kernel.connections import finish_connections, solve_connections
from engine.kernel.modes import apply_loss, begin_step_mode, end_step_mode_pushed, kick_by_force, kick_by_spring
from engine.kernel.step import StepOutcome
from engine.kernel.sums import lanes_of


@inline
def connected_step(connection, weight, h, state):
    """A step of an island in which only connections act on the modes. Returns a StepOutcome."""
    joined = state.connection
    update_factors(connection, h.connection, h.contact, state)
    if joined.is_move_known[0] == 0:
        for i in range(joined.free_move.shape[0]):
            joined.free_move[i] = 0.0
        for r in range(connection.coordinate.shape[0]):
            joined.free_move[connection.coordinate[r]] += move_at_part(connection, weight, h, r, state)
    solve_connections(h.connection, joined)
    for i in range(joined.force.shape[0]):
        store_lanes(joined.lanes[i], INT64_0, splat(0.0))
        store_lanes(joined.lanes[i], LANES, splat(0.0))
    total, begin, r, parts = splat(0.0), INT64_0, INT64_0, connection.coordinate.shape[0]
    while r < parts:
        first, end = np.int64(connection.rows.mode_begin[r]), np.int64(connection.rows.mode_end[r])
        count = INT64_1
        while r + count < parts and connection.rows.mode_begin[r + count] == first:
            count += 1
        if begin < first:
            total = total + step_free_modes(weight, h, begin, first, state)
        total = total + step_connected_modes(connection, weight, h, (r, count), state)
        begin, r = end, r + count
    if begin < state.p.shape[0]:
        total = total + step_free_modes(weight, h, begin, state.p.shape[0], state)
    for i in range(joined.force.shape[0]):
        joined.move[i] = lane_sum(load_lanes(joined.lanes[i], INT64_0))
        joined.free_move[i] = lane_sum(load_lanes(joined.lanes[i], LANES))
    joined.is_move_known[0] = 1
    lost = lane_sum(total) + finish_connections(connection, h, state)
    return StepOutcome(FALSE, INT64_0, lost, 0.0)


# --- one mode, or eight


@inline
def step_mode(weight, h, compensation, push, m, q, p):
    """A step of mode m that takes `push`, if there is one, in each half of its kick. Returns the energy lost, the
    momentum with which it has drifted, and that with which it would drift in the next step."""
    x = number_at(q, m)
    half, lost_first = begin_step_mode(h, weight, compensation, m, x, number_at(p, m))
    half = kick_by_force(push, half)
    moved, left, lost_later = end_step_mode_pushed(h, push, weight, compensation, m, x, half)
    coming = coming_momentum(
        weight, h, compensation, m, moved, left
    )  # before q and p are written, or all is read again
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


# --- modes of a body


@inline
def move_at(weight, h, place, m, state):
    """What mode m, or eight, adds to the coming move of a connection. place: of the first in its row"""
    q, p = number_at(state.q, m), number_at(state.p, m)
    return number_at(h.connection.rows.drift_phi, place) * coming_momentum(weight, h, state.kick_compensation, m, q, p)


@noinline
def move_at_part(connection, weight, h, r, state):
    """How the coming drift changes an extension by what part r moves."""
    first, row = np.int64(connection.rows.mode_begin[r]), np.int64(connection.rows.offset[r])
    count, total = np.int64(connection.rows.mode_end[r]) - first, splat(0.0)
    whole = lanes_of(count)
    for k in range(INT64_0, whole, LANES):
        total = total + move_at(weight, h, EightFrom(row + k), EightFrom(first + k), state)
    if whole < count:
        rest = count - whole
        total = total + move_at(weight, h, FewFrom(row + whole, rest), FewFrom(first + whole, rest), state)
    return lane_sum(total)


@inline
def step_free_modes(weight, h, begin, end, state):
    """A step of modes begin:end, which nothing is connected to. Returns the energy lost, in lanes."""
    total, whole, kept = splat(0.0), begin + lanes_of(end - begin), state.kick_compensation
    for m in range(begin, whole, LANES):
        total = total + step_mode(weight, h, kept, None, EightFrom(m), state.q, state.p)[0]
    if whole < end:
        total = total + step_mode(weight, h, kept, None, FewFrom(whole, end - whole), state.q, state.p)[0]
    return total


@inline
def step_connected_modes(connection, weight, h, parts, state):
    """A step of the modes of a body that connections hold; what they move these by, and will, is added to the lanes of
    each. Returns the energy lost, in lanes.

    parts: the first of the body, and how many it has
    """
    r, count = parts
    if count == 1:
        return step_modes_of_one_part(connection, weight, h, r, state)
    if count == 2:
        return step_modes_of_two_parts(connection, weight, h, r, state)
    return step_modes_of_many_parts(connection, weight, h, parts, state)


@inline
def step_at_one_part(weight, h, row, f, m, state):
    """As `step_mode`, of a mode that a connection pushes with force f."""
    push = number_at(h.connection.rows.kick_phi, row) * f
    return step_mode(weight, h, state.kick_compensation, push, m, state.q, state.p)


@inline
def step_modes_of_one_part(connection, weight, h, r, state):
    """As `step_connected_modes`, of a body with one part."""
    first, row = np.int64(connection.rows.mode_begin[r]), np.int64(connection.rows.offset[r])
    count, i = np.int64(connection.rows.mode_end[r]) - first, connection.coordinate[r]
    f, whole, total, drift = -state.connection.force[i], lanes_of(count), splat(0.0), h.connection.rows.drift_phi
    moves = begin_sums(state.connection, i)
    for k in range(INT64_0, whole, LANES):
        stepped = step_at_one_part(weight, h, EightFrom(row + k), f, EightFrom(first + k), state)
        total, moves = total + stepped[0], add_step(moves, stepped, load_lanes(drift, row + k))
    if whole < count:
        at, m = FewFrom(row + whole, count - whole), FewFrom(first + whole, count - whole)
        stepped = step_at_one_part(weight, h, at, f, m, state)
        total, moves = total + stepped[0], add_step(moves, stepped, number_at(drift, at))
    keep_sums(state.connection, i, moves)
    return total


@inline
def begin_sums(joined, i):
    """What coordinate i is moved by and will be moved by, so far, in lanes."""
    return load_lanes(joined.lanes[i], INT64_0), load_lanes(joined.lanes[i], LANES)


@inline
def add_step(sums, stepped, drift_phi):
    """Add what modes did, and will do, whose v·Φ are given."""
    return multiply_add(drift_phi, stepped[1], sums[0]), multiply_add(drift_phi, stepped[2], sums[1])


@inline
def keep_sums(joined, i, sums):
    """Put the sums of coordinate i back."""
    store_lanes(joined.lanes[i], INT64_0, sums[0])
    store_lanes(joined.lanes[i], LANES, sums[1])


@inline
def step_at_two_parts(weight, h, rows, forces, m, state):
    """As `step_mode`, of a mode that two connections push."""
    kick = h.connection.rows.kick_phi
    push = multiply_add(number_at(kick, rows[0]), forces[0], number_at(kick, rows[1]) * forces[1])
    return step_mode(weight, h, state.kick_compensation, push, m, state.q, state.p)


@inline
def step_modes_of_two_parts(connection, weight, h, r, state):
    """As `step_connected_modes`, of a body with two parts."""
    first, a = np.int64(connection.rows.mode_begin[r]), np.int64(connection.rows.offset[r])
    b, count = np.int64(connection.rows.offset[r + 1]), np.int64(connection.rows.mode_end[r]) - first
    i, j, joined = connection.coordinate[r], connection.coordinate[r + 1], state.connection
    forces, whole, total, drift = (-joined.force[i], -joined.force[j]), lanes_of(count), splat(0.0), h.connection.rows
    drift, moves, others = drift.drift_phi, begin_sums(joined, i), begin_sums(joined, j)
    for k in range(INT64_0, whole, LANES):
        rows = EightFrom(a + k), EightFrom(b + k)
        stepped = step_at_two_parts(weight, h, rows, forces, EightFrom(first + k), state)
        total, moves = total + stepped[0], add_step(moves, stepped, number_at(drift, rows[0]))
        others = add_step(others, stepped, number_at(drift, rows[1]))
    if whole < count:
        rest = count - whole
        few = FewFrom(a + whole, rest), FewFrom(b + whole, rest)
        stepped = step_at_two_parts(weight, h, few, forces, FewFrom(first + whole, rest), state)
        total, moves = total + stepped[0], add_step(moves, stepped, number_at(drift, few[0]))
        others = add_step(others, stepped, number_at(drift, few[1]))
    keep_sums(joined, i, moves)
    keep_sums(joined, j, others)
    return total


@noinline
def step_modes_of_many_parts(connection, weight, h, parts, state):
    """As `step_connected_modes`, of a body with any number of parts."""
    (r, count), rows, joined = parts, connection.rows, state.connection
    first = np.int64(rows.mode_begin[r])
    size, total = np.int64(rows.mode_end[r]) - first, splat(0.0)
    whole = lanes_of(size)
    for k in range(INT64_0, whole, LANES):
        push = splat(0.0)
        for n in range(r, r + count):
            kick = load_lanes(h.connection.rows.kick_phi, np.int64(rows.offset[n]) + k)
            push = multiply_add(kick, -joined.force[connection.coordinate[n]], push)
        stepped = step_mode(weight, h, state.kick_compensation, push, EightFrom(first + k), state.q, state.p)
        total = total + stepped[0]
        for n in range(r, r + count):
            drift, i = load_lanes(h.connection.rows.drift_phi, np.int64(rows.offset[n]) + k), connection.coordinate[n]
            keep_sums(joined, i, add_step(begin_sums(joined, i), stepped, drift))
    if whole < size:
        rest, push = size - whole, splat(0.0)
        for n in range(r, r + count):
            kick = number_at(h.connection.rows.kick_phi, FewFrom(np.int64(rows.offset[n]) + whole, rest))
            push = multiply_add(kick, -joined.force[connection.coordinate[n]], push)
        m = FewFrom(first + whole, rest)
        stepped = step_mode(weight, h, state.kick_compensation, push, m, state.q, state.p)
        total = total + stepped[0]
        for n in range(r, r + count):
            at, i = FewFrom(np.int64(rows.offset[n]) + whole, rest), connection.coordinate[n]
            keep_sums(joined, i, add_step(begin_sums(joined, i), stepped, number_at(h.connection.rows.drift_phi, at)))
    return total
