"""A step of an island part by part, written anew beside that of the engine: each force is measured from the momenta
that the bodies have by then, and kicks twice. Modes are taken one by one, and no momentum is kept from step to step.

The laws, the contact solvers and the factors of connections are the engine's.
"""

from typing import NamedTuple

from engine.compiler.decorators import FALSE, INT64_0, inline, noinline
from engine.kernel.contact.law import energy_created, laws_in_step, store_solution, takes_part
from engine.kernel.contact.power_law import end_force_of, force_of_lossy_law
from engine.kernel.data.enums import Row, SolveStatus
from engine.kernel.interactions.connection_factors import update_factors
from engine.kernel.interactions.connections import clear, finish_connections, project_rows
from engine.kernel.interactions.contact_forces import (
    finish_contacts,
    solve_only_contact,
    solve_several_contacts,
)
from engine.kernel.interactions.contacts import ContactOutcome, ContactsInReach, free_displacement_at
from engine.kernel.interactions.external_forces import find_external_forces, shapes_of
from engine.kernel.modes.mode_step import apply_loss, begin_step_mode, motion_of, reverse_momenta
from engine.kernel.modes.point_rows import project_drift, push_at_row
from engine.kernel.modes.potential import kick_by_spring, kick_by_weight
from engine.kernel.run.step import StepOutcome


@inline
def begin_modes(h, state):
    """Half a step of loss, and half a kick of each mode. Returns the energy lost, J."""
    motion, lost = motion_of(state), 0.0
    for m in range(state.p.shape[0]):
        state.p[m], lost_at_mode = begin_step_mode(h, motion.compensation, m, state.q[m], state.p[m])
        lost += lost_at_mode
    return lost


@inline
def drift_modes(h, state):
    """The drift, with its loss, and half a kick of each mode. Returns the energy lost, J."""
    motion, lost = motion_of(state), 0.0
    for m in range(state.p.shape[0]):
        state.q[m] += h.drift[m] * state.p[m]
        p, dragged = apply_loss(h.drag, m, state.p[m])
        state.p[m] = kick_by_weight(
            h.weight_kick, motion.compensation, m, kick_by_spring(h.spring_kick, m, state.q[m], p)
        )
        lost += dragged
    return lost


@inline
def lose_at_end(h, state):
    """Half a step of loss of each mode. Returns the energy lost, J."""
    total = 0.0
    for m in range(state.p.shape[0]):
        state.p[m], lost = apply_loss(h.loss, m, state.p[m])
        total += lost
    return total


# --- external forces


@inline
def kick_by_external(force, h, state):
    """Half a kick by every external force."""
    for j in range(force.start.shape[0]):
        push_at_row(force.rows, h.kick_phi, j, state.external_force[j], state.p)


@inline
def work_of_external(force, h, state):
    """Work of all external forces over the coming drift, J."""
    work = 0.0
    for j in range(force.start.shape[0]):
        work += state.external_force[j] * project_drift(force.rows, h, j, state.p)
    return work


# --- connections


@inline
def measure_moves(connection, h, moves, state):
    """How far the coming drift changes each extension, m."""
    clear(moves)
    project_rows(connection, h.connection, state.p, moves)


@inline
def kick_by_forces(connection, h, forces, state):
    """Half a kick by forces at all coordinates, N."""
    for r in range(connection.coordinate.shape[0]):
        push_at_row(connection.rows, h.connection.rows.kick_phi, r, -forces[connection.coordinate[r]], state.p)


@inline
def begin_connections(connection, h, state):
    """Find the forces of connections without those of contacts; and half a kick by them."""
    joined, n = state.connection, state.connection.extension.shape[0]
    update_factors(connection, h.connection, h.contact, state)
    measure_moves(connection, h, joined.free_move, state)
    x, y = h.connection.force_per_extension, h.connection.force_per_move
    for i in range(n):
        joined.force[i] = 0.0
        for j in range(n):
            joined.force[i] += x[j * n + i] * joined.extension[j] + y[j * n + i] * joined.free_move[j]
    kick_by_forces(connection, h, joined.force, state)


@inline
def answer(connection, h, state):
    """Correct the forces of connections by how far contact forces move them; and half a kick by the change."""
    joined, n, contacts = state.connection, state.connection.extension.shape[0], state.compression.shape[0]
    for i in range(n):
        joined.move[i] = 0.0
        for k in range(contacts):
            joined.move[i] -= h.connection.contact_moves[k * n + i] * state.contact_force[k]
    for i in range(n):
        joined.free_move[i] = 0.0
        for j in range(n):
            joined.free_move[i] += h.connection.force_per_move[j * n + i] * joined.move[j]
    kick_by_forces(connection, h, joined.free_move, state)
    for i in range(n):
        joined.force[i] += joined.free_move[i]


@inline
def finish(connection, h, state):
    """Half a kick by connections after the drift."""
    kick_by_forces(connection, h, state.connection.force, state)


@inline
def measure_connections(connection, h, state):
    """Measure how far the coming drift changes each extension."""
    measure_moves(connection, h, state.connection.move, state)
    state.connection.is_move_known[0] = 0


# --- contacts


@inline
def kick_by_contacts(contact, h, state):
    """Half a kick by all contact forces."""
    for k in range(state.compression.shape[0]):
        push_at_row(contact.rows, h.rows.kick_phi, k, -state.contact_force[k], state.p)
        push_at_row(contact.other_rows, h.other_rows.kick_phi, k, -state.contact_force[k], state.p)


class Found(NamedTuple):
    """Outcome of the contact solve."""

    status: int  # SolveStatus
    evaluations: int
    single: tuple[float, float, float]  # η and the compression at the end of an only contact (m), and its force (N)


@inline
def solve_all_contacts(contact, h, state):
    """Find all contact forces. Returns a Found."""
    s, g = state.compression, state.free_displacement
    is_closing = FALSE
    for k in range(s.shape[0]):
        g[k] = free_displacement_at(contact, h.contact, k, state.p)
        is_closing = is_closing or s[k] > 0.0 or s[k] + g[k] > 0.0
    if not is_closing:
        for k in range(s.shape[0]):
            s[k] += g[k]
            state.contact_force[k] = 0.0
        return Found(SolveStatus.FREE, INT64_0, (0.0, 0.0, 0.0))
    return solve_by_number(contact, h.contact, state)


@inline
def solve_by_number(contact, h, state):
    """Find the force of an only contact, or of several. Returns a Found."""
    if state.compression.shape[0] > 1:
        return solve_several(contact, h, state)
    s, g = state.compression[0], state.free_displacement[0]
    eta, b, f, evaluations, status = solve_only_contact(contact, h, s, g, state)
    return Found(status, evaluations, (eta, b, f))


@noinline
def solve_several(contact, h, state):
    """Find the forces of several contacts. Returns a Found."""
    s, g = state.compression, state.free_displacement
    reach = ContactsInReach(s.shape[0], None, s, g, laws_in_step(h, state), h.coupling, None)
    solution = solve_several_contacts(contact, h, reach, contact.max_rounds, state)
    return Found(solution.status, solution.evaluations, (0.0, 0.0, 0.0))


@inline
def store_all_contacts(contact, h, solution, state):
    """Store all contacts, with moves that are measured. Returns the energy lost, and created, J."""
    if state.compression.shape[0] == 0:
        return 0.0, 0.0
    return store_by_number(contact, h.contact, solution, state)


@inline
def store_by_number(contact, h, solution, state):
    """Store an only contact, or several. Returns the energy lost, and created, J."""
    if state.compression.shape[0] > 1:
        return store_several(contact, h, solution, state)
    eta, b, f = solution.single
    return store_contact(contact, h, state, INT64_0, (eta, b, f, solution.status))


@noinline
def store_several(contact, h, solution, state):
    """Store several contacts. Returns the energy lost, and created, J."""
    vectors, lost, excess = state.scratch.vectors, 0.0, 0.0
    for k in range(state.compression.shape[0]):
        eta, b, f = vectors[Row.STEP, k], vectors[Row.END, k], vectors[Row.FORCE, k]
        if takes_part(state, k, state.compression[k], b, f):
            lost_here, created = store_contact(contact, h, state, k, (eta, b, f, solution.status))
            lost, excess = lost + lost_here, excess + created
        else:
            state.compression[k], state.contact_force[k] = b, 0.0
            state.compression_compensation[k] += vectors[Row.STEP_RESIDUAL, k]
    return lost, excess


@noinline
def store_contact(contact, h, state, k, found):
    """Store contact k. Returns the energy lost, and created, J."""
    (eta, b, f, status), s = found, state.compression[k]
    move = free_displacement_at(contact, h, k, state.p)
    state.free_displacement[k] = move
    law_force, end_force = f, end_force_of(laws_in_step(h, state), k, b)
    if status == SolveStatus.CAPPED:
        law_force = force_of_lossy_law(laws_in_step(h, state), k, s, eta, f)
    lost = store_solution(h, state, k, (eta, b, f, law_force, end_force), (move - eta) + h.compliance_low[k] * f)
    return lost, energy_created(state, k, s, lost, f)


@inline
def kick_again(contact, h, state):
    """Half a kick by all contact forces after the drift."""
    kick_by_contacts(contact, h.contact, state)


# --- the step


@inline
def measured_step(model, settings, state):
    """Do a step part by part. Returns a StepOutcome. The arguments are those of engine.kernel.run.step.step."""
    h, contact, connection, force = settings.h, model.contact, model.connection, model.force
    lost = begin_modes(h, state)
    find_external_forces(force, model.events, shapes_of(model.refinement), settings, state)
    kick_by_external(force, h.force, state)
    begin_connections(connection, h, state)
    solution = solve_all_contacts(contact, h, state)
    if solution.status == SolveStatus.FAILED:
        reverse_momenta(state.p)
        return StepOutcome(FALSE, solution.evaluations, 0.0, 0.0)
    in_contact, at_contacts, excess = solution.status != SolveStatus.FREE, 0.0, 0.0
    if in_contact:
        kick_again(contact, h, state)
        answer(connection, h, state)
        at_contacts, excess = store_all_contacts(contact, h, solution, state)
    work = work_of_external(force, h.force, state)
    measure_connections(connection, h, state)
    lost += at_contacts + finish_connections(h.connection, state) + drift_modes(h, state)
    kick_by_external(force, h.force, state)
    finish(connection, h, state)
    if in_contact:
        kick_again(contact, h, state)
        outcome = ContactOutcome(solution.status, solution.evaluations, 0.0, excess, FALSE, 0.0)
        lost += finish_contacts(outcome, state)
    return StepOutcome(in_contact, solution.evaluations, lost + lose_at_end(h, state), work)
