"""Contact forces of a step: they are found after the first half-kick of all else, and then act.

A solve that fails, or whose forces are not finite, acts on nothing: the step then reverses the island's motion
(engine.kernel.modes.reverse_motion), which keeps every energy as it is.
"""

import math
from typing import NamedTuple

from engine.compiler.decorators import INT64_0, inline, noinline
from engine.kernel.codes import Row, SolveStatus
from engine.kernel.connections import answer_contact, answer_contacts
from engine.kernel.contacts import (
    apply_contact_force,
    apply_contact_forces,
    end_force_of,
    energy_created,
    energy_created_if_persistent,
    find_moves_by_basis,
    free_displacements,
    measured_miss,
    moves_by_basis,
    must_be_measured,
    store_free_move,
    store_solution,
)
from engine.kernel.coupled_contact_round import contact_response
from engine.kernel.coupled_contact_solver import NO_CAP, CoupledProblem, solve_coupled
from engine.kernel.modes import kinetic_energy
from engine.kernel.persistent_contact_solver import solve_persistent
from engine.kernel.reduced_contact_solver import basis_of_island, solve_reduced
from engine.kernel.scalar_contact_solver import loss_rate_of, solve_scalar_contact


class ContactSolution(NamedTuple):
    """Outcome of the contact solve of an island in a step."""

    status: int  # SolveStatus; FREE if no contact was in reach
    evaluations: int  # of the contact laws
    dissipated: float  # J, by contact loss
    excess: float  # J, that forces off their curves create


@inline
def count_outcome(state, evaluations, status):
    """Count the outcome of a solve."""
    state.solve_outcomes[status] += 1
    if status >= SolveStatus.NEWTON:
        state.iteration_histogram[evaluations] += 1


class SingleSolution(NamedTuple):
    """Solution of one contact's equation."""

    eta: float  # change of compression, m
    end: float  # compression at the end of the step, m
    force: float  # mean over the step, N
    evaluations: int  # of the contact law
    status: int  # SolveStatus


@inline
def find_contact_force(contact, h, state, k):
    """Solve contact k alone; nothing is moved. Returns a SingleSolution."""
    eta, b, f, _, evaluations, status = solve_scalar_contact(
        contact.law,
        h.loss_rate,
        k,
        state.compression[k],
        state.free_displacement[k],
        h.compliance[k],
        contact.tolerance,
    )
    if not math.isfinite(eta + b + f):
        status = SolveStatus.FAILED
    return SingleSolution(eta, b, f, evaluations, status)


@inline
def store_single_solution(contact, h, state, k, solution):
    """Store the solution of contact k, where its forces do not cancel. Returns the energy lost, J."""
    eta, b, f, _, _ = solution
    miss = (state.free_displacement[k] - eta) - h.compliance[k] * f
    return store_solution(contact, h, state, k, (eta, b, f, f, end_force_of(contact, h.loss_rate, k, b)), miss)


@inline
def use_single_solution(contact, connection, step, state, k, solution):
    """Do the first half-kick by the force that was found at contact k, and store its solution. Returns a
    ContactSolution."""
    (eta, b, f, evaluations, status), h = solution, step.contact
    if status == SolveStatus.FAILED:
        return ContactSolution(status, evaluations, 0.0, 0.0)
    apply_contact_force(contact, contact.other_rows, h, k, f, state.p)
    answer_contact(connection, step, state, k, f)
    s = state.compression[k]
    if not must_be_measured(h, state, k, s, eta, f):
        return ContactSolution(status, evaluations, store_single_solution(contact, h, state, k, solution), 0.0)
    miss = measured_miss(contact, h, state, k, eta, f)
    lost = store_solution(contact, h, state, k, (eta, b, f, f, end_force_of(contact, h.loss_rate, k, b)), miss)
    return ContactSolution(status, evaluations, lost, energy_created(contact, state, k, s, lost, f))


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
def find_coupled_forces(contact, h, problem, state):
    """Find the forces of all contacts of an island, in the space of their basis or in that of the contacts; the scratch
    holds them. Returns rounds, SolveStatus, and the energy that forces off their curves create, J."""
    law, loss_rate, evaluations = contact.law, h.loss_rate, INT64_0
    is_first = moves_by_basis(contact.basis)
    if is_first:
        evaluations = solve_by_basis(contact.basis, h.basis, law, loss_rate, state)
        if evaluations > 0:
            return evaluations, SolveStatus.NEWTON, 0.0
    for k in range(state.compression.shape[0]):
        state.scratch.vectors[Row.FORCE, k] = state.contact_force[k]
    rounds, status, excess = solve_coupled(problem, contact.max_rounds, state.line_search_budget)
    if status == SolveStatus.CAPPED and not is_first:
        evaluations = solve_by_basis(contact.basis, h.basis, law, loss_rate, state)
        if evaluations > 0:
            return rounds + evaluations, SolveStatus.NEWTON, 0.0
    while status == SolveStatus.CAPPED and not excess < 0.5 * kinetic_energy(state.p):
        # a second time, without a cap, if the motion could not pay for the energy created
        rounds, status, excess = solve_coupled(problem, NO_CAP, state.line_search_budget)
    return rounds, status, excess


@noinline
def solve_coupled_contacts(contact, connection, step, state):
    """Solve all contacts of an island, and do the first half-kick by their forces. Returns a ContactSolution."""
    h = step.contact
    problem = CoupledProblem(
        contact.law,
        h.loss_rate,
        h.coupling,
        state.compression,
        state.free_displacement,
        contact.tolerance,
        state.scratch,
    )
    if not moves_by_basis(contact.basis):
        rounds = solve_persistent(problem)
        if rounds > 0:
            return use_persistent_solution(contact, connection, step, state, rounds)
    rounds, status, excess = find_coupled_forces(contact, h, problem, state)
    status = push_by_solution(contact, connection, step, state, rounds, status)
    if status == SolveStatus.FAILED:
        return ContactSolution(status, rounds, 0.0, 0.0)
    lost, excess = store_coupled_solution(contact, h, state, status, excess)
    return ContactSolution(status, rounds, lost, excess)


@inline
def push_by_solution(contact, connection, step, state, rounds, status):
    """Do the first half-kick by the forces found at all contacts of an island. Returns SolveStatus."""
    vectors, n = state.scratch.vectors, state.compression.shape[0]
    for k in range(n):
        if not math.isfinite(vectors[Row.STEP, k] + vectors[Row.END, k] + vectors[Row.FORCE, k]):
            status = SolveStatus.FAILED
    count_outcome(state, rounds, status)
    if status != SolveStatus.FAILED:
        for k in range(n):
            state.contact_force[k] = vectors[Row.FORCE, k]
        apply_contact_forces(contact, step.contact, state)
        answer_contacts(connection, step, state)
    return status


@inline
def takes_part(s, vectors, k):
    """True if contact k has a force or energy in this step."""
    return vectors[Row.FORCE, k] != 0.0 or s[k] > 0.0 or vectors[Row.END, k] > 0.0


@inline
def measure_misses(contact, h, state):
    """Measure MISS of the contacts that take part, where the forces of an island all but cancel. Returns True if it was
    measured."""
    s, vectors, measured = state.compression, state.scratch.vectors, False
    for k in range(s.shape[0]):
        measured = measured or must_be_measured(h, state, k, s[k], vectors[Row.STEP, k], vectors[Row.FORCE, k])
    if measured:
        find_misses(contact, h, state)
    return measured


@noinline
def find_misses(contact, h, state):
    """Find MISS of the contacts that take part, from the momenta that the bodies have by now."""
    s, vectors = state.compression, state.scratch.vectors
    if moves_by_basis(contact.basis):
        find_moves_by_basis(contact.basis, h.basis, state)
        for k in range(s.shape[0]):
            vectors[Row.MISS, k] = state.free_displacement[k] - vectors[Row.STEP, k]
        return
    for k in range(s.shape[0]):
        if takes_part(s, vectors, k):
            vectors[Row.MISS, k] = measured_miss(contact, h, state, k, vectors[Row.STEP, k], vectors[Row.FORCE, k])


@inline
def store_coupled_solution(contact, h, state, status, excess):
    """Give all contacts of an island the compressions and forces that were found. Returns the energy lost and the
    energy that forces off their curves create, J."""
    s, vectors, lost = state.compression, state.scratch.vectors, 0.0
    measured = measure_misses(contact, h, state)
    if measured:
        excess = 0.0
    for k in range(s.shape[0]):
        if not takes_part(s, vectors, k):
            store_free_move(state, k)
            continue
        begin, eta, b, f = s[k], vectors[Row.STEP, k], vectors[Row.END, k], vectors[Row.FORCE, k]
        law_force = force_of_law(contact, h.loss_rate, k, begin, eta, f, status)
        end_force = end_force_of(contact, h.loss_rate, k, b)
        lost_at_contact = store_solution(contact, h, state, k, (eta, b, f, law_force, end_force), vectors[Row.MISS, k])
        lost += lost_at_contact
        if measured:
            excess += energy_created(contact, state, k, begin, lost_at_contact, f)
    return lost, excess


@noinline
def use_persistent_solution(contact, connection, step, state, rounds):
    """Use what `solve_persistent` has found: as any other solution, but that the forces at the end are known. Returns a
    ContactSolution."""
    s, vectors, lost, excess, h = state.compression, state.scratch.vectors, 0.0, 0.0, step.contact
    status = push_by_solution(contact, connection, step, state, rounds, SolveStatus.NEWTON)
    if status == SolveStatus.FAILED:
        return ContactSolution(status, rounds, 0.0, 0.0)
    measured = measure_misses(contact, h, state)
    for k in range(s.shape[0]):
        begin, f, miss = s[k], vectors[Row.FORCE, k], vectors[Row.MISS, k]
        if begin <= 0.0:
            store_free_move(state, k)
            continue
        solution = (vectors[Row.STEP, k], vectors[Row.END, k], f, f, vectors[Row.END_FORCE, k])
        lost_at_contact = store_solution(contact, h, state, k, solution, miss)
        lost += lost_at_contact
        if measured:
            excess += energy_created_if_persistent(h.loss_rate, state, k, begin, lost_at_contact, solution)
    return ContactSolution(status, rounds, lost, excess)


@inline
def force_of_law(contact, loss_rate, k, s, eta, f, status):
    """Force of the contact law for a step, N; that of a capped solve may differ from it."""
    if status == SolveStatus.CAPPED and loss_rate_of(loss_rate, k) > 0.0:
        return contact_response(contact.law, loss_rate, k, s, eta)[0]
    return f


@inline
def solve_contacts(contact, connection, step, state):
    """Solve for the contact forces of an island. Do the first half-kick by them, and by the correction of the forces of
    connections. Returns a ContactSolution.

    step: StepCoefficients
    """
    if contact is None:
        return ContactSolution(SolveStatus.FREE, INT64_0, 0.0, 0.0)
    closing, last = INT64_0, INT64_0
    free_displacements(contact, step.contact, state)
    for k in range(state.compression.shape[0]):
        s = state.compression[k]
        if s > 0.0 or s + state.free_displacement[k] > 0.0:
            closing += 1
            last = k
    if closing == 0:
        for k in range(state.compression.shape[0]):
            state.compression[k] += state.free_displacement[k]
        return ContactSolution(SolveStatus.FREE, INT64_0, 0.0, 0.0)
    return solve_closing(contact, connection, step, step.contact.coupling, state, last)


@inline
def solve_closing(contact, connection, step, coupling, state, last):
    """Solve the contacts of an island, of which some are in reach; `last` is the last of these. Returns a
    ContactSolution."""
    if coupling is not None:  # by type, where no island of the scene has several contacts
        if state.compression.shape[0] > 1:
            return solve_coupled_contacts(contact, connection, step, state)
    solution = find_contact_force(contact, step.contact, state, last)
    count_outcome(state, solution.evaluations, solution.status)
    return use_single_solution(contact, connection, step, state, last, solution)
