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
from engine.kernel.data.effects import CONNECTIONS, EFFECTS
from engine.kernel.data.enums import EventKind
from engine.kernel.interactions.connection_factors import update_factors
from engine.kernel.interactions.contacts import contact_number
from engine.kernel.modes.mode_step import forget_drift
from engine.kernel.modes.ordered_sums import add_products, sum_products
from engine.kernel.modes.point_rows import (
    displacement_at_row,
    project,
    project_drift,
    push_at_row,
    push_both_at_row,
)


@inline
def has_connections(state):
    """True if anything in the island is connected."""
    if EFFECTS & CONNECTIONS:
        return state.connection.extension.shape[0] > 0
    return False


@inline
def forget_near_contacts(state):
    """Mark state.connection.near as out of date, because other contacts may close."""
    if EFFECTS & CONNECTIONS:
        state.connection.near.until[0] = 0


# --- within a step


@inline
def product_at(matrix, i, x):
    """Return the product of row i of a matrix and a vector."""
    return sum_products(matrix, np.int64(i) * x.shape[0], x, INT64_0, x.shape[0])


@inline
def project_rows(connection, h, p, moves):
    """Add how far a drift with momenta p moves each row of connections to the moves of their coordinates, m.
    h: ConnectionCoefficients"""
    for r in range(connection.coordinate.shape[0]):
        moves[connection.coordinate[r]] += project_drift(connection.rows, h.rows, r, p)


@inline
def clear(values):
    """Set the moves or the forces of all connections to zero."""
    for i in range(values.shape[0]):
        values[i] = 0.0


@inline
def find_connection_forces(connection, h, state):
    """Find the forces of connections, if no contact pushes. h: StepCoefficients"""
    if has_connections(state):
        update_factors(connection, h.connection, h.contact, state)
        find_forces(connection, h.connection, state)


@inline
def find_forces(connection, h, state):
    """Find the forces of connections by the factors of h, ConnectionCoefficients."""
    of = state.connection
    if of.is_move_known[0] == 0:
        clear(of.free_move)
        project_rows(connection, h, state.drift_momentum, of.free_move)
    clear(of.force)
    add_products(h.force_per_extension, of.extension, of.force)
    add_products(h.force_per_move, of.free_move, of.force)


@noinline
def push_by_connections(connection, h, state):
    """Do half a kick by all connections, keep it for the second one, and measure how far the coming drift changes each
    extension. The moves of the next step are not known then. h: ConnectionCoefficients"""
    if EFFECTS & CONNECTIONS:
        for r in range(connection.coordinate.shape[0]):
            force = -state.connection.force[connection.coordinate[r]]
            push_both_at_row(connection.rows, h.rows, r, force, state)
        measure_moves(connection, h, state)
        state.connection.is_move_known[0] = 0


@inline
def measure_moves(connection, h, state):
    """Measure how far the coming drift changes each extension. h: ConnectionCoefficients"""
    if EFFECTS & CONNECTIONS:
        clear(state.connection.move)
        project_rows(connection, h, state.drift_momentum, state.connection.move)


@inline
def answer_contacts(h, reach, state):
    """Correct the forces of connections for how far the contact forces move these. h: ConnectionCoefficients"""
    if EFFECTS & CONNECTIONS:
        move = state.connection.move
        clear(move)
        for k in range(reach.size):
            f = state.contact_force[contact_number(reach.numbers, k)]
            if f != 0.0:
                for i in range(move.shape[0]):
                    move[i] -= reach.moves[k * move.shape[0] + i] * f
        add_products(h.force_per_move, move, state.connection.force)


@inline
def moved_by_connections(moves, state):
    """Return how far the forces of connections move the contact in the coming drift, m. moves: by a force at it, m/N"""
    moved = 0.0
    if EFFECTS & CONNECTIONS:
        f = state.connection.force
        for i in range(f.shape[0]):
            moved += moves[i] * f[i]
    return moved


@inline
def finish_connections(h, state):
    """Add the move of each connection to its extension. What is too small to add is carried to the next step (Kahan).
    Returns the energy that dampers have taken, J. h: ConnectionCoefficients

    The moves are measured: the rounding of g - B·f would have the same sign in each step, and add up.
    """
    lost = 0.0
    if EFFECTS & CONNECTIONS:
        of = state.connection
        for i in range(of.move.shape[0]):
            before, move = of.extension[i], of.move[i]
            lost += of.damping[i] * h.step_rate[i] * move * move
            more = move + of.extension_compensation[i]
            of.extension[i] = before + more
            of.extension_compensation[i] = more - (of.extension[i] - before)
    return lost


# --- outside the steps


@inline
def connection_energy(connection, state):
    """Energy that the connections hold, ½·s·K·s, J. That of string ends does not include what their strings hold while
    the ends are at rest."""
    total = 0.0
    if EFFECTS & CONNECTIONS:
        s = state.connection.extension
        for i in range(s.shape[0]):
            total += 0.5 * s[i] * (state.connection.stiffness[i] * s[i] + product_at(connection.coupling, i, s))
    return total


@inline
def damp_connections(connection, duration, is_end, state):
    """Let all dampers act outside the step for a duration, s, one after the other; at its end in the reverse order.
    Relative velocities fall as e^(-r·W·t), W = Φ·Φᵀ. Returns the energy lost, J."""
    if EFFECTS & CONNECTIONS:
        return damp_each(connection, duration, is_end, state.connection.damping, state)
    return 0.0


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
    of = state.connection
    of.is_move_known[0] = of.near.until[0] = 0
    for i in range(of.extension.shape[0]):
        if connection.is_rigid[i] == 0:
            of.extension[i] = -of.rest[i]
            of.extension_compensation[i] = 0.0
    for r in range(connection.coordinate.shape[0]):
        if connection.is_rigid[connection.coordinate[r]] == 0:
            of.extension[connection.coordinate[r]] += project(connection.rows, r, state.q)


# --- events


@inline
def shift_connections(connection, state, m, change):
    """Let the extensions of connections follow a change of mode m."""
    for r in range(connection.coordinate.shape[0]):
        move = displacement_at_row(connection.rows, r, m, change)
        if move != 0.0:
            state.connection.extension[connection.coordinate[r]] += move
            state.connection.extension_compensation[connection.coordinate[r]] = 0.0


@inline
def connection_parameter(kind, i, state):
    """Return what an event of a kind changes of coordinate i: its stiffness (N/m), damping (kg/s) or rest (m)."""
    if kind == EventKind.CONNECTION_STIFFNESS:
        return state.connection.stiffness[i]
    if kind == EventKind.CONNECTION_DAMPING:
        return state.connection.damping[i]
    return state.connection.rest[i]


@inline
def set_connection_parameter(kind, span, value, state):
    """Set this parameter of coordinates. span: the first, and the last + 1"""
    of = state.connection
    if of.lowest_energy[0] != 0.0 or kind == EventKind.CONNECTION_REST:
        of.lowest_energy[0] = -math.inf  # what is under load may rest at any energy by now
    for i in range(span[0], span[1]):
        if kind == EventKind.CONNECTION_STIFFNESS:
            of.stiffness[i] = value
        elif kind == EventKind.CONNECTION_DAMPING:
            of.damping[i] = value
        else:
            of.extension[i] -= value - of.rest[i]
            of.rest[i] = value
