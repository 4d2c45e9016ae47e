"""Contacts within a step: after the first half-kick, find the forces and let them act.

A solve that fails, or whose forces are not finite, acts on nothing: the step then reverses the
island's motion (engine.kernel.modes.reverse_motion), which keeps every energy as it is.
"""

import math
from typing import NamedTuple

from engine.compiler.decorators import INT64_0, inline, noinline
from engine.kernel.codes import Row, SolveStatus
from engine.kernel.contact_law import elastic_force, potential, potential_difference
from engine.kernel.coupled_contact_round import contact_response
from engine.kernel.coupled_contact_solver import NO_CAP, CoupledProblem, solve_coupled
from engine.kernel.modes import bound_at_row, kick_at_row, kinetic_energy, project, project_drift
from engine.kernel.reduced_contact_solver import basis_of_island, gather_rows, solve_reduced, spread_rows
from engine.kernel.scalar_contact_solver import loss_rate_of, solve_scalar_contact

CANCELLATION = 100.0  # times compression and step: what B·f may be before moves are measured instead
LINE_SEARCHES = 16  # that the capped solves of an island may spend between two periodic checks


class ContactSolution(NamedTuple):
    """What a step does at the contacts of an island."""

    status: int  # SolveStatus; FREE if no contact was in reach
    evaluations: int  # of the contact laws
    dissipated: float  # J, by contact loss
    excess: float  # J, that forces off their curves create


@inline
def count_outcome(state, evaluations, status):
    """Count a solve."""
    state.solve_outcomes[status] += 1
    if status >= SolveStatus.NEWTON:
        state.iteration_histogram[evaluations] += 1


# --- moves and forces at a contact


@inline
def moves_by_basis(basis):
    """Whether contacts move bodies, and are moved, by the rows of their basis."""
    if basis is None:
        return False
    return basis.is_first.shape[0] > 0 and basis.is_first[0] != 0


@inline
def find_moves_by_basis(basis, coefficients, state):
    """How the coming drift changes each compression, by the basis of the island's contacts."""
    if basis is not None:
        g, momentum = state.free_displacement, state.scratch.vectors[Row.GUESS]
        found = basis_of_island(basis, coefficients, g.shape[0])
        for j in range(found.rank):
            momentum[j] = project_drift(basis.rows, coefficients.rows, j, state.p)
        spread_rows(found, momentum, state.scratch.vectors[Row.WORK], g)


@inline
def push_by_basis(basis, coefficients, state):
    """Half a kick by all contact forces, by the basis of the island's contacts."""
    if basis is not None:
        f, vectors = state.contact_force, state.scratch.vectors
        found = basis_of_island(basis, coefficients, f.shape[0])
        gather_rows(found, f, vectors[Row.WORK], vectors[Row.GUESS])
        for j in range(found.rank):
            kick_at_row(basis.rows, coefficients.rows, j, -vectors[Row.GUESS, j], state.p)


@inline
def free_displacement_at(contact, other_rows, h, k, p):
    """How the coming drift changes compression k without contact force, m: g."""
    g = project_drift(contact.rows, h.rows, k, p)
    if other_rows is not None:
        g += project_drift(other_rows, h.other_rows, k, p)
    return g


@inline
def free_displacements(contact, h, state):
    """How the coming drift changes each compression."""
    if moves_by_basis(contact.basis):
        find_moves_by_basis(contact.basis, h.basis, state)
        return
    for k in range(state.compression.shape[0]):
        state.free_displacement[k] = free_displacement_at(contact, contact.other_rows, h, k, state.p)


@inline
def apply_contact_force(contact, other_rows, h, k, f, p):
    """Half a kick by the force f of contact k on the bodies it joins."""
    kick_at_row(contact.rows, h.rows, k, -f, p)
    if other_rows is not None:
        kick_at_row(other_rows, h.other_rows, k, -f, p)


@inline
def apply_contact_forces(contact, h, state):
    """Half a kick by all contact forces."""
    if contact is not None:
        if moves_by_basis(contact.basis):
            push_by_basis(contact.basis, h.basis, state)
            return
        for k in range(state.compression.shape[0]):
            f = state.contact_force[k]
            if f != 0.0:
                apply_contact_force(contact, contact.other_rows, h, k, f, state.p)


@inline
def clear_forces(contact, state):
    """No contact force acts in this step."""
    if contact is not None:
        for k in range(state.compression.shape[0]):
            state.contact_force[k] = 0.0


@inline
def compression_from_modes(contact, other_rows, state, k):
    """Compression of contact k as the displacements of the modes give it, m."""
    s = project(contact.rows, k, state.q) - state.barrier[k]
    if other_rows is not None:
        s += project(other_rows, k, state.q)
    return s


@inline
def resync_open_contacts(contact, state):
    """Out of contact, read the compressions from the modes.

    Never in contact, where it would cost 1e-12 of the energy at kc = 1e13 (docs/design.md, sec. 3).
    """
    if contact is not None:
        for k in range(state.compression.shape[0]):
            state.contact_force[k] = 0.0
            state.compression[k] = min(compression_from_modes(contact, contact.other_rows, state, k), 0.0)


@inline
def contact_energy(contact, state):
    """Potential energy of the contacts, J."""
    total = 0.0
    if contact is not None:
        for k in range(state.compression.shape[0]):
            total += potential(contact.law, k, state.compression[k])
    return total


# --- can a contact close?


@inline
def bound_at_contact(contact, other_rows, k, bound):
    """How far contact k can close, m, if each mode moves no further than `bound`."""
    distance = bound_at_row(contact.rows, k, bound)
    if other_rows is not None:
        distance += bound_at_row(other_rows, k, bound)
    return distance


@inline
def cannot_close(contact, state):
    """Whether no contact can close if each mode moves no further than `state.displacement_bound`."""
    if contact is not None:
        for k in range(state.compression.shape[0]):
            distance = bound_at_contact(contact, contact.other_rows, k, state.displacement_bound)
            if not state.compression[k] + 1.01 * distance < 0.0:  # NaN can close
                return False
    return True


@inline
def invalidate_margins(moving):
    """The margins of a refined sample (engine.kernel.refinement) hold no longer."""
    if moving is not None:
        moving.margin_valid[0] = 0


@inline
def reset_line_search_budget(coupling, state):
    """A new budget for capped solves."""
    if coupling is not None:
        state.line_search_budget[0] = LINE_SEARCHES


# --- a solution is stored


@inline
def contact_dissipation(contact, loss_rate, k, s, b, eta, f):
    """Energy that contact loss takes over one step: (f - φ)·η, J."""
    rate = loss_rate_of(loss_rate, k)
    if rate == 0.0:
        return 0.0
    w = 1.0 + rate * eta
    if w > 0.5:
        return f * eta * (rate * eta) / w
    return f * eta - potential_difference(contact.law, k, s, b, eta)  # f/w would cancel


@inline
def store_solution(contact, h, state, k, solution, miss):
    """Give contact k its new compression and force; returns the energy lost.

    solution: η (m), end compression b (m), force f (N), and the force of the contact law (N), which f is not where a
              solve was capped
    miss:     how far the bodies moved at the contact beyond η, m

    What rounding leaves of a step has the same sign at every step of a contact, and would add up
    (2e-13 of the energy in 60 ms): the low part of B, the residual of the
    solution, and the step's part beneath the last digit of the compression. It is carried to the
    next step (Kahan).
    """
    eta, b, f, _ = solution
    s = state.compression[k]
    miss -= h.compliance_low[k] * f
    lost = dissipation_of(contact, h.loss_rate, k, s, solution, miss)
    residue = state.compression_compensation[k] + miss
    if 2.0 * abs(eta) < b:
        end = s + (eta + residue)
        residue = (eta + residue) - (end - s)
    else:  # beside a long step to a small compression, what rounding left of the step is no longer small
        end = b
    state.compression_compensation[k] = residue
    state.compression[k] = end
    state.contact_force[k] = f
    return lost


@inline
def dissipation_of(contact, loss_rate, k, s, solution, miss):
    """Energy that the contact loss of a solution takes, J."""
    eta, b, f, law_force = solution
    lost = 0.0
    if loss_rate is not None:
        lost = contact_dissipation(contact, loss_rate, k, s, b, eta, law_force)
        lost += (f - elastic_force(contact.law, k, b)) * miss  # where bodies move beyond the step, the force works on
    return lost


@inline
def cancels(h, k, s, eta, f):
    """Whether forces all but cancel at contact k: of what a force moves by itself, B·f, so little is left that
    the rest is rounding."""
    return h.compliance[k] * f > CANCELLATION * (abs(s) + abs(eta))


@noinline
def measured_miss(contact, h, state, k, eta, f):
    """How far the bodies move at contact k beyond the step η, m, from the momenta they have by now;
    `free_displacement` is then the whole move."""
    move = free_displacement_at(contact, contact.other_rows, h, k, state.p)
    state.free_displacement[k] = move
    return (move - eta) + h.compliance_low[k] * f  # the last is taken off in `store_solution`


@noinline
def energy_created(contact, state, k, s, lost, f):
    """Energy that contact k has gained since its compression was s, and lost, beyond the work of its force on what
    moves, J."""
    end = state.compression[k]
    return potential_difference(contact.law, k, s, end, end - s) + lost - f * state.free_displacement[k]


# --- the solve


class SingleSolution(NamedTuple):
    """The solution of one contact's equation."""

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
    count_outcome(state, evaluations, status)
    return SingleSolution(eta, b, f, evaluations, status)


@inline
def store_single_solution(contact, h, state, k, solution):
    """Give contact k what was found, where its forces do not cancel. Returns the energy lost, J."""
    eta, b, f, _, _ = solution
    miss = (state.free_displacement[k] - eta) - h.compliance[k] * f
    return store_solution(contact, h, state, k, (eta, b, f, f), miss)


@inline
def use_single_solution(contact, h, state, k, solution):
    """Give the first half-kick by the force that was found at contact k, and store it. Returns a ContactSolution."""
    eta, b, f, evaluations, status = solution
    if status == SolveStatus.FAILED:
        return ContactSolution(status, evaluations, 0.0, 0.0)
    apply_contact_force(contact, contact.other_rows, h, k, f, state.p)
    s = state.compression[k]
    if not cancels(h, k, s, eta, f):
        return ContactSolution(status, evaluations, store_single_solution(contact, h, state, k, solution), 0.0)
    miss = measured_miss(contact, h, state, k, eta, f)
    lost = store_solution(contact, h, state, k, (eta, b, f, f), miss)
    return ContactSolution(status, evaluations, lost, energy_created(contact, state, k, s, lost, f))


@inline
def solve_by_basis(basis, coefficients, law, loss_rate, state):
    """Solve all contacts of an island in the space of their basis. Returns evaluations of the laws; 0 if there is no
    basis, or the solve did not converge."""
    if basis is None:
        return INT64_0
    if basis.is_first.shape[0] == 0:
        return INT64_0
    found = basis_of_island(basis, coefficients, state.compression.shape[0])
    return solve_reduced(law, loss_rate, found, state.compression, state.free_displacement, state.scratch)


@inline
def find_coupled_forces(contact, h, state):
    """Find the forces of all contacts of an island, in the space of their basis or in that of the contacts; the scratch
    holds them. Returns rounds, SolveStatus, and the energy that forces off their curves create, J."""
    law, loss_rate, evaluations = contact.law, h.loss_rate, INT64_0
    is_first = moves_by_basis(contact.basis)
    if is_first:
        evaluations = solve_by_basis(contact.basis, h.basis, law, loss_rate, state)
        if evaluations > 0:
            return evaluations, SolveStatus.NEWTON, 0.0
    problem = CoupledProblem(
        law, loss_rate, h.coupling, state.compression, state.free_displacement, contact.tolerance, state.scratch
    )
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
def solve_coupled_contacts(contact, h, state):
    """Solve all contacts of an island, and give the first half-kick by their forces. Returns a ContactSolution."""
    s, vectors = state.compression, state.scratch.vectors
    n = s.shape[0]
    for k in range(n):
        vectors[Row.FORCE, k] = state.contact_force[k]
    rounds, status, excess = find_coupled_forces(contact, h, state)
    for k in range(n):
        if not math.isfinite(vectors[Row.STEP, k] + vectors[Row.END, k] + vectors[Row.FORCE, k]):
            status = SolveStatus.FAILED
    count_outcome(state, rounds, status)
    if status == SolveStatus.FAILED:
        return ContactSolution(status, rounds, 0.0, 0.0)
    for k in range(n):
        state.contact_force[k] = vectors[Row.FORCE, k]
    apply_contact_forces(contact, h, state)
    lost, excess = store_coupled_solution(contact, h, state, status, excess)
    return ContactSolution(status, rounds, lost, excess)


@inline
def takes_part(s, vectors, k):
    """Whether contact k has a force or energy in this step."""
    return vectors[Row.FORCE, k] != 0.0 or s[k] > 0.0 or vectors[Row.END, k] > 0.0


@noinline
def measure_misses(contact, h, state):
    """MISS of the contacts that take part, from the momenta that the bodies have by now."""
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
    s, vectors = state.compression, state.scratch.vectors
    n, lost, measured = s.shape[0], 0.0, False
    for k in range(n):
        measured = measured or cancels(h, k, s[k], vectors[Row.STEP, k], vectors[Row.FORCE, k])
    if measured:
        excess = 0.0
        measure_misses(contact, h, state)
    for k in range(n):
        begin, has_energy = s[k], takes_part(s, vectors, k)
        eta, b, f = vectors[Row.STEP, k], vectors[Row.END, k], vectors[Row.FORCE, k]
        law_force = force_of_law(contact, h.loss_rate, k, begin, eta, f, status)
        lost_at_contact = store_solution(contact, h, state, k, (eta, b, f, law_force), vectors[Row.MISS, k])
        lost += lost_at_contact
        if measured and has_energy:
            excess += energy_created(contact, state, k, begin, lost_at_contact, f)
    return lost, excess


@inline
def force_of_law(contact, loss_rate, k, s, eta, f, status):
    """The force of the contact law for a step, N; that of a capped solve is not always it."""
    if loss_rate is None:
        return f
    if status == SolveStatus.CAPPED:
        return contact_response(contact.law, loss_rate, k, s, eta)[0]
    return f


@inline
def solve_contacts(contact, h, state):
    """Solve for the contact forces of an island, and give the first half-kick by them. Returns a ContactSolution.

    h: ContactCoefficients
    """
    if contact is None:
        return ContactSolution(SolveStatus.FREE, INT64_0, 0.0, 0.0)
    closing, last = INT64_0, INT64_0
    free_displacements(contact, h, state)
    for k in range(state.compression.shape[0]):
        s = state.compression[k]
        if s > 0.0 or s + state.free_displacement[k] > 0.0:
            closing += 1
            last = k
    if closing == 0:
        for k in range(state.compression.shape[0]):
            state.compression[k] += state.free_displacement[k]
        return ContactSolution(SolveStatus.FREE, INT64_0, 0.0, 0.0)
    return solve_closing(contact, h, h.coupling, state, last)


@inline
def solve_closing(contact, h, coupling, state, last):
    """Solve contacts of which some are in reach; `last` is the last of these. Returns a ContactSolution."""
    if coupling is not None:  # by type, where no island of the scene has several contacts
        if state.compression.shape[0] > 1:
            return solve_coupled_contacts(contact, h, state)
    return use_single_solution(contact, h, state, last, find_contact_force(contact, h, state, last))
