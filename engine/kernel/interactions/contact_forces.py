"""Forces of contacts: they are found from the momenta of the coming drift, and push. The numbers of an only contact of
an island stay in registers; several are solved together.

A solve that fails, or whose forces are not finite, acts on nothing (engine.kernel.run.step.reverse_motion).
"""

import math
from typing import NamedTuple

from engine.compiler.decorators import FALSE, INT64_0, INT64_1, TRUE, inline
from engine.kernel.contact.coupled_contact_solver import NO_CAP, CoupledProblem, solve_coupled
from engine.kernel.contact.law import (
    driven_move,
    energy_created,
    free_end,
    laws_in_step,
    may_act,
    settle_alone,
    settle_together,
    solve_alone,
    step_start,
    store_solution,
    takes_part,
)
from engine.kernel.contact.persistent_contact_solver import solve_persistent
from engine.kernel.contact.power_law import end_force_of, energy_gained, force_of_lossy_law
from engine.kernel.contact.scalar_contact_solver import ContactEquation
from engine.kernel.data.effects import CONNECTIONS, EFFECTS, SEVERAL
from engine.kernel.data.enums import Row, SolveStatus
from engine.kernel.interactions.connections import (
    answer_contacts,
    has_connections,
    moved_by_connections,
    push_by_connections,
)
from engine.kernel.interactions.contacts import (
    ContactOutcome,
    ContactsInReach,
    contact_number,
    count_outcome,
    free_displacement_at,
    has_contacts,
    measured_residual,
    must_be_measured,
    outcome_without_push,
    push_by_reach,
)
from engine.kernel.interactions.near_contacts import contacts_in_reach, leave_out_far_contacts
from engine.kernel.modes.mode_step import forget_drift, kinetic_energy, rescale_kinetic_energy


@inline
def push_by_contacts(model, settings, is_forced, state):
    """Find the forces of contacts, and let them push. Returns a ContactOutcome.

    settings:  StepSettings
    is_forced: True if external forces have pushed
    """
    if settings.is_free or not has_contacts(state):
        return outcome_without_push(SolveStatus.FREE, INT64_0)
    if EFFECTS & SEVERAL:
        if state.compression.shape[0] > 1:
            return push_by_several_contacts(model, settings, is_forced, state)
    return push_by_only_contact(model, settings, is_forced, state)


@inline
def finish_contacts(outcome, state):
    """Take from the kinetic energy, at the end of a step, what a capped solve created, or give it what that solve took;
    what cannot be taken at once is owed. Returns the energy that contacts have taken, J."""
    owed, paid = state.energy_debt[0] + outcome.excess, 0.0
    if outcome.status != SolveStatus.FREE and owed != 0.0:
        paid = rescale_kinetic_energy(owed, state.p)
        state.energy_debt[0] = max(0.0, owed - paid)
        forget_drift(state)
    return outcome.dissipated + (paid - outcome.excess)


# --- an only contact


@inline
def push_by_only_contact(model, settings, is_forced, state):
    """Find the force of the only contact of an island, and let it push. Returns a ContactOutcome."""
    h, contact = settings.h, model.contact
    if EFFECTS & CONNECTIONS:
        if leave_out_far_contacts(model, settings, state) and state.connection.near.size[0] == 0:
            return outcome_without_push(SolveStatus.FREE, INT64_0)
    s, moves = state.compression[0], h.connection.contact_moves
    g = free_displacement_at(contact, h.contact, INT64_0, state.drift_momentum)
    g -= moved_by_connections(moves, state) - driven_move(state, h.contact.duration, INT64_0)
    if not may_act(state, INT64_0, s, g):
        state.compression[0], state.contact_force[0] = free_end(state, INT64_0, s, g), 0.0
        return outcome_without_push(SolveStatus.FREE, INT64_0)
    eta, b, f, evaluations, status = solve_only_contact(contact, h.contact, s, g, state)
    if status == SolveStatus.FAILED:
        return outcome_without_push(status, evaluations)
    law = laws_in_step(h.contact, state)
    reach = ContactsInReach(INT64_1, None, state.compression, None, law, None, moves)
    answer_contacts(h.connection, reach, state)
    is_measured, point_force = must_be_measured(h.contact, state, INT64_0, s, eta, f), 0.0
    if is_forced or is_measured or has_connections(state):
        push_by_reach(contact, h.contact, reach, state)
    else:
        point_force = -f
    if is_forced or is_measured:
        push_by_connections(model.connection, h.connection, state)
    residual = (g - eta) - h.contact.compliance[0] * f
    if is_measured:
        residual = measured_residual(contact, h.contact, state, INT64_0, eta, f)
    end_force, excess = end_force_of(law, INT64_0, b), 0.0
    lost = store_solution(h.contact, state, INT64_0, (eta, b, f, f, end_force), residual)
    if is_measured:
        excess = energy_created(state, INT64_0, s, lost, f)
    return ContactOutcome(status, evaluations, lost, excess, is_forced or is_measured, point_force)


@inline
def solve_only_contact(contact, h, s, g, state):
    """Find the force of the only contact of an island. Returns the change of compression (m), the compression at the
    end (m), the force (N), evaluations of the law, and the SolveStatus.

    h:    ContactCoefficients
    s, g: compression, and how the coming drift changes it without the force, m
    """
    law = laws_in_step(h, state)
    settle_alone(law, INT64_0, s, g, h)
    start = step_start(law, INT64_0, s)
    equation = ContactEquation(law, INT64_0, start, g, h.compliance[0], contact.tolerance)
    eta, b, f, _, evaluations, status = solve_alone(equation, 0.0)
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
def push_by_several_contacts(model, settings, is_forced, state):
    """Find the forces of several contacts, and let them push. Returns a ContactOutcome."""
    h, contact = settings.h, model.contact
    reach = contacts_in_reach(model, settings, state)
    if not is_any_closing(reach):
        open_contacts(reach, state)
        return outcome_without_push(SolveStatus.FREE, INT64_0)
    solution = solve_several_contacts(contact, h.contact, reach, contact.max_rounds, state)
    if solution.status == SolveStatus.FAILED:
        return outcome_without_push(solution.status, solution.evaluations)
    answer_contacts(h.connection, reach, state)
    push_by_reach(contact, h.contact, reach, state)
    if is_forced or solution.is_measured:
        push_by_connections(model.connection, h.connection, state)
    lost, excess = store_several_contacts(contact, h.contact, reach, solution, state)
    return ContactOutcome(solution.status, solution.evaluations, lost, excess, is_forced or solution.is_measured, 0.0)


# --- the forces are found


@inline
def is_any_closing(reach):
    """True if a contact is closed, or would be closed at the end of the step; or a point of friction may have a
    force."""
    for n in range(reach.size):
        s, g = reach.compression[n], reach.free_displacement[n]
        if may_act(reach.law, n, s, g):
            return True
    return False


@inline
def open_contacts(reach, state):
    """Store the compressions at the end of a step in which all contacts are open, and forces of zero."""
    for n in range(reach.size):
        k = contact_number(reach.numbers, n)
        state.compression[k] = free_end(reach.law, n, reach.compression[n], reach.free_displacement[n])
        state.contact_force[k] = 0.0


@inline
def solve_several_contacts(contact, h, reach, max_rounds, state):
    """Find the forces of several contacts of an island together, in so many rounds. Returns a ContactSolution."""
    s, g = reach.compression, reach.free_displacement
    problem = CoupledProblem(reach.law, reach.coupling, s, g, contact.tolerance, state.scratch)
    rounds, status, excess, is_persistent = INT64_0, SolveStatus.NEWTON, 0.0, TRUE
    if contact.has_power_laws[0] == 0:
        max_rounds = NO_CAP  # the energy of forces off their laws is known of power laws alone
    else:
        rounds = solve_persistent(problem)
    if rounds == 0:
        rounds, status, excess = find_coupled_forces(reach, problem, max_rounds, state)
        is_persistent = FALSE
        choices = INT64_0
        while settle_together(contact, h, reach, choices, state):
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
    law = laws_in_step(h, state)
    if solution.is_measured:
        measure_residuals(contact, h, reach, state)
        excess = 0.0
    for n in range(reach.size):
        k, s, eta, b = contact_number(reach.numbers, n), reach.compression[n], vectors[Row.STEP, n], vectors[Row.END, n]
        f, residual = vectors[Row.FORCE, n], vectors[Row.STEP_RESIDUAL, n]
        if not takes_part(law, k, s, b, f):
            state.compression[k], state.contact_force[k] = b, 0.0
            state.compression_compensation[k] += residual
            continue
        law_force = f
        if solution.status == SolveStatus.CAPPED:
            law_force = force_of_lossy_law(law, k, s, eta, f)
        end_force = vectors[Row.END_FORCE, n] if solution.is_persistent else end_force_of(law, k, b)
        values = eta, b, f, law_force, end_force
        lost_at_contact = store_solution(h, state, k, values, residual)
        lost += lost_at_contact
        if solution.is_measured:
            if solution.is_persistent:
                gained = energy_gained(law, k, state.compression[k] - s, values)
                excess += gained + lost_at_contact - f * state.free_displacement[k]
            else:
                excess += energy_created(state, k, s, lost_at_contact, f)
    return lost, excess


@inline
def measure_residuals(contact, h, reach, state):
    """Measure MISS of the contacts that take part, from the momenta of the drift."""
    vectors = state.scratch.vectors
    for n in range(reach.size):
        eta, f = vectors[Row.STEP, n], vectors[Row.FORCE, n]
        k = contact_number(reach.numbers, n)
        if takes_part(state, k, reach.compression[n], vectors[Row.END, n], f):
            vectors[Row.STEP_RESIDUAL, n] = measured_residual(contact, h, state, k, eta, f)
