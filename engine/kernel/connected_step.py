"""A step of an island whose connections alone act: in one pass over the modes.

The pass kicks and drifts each mode, and finds at once how the next drift would move the connections
(`ConnectionState.free_move`): so the forces of the next step are known before its pass. Every number between two passes
is that at a sample.
"""

import numpy as np

from engine.compiler.decorators import FALSE, INT64_0, INT64_1, inline
from engine.compiler.lanes import EightFrom, FewFrom, lane_sum, load_lanes, multiply_add, number_at, splat
from engine.kernel.codes import LANES
from engine.kernel.connected_modes import (
    Acting,
    add_push,
    add_step,
    coming_move_at_row,
    keep_sums,
    push_of,
    step_mode,
)
from engine.kernel.connected_step_of_many import step_modes_of_many_parts
from engine.kernel.connection_factors import update_factors
from engine.kernel.connections import finish_connections, solve_connections
from engine.kernel.model import ModalLoss, StepCoefficients
from engine.kernel.step import StepOutcome
from engine.kernel.sums import lanes_of


@inline
def connected_step(connection, weight, h, state):
    """A step of an island in which only connections act on the modes. Returns a StepOutcome."""
    find_forces(connection, weight, h, state)
    lost = move_all(connection, weight, None, h, state)
    return StepOutcome(FALSE, INT64_0, lost, 0.0)


@inline
def find_forces(connection, weight, h, state):
    """The forces of connections, if nothing else pushes."""
    joined = state.connection
    update_factors(connection, h.connection, h.contact, state)
    if joined.is_move_known[0] == 0:
        clear_moves(joined)
        for r in range(connection.coordinate.shape[0]):
            move = coming_move_at_row(connection.rows, h.connection.rows, weight, h, r, state)
            joined.free_move[connection.coordinate[r]] += move
        joined.is_move_known[0] = 1
    solve_connections(h.connection, joined)


@inline
def move_all(connection, weight, pushes, h, state):
    """Move all modes by a step, and with them the connections. Returns the energy lost, J.

    pushes: that contacts give each mode in half a kick, or None
    """
    clear_moves(state.connection)
    lost = step_as_modes_allow(weight, h.drag, pushes, connection, h, state)
    return lost + finish_connections(connection, h, state)


@inline
def clear_moves(joined):
    """Nothing has moved the connections, or is known to."""
    for i in range(joined.move.shape[0]):
        joined.move[i] = joined.free_move[i] = 0.0


@inline
def step_as_modes_allow(weight, drag, pushes, connection, h, state):
    """A step of all modes, in which nothing is read of what the modes of the island have not. Returns the energy lost,
    J."""
    if weight is None:
        if drag is None:
            return 0.5 * step_all(connection, Acting(None, pushes), plain_step(h), state)
    if connection.is_plain[0] != 0:
        return 0.5 * step_all(connection, Acting(None, pushes), plain_step(h), state)
    return step_all(connection, Acting(weight, pushes), h, state)


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
def step_all(connection, acting, h, state):
    """A step of all modes, those of each group of bodies with all its parts. Returns the energy lost, J."""
    total, begin, r, parts = splat(0.0), INT64_0, INT64_0, connection.coordinate.shape[0]
    while r < parts:
        first, end = np.int64(connection.rows.mode_begin[r]), np.int64(connection.rows.mode_end[r])
        count = INT64_1
        while r + count < parts and connection.rows.mode_begin[r + count] == first:
            count += 1
        if begin < first:
            total = total + step_free_modes(acting, h, begin, first, state)
        total = total + step_connected_modes(connection, acting, h, (r, count), state)
        begin, r = end, r + count
    if begin < state.p.shape[0]:
        total = total + step_free_modes(acting, h, begin, state.p.shape[0], state)
    return lane_sum(total)


# --- modes beside each other


@inline
def step_free_mode(acting, h, kept, m, state):
    """As `step_mode`, of a mode that nothing is connected to. Returns the energy lost."""
    return step_mode(acting.weight, h, kept, push_of(acting.pushes, m), m, state.q, state.p)[0]


@inline
def step_free_modes(acting, h, begin, end, state):
    """A step of modes begin:end, which nothing is connected to. Returns the energy lost, in lanes."""
    total, whole, kept = splat(0.0), begin + lanes_of(end - begin), state.kick_compensation
    for m in range(begin, whole, LANES):
        total = total + step_free_mode(acting, h, kept, EightFrom(m), state)
    if whole < end:
        total = total + step_free_mode(acting, h, kept, FewFrom(whole, end - whole), state)
    return total


@inline
def step_connected_modes(connection, acting, h, parts, state):
    """A step of modes that connections hold; what they move these by, and will, is added. Returns the energy lost, in
    lanes.

    parts: the first of these modes, and how many they have
    """
    r, count = parts
    if count == 1:
        return step_modes_of_one_part(connection, acting, h, r, state)
    if count == 2:
        return step_modes_of_two_parts(connection, acting, h, r, state)
    return step_modes_of_many_parts(connection, acting, h, parts, state)


@inline
def step_at_one_part(acting, h, row, f, m, state):
    """As `step_mode`, of a mode that a connection pushes with force f."""
    push = add_push(acting.pushes, m, number_at(h.connection.rows.kick_phi, row) * f)
    return step_mode(acting.weight, h, state.kick_compensation, push, m, state.q, state.p)


@inline
def step_modes_of_one_part(connection, acting, h, r, state):
    """As `step_connected_modes`, of modes with one part."""
    first, row = np.int64(connection.rows.mode_begin[r]), np.int64(connection.rows.offset[r])
    count, i = np.int64(connection.rows.mode_end[r]) - first, connection.coordinate[r]
    f, whole, total, drift = -state.connection.force[i], lanes_of(count), splat(0.0), h.connection.rows.drift_phi
    moves = splat(0.0), splat(0.0)
    for k in range(INT64_0, whole, LANES):
        stepped = step_at_one_part(acting, h, EightFrom(row + k), f, EightFrom(first + k), state)
        total, moves = total + stepped[0], add_step(moves, stepped, load_lanes(drift, row + k))
    if whole < count:
        at, m = FewFrom(row + whole, count - whole), FewFrom(first + whole, count - whole)
        stepped = step_at_one_part(acting, h, at, f, m, state)
        total, moves = total + stepped[0], add_step(moves, stepped, number_at(drift, at))
    keep_sums(state.connection, i, moves)
    return total


@inline
def step_at_two_parts(acting, h, rows, forces, m, state):
    """As `step_mode`, of a mode that two connections push."""
    kick = h.connection.rows.kick_phi
    push = multiply_add(number_at(kick, rows[0]), forces[0], number_at(kick, rows[1]) * forces[1])
    push = add_push(acting.pushes, m, push)
    return step_mode(acting.weight, h, state.kick_compensation, push, m, state.q, state.p)


@inline
def step_modes_of_two_parts(connection, acting, h, r, state):
    """As `step_connected_modes`, of modes with two parts."""
    first, a = np.int64(connection.rows.mode_begin[r]), np.int64(connection.rows.offset[r])
    b, count = np.int64(connection.rows.offset[r + 1]), np.int64(connection.rows.mode_end[r]) - first
    i, j, joined = connection.coordinate[r], connection.coordinate[r + 1], state.connection
    forces, whole, total, drift = (-joined.force[i], -joined.force[j]), lanes_of(count), splat(0.0), h.connection.rows
    drift, moves, others = drift.drift_phi, (splat(0.0), splat(0.0)), (splat(0.0), splat(0.0))
    for k in range(INT64_0, whole, LANES):
        rows = EightFrom(a + k), EightFrom(b + k)
        stepped = step_at_two_parts(acting, h, rows, forces, EightFrom(first + k), state)
        total, moves = total + stepped[0], add_step(moves, stepped, number_at(drift, rows[0]))
        others = add_step(others, stepped, number_at(drift, rows[1]))
    if whole < count:
        rest = count - whole
        few = FewFrom(a + whole, rest), FewFrom(b + whole, rest)
        stepped = step_at_two_parts(acting, h, few, forces, FewFrom(first + whole, rest), state)
        total, moves = total + stepped[0], add_step(moves, stepped, number_at(drift, few[0]))
        others = add_step(others, stepped, number_at(drift, few[1]))
    keep_sums(joined, i, moves)
    keep_sums(joined, j, others)
    return total
