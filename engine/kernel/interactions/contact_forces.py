"""Forces of contacts: they are found from the momenta of the coming drift, and push. The numbers of an only contact of
an island stay in registers; several are solved together.

A solve that fails, or whose forces are not finite, acts on nothing (engine.kernel.run.step.reverse_motion).
"""

import math
from typing import NamedTuple

from engine.compiler.decorators import FALSE, INT64_0, INT64_1, TRUE, inline
from engine.kernel.contact.contact_law import (
    end_force_of,
    energy_gained,
    force_of_lossy_law,
    law_in_step,
    step_start,
)
from engine.kernel.contact.coupled_contact_solver import NO_CAP, CoupledProblem, solve_coupled
from engine.kernel.contact.friction_law import slides
from engine.kernel.contact.persistent_contact_solver import solve_persistent
from engine.kernel.contact.scalar_contact_solver import ContactEquation, solve_scalar_contact
from engine.kernel.data.enums import Row, SolveStatus
from engine.kernel.interactions.connections import (
    answer_contacts,
    has_connections,
    moved_by_connections,
    moves_of_connections,
    push_by_connections,
)
from engine.kernel.interactions.contacts import (
    Reach,
    Touch,
    contact_number,
    count_outcome,
    energy_created,
    free_displacement_at,
    has_contacts,
    is_closing,
    measured_miss,
    must_be_measured,
    no_touch,
    open_compression,
    push_by_reach,
    store_solution,
)
from engine.kernel.interactions.friction import choose_alone, choose_together, has_friction, surface_move
from engine.kernel.interactions.near_contacts import are_all_left_out, contacts_in_reach
from engine.kernel.modes.mode_step import forget_drift, kinetic_energy, rescale_kinetic_energy


@inline
def push_by_contacts(model, contact, h, settings, is_forced, state):
    """Find the forces of contacts, and let them push. Returns a Touch.

    h:         ContactCoefficients or None
    settings:  StepSettings
    is_forced: True if external forces have pushed
    """
    if contact is None:
        return no_touch(SolveStatus.FREE, INT64_0)
    if settings.is_free or not has_contacts(contact, state):
        return no_touch(SolveStatus.FREE, INT64_0)
    return push_by_one_or_several(model, contact, h.coupling, settings, is_forced, state)


@inline
def push_by_one_or_several(model, contact, coupling, settings, is_forced, state):
    """Find the forces of contacts, and let them push. Returns a Touch. coupling: None if no island has several"""
    if coupling is not None:
        if state.compression.shape[0] > 1:
            return push_by_several_contacts(model, contact, settings, is_forced, state)
    return push_by_only_contact(model, contact, settings, is_forced, state)


@inline
def finish_contacts(touch, state):
    """Take from the kinetic energy, at the end of a step, what a capped solve created, or give it what that solve took;
    what cannot be taken at once is owed. Returns the energy that contacts have taken, J."""
    owed, paid = state.energy_debt[0] + touch.excess, 0.0
    if touch.status != SolveStatus.FREE and owed != 0.0:
        paid = rescale_kinetic_energy(owed, state.p)
        state.energy_debt[0] = max(0.0, owed - paid)
        forget_drift(state)
    return touch.dissipated + (paid - touch.excess)


# --- an only contact


@inline
def push_by_only_contact(model, contact, settings, is_forced, state):
    """Find the force of the only contact of an island, and let it push. Returns a Touch."""
    h, connection = settings.h, model.connection
    if are_all_left_out(connection, model, settings, state):
        return no_touch(SolveStatus.FREE, INT64_0)
    s, moves = state.compression[0], moves_of_connections(connection, h)
    g = free_displacement_at(contact, contact.other_rows, h.contact, INT64_0, state.drift_momentum)
    g -= moved_by_connections(connection, moves, state) + surface_move(state.friction, h.contact.duration, INT64_0)
    if not is_closing(state.friction, INT64_0, s, g):
        state.compression[0], state.contact_force[0] = open_compression(state.friction, INT64_0, s, g), 0.0
        return no_touch(SolveStatus.FREE, INT64_0)
    eta, b, f, evaluations, status = solve_only_contact(contact, h.contact, s, g, state)
    if status == SolveStatus.FAILED:
        return no_touch(status, evaluations)
    law = law_in_step(contact, h.contact, state)
    reach = Reach(INT64_1, None, state.compression, None, law, None, moves)
    answer_contacts(connection, h, reach, state)
    is_measured, point_force = must_be_measured(h.contact, state, INT64_0, s, eta, f), 0.0
    if is_forced or is_measured or has_connections(connection, state) or h.contact.only_kick_phi is None:
        push_by_reach(contact, h.contact, reach, state)
    else:
        point_force = -f
    if is_forced or is_measured:
        push_by_connections(connection, h, state)
    residual = (g - eta) - h.contact.compliance[0] * f
    if is_measured:
        residual = measured_miss(contact, h.contact, state, INT64_0, eta, f)
    end_force, excess = end_force_of(law, INT64_0, b), 0.0
    lost = store_solution(contact, h.contact, state, INT64_0, (eta, b, f, f, end_force), residual)
    if is_measured:
        excess = energy_created(contact, state, INT64_0, s, lost, f)
    return Touch(status, evaluations, lost, excess, is_forced or is_measured, point_force)


@inline
def solve_only_contact(contact, h, s, g, state):
    """Find the force of the only contact of an island. Returns the change of compression (m), the compression at the
    end (m), the force (N), evaluations of the law, and the SolveStatus.

    h:    ContactCoefficients
    s, g: compression, and how the coming drift changes it without the force, m
    """
    choose_alone(state.friction, INT64_0, s, g, h)
    law = law_in_step(contact, h, state)
    start = step_start(law, INT64_0, s)
    equation = ContactEquation(law, INT64_0, start, g, h.compliance[0], contact.tolerance)
    eta, b, f, _, evaluations, status = solve_scalar_contact(equation, 0.0)
    if not math.isfinite(eta + b + f):
        status = SolveStatus.FAILED
    count_outcome(state, evaluations, status)
    state.contact_force[0] = f
    return eta, b, f, evaluations, status


# --- several contacts


class ContactSolution(NamedTuple):
    """Outcome of the solve of several contacts in a step. `State.contact_force` and the scratch hold the forces."""

    status: int  # SolveStatus
    evaluations: int  # of the contact laws
    excess: float  # J, that forces off their curves create
    is_persistent: bool  # True if all that are closed remain so, and END_FORCE is known
    is_measured: bool  # True if forces all but cancel, so that moves have to be measured


@inline
def push_by_several_contacts(model, contact, settings, is_forced, state):
    """Find the forces of several contacts, and let them push. Returns a Touch."""
    h, connection = settings.h, model.connection
    reach = contacts_in_reach(connection, model, settings, state)
    if not is_any_closing(reach):
        open_contacts(reach, state)
        return no_touch(SolveStatus.FREE, INT64_0)
    solution = solve_several_contacts(contact, h.contact, reach, contact.max_rounds, state)
    if solution.status == SolveStatus.FAILED:
        return no_touch(solution.status, solution.evaluations)
    answer_contacts(connection, h, reach, state)
    push_by_reach(contact, h.contact, reach, state)
    if is_forced or solution.is_measured:
        push_by_connections(connection, h, state)
    lost, excess = store_several_contacts(contact, h.contact, reach, solution, state)
    return Touch(solution.status, solution.evaluations, lost, excess, is_forced or solution.is_measured, 0.0)


# --- the forces are found


@inline
def is_any_closing(reach):
    """True if a contact is closed, or would be closed at the end of the step; or a point of friction may have a
    force."""
    for n in range(reach.size):
        if is_closing(reach.law.friction, n, reach.compression[n], reach.free_displacement[n]):
            return True
    return False


@inline
def open_contacts(reach, state):
    """Store the compressions at the end of a step in which all contacts are open, and forces of zero."""
    for n in range(reach.size):
        k = contact_number(reach.numbers, n)
        state.compression[k] = open_compression(reach.law.friction, n, reach.compression[n], reach.free_displacement[n])
        state.contact_force[k] = 0.0


@inline
def solve_several_contacts(contact, h, reach, max_rounds, state):
    """Find the forces of several contacts of an island together, in so many rounds. Returns a ContactSolution."""
    s, g = reach.compression, reach.free_displacement
    problem = CoupledProblem(reach.law, reach.coupling, s, g, contact.tolerance, state.scratch)
    rounds, status, excess, is_persistent = INT64_0, SolveStatus.NEWTON, 0.0, TRUE
    if has_friction(contact.friction):
        max_rounds = NO_CAP  # the energy of forces off their laws is known of contacts alone
    else:
        rounds = solve_persistent(problem)
    if rounds == 0:
        rounds, status, excess = find_coupled_forces(reach, problem, max_rounds, state)
        is_persistent = FALSE
        choices = INT64_0
        while choose_together(contact.friction, h, reach, choices, state):
            choices += 1
            more, status, excess = find_coupled_forces(reach, problem, max_rounds, state)
            rounds += more
    vectors, is_measured = state.scratch.vectors, FALSE
    for n in range(reach.size):
        eta, b, f = vectors[Row.STEP, n], vectors[Row.END, n], vectors[Row.FORCE, n]
        k = contact_number(reach.numbers, n)
        if not math.isfinite(eta + b + f):
            status = SolveStatus.FAILED
        state.contact_force[k] = f
        is_measured = is_measured or must_be_measured(h, state, k, s[n], eta, f)
    count_outcome(state, rounds, status)
    return ContactSolution(status, rounds, excess, is_persistent, is_measured)


@inline
def find_coupled_forces(reach, problem, max_rounds, state):
    """Find the forces of several contacts, of which any may close or let go; the scratch holds them. Returns rounds,
    SolveStatus, and the energy that forces off their curves create, J."""
    for n in range(reach.size):
        state.scratch.vectors[Row.FORCE, n] = state.contact_force[contact_number(reach.numbers, n)]
    rounds, status, excess = solve_coupled(problem, max_rounds, state.solve_budget)
    while status == SolveStatus.CAPPED and not excess < 0.5 * kinetic_energy(state.p):
        # a second time, without a cap, if the motion could not pay for the energy created
        rounds, status, excess = solve_coupled(problem, NO_CAP, state.solve_budget)
    return rounds, status, excess


# --- the forces are stored, once all forces have pushed


@inline
def store_several_contacts(contact, h, reach, solution, state):
    """Store the solutions of several contacts of an island. Returns the energy lost, and created, J."""
    vectors, lost, excess = state.scratch.vectors, 0.0, solution.excess
    law = law_in_step(contact, h, state)
    if solution.is_measured:
        measure_misses(contact, h, reach, state)
        excess = 0.0
    for n in range(reach.size):
        k, s, eta, b = contact_number(reach.numbers, n), reach.compression[n], vectors[Row.STEP, n], vectors[Row.END, n]
        f, residual = vectors[Row.FORCE, n], vectors[Row.MISS, n]
        if not (takes_part(s, b, f) or slides(state.friction, k)):
            state.compression[k], state.contact_force[k] = b, 0.0
            state.compression_compensation[k] += residual
            continue
        law_force = f
        if solution.status == SolveStatus.CAPPED:
            law_force = force_of_lossy_law(law, k, s, eta, f)
        end_force = vectors[Row.END_FORCE, n] if solution.is_persistent else end_force_of(law, k, b)
        values = eta, b, f, law_force, end_force
        lost_at_contact = store_solution(contact, h, state, k, values, residual)
        lost += lost_at_contact
        if solution.is_measured:
            if slides(state.friction, k):
                continue  # the energy lost holds all
            if solution.is_persistent:
                gained = energy_gained(law, k, state.compression[k] - s, values)
                excess += gained + lost_at_contact - f * state.free_displacement[k]
            else:
                excess += energy_created(contact, state, k, s, lost_at_contact, f)
    return lost, excess


@inline
def takes_part(s, b, f):
    """True if a contact has a force or energy in this step."""
    return f != 0.0 or s > 0.0 or b > 0.0


@inline
def measure_misses(contact, h, reach, state):
    """Measure MISS of the contacts that take part, from the momenta of the drift."""
    vectors = state.scratch.vectors
    for n in range(reach.size):
        eta, f = vectors[Row.STEP, n], vectors[Row.FORCE, n]
        k = contact_number(reach.numbers, n)
        if takes_part(reach.compression[n], vectors[Row.END, n], f) or slides(state.friction, k):
            vectors[Row.MISS, n] = measured_miss(contact, h, state, k, eta, f)
