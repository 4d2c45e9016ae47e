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
)
from engine.kernel.codes import LANES
from engine.kernel.connection_factors import update_factors
from engine.kernel.connections import finish_connections, solve_connections
from engine.kernel.model import ModalLoss, StepCoefficients
from engine.kernel.modes import apply_loss, begin_step_mode, end_step_mode_pushed, kick_by_force, kick_by_spring
from engine.kernel.rows import ROWS_AT_ONCE
from engine.kernel.step import StepOutcome
from engine.kernel.sums import lanes_of


@inline
def connected_step(connection, weight, h, state):
    """A step of an island in which only connections act on the modes. Returns a StepOutcome."""
    joined = state.connection
    update_factors(connection, h.connection, h.contact, state)
    if joined.is_move_known[0] == 0:
        clear_moves(joined)
        for r in range(connection.coordinate.shape[0]):
            joined.free_move[connection.coordinate[r]] += move_at_part(connection, weight, h, r, state)
    solve_connections(h.connection, joined)
    clear_moves(joined)
    lost = step_as_modes_allow(weight, h.drag, connection, h, state)
    joined.is_move_known[0] = 1
    return StepOutcome(FALSE, INT64_0, lost + finish_connections(connection, h, state), 0.0)


@inline
def clear_moves(joined):
    """Nothing has moved the connections, or is known to."""
    for i in range(joined.move.shape[0]):
        joined.move[i] = joined.free_move[i] = 0.0


@inline
def step_as_modes_allow(weight, drag, connection, h, state):
    """A step of all modes, in which nothing is read of what the modes of the island have not. Returns the energy lost,
    J."""
    if weight is None:
        if drag is None:
            return 0.5 * step_all(connection, None, plain_step(h), state)
    if connection.is_plain[0] != 0:
        return 0.5 * step_all(connection, None, plain_step(h), state)
    return step_all(connection, weight, h, state)


@inline
def plain_step(h):
    """The coefficients of a step without loss in the drift, whose losses are twice the energy, found from the momenta
    (engine.kernel.modes.energy_of_loss)."""
    return StepCoefficients(h.kick, h.drift, h.spring_kick, only_decay(h.loss), None, h.connection, h.contact, h.force)


@inline
def only_decay(loss):
    """A loss without its energy."""
    if loss is None:
        return None
    return ModalLoss(loss.decay_factor, None)


@inline
def step_all(connection, weight, h, state):
    """A step of all modes, those of each group of bodies with all its parts. Returns the energy lost, J."""
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
    return lane_sum(total)


# --- one mode, or eight


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


# --- modes beside each other


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
    """A step of modes that connections hold; what they move these by, and will, is added. Returns the energy lost, in
    lanes.

    parts: the first of these modes, and how many they have
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
    """As `step_connected_modes`, of modes with one part."""
    first, row = np.int64(connection.rows.mode_begin[r]), np.int64(connection.rows.offset[r])
    count, i = np.int64(connection.rows.mode_end[r]) - first, connection.coordinate[r]
    f, whole, total, drift = -state.connection.force[i], lanes_of(count), splat(0.0), h.connection.rows.drift_phi
    moves = splat(0.0), splat(0.0)
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
def step_at_two_parts(weight, h, rows, forces, m, state):
    """As `step_mode`, of a mode that two connections push."""
    kick = h.connection.rows.kick_phi
    push = multiply_add(number_at(kick, rows[0]), forces[0], number_at(kick, rows[1]) * forces[1])
    return step_mode(weight, h, state.kick_compensation, push, m, state.q, state.p)


@inline
def step_modes_of_two_parts(connection, weight, h, r, state):
    """As `step_connected_modes`, of modes with two parts."""
    first, a = np.int64(connection.rows.mode_begin[r]), np.int64(connection.rows.offset[r])
    b, count = np.int64(connection.rows.offset[r + 1]), np.int64(connection.rows.mode_end[r]) - first
    i, j, joined = connection.coordinate[r], connection.coordinate[r + 1], state.connection
    forces, whole, total, drift = (-joined.force[i], -joined.force[j]), lanes_of(count), splat(0.0), h.connection.rows
    drift, moves, others = drift.drift_phi, (splat(0.0), splat(0.0)), (splat(0.0), splat(0.0))
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


# --- of many parts: their rows four at a time, so that sums stay in registers


@noinline
def step_modes_of_many_parts(connection, weight, h, parts, state):
    """As `step_connected_modes`, of modes with any number of parts."""
    (r, count), joined, total = parts, state.connection, splat(0.0)
    first, end = np.int64(connection.rows.mode_begin[r]), np.int64(connection.rows.mode_end[r])
    whole = first + lanes_of(end - first)
    for m in range(first, end):
        joined.push[m] = 0.0
    for n in range(INT64_0, count, ROWS_AT_ONCE):
        rows = four_rows(connection, r + n, count - n)
        forces = four_forces(connection, joined, r + n, count - n)
        for m in range(first, whole, LANES):
            add_pushes(h, eight_in_rows(rows, m), forces, EightFrom(m), joined.push)
        if whole < end:
            few = FewFrom(whole, end - whole)
            add_pushes(h, few_in_rows(rows, few), forces, few, joined.push)
    for m in range(first, whole, LANES):
        total = total + step_pushed_mode(weight, h, EightFrom(m), state)
    if whole < end:
        total = total + step_pushed_mode(weight, h, FewFrom(whole, end - whole), state)
    for n in range(INT64_0, count, ROWS_AT_ONCE):
        rows, zeros = four_rows(connection, r + n, count - n), (splat(0.0), splat(0.0))
        moves = zeros, zeros, zeros, zeros
        for m in range(first, whole, LANES):
            moves = add_moves(h, eight_in_rows(rows, m), moves, EightFrom(m), joined)
        if whole < end:
            few = FewFrom(whole, end - whole)
            moves = add_moves(h, few_in_rows(rows, few), moves, few, joined)
        keep_moves(connection, joined, r + n, count - n, moves)
    return total


@inline
def row_origin(connection, r):
    """Where the entry of mode 0 would be in row r."""
    return np.int64(connection.rows.offset[r]) - np.int64(connection.rows.mode_begin[r])


@inline
def four_rows(connection, r, left):
    """The origins of four rows from r on; of fewer than four, the last stands for the missing ones."""
    last = r + min(left, ROWS_AT_ONCE) - 1
    second, third = row_origin(connection, min(r + 1, last)), row_origin(connection, min(r + 2, last))
    return row_origin(connection, r), second, third, row_origin(connection, last)


@inline
def eight_in_rows(rows, m):
    """Where the entries of eight modes from m on are in four rows."""
    return EightFrom(rows[0] + m), EightFrom(rows[1] + m), EightFrom(rows[2] + m), EightFrom(rows[3] + m)


@inline
def few_in_rows(rows, few):
    """The same of fewer modes."""
    m, size = few
    return (
        FewFrom(rows[0] + m, size),
        FewFrom(rows[1] + m, size),
        FewFrom(rows[2] + m, size),
        FewFrom(rows[3] + m, size),
    )


@inline
def four_forces(connection, joined, r, left):
    """The forces on modes at four rows from r on, N; 0 for those that are missing."""
    f, of = joined.force, connection.coordinate
    b = -f[of[r + 1]] if left > 1 else 0.0
    c = -f[of[r + 2]] if left > 2 else 0.0
    d = -f[of[r + 3]] if left > 3 else 0.0
    return -f[of[r]], b, c, d


@inline
def add_pushes(h, places, forces, m, pushes):
    """Add what forces at four rows give mode m, or eight, in half a kick."""
    kick = h.connection.rows.kick_phi
    push = multiply_add(number_at(kick, places[0]), forces[0], number_at(pushes, m))
    push = multiply_add(number_at(kick, places[1]), forces[1], push)
    push = multiply_add(number_at(kick, places[2]), forces[2], push)
    put_number(pushes, m, multiply_add(number_at(kick, places[3]), forces[3], push))


@inline
def step_pushed_mode(weight, h, m, state):
    """A step of mode m, or of eight, whose push is known; the momenta with which it drifts and will are kept. Returns
    the energy lost."""
    joined = state.connection
    lost, half, coming = step_mode(weight, h, state.kick_compensation, number_at(joined.push, m), m, state.q, state.p)
    put_number(joined.push, m, half)
    put_number(joined.coming, m, coming)
    return lost


@inline
def add_moves(h, places, moves, m, joined):
    """Add what mode m, or eight, moves at four rows, and will, to these sums."""
    drift, stepped = h.connection.rows.drift_phi, (0.0, number_at(joined.push, m), number_at(joined.coming, m))
    a, b = (
        add_step(moves[0], stepped, number_at(drift, places[0])),
        add_step(moves[1], stepped, number_at(drift, places[1])),
    )
    c, d = (
        add_step(moves[2], stepped, number_at(drift, places[2])),
        add_step(moves[3], stepped, number_at(drift, places[3])),
    )
    return a, b, c, d


@inline
def keep_moves(connection, joined, r, left, moves):
    """Add the sums of four rows from r on, so far as there are any."""
    keep_sums(joined, connection.coordinate[r], moves[0])
    if left > 1:
        keep_sums(joined, connection.coordinate[r + 1], moves[1])
    if left > 2:
        keep_sums(joined, connection.coordinate[r + 2], moves[2])
    if left > 3:
        keep_sums(joined, connection.coordinate[r + 3], moves[3])
