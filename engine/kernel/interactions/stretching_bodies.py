"""Forces of an island with bodies that stretch: of their tension, and of contacts, which change the tension of the same
step. For given tensions contacts are solved as ever, with the compliance of the stretched bodies; and for given contact
forces each tension follows. The two are found in turn; a secant takes most of the rounds."""

import math
from typing import NamedTuple

from engine.compiler.decorators import FALSE, INT64_0, INT64_1, TRUE, inline, noinline
from engine.kernel.contact.coupled_contact_solver import NO_CAP
from engine.kernel.contact.law import free_end, laws_in_step, may_act, store_solution
from engine.kernel.contact.power_law import end_force_of
from engine.kernel.data.effects import CONTACTS, EFFECTS, SEVERAL
from engine.kernel.data.enums import SolveStatus, Stretch
from engine.kernel.interactions.connection_factors import make_factors, reduce_contact_compliance, solve_connections
from engine.kernel.interactions.connections import (
    answer_contacts,
    clear,
    has_connections,
    measure_moves,
    product_at,
    project_rows,
    push_by_connections,
)
from engine.kernel.interactions.contact_forces import (
    ContactSolution,
    is_any_closing,
    measure_residuals,
    solve_only_contact,
    solve_several_contacts,
    store_several_contacts,
)
from engine.kernel.interactions.contacts import (
    ContactOutcome,
    has_contacts,
    measured_residual,
    outcome_without_push,
    push_at_contact,
)
from engine.kernel.interactions.near_contacts import all_contacts, contacts_in_reach
from engine.kernel.interactions.stretched_compliance import (
    find_compliance_lost,
    stiffen_connections,
    stiffen_contacts,
    stiffen_ends,
    stretched_settings,
)
from engine.kernel.interactions.tension import (
    find_free_rises,
    find_rise,
    predict_rises,
    present_stiffness,
    push_by_tension,
    push_freely,
    remember_rises,
    stretch_by_ends,
)
from engine.kernel.modes.ordered_sums import copy_items

MAX_ROUNDS = 400  # to find tensions; two or three are usual; then the last ones are taken
TOGETHER = 30  # rounds in which all tensions change; after that, they change one at a time
SECANTS = 8  # rounds after which the bracket of a tension is halved where secants do not lead to it
SAME = 1e-15  # of a tension, or of its larger parts, if these cancel: two that differ by less are the same
LOOSE = 1e-12  # of these: a tension taken with a larger residual counts as not found


class Turn(NamedTuple):
    """Whose tension is to be found."""

    body: int  # -1: those of all together
    since: int  # number of the round in which its turn began


@inline
def push_stretched(model, settings, state):
    """Find the forces of tensions, connections and contacts, and let them push. Returns a ContactOutcome."""
    touches = has_contacts(state) and not settings.is_free
    if touches or has_connections(state):
        outcome = push_together(model, settings, touches, state)
        remember_rises(model.tension, state)
        return outcome
    find_free_rises(model.tension, settings.h, state)
    push_freely(model.tension, settings.h, state)
    remember_rises(model.tension, state)
    return ContactOutcome(SolveStatus.FREE, INT64_0, 0.0, 0.0, TRUE, 0.0)


@noinline
def push_together(model, settings, touches, state):
    """Do this where contacts may close (`touches`), or bodies are connected."""
    tension, h, of = model.tension, settings.h, state.tension
    stretched = stretched_settings(settings, state)
    copy_items(state.drift_momentum, of.momentum)
    copy_items(state.push, of.push)
    if has_connections(state) or is_any_closed(state):
        predict_rises(tension, state)
    else:
        find_free_rises(tension, h, state)
    evaluations, turn = INT64_0, Turn(-INT64_1, INT64_0)
    for n in range(MAX_ROUNDS):
        push_by_tension(tension, h, state)
        find_stretched_connection_forces(model, stretched.h, h, state)
        forces = find_stretched_contact_forces(model, stretched, h, touches, state)
        stretch_ends(tension, stretched.h, forces, state)
        evaluations += forces.evaluations
        restore_momenta(state)
        if forces.status == SolveStatus.FAILED:
            return outcome_without_push(forces.status, evaluations)
        if forces.status != SolveStatus.FREE:
            for k in range(state.contact_force.shape[0]):
                push_at_contact(model.contact, h.contact, k, state)
        push_by_connections(model.connection, h.connection, state)
        if find_residuals_of_rises(tension, h, n, state) or n == MAX_ROUNDS - 1:
            break
        restore_momenta(state)
        turn = try_other_rises(tension, n, turn, state)
    count_loose_tensions(tension, state)
    push_by_tension(tension, h, state)
    measure_moves(model.connection, h.connection, state)
    lost, excess = store_contact_forces(model.contact, stretched.h, forces, touches, state)
    return ContactOutcome(forces.status, evaluations, lost, excess, TRUE, 0.0)


@inline
def is_any_closed(state):
    """True if a contact is closed at the begin of the step."""
    closed = False
    for k in range(state.compression.shape[0]):
        closed = closed or may_act(state, k, state.compression[k], 0.0)
    return closed


@inline
def restore_momenta(state):
    """Take back what contacts and tensions have pushed."""
    copy_items(state.tension.momentum, state.drift_momentum)
    copy_items(state.tension.push, state.push)


@inline
def find_residuals_of_rises(tension, h, n, state):
    """Find how far that which its forces lead to is from each tension. Returns True if all are found.

    n: number of rounds before this one
    """
    is_same = True
    for b in range(tension.mode_begin.shape[0]):
        body = state.tension.body[b]
        if present_stiffness(tension, state, b) != 0.0:
            rise, size = body[Stretch.RISE], size_of_rise(tension, state, b, body[Stretch.RISE])
            residual = find_rise(tension, h, state, b, rise)[0] - rise
            is_near = n > SECANTS and is_between_neighbours(body, rise, residual, size)
            is_found = abs(residual) <= SAME * size or is_near
            body[Stretch.RESIDUAL] = 0.0 if is_found else residual
            is_same = is_same and body[Stretch.RESIDUAL] == 0.0
    return is_same


@inline
def try_other_rises(tension, n, turn, state):
    """Try other tensions: of all bodies together, and after many rounds of one at a time, which has one solution
    whatever the others are. Returns a Turn."""
    bodies = tension.mode_begin.shape[0]
    if n >= TOGETHER and (turn.body < 0 or state.tension.body[turn.body][Stretch.RESIDUAL] == 0.0):
        following = turn.body + 1
        while state.tension.body[following % bodies][Stretch.RESIDUAL] == 0.0:
            following += 1
        turn = Turn(following % bodies, n)
    for b in range(bodies):
        body = state.tension.body[b]
        rise, residual = body[Stretch.RISE], body[Stretch.RESIDUAL]
        if residual != 0.0 and (turn.body < 0 or turn.body == b):
            narrow_bracket(body, n - turn.since, rise, residual)
            body[Stretch.RISE] = next_rise(body, n - turn.since, rise, residual)
        body[Stretch.TRIED], body[Stretch.TRIED_RESIDUAL] = rise, residual
    return turn


@inline
def is_between_neighbours(body, rise, residual, size):
    """True if the tension of the step lies between this one and that of the round before, and nothing else does."""
    change = abs(rise - body[Stretch.TRIED])
    return residual * body[Stretch.TRIED_RESIDUAL] <= 0.0 and change > 0.0 and change <= SAME * size


@inline
def size_of_rise(tension, state, b, rise):
    """Return the tension of body b, or the larger ones that its ends and its modes would give, if these cancel."""
    body = state.tension.body[b]
    by_ends = abs(body[Stretch.ENDS_BEFORE]) + abs(body[Stretch.ENDS_AFTER])
    return abs(rise) + 0.5 * present_stiffness(tension, state, b) * by_ends


@inline
def count_loose_tensions(tension, state):
    """Count the step if a tension with which its forces were found is not the one that these lead to. The energy
    balance holds what is left."""
    is_loose = False
    for b in range(tension.mode_begin.shape[0]):
        if present_stiffness(tension, state, b) != 0.0:
            body = state.tension.body[b]
            size = size_of_rise(tension, state, b, body[Stretch.RISE])
            is_loose = is_loose or not abs(body[Stretch.RESIDUAL]) <= LOOSE * size
    state.solve_outcomes[SolveStatus.LOOSE_TENSION] += int(is_loose)


@inline
def narrow_bracket(body, n, rise, residual):
    """Keep between which tensions that of the step lies: what is found is above it where that which was tried is
    below. A bound that is passed was one for other tensions of other bodies, and is given up."""
    if n == 0:
        body[Stretch.LOW], body[Stretch.HIGH] = 0.0, math.inf
    if residual > 0.0:
        body[Stretch.LOW] = max(body[Stretch.LOW], rise)
        body[Stretch.HIGH] = body[Stretch.HIGH] if rise < body[Stretch.HIGH] else math.inf
    else:
        body[Stretch.HIGH] = min(body[Stretch.HIGH], rise)
        body[Stretch.LOW] = body[Stretch.LOW] if rise > body[Stretch.LOW] else 0.0


@inline
def next_rise(body, n, rise, residual):
    """Return the tension to try next: that which was found, or the zero of the secant through the last two residuals;
    or, if these do not lead to it, the middle of the bracket."""
    low, high = body[Stretch.LOW], body[Stretch.HIGH]
    following = rise + residual
    if n > SECANTS and abs(residual) > 0.5 * abs(body[Stretch.TRIED_RESIDUAL]):
        following = 0.5 * (low + high) if high < math.inf else 2.0 * following
    elif n > 0:
        slope = (residual - body[Stretch.TRIED_RESIDUAL]) / (rise - body[Stretch.TRIED])
        if slope > -20.0 and slope < -0.05:
            following = rise - residual / slope
    return min(max(following, low), high)


# --- connections of stretched bodies


@inline
def find_stretched_connection_forces(model, stretched, h, state):
    """Find the forces of connections of stretched bodies, if no contact pushes. stretched, h: StepCoefficients"""
    if has_connections(state):
        connection, of = model.connection, state.connection
        find_compliance_lost(model.tension, h, state)
        stiffen_connections(model.tension, h.connection, stretched.connection, state)
        stiffen_ends(connection, model.tension, state)
        clear(of.free_move)
        project_rows(connection, h.connection, state.drift_momentum, of.free_move)
        solve_connections(connection, state.tension.connection.coupling, stretched.connection, of)


# --- ends of strings that move


@inline
def stretch_ends(tension, h, forces, state):
    """Find what the ends of strings stretch these, at the begin and at the end of the step. h: StepCoefficients of
    stretched bodies"""
    if has_connections(state):
        find_moves(h.connection, forces, state)
        for b in range(tension.mode_begin.shape[0]):
            body = state.tension.body[b]
            body[Stretch.ENDS_BEFORE] = stretch_by_ends(tension, state.connection, 0.0, b)
            body[Stretch.ENDS_AFTER] = stretch_by_ends(tension, state.connection, 1.0, b)


@inline
def find_moves(h, forces, state):
    """Find how far the forces that were found move connections. h: ConnectionCoefficients"""
    of, n = state.connection, state.connection.extension.shape[0]
    for i in range(n):
        of.move[i] = of.free_move[i] - product_at(h.compliance, i, of.force)
    if forces.status != SolveStatus.FREE:
        for k in range(state.contact_force.shape[0]):
            for i in range(n):
                of.move[i] -= h.contact_moves[k * n + i] * state.contact_force[k]


# --- contacts: their forces are found, push, and are stored


class ContactForces(NamedTuple):
    """Outcome of the contacts of a round. `State.contact_force` holds the forces."""

    status: int  # SolveStatus; FREE if none is closed, or closes
    evaluations: int  # of the contact laws
    excess: float  # J, that forces off their curves create
    is_persistent: bool  # True if all that are closed remain so
    step: float  # η, m, of an only contact; and its compression at the end
    end: float


@inline
def find_stretched_contact_forces(model, stretched, h, touches, state):
    """Find the forces of contacts of stretched bodies. Returns ContactForces. stretched: StepSettings"""
    if EFFECTS & CONTACTS:
        if touches:
            return find_forces_of_contacts(model, stretched, h, state)
    return ContactForces(SolveStatus.FREE, INT64_0, 0.0, FALSE, 0.0, 0.0)


@inline
def find_forces_of_contacts(model, stretched, h, state):
    """Do this in a step in which contacts may close."""
    reach, of = contacts_in_reach(model, stretched, state), stretched.h
    if not is_any_closing(reach):
        for k in range(state.contact_force.shape[0]):
            state.contact_force[k] = 0.0
        return ContactForces(SolveStatus.FREE, INT64_0, 0.0, FALSE, 0.0, 0.0)
    if has_connections(state):
        make_factors(model.connection, state.tension.connection.coupling, of.connection, state.connection)
        reduce_contact_compliance(of.connection, of.contact, state.connection)
    else:
        find_compliance_lost(model.tension, h, state)
        stiffen_contacts(model.tension, h.contact, state)
    forces = solve_one_or_several(model.contact, of.contact, reach, state)
    answer_contacts(of.connection, reach, state)
    return forces


@inline
def solve_one_or_several(contact, h, reach, state):
    """Find the forces of contacts for given tensions. Returns ContactForces."""
    if EFFECTS & SEVERAL:
        if reach.size > 1:
            solved = solve_several_contacts(contact, h, reach, NO_CAP, state)
            return ContactForces(solved.status, solved.evaluations, solved.excess, solved.is_persistent, 0.0, 0.0)
    s, g = state.compression[0], reach.free_displacement[0]
    eta, end, _, evaluations, status = solve_only_contact(contact, h, s, g, state)
    return ContactForces(status, evaluations, 0.0, FALSE, eta, end)


@inline
def store_contact_forces(contact, h, forces, touches, state):
    """Store the solution of all contacts, once all forces have pushed. Returns the energy lost, and created, J.
    h: StepCoefficients of stretched bodies

    All moves are measured: what is carried of them holds what the last round has left.
    """
    if not touches:
        return 0.0, 0.0
    if forces.status == SolveStatus.FREE:
        for k in range(state.compression.shape[0]):
            state.compression[k] = free_end(state, k, state.compression[k], state.free_displacement[k])
        return 0.0, 0.0
    if EFFECTS & SEVERAL:
        if state.compression.shape[0] > 1:
            reach = all_contacts(h, state)
            measure_residuals(contact, h.contact, reach, state)
            solution = ContactSolution(forces.status, forces.evaluations, forces.excess, forces.is_persistent, FALSE)
            return store_several_contacts(contact, h.contact, reach, solution, state)
    eta, b, f = forces.step, forces.end, state.contact_force[0]
    residual = measured_residual(contact, h.contact, state, INT64_0, eta, f)
    end_force = end_force_of(laws_in_step(h.contact, state), INT64_0, b)
    return store_solution(h.contact, state, INT64_0, (eta, b, f, f, end_force), residual), 0.0
