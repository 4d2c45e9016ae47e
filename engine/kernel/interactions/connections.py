"""Connections: springs and dampers between bodies that hold both ways, rigid joints, and ends of strings that move.

Their forces are constant over a step, and linear in extensions and moves
(engine.kernel.interactions.connection_factors), so that they need no iteration, and no stiffness makes a step unstable
(docs/design.md, "Connections"). They act like any other force: half a kick before the drift, and half a kick after it.
They are found first, and corrected for what the contact forces of the same step move.
"""

import math

import numpy as np

from engine.compiler.decorators import INT64_0, inline, noinline
from engine.compiler.elementary import expm1_of
from engine.kernel.data.enums import EventKind
from engine.kernel.interactions.connection_factors import update_factors
from engine.kernel.interactions.contacts import contact_number
from engine.kernel.modes.mode_step import forget_drift
from engine.kernel.modes.ordered_sums import add_products, copy_or_back, sum_products
from engine.kernel.modes.point_rows import (
    displacement_at_row,
    project,
    project_drift,
    push_at_row,
    push_both_at_row,
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
def project_rows(connection, h, p, moves):
    """Add how far a drift with momenta p moves each row of connections to the moves of their coordinates, m."""
    for r in range(connection.coordinate.shape[0]):
        moves[connection.coordinate[r]] += project_drift(connection.rows, h.rows, r, p)


@inline
def clear(values):
    """Set the moves or the forces of all connections to zero."""
    for i in range(values.shape[0]):
        values[i] = 0.0


@inline
def find_connection_forces(connection, h, state):
    """Find the forces of connections, if no contact pushes."""
    if connection is not None:
        connection_state = state.connection
        if connection_state.extension.shape[0] > 0:
            update_factors(connection, h.connection, h.contact, state)
            find_forces(connection, h, state)


@inline
def find_forces(connection, h, state):
    """Find the forces of connections by the factors of h, StepCoefficients."""
    connection_state = state.connection
    if connection_state.is_move_known[0] == 0:
        clear(connection_state.free_move)
        project_rows(connection, h.connection, state.drift_momentum, connection_state.free_move)
    clear(connection_state.force)
    add_products(h.connection.force_per_extension, connection_state.extension, connection_state.force)
    add_products(h.connection.force_per_move, connection_state.free_move, connection_state.force)


@noinline
def push_by_connections(connection, h, state):
    """Do half a kick by all connections, keep it for the second one, and measure how far the coming drift changes each
    extension. The moves of the next step are not known then."""
    if connection is not None:
        connection_state = state.connection
        for r in range(connection.coordinate.shape[0]):
            force = -connection_state.force[connection.coordinate[r]]
            push_both_at_row(connection.rows, h.connection.rows, r, force, state)
        measure_moves(connection, h, state)
        connection_state.is_move_known[0] = 0


@inline
def measure_moves(connection, h, state):
    """Measure how far the coming drift changes each extension."""
    if connection is not None:
        clear(state.connection.move)
        project_rows(connection, h.connection, state.drift_momentum, state.connection.move)


@inline
def answer_contacts(connection, h, reach, state):
    """Correct the forces of connections for how far the contact forces move these."""
    if connection is not None:
        connection_state, n = state.connection, state.connection.move.shape[0]
        clear(connection_state.move)
        for k in range(reach.size):
            f = state.contact_force[contact_number(reach.numbers, k)]
            if f != 0.0:
                for i in range(n):
                    connection_state.move[i] -= reach.moves[k * n + i] * f
        add_products(h.connection.force_per_move, connection_state.move, connection_state.force)


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
def copy_extensions(connection_state, saved, is_back):
    """Copy the extensions to a SavedMotion, or back. connection_state: ConnectionState or None"""
    if connection_state is not None:
        copy_or_back(connection_state.extension, saved.extension, is_back)
        copy_or_back(connection_state.extension_compensation, saved.extension_compensation, is_back)


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
    share = -expm1_of(-impulse * mobility)
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
