"""Connections: springs and dampers between bodies that hold both ways, rigid joints, and ends of strings that move.

Their forces are constant over a step, and linear in extensions and moves
(engine.kernel.interactions.connection_factors), so that they need no iteration, and no stiffness makes a step unstable
(docs/design.md, "Connections"). They act like any other force: half a kick before the drift, and half a kick after it.
They are found first, and corrected for what the contact forces of the same step move.
"""

import math

import numpy as np

from engine.compiler.decorators import INT64_0, inline, noinline
from engine.compiler.lanes import multiply_add, number_at, place_after, put_number, splat, zero_like
from engine.kernel.data.enums import EventKind
from engine.kernel.interactions.connection_factors import update_factors
from engine.kernel.interactions.contacts import contact_number
from engine.kernel.modes.mode_step import forget_drift
from engine.kernel.modes.ordered_sums import copy_items, fold_lanes, sum_products
from engine.kernel.modes.point_rows import (
    displacement_at_row,
    drifts_of_same_modes,
    project,
    project_drift,
    push_at_row,
    push_both_at_row,
    push_both_at_rows_of_same_modes,
    rows_of_same_modes,
)


@inline
def count_connections(connection, state):
    """Number of coordinates that the connections of the island have."""
    if connection is None:
        return INT64_0
    return state.connection.extension.shape[0]


@inline
def has_connections(connection, state):
    """True if anything in the island is connected."""
    if connection is None:
        return False
    return state.connection.extension.shape[0] > 0


@inline
def forget_near_contacts(connection_state):
    """Mark state.connection.near as out of date, because other contacts may close. connection_state: ConnectionState or
    None"""
    if connection_state is not None:
        connection_state.near.until[0] = 0


# --- within a step


@inline
def product_at(matrix, i, x):
    """Return the product of row i of a matrix and a vector."""
    return sum_products(matrix, np.int64(i) * x.shape[0], x, INT64_0, x.shape[0])


@inline
def project_rows(connection, h, p, begin, end, moves):
    """Add how far a drift with momenta p moves rows begin:end of connections to the moves of their coordinates, m."""
    r, of = begin, connection.coordinate
    while r < end:
        count = rows_of_same_modes(connection.rows, r, end)
        if count == 1:
            moves[of[r]] += project_drift(connection.rows, h.rows, r, p)
        else:
            a, b, c, d = drifts_of_same_modes(connection.rows, h.rows, r, count, p)
            moves[of[r]] += a
            moves[of[r + 1]] += b
            if count > 2:
                moves[of[r + 2]] += c
            if count > 3:
                moves[of[r + 3]] += d
        r += count


@inline
def push_at_rows(connection, h, begin, end, state):
    """Do half a kick by the forces at rows begin:end, and keep it for the second one."""
    r, of, forces = begin, connection.coordinate, state.connection.force
    while r < end:
        count = rows_of_same_modes(connection.rows, r, end)
        c = -forces[of[r + 2]] if count > 2 else 0.0
        d = -forces[of[r + 3]] if count > 3 else 0.0
        if count == 1:
            push_both_at_row(connection.rows, h.rows, r, -forces[of[r]], state)
        else:
            four = -forces[of[r]], -forces[of[r + 1]], c, d
            push_both_at_rows_of_same_modes(connection.rows, h.rows, r, count, four, state)
        r += count


@inline
def clear_moves(moves):
    """Set the moves of all connections to zero."""
    for i in range(moves.shape[0]):
        moves[i] = 0.0


@inline
def find_connection_forces(connection, h, state):
    """Find the forces of connections, if no contact pushes."""
    if connection is not None:
        connection_state = state.connection
        if connection_state.extension.shape[0] > 0:
            update_factors(connection, h.connection, h.contact, state)
            if connection_state.is_move_known[0] == 0:
                clear_moves(connection_state.free_move)
                rows = connection.coordinate.shape[0]
                project_rows(connection, h.connection, state.drift_momentum, INT64_0, rows, connection_state.free_move)
            find_forces(h.connection, connection_state)


@inline
def find_forces(h, connection_state):
    """Compute the forces of connections from their extensions and moves: X·s + Y·g. h: ConnectionCoefficients"""
    of = h.force_per_extension, connection_state.extension, h.force_per_move, connection_state.free_move
    fold_lanes(put_force, (of, connection_state.force), connection_state.force.shape[0], (splat(0.0),))


@inline
def put_force(of, i, sums):
    """Compute force i, or as many as i stands for: each column of X and Y adds to all of them."""
    (x, s, y, g), force = of
    elastic, moved = zero_like(number_at(force, i)), zero_like(number_at(force, i))
    for j in range(force.shape[0]):
        column = place_after(i, np.int64(j) * force.shape[0])
        elastic = multiply_add(number_at(x, column), s[j], elastic)
        moved = multiply_add(number_at(y, column), g[j], moved)
    put_number(force, i, elastic + moved)
    return sums


@inline
def add_response(of, i, sums):
    """Add to force i, or to as many as i stands for, how they respond to moves: Y·g."""
    y, g, force = of
    total = number_at(force, i)
    for j in range(force.shape[0]):
        total = multiply_add(number_at(y, place_after(i, np.int64(j) * force.shape[0])), g[j], total)
    put_number(force, i, total)
    return sums


@noinline
def push_by_connections(connection, h, state):
    """Do half a kick by all connections, keep it for the second one, and measure how far the coming drift changes each
    extension. The moves of the next step are not known then."""
    if connection is not None:
        rows, connection_state = connection.coordinate.shape[0], state.connection
        push_at_rows(connection, h.connection, INT64_0, rows, state)
        clear_moves(connection_state.move)
        project_rows(connection, h.connection, state.drift_momentum, INT64_0, rows, connection_state.move)
        connection_state.is_move_known[0] = 0


@inline
def answer_contacts(connection, h, reach, state):
    """Correct the forces of connections for how far the contact forces move these."""
    if connection is not None:
        connection_state, n = state.connection, reach.size
        for i in range(connection_state.move.shape[0]):
            moved = 0.0
            for k in range(n):
                moved += reach.moves[i * n + k] * state.contact_force[contact_number(reach.numbers, k)]
            connection_state.move[i] = -moved
        of = h.connection.force_per_move, connection_state.move, connection_state.force
        fold_lanes(add_response, of, connection_state.force.shape[0], (splat(0.0),))


@inline
def moves_of_connections(connection, h):
    """Return how far a force at the contact moves each connection, m/N; None in a scene without connections."""
    if connection is None:
        return None
    return h.connection.contact_moves


@inline
def moved_by_connections(connection, moves, state):
    """Return how far the forces of connections move the contact in the coming drift, m."""
    moved = 0.0
    if connection is not None:
        f = state.connection.force
        for i in range(f.shape[0]):
            moved += moves[i] * f[i]
    return moved


@inline
def finish_connections(connection, h, state):
    """Update the extension of each connection. Returns the energy that dampers have taken, J.

    The moves are measured: the rounding of g - B·f would have the same sign in each step, and add up.
    """
    lost = 0.0
    if connection is not None:
        lost = extend_connections(h.connection.step_rate, state.connection)
    return lost


@inline
def extend_connections(step_rate, connection_state):
    """Add the move of each connection to its extension. What is too small to add is carried to the next step (Kahan).
    Returns the energy that dampers have taken, J."""
    lost = 0.0
    for i in range(connection_state.move.shape[0]):
        before, move = connection_state.extension[i], connection_state.move[i]
        lost += connection_state.damping[i] * step_rate[i] * move * move
        more = move + connection_state.extension_compensation[i]
        connection_state.extension[i] = before + more
        connection_state.extension_compensation[i] = more - (connection_state.extension[i] - before)
    return lost


# --- outside the steps


@inline
def save_extensions(connection_state, saved):
    """Keep the extensions in a SavedMotion. connection_state: ConnectionState or None"""
    if connection_state is not None:
        copy_items(connection_state.extension, saved.extension)
        copy_items(connection_state.extension_compensation, saved.extension_compensation)


@inline
def restore_extensions(connection_state, saved):
    """Take the extensions of a SavedMotion again. connection_state: ConnectionState or None"""
    if connection_state is not None:
        copy_items(saved.extension, connection_state.extension)
        copy_items(saved.extension_compensation, connection_state.extension_compensation)


@inline
def connection_energy(connection, state):
    """Energy that the connections hold, ½·s·K·s, J. That of string ends does not include what their strings hold while
    the ends are at rest."""
    total = 0.0
    if connection is not None:
        s = state.connection.extension
        for i in range(s.shape[0]):
            total += 0.5 * s[i] * (state.connection.stiffness[i] * s[i] + product_at(connection.coupling, i, s))
    return total


@inline
def damp_connections(connection, duration, is_end, state):
    """Let all dampers act outside the step for a duration, s, one after the other; at its end in the reverse order.
    Relative velocities fall as e^(-r·W·t), W = Φ·Φᵀ. Returns the energy lost, J."""
    lost = 0.0
    if connection is not None:
        lost = damp_each(connection, duration, is_end, state.connection.damping, state)
    return lost


@noinline
def damp_each(connection, duration, is_end, damping, state):
    """Let each damper of an island act for a duration, s, one after the other; at the end of a step in the reverse
    order. Returns the energy lost, J."""
    lost, count = 0.0, damping.shape[0]
    for n in range(count):
        i = count - 1 - n if is_end else n
        if damping[i] != 0.0:
            lost += damp_coordinate(connection, i, damping[i] * duration, state.p)
            forget_drift(state)
    return lost


@noinline
def damp_coordinate(connection, i, impulse, p):
    """Let the damper of coordinate i act. Returns the energy lost, J. impulse: its damping times how long it acts,
    kg"""
    velocity, mobility = 0.0, 0.0
    for r in range(connection.coordinate.shape[0]):
        if connection.coordinate[r] == i:
            velocity += project(connection.rows, r, p)
            begin = connection.rows.offset[r]
            for m in range(connection.rows.mode_end[r] - connection.rows.mode_begin[r]):
                mobility += connection.rows.phi[begin + m] * connection.rows.phi[begin + m]
    if mobility == 0.0:
        return 0.0
    share = -math.expm1(-impulse * mobility)
    push = velocity * share / mobility
    for r in range(connection.coordinate.shape[0]):
        if connection.coordinate[r] == i:
            push_at_row(connection.rows, connection.rows.phi, r, -push, p)
    return velocity * push - 0.5 * mobility * push * push


@inline
def reset_connections(connection, state):
    """Read the extensions from the modes; those of rigid connections stay as they are."""
    if connection is not None:
        connection_state = state.connection
        connection_state.is_move_known[0] = connection_state.near.until[0] = 0
        for i in range(connection_state.extension.shape[0]):
            if connection.is_rigid[i] == 0:
                connection_state.extension[i] = -connection_state.rest[i]
                connection_state.extension_compensation[i] = 0.0
        for r in range(connection.coordinate.shape[0]):
            if connection.is_rigid[connection.coordinate[r]] == 0:
                connection_state.extension[connection.coordinate[r]] += project(connection.rows, r, state.q)


# --- events


@inline
def shift_connections(connection, state, m, change):
    """Let the extensions of connections follow a change of mode m."""
    if connection is not None:
        for r in range(connection.coordinate.shape[0]):
            move = displacement_at_row(connection.rows, r, m, change)
            if move != 0.0:
                state.connection.extension[connection.coordinate[r]] += move
                state.connection.extension_compensation[connection.coordinate[r]] = 0.0


@inline
def connection_parameter(connection, kind, i, state):
    """Return what an event of a kind changes of coordinate i: its stiffness (N/m), damping (kg/s) or rest (m)."""
    if connection is None:
        return 0.0
    if kind == EventKind.CONNECTION_STIFFNESS:
        return state.connection.stiffness[i]
    if kind == EventKind.CONNECTION_DAMPING:
        return state.connection.damping[i]
    return state.connection.rest[i]


@inline
def set_connection_parameter(connection, kind, span, value, state):
    """Set this parameter of coordinates. span: the first, and the last + 1"""
    if connection is not None:
        connection_state = state.connection
        if connection_state.lowest_energy[0] != 0.0 or kind == EventKind.CONNECTION_REST:
            connection_state.lowest_energy[0] = -math.inf  # what is under load may rest at any energy by now
        for i in range(span[0], span[1]):
            if kind == EventKind.CONNECTION_STIFFNESS:
                connection_state.stiffness[i] = value
            elif kind == EventKind.CONNECTION_DAMPING:
                connection_state.damping[i] = value
            else:
                connection_state.extension[i] -= value - connection_state.rest[i]
                connection_state.rest[i] = value
