"""Forces of an island with bodies that stretch: of their tension, and of contacts, which change the tension of the same
step. For given tensions contacts are solved as ever, with the compliance of the stretched bodies; and for given contact
forces each tension follows. The two are found in turn; a secant takes most of the rounds."""

import numpy as np

from engine.compiler.decorators import FALSE, INT64_0, TRUE, inline, noinline
from engine.compiler.lanes import multiply_add, number_at, place_after, put_number, splat
from engine.kernel.contact.contact_law import end_force_of, law_in_step
from engine.kernel.data.enums import SolveStatus
from engine.kernel.data.model import ContactCoefficients, StepCoefficients, StepSettings
from engine.kernel.interactions.contact_forces import (
    ContactSolution,
    is_any_closing,
    measure_misses,
    open_contacts,
    solve_only_contact,
    solve_several_contacts,
    store_several_contacts,
)
from engine.kernel.interactions.contacts import (
    Touch,
    has_contacts,
    measured_miss,
    no_touch,
    push_by_reach,
    store_solution,
)
from engine.kernel.interactions.near_contacts import contacts_in_reach, gathered
from engine.kernel.interactions.tension import (
    find_free_rises,
    find_rise,
    predicted_rise,
    push_by_tension,
    remember_rises,
)
from engine.kernel.modes.ordered_sums import copy_items, fold, fold_lanes

MAX_ROUNDS = 50
SAME = 1e-15  # of a tension: two that differ by less are the same


@inline
def push_stretched(model, contact, settings, state):
    """Find the forces of tensions and contacts, and let them push. Returns a Touch."""
    if contact is not None:
        if has_contacts(contact, state) and not settings.is_free:
            touch = push_with_contacts(model, contact, settings, state)
            remember_rises(state.tension)
            return touch
    find_free_rises(model.tension, settings.h, state)
    push_by_tension(model.tension, settings.h, state)
    remember_rises(state.tension)
    return Touch(SolveStatus.FREE, INT64_0, 0.0, 0.0, TRUE, 0.0)


@noinline
def push_with_contacts(model, contact, settings, state):
    """Do this in a step in which contacts may close."""
    tension, h, base = model.tension, settings.h, state.tension
    copy_items(state.drift_momentum, base.momentum)
    copy_items(state.push, base.push)
    is_closed = is_any_closed(state)
    if is_closed:
        for b in range(base.rise.shape[0]):
            base.rise[b] = predicted_rise(base.history[b]) if base.stiffness[b] != 0.0 else 0.0
    else:
        find_free_rises(tension, h, state)
    push_by_tension(tension, h, state)
    softened = soften(tension, contact, h, settings, state)
    reach = contacts_in_reach(model.connection, model, softened, state)
    if not is_closed and not is_any_closing(reach):
        open_contacts(reach, state)
        return Touch(SolveStatus.FREE, INT64_0, 0.0, 0.0, TRUE, 0.0)
    evaluations = INT64_0
    for n in range(MAX_ROUNDS):
        solution = solve_contacts(contact, softened.h.contact, reach, state)
        evaluations += solution.evaluations
        restore_momenta(state)
        if solution.status == SolveStatus.FAILED:
            return no_touch(solution.status, evaluations)
        push_by_reach(contact, h.contact, reach, state)
        if are_rises_found(tension, h, n, state):
            break
        restore_momenta(state)
        push_by_tension(tension, h, state)
        softened = soften(tension, contact, h, settings, state)
        reach = contacts_in_reach(model.connection, model, softened, state)
    push_by_tension(tension, h, state)
    lost, excess = store_contacts(contact, softened.h.contact, reach, solution, state)
    return Touch(solution.status, evaluations, lost, excess, TRUE, 0.0)


@inline
def is_any_closed(state):
    """True if a contact is closed at the begin of the step."""
    for k in range(state.compression.shape[0]):
        if state.compression[k] > 0.0:
            return True
    return False


@inline
def restore_momenta(state):
    """Take back what contacts and tensions have pushed."""
    copy_items(state.tension.momentum, state.drift_momentum)
    copy_items(state.tension.push, state.push)


@inline
def are_rises_found(tension, h, n, state):
    """True if the tensions that contact forces lead to are those with which these were found; if not, try others.
    State.tension.rise holds them.

    n: number of rounds before this one
    """
    is_same, trial, of = True, state.tension.trial, state.tension
    for b in range(of.rise.shape[0]):
        if of.stiffness[b] != 0.0:
            rise = of.rise[b]
            found = find_rise(tension, h, state, b, rise)
            miss = found - rise
            is_same = is_same and abs(miss) <= SAME * found
            of.rise[b] = next_rise(trial[b], n, rise, miss)
            trial[b, 0], trial[b, 1] = rise, miss
    return is_same


@inline
def next_rise(trial, n, rise, miss):
    """Return the tension to try next: that found, or the zero of the secant through the last two misses.

    trial: the tension tried before, and by how much that which was found missed it
    """
    if n > 0 and abs(miss) > SAME * rise:
        slope = (miss - trial[1]) / (rise - trial[0])
        if -20.0 < slope and slope < -0.05:
            return max(0.0, rise - miss / slope)
        if n > 12:
            return rise + 0.5 * miss
    return rise + miss


# --- contacts of stretched bodies


@inline
def soften(tension, contact, h, settings, state):
    """Return the StepSettings with the compliance of the contacts of bodies that are stretched."""
    find_softness(tension, h, state)
    soften_contacts(contact, h.contact, h.contact.coupling, state)
    c, of = h.contact, state.tension
    coupling = gathered(c.coupling, of.coupling, of.coupling.shape[0])
    contacts = ContactCoefficients(
        c.rows, c.other_rows, of.compliance, c.compliance_low, c.loss_rate, coupling, c.only_kick_phi, c.basis
    )
    changed = StepCoefficients(
        h.kick, h.drift, h.spring_kick, h.weight_kick, h.loss, h.drag, h.connection, contacts, h.force
    )
    return StepSettings(changed, settings.kind, settings.is_free, settings.frame)


@inline
def add_softness(of, k, sums):
    """Write what the tension takes from the compliance of mode k of a body, e·aλ/(1 + aλ), e = t·v, s²."""
    tension, h, state, first, rise = of
    m = place_after(k, first)
    compliance = number_at(h.kick, m) * number_at(h.drift, m)
    stiffened = 0.5 * compliance * number_at(tension.weight, m) * rise
    put_number(state.displacement_bound, m, compliance * stiffened / (1.0 + stiffened))
    return sums


@inline
def find_softness(tension, h, state):
    """Find what tensions take from the compliance of each mode."""
    for m in range(state.displacement_bound.shape[0]):
        state.displacement_bound[m] = 0.0
    for b in range(tension.mode_begin.shape[0]):
        first, modes = tension.mode_begin[b], tension.mode_end[b] - tension.mode_begin[b]
        fold_lanes(add_softness, (tension, h, state, first, state.tension.rise[b]), modes, (splat(0.0),))


@inline
def soften_contacts(contact, h, coupling, state):
    """Find the compliance of contacts of stretched bodies. h: ContactCoefficients; coupling: of it, or None"""
    of, count = state.tension, state.compression.shape[0]
    for k in range(count):
        of.compliance[k] = h.compliance[k] - softness_between(contact, contact.other_rows, k, k, state)
    if coupling is not None:
        for k in range(count):
            for i in range(k):
                pair = coupling[k * count + i] - softness_between(contact, contact.other_rows, k, i, state)
                of.coupling[k * count + i] = of.coupling[i * count + k] = pair
            of.coupling[k * count + k] = of.compliance[k]


@inline
def softness_between(contact, other_rows, k, i, state):
    """Return how much less a force at contact k moves contact i because bodies are stretched, m/N."""
    softness = softness_at_rows(contact.rows, k, contact.rows, i, state)
    if other_rows is not None:
        softness += softness_at_rows(contact.rows, k, other_rows, i, state)
        softness += softness_at_rows(other_rows, k, contact.rows, i, state)
        softness += softness_at_rows(other_rows, k, other_rows, i, state)
    return softness


@inline
def add_softness_of_rows(of, n, sums):
    """Add the product of two mode shapes and what tensions take from a compliance to the sums."""
    phi, begin, other_phi, other_begin, softness, first = of
    shapes = number_at(phi, place_after(n, begin)) * number_at(other_phi, place_after(n, other_begin))
    return (multiply_add(shapes, number_at(softness, place_after(n, first)), sums[0]),)


@inline
def softness_at_rows(rows, k, other_rows, i, state):
    """Return how much less a force at row k moves row i of others because bodies are stretched, m/N."""
    first, end = np.int64(rows.mode_begin[k]), np.int64(rows.mode_end[k])
    if first == end or other_rows.mode_begin[i] != first or other_rows.mode_end[i] != end:
        return 0.0
    places = np.int64(rows.offset[k]), np.int64(other_rows.offset[i])
    of = rows.phi, places[0], other_rows.phi, places[1], state.displacement_bound, first
    return fold(add_softness_of_rows, of, end - first, (splat(0.0),))[0]


# --- the forces are found, and stored


@inline
def solve_contacts(contact, h, reach, state):
    """Find the forces of contacts for given tensions. Returns a ContactSolution. h: ContactCoefficients"""
    return solve_one_or_several(contact, h, h.coupling, reach, state)


@inline
def solve_one_or_several(contact, h, coupling, reach, state):
    """Do this where an island may have several contacts, or not. coupling: None if none has"""
    if coupling is not None:
        if reach.size > 1:
            return solve_several_contacts(contact, h, reach, state)
    s, g, of = state.compression[0], reach.free_displacement[0], state.tension
    of.move[0], of.end[0], state.contact_force[0] = g, s + g, 0.0
    evaluations, status = INT64_0, SolveStatus.SEPARATION
    if s > 0.0 or s + g > 0.0:
        of.move[0], of.end[0], _, evaluations, status = solve_only_contact(contact, h, s, g, state)
    return ContactSolution(status, evaluations, 0.0, FALSE, TRUE)


@inline
def store_contacts(contact, h, reach, solution, state):
    """Store the solution of all contacts, once all forces have pushed. Returns the energy lost, and created, J."""
    return store_one_or_several(contact, h, h.coupling, reach, solution, state)


@inline
def store_one_or_several(contact, h, coupling, reach, solution, state):
    """Do this where an island may have several contacts, or not. coupling: None if none has

    All moves are measured: what is carried of them holds what the last round has left.
    """
    if coupling is not None:
        if reach.size > 1:
            measure_misses(contact, h, reach, state)
            kept = ContactSolution(
                solution.status, solution.evaluations, solution.excess, solution.is_persistent, FALSE
            )
            return store_several_contacts(contact, h, reach, kept, state)
    eta, b, f = state.tension.move[0], state.tension.end[0], state.contact_force[0]
    residual = measured_miss(contact, h, state, INT64_0, eta, f)
    end_force = end_force_of(law_in_step(contact, h), INT64_0, b)
    return store_solution(contact, h, state, INT64_0, (eta, b, f, f, end_force), residual), 0.0
