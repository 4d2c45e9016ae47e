"""Contacts: how bodies move them and they push bodies, whether they can close, and how a solution is stored."""

from engine.compiler.decorators import inline, noinline
from engine.kernel.codes import Row
from engine.kernel.contact_law import elastic_force, potential, potential_difference
from engine.kernel.reduced_contact_solver import basis_of_island, gather_rows, spread_rows
from engine.kernel.rows import add_drifts, bound_at_row, kick_at_row, project, project_drift
from engine.kernel.scalar_contact_solver import loss_rate_of

CANCELLATION = 3.0  # times compression and step: what B·f may be before moves are measured instead. At 100, a body
# between two stiff walls gains 1e-14 of its energy in a step; at 0, no less than at 3
LARGE_RESIDUE = 1e-10  # of compression and step: a residue that is carried from earlier steps and moves the bodies
LINE_SEARCHES = 16  # that the capped solves of an island may spend between two periodic checks


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
        island_basis = basis_of_island(basis, coefficients, g.shape[0])
        for j in range(island_basis.rank):
            momentum[j] = project_drift(basis.rows, coefficients.rows, j, state.p)
        spread_rows(island_basis, momentum, state.scratch.vectors[Row.WORK], g)


@inline
def push_by_basis(basis, coefficients, state):
    """Half a kick by all contact forces, by the basis of the island's contacts."""
    if basis is not None:
        f, vectors = state.contact_force, state.scratch.vectors
        island_basis = basis_of_island(basis, coefficients, f.shape[0])
        gather_rows(island_basis, f, vectors[Row.WORK], vectors[Row.GUESS])
        for j in range(island_basis.rank):
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
    moves = state.free_displacement
    for k in range(moves.shape[0]):
        moves[k] = 0.0
    add_drifts(contact.rows, h.rows, state.p, moves)
    add_drifts(contact.other_rows, h.other_rows, state.p, moves)


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
def split_bound_at_row(connection, rows, r, bound):
    """How far the modes of row r can move its point, m, if each moves no further than `bound`: of a body that nothing
    is connected to, and of one that is."""
    distance = bound_at_row(rows, r, bound)
    if connection is not None:
        if distance > 0.0 and connection.is_unconnected[rows.mode_begin[r]] == 0.0:
            return 0.0, distance
    return distance, 0.0


@inline
def split_bound_at_contact(contact, other_rows, connection, k, bound):
    """The same of contact k: how far it can close."""
    alone, connected = split_bound_at_row(connection, contact.rows, k, bound)
    if other_rows is not None:
        more, further = split_bound_at_row(connection, other_rows, k, bound)
        return alone + more, connected + further
    return alone, connected


@inline
def reach_of_connected(connection, amplitude, is_disturbed, k, distance):
    """How far what is connected can close contact k, m: by all of its energy; or as far as the bodies there move by
    themselves, and what the forces of connections add, which that energy bounds.

    amplitude:    √(2E) of it, √J
    is_disturbed: whether the bodies do not move by themselves alone, but are damped by an event
    distance:     how far the bodies can close it by themselves, m
    """
    if connection is None:
        return 0.0
    by_energy = connection.contact_reach[k] * amplitude
    if is_disturbed:
        return by_energy
    return min(by_energy, distance + connection.contact_reach_by_forces[k] * amplitude)


@inline
def cannot_close(contact, connection, amplitude, is_disturbed, state):
    """Whether no contact can close if each mode moves by itself no further than `state.displacement_bound`, and what is
    connected has no more than this amplitude, √J. is_disturbed: as of `reach_of_connected`"""
    if contact is not None:
        for k in range(state.compression.shape[0]):
            bound = state.displacement_bound
            distance, connected = split_bound_at_contact(contact, contact.other_rows, connection, k, bound)
            distance += reach_of_connected(connection, amplitude, is_disturbed, k, connected)
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
    w = 1.0 + rate * eta
    if w > 0.5:
        return f * eta * (rate * eta) / w
    return f * eta - potential_difference(contact.law, k, s, b, eta)  # f/w would cancel


@inline
def store_solution(contact, h, state, k, solution, miss):
    """Give contact k its new compression and force; returns the energy lost.

    solution: η (m), end compression b (m), force f (N), the force of the contact law (N), which f is not where a
              solve was capped, and the elastic force at b (N) if there is contact loss
    miss:     how far the bodies moved at the contact beyond η, m

    What rounding leaves of a step has the same sign at every step of a contact, and would add up
    (2e-13 of the energy in 60 ms): the low part of B, the residual of the
    solution, and the step's part beneath the last digit of the compression. It is carried to the
    next step (Kahan).
    """
    eta, b, f, _, _ = solution
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
def store_free_move(state, k):
    """As `store_solution`, of a contact that is open before the step and after it."""
    vectors = state.scratch.vectors
    state.compression[k] = vectors[Row.END, k]
    state.compression_compensation[k] += vectors[Row.MISS, k]
    state.contact_force[k] = 0.0


@inline
def dissipation_of(contact, loss_rate, k, s, solution, miss):
    """Energy that the contact loss of a solution takes, J."""
    eta, b, f, law_force, end_force = solution
    if loss_rate_of(loss_rate, k) == 0.0:
        return 0.0
    lost = contact_dissipation(contact, loss_rate, k, s, b, eta, law_force)
    return lost + (f - end_force) * miss  # where bodies move beyond the step, the force works on


@inline
def end_force_of(contact, loss_rate, k, b):
    """The elastic force at the end compression b, N, where the loss of a solution calls for it."""
    if loss_rate_of(loss_rate, k) == 0.0:
        return 0.0
    return elastic_force(contact.law, k, b)


@inline
def must_be_measured(h, state, k, s, eta, f):
    """Whether the energy at contact k has to be measured. Its forces all but cancel: of what a force moves by itself,
    B·f, so little is left that the rest is rounding. Or this was so before, and a residue is left of it."""
    size = abs(s) + abs(eta)
    return h.compliance[k] * f > CANCELLATION * size or abs(state.compression_compensation[k]) > LARGE_RESIDUE * size


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


@inline
def energy_created_if_persistent(loss_rate, state, k, s, lost, solution):
    """As `energy_created`, of a contact that persists: its potential is that of the solution, but for what rounding
    moved the compression beyond it."""
    eta, _, f, _, end_force = solution
    elastic = f / (1.0 + loss_rate_of(loss_rate, k) * eta)
    gained = elastic * eta + end_force * ((state.compression[k] - s) - eta)
    return gained + lost - f * state.free_displacement[k]
