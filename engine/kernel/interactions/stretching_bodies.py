"""Forces of an island with bodies that stretch: of their tension, and of contacts, which change the tension of the same
step. For given tensions contacts are solved as ever, with the compliance of the stretched bodies; and for given contact
forces each tension follows. The two are found in turn; a secant takes most of the rounds."""

import math
from typing import NamedTuple

from engine.compiler.decorators import FALSE, INT64_0, INT64_1, TRUE, inline, noinline
from engine.kernel.contact.contact_law import end_force_of, law_in_step
from engine.kernel.contact.coupled_contact_solver import NO_CAP
from engine.kernel.contact.friction_law import acts
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
    measure_misses,
    solve_only_contact,
    solve_several_contacts,
    store_several_contacts,
)
from engine.kernel.interactions.contacts import (
    Touch,
    has_contacts,
    measured_miss,
    no_touch,
    open_compression,
    push_at_contact,
    store_solution,
)
from engine.kernel.interactions.near_contacts import contacts_in_reach, reach_of_all
from engine.kernel.interactions.stretched_compliance import (
    find_softness,
    soften_connections,
    soften_contacts,
    softened_settings,
    stiffen_ends,
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
LOOSE = 1e-12  # of these: a tension taken with a larger miss counts as not found


class Turn(NamedTuple):
    """Whose tension is to be found."""

    body: int  # -1: those of all together
    since: int  # number of the round in which its turn began


@inline
def push_stretched(model, contact, settings, state):
    """Find the forces of tensions, connections and contacts, and let them push. Returns a Touch."""
    touches = False
    if contact is not None:
        touches = has_contacts(contact, state) and not settings.is_free
    if touches or has_connections(model.connection, state):
        touch = push_together(model, contact, settings, touches, state)
        remember_rises(model.tension, state)
        return touch
    find_free_rises(model.tension, settings.h, state)
    push_freely(model.tension, settings.h, state)
    remember_rises(model.tension, state)
    return Touch(SolveStatus.FREE, INT64_0, 0.0, 0.0, TRUE, 0.0)


@noinline
def push_together(model, contact, settings, touches, state):
    """Do this where contacts may close (`touches`), or bodies are connected."""
    tension, h, connection, of = model.tension, settings.h, model.connection, state.tension
    softened = softened_settings(settings, state)
    copy_items(state.drift_momentum, of.momentum)
    copy_items(state.push, of.push)
    if has_connections(connection, state) or is_any_closed(state):
        predict_rises(tension, state)
    else:
        find_free_rises(tension, h, state)
    evaluations, turn = INT64_0, Turn(-INT64_1, INT64_0)
    for n in range(MAX_ROUNDS):
        push_by_tension(tension, h, state)
        find_softened_connection_forces(connection, model, softened.h, h, state)
        forces = find_softened_contact_forces(contact, model, softened, h, touches, state)
        stretch_ends(connection, tension, softened.h, forces, state)
        evaluations += forces.evaluations
        restore_momenta(state)
        if forces.status == SolveStatus.FAILED:
            return no_touch(forces.status, evaluations)
        push_by_contact_forces(contact, h.contact, forces, state)
        push_by_connections(connection, h, state)
        if are_rises_found(tension, h, n, state) or n == MAX_ROUNDS - 1:
            break
        restore_momenta(state)
        turn = try_other_rises(tension, n, turn, state)
    count_loose_tensions(tension, state)
    push_by_tension(tension, h, state)
    measure_moves(connection, h, state)
    lost, excess = store_contact_forces(contact, model, softened, forces, touches, state)
    return Touch(forces.status, evaluations, lost, excess, TRUE, 0.0)


@inline
def is_any_closed(state):
    """True if a contact is closed at the begin of the step."""
    closed = False
    for k in range(state.compression.shape[0]):
        closed = closed or state.compression[k] > 0.0 or acts(state.friction, k, 0.0)
    return closed


@inline
def restore_momenta(state):
    """Take back what contacts and tensions have pushed."""
    copy_items(state.tension.momentum, state.drift_momentum)
    copy_items(state.tension.push, state.push)


@inline
def are_rises_found(tension, h, n, state):
    """True if the tensions that forces lead to are those with which these were found. Finds by how much each misses.

    n: number of rounds before this one
    """
    is_same = True
    for b in range(tension.mode_begin.shape[0]):
        body = state.tension.body[b]
        if present_stiffness(tension, state, b) != 0.0:
            rise, size = body[Stretch.RISE], size_of_rise(tension, state, b, body[Stretch.RISE])
            miss = find_rise(tension, h, state, b, rise)[0] - rise
            is_found = abs(miss) <= SAME * size or (n > SECANTS and is_between_neighbours(body, rise, miss, size))
            body[Stretch.MISS] = 0.0 if is_found else miss
            is_same = is_same and body[Stretch.MISS] == 0.0
    return is_same


@inline
def try_other_rises(tension, n, turn, state):
    """Try other tensions: of all bodies together, and after many rounds of one at a time, which has one solution
    whatever the others are. Returns a Turn."""
    bodies = tension.mode_begin.shape[0]
    if n >= TOGETHER and (turn.body < 0 or state.tension.body[turn.body][Stretch.MISS] == 0.0):
        following = turn.body + 1
        while state.tension.body[following % bodies][Stretch.MISS] == 0.0:
            following += 1
        turn = Turn(following % bodies, n)
    for b in range(bodies):
        body = state.tension.body[b]
        rise, miss = body[Stretch.RISE], body[Stretch.MISS]
        if miss != 0.0 and (turn.body < 0 or turn.body == b):
            narrow_bracket(body, n - turn.since, rise, miss)
            body[Stretch.RISE] = next_rise(body, n - turn.since, rise, miss)
        body[Stretch.TRIED], body[Stretch.MISSED] = rise, miss
    return turn


@inline
def is_between_neighbours(body, rise, miss, size):
    """True if the tension of the step lies between this one and that of the round before, and nothing else does."""
    change = abs(rise - body[Stretch.TRIED])
    return miss * body[Stretch.MISSED] <= 0.0 and change > 0.0 and change <= SAME * size


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
            is_loose = is_loose or not abs(body[Stretch.MISS]) <= LOOSE * size
    state.solve_outcomes[SolveStatus.LOOSE_TENSION] += int(is_loose)


@inline
def narrow_bracket(body, n, rise, miss):
    """Keep between which tensions that of the step lies: what is found is above it where that which was tried is
    below. A bound that is missed was one for other tensions of other bodies, and is given up."""
    if n == 0:
        body[Stretch.LOW], body[Stretch.HIGH] = 0.0, math.inf
    if miss > 0.0:
        body[Stretch.LOW] = max(body[Stretch.LOW], rise)
        body[Stretch.HIGH] = body[Stretch.HIGH] if rise < body[Stretch.HIGH] else math.inf
    else:
        body[Stretch.HIGH] = min(body[Stretch.HIGH], rise)
        body[Stretch.LOW] = body[Stretch.LOW] if rise > body[Stretch.LOW] else 0.0


@inline
def next_rise(body, n, rise, miss):
    """Return the tension to try next: that which was found, or the zero of the secant through the last two misses; or,
    if these do not lead to it, the middle of the bracket."""
    low, high = body[Stretch.LOW], body[Stretch.HIGH]
    following = rise + miss
    if n > SECANTS and abs(miss) > 0.5 * abs(body[Stretch.MISSED]):
        following = 0.5 * (low + high) if high < math.inf else 2.0 * following
    elif n > 0:
        slope = (miss - body[Stretch.MISSED]) / (rise - body[Stretch.TRIED])
        if slope > -20.0 and slope < -0.05:
            following = rise - miss / slope
    return min(max(following, low), high)


# --- connections of stretched bodies


@inline
def find_softened_connection_forces(connection, model, softened, h, state):
    """Find the forces of connections of stretched bodies, if no contact pushes. softened, h: StepCoefficients"""
    if connection is not None:
        if has_connections(connection, state):
            find_softness(model.tension, h, state)
            soften_connections(model.contact, model.tension, h.connection, softened.connection, state)
            stiffen_ends(connection, model.tension, state)
            clear(state.connection.free_move)
            project_rows(connection, h.connection, state.drift_momentum, state.connection.free_move)
            solve_connections(connection, state.tension.connection.coupling, softened.connection, state.connection)


@inline
def reduce_softened(connection, softened, state):
    """Find the compliance of contacts of stretched bodies while connections hold. softened: StepCoefficients"""
    if connection is not None:
        make_factors(connection, state.tension.connection.coupling, softened.connection, state.connection)
        reduce_contact_compliance(softened.connection, softened.contact, state.connection)


# --- ends of strings that move


@inline
def stretch_ends(connection, tension, h, forces, state):
    """Find what the ends of strings stretch these, at the begin and at the end of the step. h: StepCoefficients of
    stretched bodies"""
    if connection is not None:
        if has_connections(connection, state):
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
def find_softened_contact_forces(contact, model, softened, h, touches, state):
    """Find the forces of contacts of stretched bodies. Returns ContactForces. softened: StepSettings"""
    if contact is not None:
        if touches:
            return find_forces_of_contacts(contact, model, softened, h, state)
    return ContactForces(SolveStatus.FREE, INT64_0, 0.0, FALSE, 0.0, 0.0)


@inline
def find_forces_of_contacts(contact, model, softened, h, state):
    """Do this in a step in which contacts may close."""
    reach = contacts_in_reach(model.connection, model, softened, state)
    if not is_any_closing(reach):
        for k in range(state.contact_force.shape[0]):
            state.contact_force[k] = 0.0
        return ContactForces(SolveStatus.FREE, INT64_0, 0.0, FALSE, 0.0, 0.0)
    if has_connections(model.connection, state):
        reduce_softened(model.connection, softened.h, state)
    else:
        find_softness(model.tension, h, state)
        soften_contacts(model.tension, h.contact, h.contact.coupling, state)
    forces = solve_one_or_several(contact, softened.h.contact, h.contact.coupling, reach, state)
    answer_contacts(model.connection, softened.h, reach, state)
    return forces


@inline
def solve_one_or_several(contact, h, coupling, reach, state):
    """Find the forces of contacts for given tensions. Returns ContactForces. coupling: None if no island has several"""
    if coupling is not None:
        if reach.size > 1:
            solved = solve_several_contacts(contact, h, reach, NO_CAP, state)
            return ContactForces(solved.status, solved.evaluations, solved.excess, solved.is_persistent, 0.0, 0.0)
    s, g = state.compression[0], reach.free_displacement[0]
    eta, end, _, evaluations, status = solve_only_contact(contact, h, s, g, state)
    return ContactForces(status, evaluations, 0.0, FALSE, eta, end)


@inline
def push_by_contact_forces(contact, h, forces, state):
    """Do half a kick by the forces of contacts, and keep it for the second half. h: ContactCoefficients"""
    if contact is not None:
        if forces.status != SolveStatus.FREE:
            for k in range(state.contact_force.shape[0]):
                push_at_contact(contact, contact.other_rows, h, k, state)


@inline
def store_contact_forces(contact, model, softened, forces, touches, state):
    """Store the solution of all contacts, once all forces have pushed. Returns the energy lost, and created, J.

    All moves are measured: what is carried of them holds what the last round has left.
    """
    if contact is not None:
        if touches:
            return store_forces_of_contacts(contact, model.connection, softened.h, forces, state)
    return 0.0, 0.0


@inline
def store_forces_of_contacts(contact, connection, h, forces, state):
    """Do this in a step in which contacts may close. h: StepCoefficients"""
    if forces.status == SolveStatus.FREE:
        for k in range(state.compression.shape[0]):
            state.compression[k] = open_compression(state.friction, k, state.compression[k], state.free_displacement[k])
        return 0.0, 0.0
    return store_one_or_several(contact, connection, h, h.contact.coupling, forces, state)


@inline
def store_one_or_several(contact, connection, h, coupling, forces, state):
    """Do this where contacts are closed. coupling: None if no island has several contacts"""
    if coupling is not None:
        if state.compression.shape[0] > 1:
            reach = reach_of_all(connection, contact, h, state)
            measure_misses(contact, h.contact, reach, state)
            solution = ContactSolution(forces.status, forces.evaluations, forces.excess, forces.is_persistent, FALSE)
            return store_several_contacts(contact, h.contact, reach, solution, state)
    eta, b, f = forces.step, forces.end, state.contact_force[0]
    residual = measured_miss(contact, h.contact, state, INT64_0, eta, f)
    end_force = end_force_of(law_in_step(contact, h.contact, state), INT64_0, b)
    return store_solution(contact, h.contact, state, INT64_0, (eta, b, f, f, end_force), residual), 0.0
