"""Several contacts of an island: their forces in a step are found together, from the momenta of the coming drift, and
push."""

import math
from typing import NamedTuple

from engine.compiler.decorators import FALSE, INT64_0, TRUE, inline, noinline
from engine.kernel.contact.coupled_contact_round import contact_response
from engine.kernel.contact.coupled_contact_solver import NO_CAP, CoupledProblem, solve_coupled
from engine.kernel.contact.persistent_contact_solver import solve_persistent
from engine.kernel.contact.reduced_contact_solver import basis_of_island, solve_reduced
from engine.kernel.contact.scalar_contact_solver import loss_rate_of
from engine.kernel.data.enums import Row, SolveStatus
from engine.kernel.interactions.connections import answer_contacts, push_by_connections
from engine.kernel.interactions.contacts import (
    Touch,
    contact_number,
    count_outcome,
    end_force_of,
    energy_created,
    energy_created_if_persistent,
    find_moves_by_basis,
    measured_miss,
    moves_by_basis,
    must_be_measured,
    no_touch,
    push_by_contacts,
    store_solution,
)
from engine.kernel.interactions.near_contacts import contacts_in_reach
from engine.kernel.modes.mode_step import kinetic_energy


class ContactSolution(NamedTuple):
    """Outcome of the solve of several contacts in a step. `State.contact_force` and the scratch hold the forces."""

    status: int  # SolveStatus
    evaluations: int  # of the contact laws
    excess: float  # J, that forces off their curves create
    is_persistent: bool  # True if all that are closed remain so, and END_FORCE is known
    is_measured: bool  # True if forces all but cancel, so that moves have to be measured


# --- the forces are found


@inline
def push_by_several_contacts(model, contact, settings, is_forced, state):
    """Find the forces of several contacts, and let them push. Returns a Touch.

    settings:  StepSettings
    is_forced: True if external forces have pushed
    """
    h, connection = settings.h, model.connection
    reach = contacts_in_reach(connection, model, settings, state)
    if not is_any_closing(reach):
        open_contacts(reach, state)
        return no_touch(SolveStatus.FREE, INT64_0)
    solution = solve_several_contacts(contact, h.contact, reach, state)
    if solution.status == SolveStatus.FAILED:
        return no_touch(solution.status, solution.evaluations)
    answer_contacts(connection, h, reach, state)
    push_by_contacts(contact, h.contact, reach, state)
    if is_forced or solution.is_measured:
        push_by_connections(connection, h, state)
    lost, excess = store_several_contacts(contact, h.contact, reach, solution, state)
    return Touch(solution.status, solution.evaluations, lost, excess, is_forced or solution.is_measured, 0.0)


# --- the forces are found


@inline
def is_any_closing(reach):
    """True if a contact is closed, or would be closed at the end of the step."""
    for n in range(reach.size):
        if reach.compression[n] > 0.0 or reach.compression[n] + reach.free_displacement[n] > 0.0:
            return True
    return False


@inline
def open_contacts(reach, state):
    """Store the compressions at the end of a step in which all contacts are open, and forces of zero."""
    for n in range(reach.size):
        k = contact_number(reach.numbers, n)
        state.compression[k] = reach.compression[n] + reach.free_displacement[n]
        state.contact_force[k] = 0.0


@noinline
def solve_several_contacts(contact, h, reach, state):
    """Find the forces of several contacts of an island together. Returns a ContactSolution."""
    law, loss_rate, s, g = reach.law, reach.loss_rate, reach.compression, reach.free_displacement
    problem = CoupledProblem(law, loss_rate, reach.coupling, s, g, contact.tolerance, state.scratch)
    rounds, status, excess, is_persistent = INT64_0, SolveStatus.NEWTON, 0.0, TRUE
    if not moves_by_basis(contact.basis):
        rounds = solve_persistent(problem)
    if rounds == 0:
        rounds, status, excess = find_coupled_forces(contact, h, reach, problem, state)
        is_persistent = FALSE
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
def solve_by_basis(basis, coefficients, law, loss_rate, state):
    """Solve all contacts of an island in the space of their basis. Returns evaluations of the laws; 0 if there is no
    basis, or the solve did not converge."""
    if basis is None:
        return INT64_0
    if basis.is_first.shape[0] == 0:
        return INT64_0
    island_basis = basis_of_island(basis, coefficients, state.compression.shape[0])
    return solve_reduced(law, loss_rate, island_basis, state.compression, state.free_displacement, state.scratch)


@inline
def find_coupled_forces(contact, h, reach, problem, state):
    """Find the forces of several contacts, in the space of their basis or in that of the contacts; the scratch holds
    them. Returns rounds, SolveStatus, and the energy that forces off their curves create, J."""
    evaluations, is_all = INT64_0, reach.size == state.compression.shape[0]
    is_first = moves_by_basis(contact.basis)
    if is_first:
        evaluations = solve_by_basis(contact.basis, h.basis, contact.law, h.loss_rate, state)
        if evaluations > 0:
            return evaluations, SolveStatus.NEWTON, 0.0
    for n in range(reach.size):
        state.scratch.vectors[Row.FORCE, n] = state.contact_force[contact_number(reach.numbers, n)]
    rounds, status, excess = solve_coupled(problem, contact.max_rounds, state.line_search_budget)
    if status == SolveStatus.CAPPED and is_all and not is_first:
        evaluations = solve_by_basis(contact.basis, h.basis, contact.law, h.loss_rate, state)
        if evaluations > 0:
            return rounds + evaluations, SolveStatus.NEWTON, 0.0
    while status == SolveStatus.CAPPED and not excess < 0.5 * kinetic_energy(state.p):
        # a second time, without a cap, if the motion could not pay for the energy created
        rounds, status, excess = solve_coupled(problem, NO_CAP, state.line_search_budget)
    return rounds, status, excess


# --- the forces are stored, once all forces have pushed


@noinline
def store_several_contacts(contact, h, reach, solution, state):
    """Store the solutions of several contacts of an island. Returns the energy lost, and created, J."""
    vectors, lost, excess = state.scratch.vectors, 0.0, solution.excess
    if solution.is_measured:
        measure_misses(contact, h, reach, state)
        excess = 0.0
    for n in range(reach.size):
        k, s, eta, b = contact_number(reach.numbers, n), reach.compression[n], vectors[Row.STEP, n], vectors[Row.END, n]
        f, miss = vectors[Row.FORCE, n], vectors[Row.MISS, n]
        if not takes_part(s, b, f):
            state.compression[k], state.contact_force[k] = b, 0.0
            state.compression_compensation[k] += miss
            continue
        law_force = force_of_law(contact, h.loss_rate, k, s, eta, f, solution.status)
        end_force = vectors[Row.END_FORCE, n] if solution.is_persistent else end_force_of(contact, h.loss_rate, k, b)
        values = eta, b, f, law_force, end_force
        lost_at_contact = store_solution(contact, h, state, k, values, miss)
        lost += lost_at_contact
        if solution.is_measured:
            if solution.is_persistent:
                excess += energy_created_if_persistent(h.loss_rate, state, k, s, lost_at_contact, values)
            else:
                excess += energy_created(contact, state, k, s, lost_at_contact, f)
    return lost, excess


@inline
def takes_part(s, b, f):
    """True if a contact has a force or energy in this step."""
    return f != 0.0 or s > 0.0 or b > 0.0


@noinline
def measure_misses(contact, h, reach, state):
    """Measure MISS of the contacts that take part, from the momenta of the drift."""
    vectors = state.scratch.vectors
    if moves_by_basis(contact.basis):
        find_moves_by_basis(contact.basis, h.basis, state)
        for k in range(reach.size):
            vectors[Row.MISS, k] = state.free_displacement[k] - vectors[Row.STEP, k]
        return
    for n in range(reach.size):
        eta, f = vectors[Row.STEP, n], vectors[Row.FORCE, n]
        if takes_part(reach.compression[n], vectors[Row.END, n], f):
            vectors[Row.MISS, n] = measured_miss(contact, h, state, contact_number(reach.numbers, n), eta, f)


@inline
def force_of_law(contact, loss_rate, k, s, eta, f, status):
    """Force of the contact law for a step, N; that of a capped solve may differ from it."""
    if status == SolveStatus.CAPPED and loss_rate_of(loss_rate, k) > 0.0:
        return contact_response(contact.law, loss_rate, k, s, eta)[0]
    return f
