"""Contacts: how bodies move them and they push bodies, whether they can close, and how a solution is stored."""

from typing import Any, NamedTuple

from engine.compiler.decorators import FALSE, inline, noinline
from engine.kernel.contact.law import add_driven_moves, driven_move, energy_of_contact, follows_modes
from engine.kernel.data.effects import CONTACTS, EFFECTS, SEVERAL, TWO_BODIES
from engine.kernel.data.enums import FURTHER_ROUNDS, LINE_SEARCHES, SolveStatus
from engine.kernel.modes.point_rows import (
    add_drifts,
    bound_at_row,
    displacement_at_row,
    project,
    project_drift,
    push_both_at_row,
)

CANCELLATION = 3.0  # times compression and step: what B·f may be before moves are measured instead. At 100, a body
# between two stiff walls gains 1e-14 of its energy in a step; at 0, no less than at 3
LARGE_RESIDUE = 1e-10  # of compression and step: a residue that is carried from earlier steps and moves the bodies


@inline
def has_contacts(state):
    """True if the island has contacts."""
    if EFFECTS & CONTACTS:
        return state.compression.shape[0] > 0
    return False


# --- moves and forces at a contact


class ContactOutcome(NamedTuple):
    """Outcome of the contacts in a step, before modes move."""

    status: int  # SolveStatus; FREE if no contact was in reach
    evaluations: int  # of the contact laws
    dissipated: float  # J, by contact loss
    excess: float  # J, that forces off their curves create
    are_moves_measured: bool  # with the pushes of connections, which are done then
    point_force: float  # N, of an only contact that is to push in the pass over the modes; or 0


@inline
def outcome_without_push(status, evaluations):
    """Return the ContactOutcome of a step in which no contact pushes."""
    return ContactOutcome(status, evaluations, 0.0, 0.0, FALSE, 0.0)


class ContactsInReach(NamedTuple):
    """Contacts of an island that may close, of which the forces of a step are to be found: all of them, or those that
    are near (engine.kernel.interactions.near_contacts). Arrays are of these contacts, one after the other."""

    size: int  # how many
    numbers: Any  # theirs in the island; None of an only contact
    compression: Any  # s, m
    free_displacement: Any  # g, m: how the coming drift changes it without contact force
    law: Any  # Laws
    coupling: Any  # B, row by row, m/N; None of an only contact
    moves: Any  # m/N: of each connection, row by row


@inline
def contact_number(numbers, n):
    """Return the number in its island of contact n within reach."""
    if numbers is None:
        return n
    return numbers[n]


@inline
def free_displacement_at(contact, h, k, p):
    """Change of compression k by a drift with momenta p, m."""
    g = project_drift(contact.rows, h.rows, k, p)
    if EFFECTS & TWO_BODIES:
        g += project_drift(contact.other_rows, h.other_rows, k, p)
    return g


@inline
def find_free_displacements(contact, h, state):
    """Find how far the coming drift changes each compression, m."""
    moves = state.free_displacement
    for k in range(moves.shape[0]):
        moves[k] = 0.0
    add_drifts(contact.rows, h.rows, state.drift_momentum, moves)
    if EFFECTS & TWO_BODIES:
        add_drifts(contact.other_rows, h.other_rows, state.drift_momentum, moves)
    add_driven_moves(contact, h.duration, state)


@inline
def push_at_contact(contact, h, k, state):
    """Do half a kick by the force of contact k on the bodies it joins, and keep it for the second half."""
    f = state.contact_force[k]
    if f != 0.0:
        push_both_at_row(contact.rows, h.rows, k, -f, state)
        if EFFECTS & TWO_BODIES:
            push_both_at_row(contact.other_rows, h.other_rows, k, -f, state)


@inline
def push_by_reach(contact, h, reach, state):
    """Do half a kick by the forces of contacts within reach, and keep it for the second half."""
    for n in range(reach.size):
        push_at_contact(contact, h, contact_number(reach.numbers, n), state)


@inline
def compression_from_modes(contact, state, k):
    """Compression of contact k, from the displacements of the modes, m."""
    s = project(contact.rows, k, state.q) - state.barrier[k]
    if EFFECTS & TWO_BODIES:
        s += project(contact.other_rows, k, state.q)
    return s


@inline
def reset_open_contacts(contact, state):
    """Read the compressions of open contacts from the modes.

    This is never done in contact, where it would cost 1e-12 of the energy at kc = 1e13 (docs/design.md, sec. 3).
    """
    if EFFECTS & CONTACTS:
        for k in range(state.compression.shape[0]):
            state.contact_force[k] = 0.0
            if follows_modes(state, k):
                state.compression[k] = min(compression_from_modes(contact, state, k), 0.0)


@inline
def reset_compressions(contact, state):
    """Read the compressions from the modes, also in contact. If any is closed now, the island is in contact: else a
    check before the next step would open it, and its energy would be lost. A bristle keeps its bend."""
    for k in range(state.compression.shape[0]):
        if follows_modes(state, k):
            state.compression[k] = compression_from_modes(contact, state, k)
            state.compression_compensation[k] = 0.0
            if state.compression[k] > 0.0:
                state.in_contact[0] = 1


@inline
def contact_energy(state):
    """Potential energy of the contacts, J."""
    total = 0.0
    if EFFECTS & CONTACTS:
        for k in range(state.compression.shape[0]):
            total += energy_of_contact(state, k)
    return total


# --- can a contact close?


@inline
def bound_at_contact(contact, k, bound):
    """Return how far contact k can close, m, if each mode moves no further than `bound`."""
    return bound_at_row(contact.rows, k, bound) + bound_at_row(contact.other_rows, k, bound)


@inline
def invalidate_margins(refined):
    """Mark the margins of a refined sample (engine.kernel.run.refinement) as no longer valid.

    refined: State.refinement, None without stages
    """
    if refined is not None:
        refined.margin_valid[0] = 0


@inline
def reset_solve_budget(state):
    """Give the solves of an island a new budget of further rounds and line searches."""
    if EFFECTS & SEVERAL:
        state.solve_budget[0] = FURTHER_ROUNDS + LINE_SEARCHES


# --- a solution is stored


@inline
def count_outcome(state, evaluations, status):
    """Count the outcome of a solve."""
    state.solve_outcomes[status] += 1
    if status >= SolveStatus.NEWTON:
        state.iteration_histogram[evaluations] += 1


@inline
def must_be_measured(h, state, k, s, eta, f):
    """True if the energy at contact k has to be measured, because its forces all but cancel: of the move B·f by the
    force itself, so little is left that the rest is rounding. True also if this was so before, and a residue is left of
    it."""
    size = abs(s) + abs(eta)
    return h.compliance[k] * f > CANCELLATION * size or abs(state.compression_compensation[k]) > LARGE_RESIDUE * size


@noinline
def measured_residual(contact, h, state, k, eta, f):
    """Measure how far the bodies move at contact k beyond the step η, m, by the momenta of the drift with all forces.
    `free_displacement` becomes the whole move."""
    move = free_displacement_at(contact, h, k, state.drift_momentum)
    move += driven_move(state, h.duration, k)
    state.free_displacement[k] = move
    return (move - eta) + h.compliance_low[k] * f  # the last is taken off in `store_solution`


# --- events


@inline
def shift_contacts(contact, state, m, change):
    """Let the compressions follow a change of mode m."""
    for k in range(state.compression.shape[0]):
        move = displacement_at_row(contact.rows, k, m, change) + displacement_at_row(contact.other_rows, k, m, change)
        if move != 0.0 and follows_modes(state, k):
            state.compression[k] += move
            state.compression_compensation[k] = 0.0
