"""One step of an island with connections and with contacts that may be in reach, in one pass over the modes.

The pass before has found how far the coming drift would move the connections (engine.kernel.connected_step), and so
their forces without contacts are known. These forces, and the momenta of the coming drift, tell how far each near
contact (engine.kernel.near_contacts) would close. These contacts are solved, the forces of connections are corrected
for them, and one pass moves all modes. Two cases need the momenta in the middle of a step, and are left to
engine.kernel.step: forces that all but cancel, and solves that fail or are capped.
"""

import math

from engine.compiler.decorators import FALSE, INT64_0, TRUE, inline, noinline
from engine.kernel.codes import Row, SolveStatus
from engine.kernel.connected_modes import coming_move_at_row
from engine.kernel.connected_step import find_forces, move_all
from engine.kernel.connections import product_at
from engine.kernel.contact_forces import count_outcome, find_contact_force, store_single_solution
from engine.kernel.contacts import end_force_of, moves_by_basis, must_be_measured, store_solution
from engine.kernel.coupled_contact_solver import CoupledProblem, solve_coupled
from engine.kernel.events import is_damping
from engine.kernel.near_contacts import find_near_contacts, law_of_near, loss_rate_of_near
from engine.kernel.persistent_contact_solver import solve_persistent
from engine.kernel.rows import kick_at_row
from engine.kernel.step import StepOutcome


@noinline
def try_connected_step(model, contact, connection, h, state, frame):
    """Do a step in which connections and contacts act, if that is possible in one pass. Returns True if it was, and a
    StepOutcome; if it was not, nothing has changed.

    h: StepCoefficients
    """
    nothing = StepOutcome(FALSE, INT64_0, 0.0, 0.0)
    if state.energy_debt[0] != 0.0 or moves_by_basis(contact.basis):
        return FALSE, nothing
    find_forces(connection, h, state)
    if frame >= state.connection.near.until[0]:
        find_near_contacts(model, contact, connection, h, is_damping(model.events, state), state, frame)
    find_closing(contact, contact.other_rows, h, state)
    if not is_any_closing(state):
        open_contacts(state)
        lost = move_all(connection, None, h, state)
        return TRUE, StepOutcome(FALSE, INT64_0, lost, 0.0)
    is_solved, evaluations, dissipated = find_contact_forces(contact, h.contact, h.contact.coupling, state)
    if not is_solved:
        return FALSE, nothing
    answer_contact_forces(h.connection, state)
    push_modes(contact, contact.other_rows, h.contact, state)
    lost = move_all(connection, state.connection.contact_push, h, state)
    clear_pushes(contact, contact.other_rows, state)
    return TRUE, StepOutcome(TRUE, evaluations, lost + dissipated, 0.0)


# --- how far contacts would close


@inline
def find_closing(contact, other_rows, h, state):
    """Find how far the coming drift would change the compression of each near contact, with the forces of connections
    and without those of contacts."""
    near, f = state.connection.near, state.connection.force
    g, count = near.free_displacement, near.size[0]
    for n in range(count):
        k = near.contact[n]
        near.compression[n] = state.compression[k]
        g[n] = coming_move_at_row(contact.rows, h.contact.rows, h, k, state)
        if other_rows is not None:
            g[n] += coming_move_at_row(other_rows, h.contact.other_rows, h, k, state)
    for i in range(f.shape[0]):
        for n in range(count):
            g[n] -= near.moves[i * count + n] * f[i]


@inline
def is_any_closing(state):
    """True if a contact is closed, or would be closed at the end of the step."""
    near = state.connection.near
    for n in range(near.size[0]):
        if near.compression[n] > 0.0 or near.compression[n] + near.free_displacement[n] > 0.0:
            return True
    return False


@inline
def open_contacts(state):
    """Store the compressions at the end of a step in which all contacts are open, and forces of zero."""
    near = state.connection.near
    for n in range(near.size[0]):
        k = near.contact[n]
        state.compression[k] = near.compression[n] + near.free_displacement[n]
        state.contact_force[k] = 0.0


# --- contact forces


@inline
def find_contact_forces(contact, h, coupling, state):
    """Find the contact forces, and store them if that needs no momenta. Returns True if they are stored, the
    evaluations of contact laws, and the energy that contact loss takes, J."""
    if coupling is not None:  # by type, where no island of the scene has several contacts
        if state.compression.shape[0] > 1:
            return find_several_forces(contact, h, state)
    return find_one_force(contact, h, state)


@inline
def find_one_force(contact, h, state):
    """Find the force of the only contact of the island, and store it if that needs no momenta. Returns True if it is
    stored, the evaluations of the contact law, and the energy that contact loss takes, J."""
    s = state.compression[0]
    state.free_displacement[0] = state.connection.near.free_displacement[0]
    solution = find_contact_force(contact, h, state, INT64_0)
    if solution.status == SolveStatus.FAILED or must_be_measured(h, state, 0, s, solution.eta, solution.force):
        return FALSE, INT64_0, 0.0
    count_outcome(state, solution.evaluations, solution.status)
    return TRUE, solution.evaluations, store_single_solution(contact, h, state, INT64_0, solution)


@inline
def find_several_forces(contact, h, state):
    """Find the forces of several contacts, and store them if that needs no momenta. Returns True if they are stored,
    the rounds of the solve, and the energy that contact loss takes, J."""
    near, n = state.connection.near, state.connection.near.size[0]
    law = law_of_near(contact.law, near.potential_coefficient[0:n], near.exponent[0:n])
    loss_rate = loss_rate_of_near(h.loss_rate, near.loss_rate[0:n])
    s, g = near.compression[0:n], near.free_displacement[0:n]
    problem = CoupledProblem(law, loss_rate, near.coupling[0 : n * n], s, g, contact.tolerance, state.scratch)
    rounds, status, persist = solve_persistent(problem), SolveStatus.NEWTON, TRUE
    if rounds == 0:
        for i in range(n):
            state.scratch.vectors[Row.FORCE, i] = state.contact_force[near.contact[i]]
        rounds, status, _ = solve_coupled(problem, contact.max_rounds, state.line_search_budget)
        persist = FALSE
    if status == SolveStatus.FAILED or status == SolveStatus.CAPPED or not are_usual(h, state):
        return FALSE, INT64_0, 0.0
    count_outcome(state, rounds, status)
    return TRUE, rounds, store_forces(contact, h, persist, state)


@inline
def are_usual(h, state):
    """True if all forces that were found are finite, and none of them all but cancels."""
    near, vectors = state.connection.near, state.scratch.vectors
    for n in range(near.size[0]):
        eta, f, k = vectors[Row.STEP, n], vectors[Row.FORCE, n], near.contact[n]
        finite = math.isfinite(eta + vectors[Row.END, n] + f)
        if not finite or must_be_measured(h, state, k, near.compression[n], eta, f):
            return False
    return True


@inline
def store_forces(contact, h, persist, state):
    """Store the forces and compressions that were found at the near contacts. Returns the energy lost, J.

    persist: True if all that are closed remain so, and END_FORCE is known
    """
    near, vectors, lost = state.connection.near, state.scratch.vectors, 0.0
    for n in range(near.size[0]):
        k, s, miss = near.contact[n], near.compression[n], vectors[Row.MISS, n]
        eta, b, f = vectors[Row.STEP, n], vectors[Row.END, n], vectors[Row.FORCE, n]
        if f == 0.0 and s <= 0.0 and b <= 0.0:
            state.compression[k], state.contact_force[k] = b, 0.0
            state.compression_compensation[k] += miss
        else:
            end_force = vectors[Row.END_FORCE, n] if persist else end_force_of(contact, h.loss_rate, k, b)
            lost += store_solution(contact, h, state, k, (eta, b, f, f, end_force), miss)
    return lost


@inline
def answer_contact_forces(h, state):
    """Correct the forces of connections for how far the contact forces move these."""
    joined, near = state.connection, state.connection.near
    count = near.size[0]
    for i in range(joined.move.shape[0]):
        moved = 0.0
        for n in range(count):
            moved += near.moves[i * count + n] * state.contact_force[near.contact[n]]
        joined.move[i] = -moved
    for i in range(joined.move.shape[0]):
        joined.force[i] += product_at(h.force_per_move, i, joined.move)


@inline
def push_modes(contact, other_rows, h, state):
    """Add to `contact_push` the momentum that the contact forces give each mode in half a kick."""
    near, pushes = state.connection.near, state.connection.contact_push
    for n in range(near.size[0]):
        k = near.contact[n]
        f = state.contact_force[k]
        if f != 0.0:
            kick_at_row(contact.rows, h.rows, k, -f, pushes)
            if other_rows is not None:
                kick_at_row(other_rows, h.other_rows, k, -f, pushes)


@inline
def clear_pushes(contact, other_rows, state):
    """Set `contact_push` to zero for all modes that contacts have pushed."""
    near, pushes = state.connection.near, state.connection.contact_push
    for n in range(near.size[0]):
        k = near.contact[n]
        if state.contact_force[k] != 0.0:
            clear_row(contact.rows, k, pushes)
            if other_rows is not None:
                clear_row(other_rows, k, pushes)


@inline
def clear_row(rows, k, pushes):
    """Set the pushes of the modes of row k to zero."""
    for m in range(rows.mode_begin[k], rows.mode_end[k]):
        pushes[m] = 0.0
