"""A step of an island on which only its connections act, in one pass over the modes.

The pass kicks and drifts each mode, and also finds how far the next drift would move the connections
(`ConnectionState.free_move`). So the forces of the next step are known before its pass. Every number between two passes
is that at a sample.
"""

import numpy as np

from engine.compiler.decorators import FALSE, INT64_0, INT64_1, inline
from engine.compiler.lanes import EightFrom, FewFrom, lane_sum, load_lanes, multiply_add, number_at, splat
from engine.kernel.codes import LANES
from engine.kernel.connected_modes import (
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
from engine.kernel.modes import motion_of
from engine.kernel.step import StepOutcome
from engine.kernel.sums import lanes_of


@inline
def connected_step(connection, h, state):
    """Do a step of an island in which only connections act on the modes. Returns a StepOutcome."""
    find_forces(connection, h, state)
    lost = move_all(connection, None, h, state)
    return StepOutcome(FALSE, INT64_0, lost, 0.0)


@inline
def find_forces(connection, h, state):
    """Find the forces of connections, if nothing else pushes."""
    joined = state.connection
    update_factors(connection, h.connection, h.contact, state)
    if joined.is_move_known[0] == 0:
        clear_moves(joined)
        for r in range(connection.coordinate.shape[0]):
            move = coming_move_at_row(connection.rows, h.connection.rows, h, r, state)
            joined.free_move[connection.coordinate[r]] += move
        joined.is_move_known[0] = 1
    solve_connections(h.connection, joined)


@inline
def move_all(connection, pushes, h, state):
    """Step all modes, and move the connections with them. Returns the energy lost, J.

    pushes: momentum that contacts give each mode in half a kick, or None
    """
    clear_moves(state.connection)
    lost = step_as_modes_allow(h.weight_kick, h.drag, pushes, connection, h, state)
    return lost + finish_connections(connection, h, state)


@inline
def clear_moves(joined):
    """Set the moves of all connections to zero, those in this step and those in the next."""
    for i in range(joined.move.shape[0]):
        joined.move[i] = joined.free_move[i] = 0.0


@inline
def step_as_modes_allow(weight_kick, drag, pushes, connection, h, state):
    """Step all modes, without reading the weight and the drag if the modes of the island have none. Returns the energy
    lost, J."""
    if weight_kick is None:
        if drag is None:
            return 0.5 * step_all(connection, pushes, plain_step(h), state)
    if connection.is_plain[0] != 0:
        return 0.5 * step_all(connection, pushes, plain_step(h), state)
    return step_all(connection, pushes, h, state)


@inline
def plain_step(h):
    """Return the coefficients of a step without weight and without loss in the drift. The losses of such a step are
    twice the energy, and are found from the momenta (engine.kernel.modes.energy_of_loss)."""
    loss = only_decay(h.loss)
    return StepCoefficients(h.kick, h.drift, h.spring_kick, None, loss, None, h.connection, h.contact, h.force)


@inline
def only_decay(loss):
    """Return a loss without the factor of its energy."""
    if loss is None:
        return None
    return ModalLoss(loss.decay_factor, None)


@inline
def step_all(connection, pushes, h, state):
    """Step all modes, those of each group of bodies with all rows of connections on them. Returns the energy lost,
    J."""
    total, begin, r, parts = splat(0.0), INT64_0, INT64_0, connection.coordinate.shape[0]
    while r < parts:
        first, end = np.int64(connection.rows.mode_begin[r]), np.int64(connection.rows.mode_end[r])
        count = INT64_1
        while r + count < parts and connection.rows.mode_begin[r + count] == first:
            count += 1
        if begin < first:
            total = total + step_free_modes(pushes, h, begin, first, state)
        total = total + step_connected_modes(connection, pushes, h, (r, count), state)
        begin, r = end, r + count
    if begin < state.p.shape[0]:
        total = total + step_free_modes(pushes, h, begin, state.p.shape[0], state)
    return lane_sum(total)


# --- modes beside each other


@inline
def step_free_mode(pushes, h, m, motion):
    """Step mode m, or eight, to which nothing is connected. Returns the energy lost."""
    return step_mode(h, push_of(pushes, m), m, motion)[0]


@inline
def step_free_modes(pushes, h, begin, end, state):
    """Step modes begin:end, to which nothing is connected. Returns the energy lost, in lanes."""
    total, whole, motion = splat(0.0), begin + lanes_of(end - begin), motion_of(state)
    for m in range(begin, whole, LANES):
        total = total + step_free_mode(pushes, h, EightFrom(m), motion)
    if whole < end:
        total = total + step_free_mode(pushes, h, FewFrom(whole, end - whole), motion)
    return total


@inline
def step_connected_modes(connection, pushes, h, parts, state):
    """Step modes that connections hold, and add how far they move these, in this step and in the next. Returns the
    energy lost, in lanes.

    parts: the first row of these modes in the connections, and the number of their rows
    """
    r, count = parts
    if count == 1:
        return step_modes_of_one_part(connection, pushes, h, r, state)
    if count == 2:
        return step_modes_of_two_parts(connection, pushes, h, r, state)
    return step_modes_of_many_parts(connection, pushes, h, parts, state)


@inline
def step_at_one_part(pushes, h, row, f, m, motion):
    """Step mode m, or eight, which a connection pushes with force f. Returns the energy lost, and the momenta of the
    drift in this step and in the next."""
    push = add_push(pushes, m, number_at(h.connection.rows.kick_phi, row) * f)
    return step_mode(h, push, m, motion)


@inline
def step_modes_of_one_part(connection, pushes, h, r, state):
    """Step modes with one row in the connections, and add how far they move its connection, in this step and in the
    next. Returns the energy lost, in lanes."""
    first, row = np.int64(connection.rows.mode_begin[r]), np.int64(connection.rows.offset[r])
    count, i = np.int64(connection.rows.mode_end[r]) - first, connection.coordinate[r]
    f, whole, total, drift = -state.connection.force[i], lanes_of(count), splat(0.0), h.connection.rows.drift_phi
    moves, motion = (splat(0.0), splat(0.0)), motion_of(state)
    for k in range(INT64_0, whole, LANES):
        stepped = step_at_one_part(pushes, h, EightFrom(row + k), f, EightFrom(first + k), motion)
        total, moves = total + stepped[0], add_step(moves, stepped, load_lanes(drift, row + k))
    if whole < count:
        at, m = FewFrom(row + whole, count - whole), FewFrom(first + whole, count - whole)
        stepped = step_at_one_part(pushes, h, at, f, m, motion)
        total, moves = total + stepped[0], add_step(moves, stepped, number_at(drift, at))
    keep_sums(state.connection, i, moves)
    return total


@inline
def step_at_two_parts(pushes, h, rows, forces, m, motion):
    """Step mode m, or eight, which two connections push. Returns the energy lost, and the momenta of the drift in this
    step and in the next."""
    kick = h.connection.rows.kick_phi
    push = multiply_add(number_at(kick, rows[0]), forces[0], number_at(kick, rows[1]) * forces[1])
    push = add_push(pushes, m, push)
    return step_mode(h, push, m, motion)


@inline
def step_modes_of_two_parts(connection, pushes, h, r, state):
    """Step modes with two rows in the connections, and add how far they move these two, in this step and in the next.
    Returns the energy lost, in lanes."""
    first, a = np.int64(connection.rows.mode_begin[r]), np.int64(connection.rows.offset[r])
    b, count = np.int64(connection.rows.offset[r + 1]), np.int64(connection.rows.mode_end[r]) - first
    i, j, joined = connection.coordinate[r], connection.coordinate[r + 1], state.connection
    forces, whole, total, drift = (-joined.force[i], -joined.force[j]), lanes_of(count), splat(0.0), h.connection.rows
    motion, drift, moves, others = motion_of(state), drift.drift_phi, (splat(0.0), splat(0.0)), (splat(0.0), splat(0.0))
    for k in range(INT64_0, whole, LANES):
        rows = EightFrom(a + k), EightFrom(b + k)
        stepped = step_at_two_parts(pushes, h, rows, forces, EightFrom(first + k), motion)
        total, moves = total + stepped[0], add_step(moves, stepped, number_at(drift, rows[0]))
        others = add_step(others, stepped, number_at(drift, rows[1]))
    if whole < count:
        rest = count - whole
        few = FewFrom(a + whole, rest), FewFrom(b + whole, rest)
        stepped = step_at_two_parts(pushes, h, few, forces, FewFrom(first + whole, rest), motion)
        total, moves = total + stepped[0], add_step(moves, stepped, number_at(drift, few[0]))
        others = add_step(others, stepped, number_at(drift, few[1]))
    keep_sums(joined, i, moves)
    keep_sums(joined, j, others)
    return total
