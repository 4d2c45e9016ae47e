"""The only contact of an island: its force in a step is found from the momenta of the coming drift, and pushes. Its
numbers stay in registers."""

import math

from engine.compiler.decorators import INT64_0, INT64_1, inline
from engine.kernel.contact.scalar_contact_solver import solve_scalar_contact
from engine.kernel.data.enums import SolveStatus
from engine.kernel.interactions.connections import answer_contacts, has_connections, push_by_connections
from engine.kernel.interactions.contacts import (
    Reach,
    Touch,
    count_outcome,
    end_force_of,
    energy_created,
    free_displacement_at,
    measured_miss,
    must_be_measured,
    no_touch,
    push_by_contacts,
    store_solution,
)
from engine.kernel.interactions.near_contacts import are_all_left_out


@inline
def push_by_only_contact(model, contact, settings, is_forced, state):
    """Find the force of the only contact of an island, and let it push. Returns a Touch.

    settings:  StepSettings
    is_forced: True if external forces have pushed
    """
    h, connection = settings.h, model.connection
    if are_all_left_out(connection, model, settings, state):
        return no_touch(SolveStatus.FREE, INT64_0)
    s, moves = state.compression[0], moves_of_connections(connection, h)
    g = free_displacement_at(contact, contact.other_rows, h.contact, INT64_0, state.drift_momentum)
    g -= moved_by_connections(connection, moves, state)
    if not (s > 0.0 or s + g > 0.0):
        state.compression[0], state.contact_force[0] = s + g, 0.0
        return no_touch(SolveStatus.FREE, INT64_0)
    eta, b, f, evaluations, status = solve_only_contact(contact, h.contact, s, g, state)
    if status == SolveStatus.FAILED:
        return no_touch(status, evaluations)
    reach = Reach(INT64_1, None, state.compression, None, contact.law, h.contact.loss_rate, None, moves)
    answer_contacts(connection, h, reach, state)
    is_measured, point_force = must_be_measured(h.contact, state, INT64_0, s, eta, f), 0.0
    if is_forced or is_measured or has_connections(connection, state) or h.contact.only_kick_phi is None:
        push_by_contacts(contact, h.contact, reach, state)
    else:
        point_force = -f
    if is_forced or is_measured:
        push_by_connections(connection, h, state)
    miss = (g - eta) - h.contact.compliance[0] * f
    if is_measured:
        miss = measured_miss(contact, h.contact, state, INT64_0, eta, f)
    end_force, excess = end_force_of(contact, h.contact.loss_rate, INT64_0, b), 0.0
    lost = store_solution(contact, h.contact, state, INT64_0, (eta, b, f, f, end_force), miss)
    if is_measured:
        excess = energy_created(contact, state, INT64_0, s, lost, f)
    return Touch(status, evaluations, lost, excess, is_forced or is_measured, point_force)


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
def solve_only_contact(contact, h, s, g, state):
    """Find the force of the only contact of an island. Returns the change of compression (m), the compression at the
    end (m), the force (N), evaluations of the law, and the SolveStatus.

    h:    ContactCoefficients
    s, g: compression, and how the coming drift changes it without the force, m
    """
    eta, b, f, _, evaluations, status = solve_scalar_contact(
        contact.law, h.loss_rate, INT64_0, s, g, h.compliance[0], contact.tolerance
    )
    if not math.isfinite(eta + b + f):
        status = SolveStatus.FAILED
    count_outcome(state, evaluations, status)
    state.contact_force[0] = f
    return eta, b, f, evaluations, status
