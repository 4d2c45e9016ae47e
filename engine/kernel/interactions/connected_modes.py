"""The pass over the modes of an island with connections: it pushes by these, and finds how far they move in this step
and in the next, so that their forces in the next step are known before its pass."""

import math

import numpy as np

from engine.compiler.decorators import INT64_0, INT64_1, inline, noinline
from engine.compiler.lanes import lane_sum, multiply_add, number_at, place_after, splat
from engine.kernel.data.effects import DRAG, EFFECTS, WEIGHT
from engine.kernel.interactions.connections import clear, connection_energy, has_connections
from engine.kernel.modes.mode_energies import vibration_energy_of
from engine.kernel.modes.moving_modes import PushedPoint, count_loss, move_pushed_rows, move_some_modes, plain_step
from engine.kernel.modes.ordered_sums import fold_lanes
from engine.kernel.modes.potential import add_elastic, add_potential, potential_of, squared_pull


@inline
def move_connected_modes(connection, pushes, h, state):
    """Move all modes by a step, with the forces of connections, and find how far these move, in this step and in the
    next. Weight and drag are not read if the modes of the island have none. Returns the energy lost, J.

    pushes: State.push, or None if it is all zeros
    """
    connection_state = state.connection
    clear(connection_state.move)
    clear(connection_state.free_move)
    connection_state.is_move_known[0] = 1
    if EFFECTS & (WEIGHT | DRAG):
        if connection.is_plain[0] == 0:
            return move_groups(connection, pushes, h, 1.0, state)
    return move_groups(connection, pushes, plain_step(h), 0.5, state)


@inline
def move_groups(connection, pushes, h, share, state):
    """Move all modes, those of each body with all rows of connections on it. Returns the energy lost, J: this share of
    what the modes count."""
    losses, begin, r, parts = (splat(0.0), splat(0.0)), INT64_0, INT64_0, connection.coordinate.shape[0]
    while r < parts:
        first, end = np.int64(connection.rows.mode_begin[r]), np.int64(connection.rows.mode_end[r])
        count = INT64_1
        while r + count < parts and connection.rows.mode_begin[r + count] == first:
            count += 1
        if begin < first:
            losses, _, _ = move_some_modes(h, (pushes, None, None), begin, first - begin, losses, state)
        losses = move_group(connection, pushes, h, (r, count), losses, state)
        begin, r = end, r + count
    if begin < state.p.shape[0]:
        losses, _, _ = move_some_modes(h, (pushes, None, None), begin, state.p.shape[0] - begin, losses, state)
    return count_loss(share * lane_sum(losses[0]), share * lane_sum(losses[1]), state)


@inline
def point_of_row(connection, h, r, state):
    """Return the PushedPoint of row r."""
    rows, offset = h.connection.rows, np.int64(connection.rows.offset[r])
    return PushedPoint(rows.kick_phi, rows.drift_phi, offset, -state.connection.force[connection.coordinate[r]])


@inline
def add_moves_of_row(connection, r, moves, connection_state):
    """Add how far row r moves, in this step and in the next, in lanes, to the moves of its coordinate."""
    add_move(connection, r, lane_sum(moves[0]), lane_sum(moves[1]), connection_state)


@inline
def move_group(connection, pushes, h, rows, losses, state):
    """Move the modes of a body with so many rows. Returns the losses with theirs added.

    rows: the first, and their number
    """
    (r, count), connection_state = rows, state.connection
    if count > 2:
        return move_group_of_many(connection, pushes, h, rows, losses, state)
    first, modes = np.int64(connection.rows.mode_begin[r]), np.int64(connection.rows.mode_end[r])
    modes -= first
    a = point_of_row(connection, h, r, state)
    if count == 1:
        losses, moves, _ = move_some_modes(h, (pushes, a, None), first, modes, losses, state)
    else:
        b = point_of_row(connection, h, r + 1, state)
        losses, moves, others = move_some_modes(h, (pushes, a, b), first, modes, losses, state)
        add_moves_of_row(connection, r + 1, others, connection_state)
    add_moves_of_row(connection, r, moves, connection_state)
    return losses


# --- bodies with more than two rows, such as a board


@inline
def move_group_of_many(connection, pushes, h, rows, losses, state):
    """Move the modes of a body with more than two rows. Returns the losses with theirs added."""
    (r, count), connection_state = rows, state.connection
    first, modes = np.int64(connection.rows.mode_begin[r]), np.int64(connection.rows.mode_end[r])
    modes -= first
    for i in range(r, r + count):
        connection_state.force_on_row[i] = -connection_state.force[connection.coordinate[i]]
    begin = np.int64(connection.rows.offset[r])
    stride = np.int64(connection.rows.offset[r + 1]) - begin  # from row to row of one body
    pushed = h.connection.rows.kick_phi, begin, stride, connection_state.force_on_row, r, count
    losses = move_pushed_rows(h, pushes, pushed, (first, modes), losses, state)
    for i in range(r, r + count, 4):
        add_moves_of_four(connection, h.connection.rows.drift_phi, (i, r + count), (first, modes), state)
    for m in range(first, first + modes):
        state.push[m] = 0.0
    return losses


@inline
def add_drifts_of_four(of, k, sums):
    """Add to the sums how far mode k of a body moves four points in this drift, and in the next."""
    drift_phi, (a, b, c, d), state, first = of
    half, coming = number_at(state.push, place_after(k, first)), number_at(state.drift_momentum, place_after(k, first))
    e, f = number_at(drift_phi, place_after(k, a)), number_at(drift_phi, place_after(k, b))
    g, i = number_at(drift_phi, place_after(k, c)), number_at(drift_phi, place_after(k, d))
    now = multiply_add(e, half, sums[0]), multiply_add(f, half, sums[1])
    now = *now, multiply_add(g, half, sums[2]), multiply_add(i, half, sums[3])
    then = multiply_add(e, coming, sums[4]), multiply_add(f, coming, sums[5])
    return *now, *then, multiply_add(g, coming, sums[6]), multiply_add(i, coming, sums[7])


@inline
def add_moves_of_four(connection, drift_phi, rows, modes, state):
    """Add how far four rows of a body move in this step and in the next to the moves of their coordinates. Of fewer
    than four, the last stands for the missing ones.

    rows:  the first, and the last of the body + 1
    modes: the first, and their number
    """
    (r, end), (first, count), offset = rows, modes, connection.rows.offset
    last = end - 1
    places = np.int64(offset[r]), np.int64(offset[min(r + 1, last)])
    places = *places, np.int64(offset[min(r + 2, last)]), np.int64(offset[min(r + 3, last)])
    zero = splat(0.0)
    of, zeros = (drift_phi, places, state, first), (zero, zero, zero, zero, zero, zero, zero, zero)
    a, b, c, d, e, f, g, i = lane_sum(fold_lanes(add_drifts_of_four, of, count, zeros))
    add_move(connection, r, a, e, state.connection)
    if r + 1 < end:
        add_move(connection, r + 1, b, f, state.connection)
    if r + 2 < end:
        add_move(connection, r + 2, c, g, state.connection)
    if r + 3 < end:
        add_move(connection, r + 3, d, i, state.connection)


@inline
def add_move(connection, r, now, then, connection_state):
    """Add how far row r moves in this step, and in the next, to the moves of its coordinate."""
    i = connection.coordinate[r]
    connection_state.move[i] += now
    connection_state.free_move[i] += then


# --- energies: connected modes exchange theirs


@inline
def amplitude_of_connected(model, seconds, state):
    """√(2E) of what is connected, √J, E without the energy of weight; at most, for so many seconds."""
    if has_connections(state):
        return connected_amplitude(model, model.connection, seconds, state)
    return 0.0


@noinline
def connected_amplitude(model, connection, seconds, state):
    """Return √(2E) of what is connected, √J, in an island that has connections; at most, for so many seconds."""
    of = connection, potential_of(model), state
    twice, pull = fold_lanes(add_connected, of, state.p.shape[0], (splat(0.0), splat(0.0)))
    energy = lane_sum(twice) + 2.0 * connection_energy(connection, state)
    return math.sqrt(max(energy, 0.0)) + math.sqrt(lane_sum(pull)) * seconds


@inline
def add_connected(of, m, sums):
    """Add p² + ω²q² of mode m, and the square of its weight, to the sums; nothing if nothing is connected to it."""
    connection, potential, state = of
    q, p, share = number_at(state.q, m), number_at(state.p, m), 1.0 - number_at(connection.is_unconnected, m)
    vibration = add_elastic(potential.omega_squared, m, q, p * p)
    return sums[0] + share * vibration, sums[1] + share * squared_pull(potential.weight, m)


@inline
def energy_of_connected(model, state):
    """Energy of vibration of what is connected, J: beyond that of its rest, and beyond what `vibration_energy` counts
    of its modes."""
    if has_connections(state):
        return connected_energy(model.connection, potential_of(model), state)
    return 0.0


@noinline
def connected_energy(connection, potential, state):
    """Return the energy of vibration of what is connected, J, beyond that of its rest and that of its modes, in an
    island that has connections."""
    energy = connection_energy(connection, state) - state.connection.lowest_energy[0]
    for m in range(state.p.shape[0]):
        if connection.is_unconnected[m] == 0.0:
            elastic, fallen, _ = add_potential(potential, m, state.q[m], (0.0, 0.0, 0.0))
            energy += 0.5 * state.p[m] * state.p[m] + 0.5 * elastic - fallen
            energy -= vibration_energy_of(potential, m, state.q, state.p)
    return energy
