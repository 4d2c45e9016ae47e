"""Connections: springs and dampers between bodies that hold both ways, rigid joints, and ends of strings that move.

Their forces are constant over a step, and linear in extensions and moves (engine.kernel.connection_factors), so that
they need no iteration, and no stiffness makes a step unstable (docs/design.md, "Connections"). They act like any other
force: half a kick before the drift, and half a kick after it. Contacts are solved in between; what their forces move,
the connections answer in the same step.
"""

import math

import numpy as np

from engine.compiler.decorators import INT64_0, inline, noinline
from engine.kernel.connection_factors import update_factors
from engine.kernel.rows import (
    drifts_of_same_modes,
    kick_at_row,
    kick_at_rows_of_same_modes,
    project,
    project_drift,
    push_at_row,
    rows_of_same_modes,
)
from engine.kernel.sums import sum_products, sum_two_products


@inline
def count_connections(connection, state):
    """How many coordinates the connections of the island have."""
    if connection is None:
        return INT64_0
    return state.connection.extension.shape[0]


@inline
def has_connections(connection, state):
    """Whether anything in the island is connected."""
    if connection is None:
        return False
    return state.connection.extension.shape[0] > 0


@inline
def forget_moves(joined):
    """Motion has changed from outside: `free_move` holds no longer. joined: ConnectionState or None"""
    if joined is not None:
        joined.is_move_known[0] = 0


@inline
def forget_near_contacts(joined):
    """Other contacts than those in state.connection.near may close. joined: ConnectionState or None"""
    if joined is not None:
        joined.near.until[0] = 0


# --- within a step


@inline
def product_at(matrix, i, x):
    """Row i of a matrix times a vector."""
    return sum_products(matrix, np.int64(i) * x.shape[0], x, INT64_0, x.shape[0])


@inline
def project_moves(connection, h, p, moves):
    """How the coming drift changes each extension, m, into `moves`."""
    for i in range(moves.shape[0]):
        moves[i] = 0.0
    r, total, of = INT64_0, connection.coordinate.shape[0], connection.coordinate
    while r < total:
        count = rows_of_same_modes(connection.rows, r, total)
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
def kick_by_forces(connection, h, forces, p):
    """Half a kick by forces at all coordinates, N."""
    r, total, of = INT64_0, connection.coordinate.shape[0], connection.coordinate
    while r < total:
        count = rows_of_same_modes(connection.rows, r, total)
        if count == 1:
            kick_at_row(connection.rows, h.rows, r, -forces[of[r]], p)
        else:
            c = -forces[of[r + 2]] if count > 2 else 0.0
            d = -forces[of[r + 3]] if count > 3 else 0.0
            four = -forces[of[r]], -forces[of[r + 1]], c, d
            kick_at_rows_of_same_modes(connection.rows, h.rows, r, count, four, p)
        r += count


@inline
def push_by_connections(connection, h, state):
    """Half a kick by all connections."""
    if connection is not None:
        kick_by_forces(connection, h.connection, state.connection.force, state.p)


@inline
def solve_connections(h, joined):
    """The forces of connections, if no contact pushes, by `free_move`."""
    x, y, n = h.force_per_extension, h.force_per_move, joined.force.shape[0]
    for i in range(n):
        joined.force[i] = sum_two_products(x, joined.extension, y, joined.free_move, np.int64(i) * n, n)


@inline
def begin_connections(connection, h, state):
    """After the first half-kick of all else but contacts: find the forces of connections, and let them kick."""
    if connection is not None:
        if state.connection.extension.shape[0] > 0:
            update_factors(connection, h.connection, h.contact, state)
            state.connection.is_move_known[0] = 0
            project_moves(connection, h.connection, state.p, state.connection.free_move)
            solve_connections(h.connection, state.connection)
            push_by_connections(connection, h, state)


@inline
def answer_contact(connection, h, state, k, f):
    """After the first half-kick of contact k alone, by a force f: let the connections answer what it moves."""
    if connection is not None:
        joined, contacts = state.connection, state.compression.shape[0]
        for i in range(joined.move.shape[0]):
            joined.move[i] = -h.connection.contact_moves[i * contacts + k] * f
        answer(connection, h.connection, joined, state.p)


@inline
def answer_contacts(connection, h, state):
    """As `answer_contact`, of all contacts by their forces."""
    if connection is not None:
        if state.connection.extension.shape[0] > 0:
            joined, contacts = state.connection, state.compression.shape[0]
            for i in range(joined.move.shape[0]):
                moved = 0.0
                for k in range(contacts):
                    moved += h.connection.contact_moves[i * contacts + k] * state.contact_force[k]
                joined.move[i] = -moved
            answer(connection, h.connection, joined, state.p)


@inline
def answer(connection, h, joined, p):
    """The forces of connections change by Y times `move`, by which the bodies would move them further; and kick."""
    for i in range(joined.move.shape[0]):
        joined.free_move[i] = product_at(h.force_per_move, i, joined.move)
    kick_by_forces(connection, h, joined.free_move, p)
    for i in range(joined.move.shape[0]):
        joined.force[i] += joined.free_move[i]


@inline
def measure_moves(connection, h, state):
    """How far the coming drift changes each extension, from the momenta that the bodies have by now."""
    if connection is not None:
        project_moves(connection, h.connection, state.p, state.connection.move)


@inline
def hold_connections(connection, state):
    """Nothing moves in this step."""
    if connection is not None:
        for i in range(state.connection.move.shape[0]):
            state.connection.move[i] = 0.0


@inline
def finish_connections(connection, h, state):
    """Give each connection its new extension. Returns the energy that dampers have taken, J.

    The moves are measured: what rounding made of g - B·f would have the same sign in each step, and add up.
    """
    lost = 0.0
    if connection is not None:
        lost = extend_connections(h.connection.step_rate, state.connection)
    return lost


@inline
def extend_connections(step_rate, joined):
    """As `finish_connections`. What is too small to add to an extension is carried to the next step (Kahan)."""
    lost = 0.0
    for i in range(joined.move.shape[0]):
        before, move = joined.extension[i], joined.move[i]
        lost += joined.damping[i] * step_rate[i] * move * move
        more = move + joined.extension_compensation[i]
        joined.extension[i] = before + more
        joined.extension_compensation[i] = more - (joined.extension[i] - before)
    return lost


# --- outside the steps


@inline
def connection_energy(connection, state):
    """Energy that the connections hold, ½·s·K·s, J; that of ends is beside what their strings hold at rest ends."""
    total = 0.0
    if connection is not None:
        s = state.connection.extension
        for i in range(s.shape[0]):
            total += 0.5 * s[i] * (state.connection.stiffness[i] * s[i] + product_at(connection.coupling, i, s))
    return total


@inline
def damp_connections(connection, duration, is_end, state):
    """Let all dampers act outside the step, for half of it, one after the other; at its end in the reverse order.
    Relative velocities fall as e^(-r·W·h/2), W = Φ·Φᵀ. Returns the energy lost, J."""
    lost = 0.0
    if connection is not None:
        if duration is not None:
            lost = damp_each(connection, duration, is_end, state.connection.damping, state.p)
    return lost


@noinline
def damp_each(connection, duration, is_end, damping, p):
    """As `damp_connections`, of the dampers of an island."""
    lost, count = 0.0, damping.shape[0]
    for n in range(count):
        i = count - 1 - n if is_end else n
        if damping[i] != 0.0 and duration[i] != 0.0:
            lost += damp_coordinate(connection, i, damping[i] * duration[i], p)
    return lost


@noinline
def damp_coordinate(connection, i, impulse, p):
    """Let one damper act, whose damping times how long it acts is given, kg. Returns the energy lost, J."""
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
def reset_extensions(connection, state):
    """Read the extensions from the modes; what is rigid stays as it is."""
    if connection is not None:
        joined = state.connection
        joined.is_move_known[0] = joined.near.until[0] = 0
        for i in range(joined.extension.shape[0]):
            if connection.is_rigid[i] == 0:
                joined.extension[i] = -joined.rest[i]
                joined.extension_compensation[i] = 0.0
        for r in range(connection.coordinate.shape[0]):
            if connection.is_rigid[connection.coordinate[r]] == 0:
                joined.extension[connection.coordinate[r]] += project(connection.rows, r, state.q)
