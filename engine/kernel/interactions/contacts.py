"""Contacts: how bodies move them and they push bodies, whether they can close, and how a solution is stored."""

from typing import Any, NamedTuple

from engine.compiler.decorators import FALSE, inline, noinline
from engine.kernel.contact.contact_law import (
    dissipation_of,
    item_or_zero,
    law_in_step,
    potential,
    potential_difference,
)
from engine.kernel.contact.friction_law import acts, bristle_energy, slides
from engine.kernel.data.enums import FURTHER_ROUNDS, LINE_SEARCHES, EventKind, SolveStatus
from engine.kernel.interactions.friction import (
    friction_parameter,
    is_of_friction,
    set_friction_parameter,
    store_friction,
    subtract_surface_moves,
    surface_move,
)
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
def has_contacts(contact, state):
    """True if the island has contacts."""
    if contact is None:
        return False
    return state.compression.shape[0] > 0


# --- moves and forces at a contact


class Touch(NamedTuple):
    """Outcome of the contacts in a step, before modes move."""

    status: int  # SolveStatus; FREE if no contact was in reach
    evaluations: int  # of the contact laws
    dissipated: float  # J, by contact loss
    excess: float  # J, that forces off their curves create
    is_measured: bool  # True if connections have pushed, and their moves been measured
    point_force: float  # N, of an only contact that is to push in the pass over the modes; or 0


@inline
def no_touch(status, evaluations):
    """Return the Touch of a step in which no contact pushes."""
    return Touch(status, evaluations, 0.0, 0.0, FALSE, 0.0)


class Reach(NamedTuple):
    """Contacts of an island that may close, of which the forces of a step are to be found: all of them, or those that
    are near (engine.kernel.interactions.near_contacts). Arrays are of these contacts, one after the other."""

    size: int  # how many
    numbers: Any  # theirs in the island; None if there are never but all
    compression: Any  # s, m
    free_displacement: Any  # g, m: how the coming drift changes it without contact force
    law: Any  # LossyLaw
    coupling: Any  # B, row by row, m/N; None if no island has several contacts
    moves: Any  # m/N: of each connection, row by row; None without connections


@inline
def contact_number(numbers, n):
    """Return the number in its island of contact n within reach."""
    if numbers is None:
        return n
    return numbers[n]


@inline
def free_displacement_at(contact, other_rows, h, k, p):
    """Change of compression k by a drift with momenta p, m."""
    g = project_drift(contact.rows, h.rows, k, p)
    if other_rows is not None:
        g += project_drift(other_rows, h.other_rows, k, p)
    return g


@inline
def find_free_displacements(contact, h, state):
    """Find how far the coming drift changes each compression, m."""
    moves = state.free_displacement
    for k in range(moves.shape[0]):
        moves[k] = 0.0
    add_drifts(contact.rows, h.rows, state.drift_momentum, moves)
    add_drifts(contact.other_rows, h.other_rows, state.drift_momentum, moves)
    subtract_surface_moves(contact.friction, h.duration, state)


@inline
def push_at_contact(contact, other_rows, h, k, state):
    """Do half a kick by the force of contact k on the bodies it joins, and keep it for the second half."""
    f = state.contact_force[k]
    if f != 0.0:
        push_both_at_row(contact.rows, h.rows, k, -f, state)
        if other_rows is not None:
            push_both_at_row(other_rows, h.other_rows, k, -f, state)


@inline
def push_by_reach(contact, h, reach, state):
    """Do half a kick by the forces of contacts within reach, and keep it for the second half."""
    for n in range(reach.size):
        push_at_contact(contact, contact.other_rows, h, contact_number(reach.numbers, n), state)


@inline
def compression_from_modes(contact, other_rows, state, k):
    """Compression of contact k, from the displacements of the modes, m."""
    s = project(contact.rows, k, state.q) - state.barrier[k]
    if other_rows is not None:
        s += project(other_rows, k, state.q)
    return s


@inline
def reset_open_contacts(contact, state):
    """Read the compressions of open contacts from the modes.

    This is never done in contact, where it would cost 1e-12 of the energy at kc = 1e13 (docs/design.md, sec. 3).
    """
    if contact is not None:
        for k in range(state.compression.shape[0]):
            state.contact_force[k] = 0.0
            if not slides(state.friction, k):
                state.compression[k] = min(compression_from_modes(contact, contact.other_rows, state, k), 0.0)


@inline
def reset_compressions(contact, state):
    """Read the compressions from the modes, also in contact. If any is closed now, the island is in contact: else a
    check before the next step would open it, and its energy would be lost. A bristle keeps its bend."""
    if contact is not None:
        for k in range(state.compression.shape[0]):
            if not slides(state.friction, k):
                state.compression[k] = compression_from_modes(contact, contact.other_rows, state, k)
                state.compression_compensation[k] = 0.0
                if state.compression[k] > 0.0:
                    state.in_contact[0] = 1


@inline
def contact_energy(contact, state):
    """Potential energy of the contacts, J."""
    total = 0.0
    if contact is not None:
        for k in range(state.compression.shape[0]):
            s = state.compression[k]
            is_friction = slides(state.friction, k)
            total += bristle_energy(state.friction, k, s) if is_friction else potential(contact.law, k, s)
    return total


# --- can a contact close?


@inline
def is_closing(friction, k, s, g):
    """True if a contact is closed, or would be at the end of the step without its force; or if a point of friction may
    have a force."""
    if slides(friction, k):
        return acts(friction, k, s)
    return s > 0.0 or s + g > 0.0


@inline
def open_compression(friction, k, s, g):
    """Return the compression at the end of a step in which a contact has no force, m."""
    if slides(friction, k):
        return s
    return s + g


@inline
def bound_at_contact(contact, other_rows, k, bound):
    """Return how far contact k can close, m, if each mode moves no further than `bound`."""
    distance = bound_at_row(contact.rows, k, bound)
    if other_rows is not None:
        distance += bound_at_row(other_rows, k, bound)
    return distance


@inline
def invalidate_margins(moving):
    """Mark the margins of a refined sample (engine.kernel.run.refinement) as no longer valid."""
    if moving is not None:
        moving.margin_valid[0] = 0


@inline
def reset_solve_budget(coupling, state):
    """Give the solves of an island a new budget of further rounds and line searches."""
    if coupling is not None:
        state.solve_budget[0] = FURTHER_ROUNDS + LINE_SEARCHES


# --- a solution is stored


@inline
def count_outcome(state, evaluations, status):
    """Count the outcome of a solve."""
    state.solve_outcomes[status] += 1
    if status >= SolveStatus.NEWTON:
        state.iteration_histogram[evaluations] += 1


@inline
def store_solution(contact, h, state, k, solution, residual):
    """Store the new compression and force of contact k, or of a point of friction. Returns the energy lost, J.

    solution: η (m), end compression b (m), force f (N), the force of the contact law (N), from which f differs where a
              solve was capped, and the elastic force at b (N) if there is contact loss
    residual:     how far the bodies moved at the contact beyond η, m

    The rounding of a step has the same sign at every step of a contact, and would add up (2e-13 of the energy in 60
    ms). It consists of the low part of B, the residual of the solution, and the step's part beneath the last digit of
    the compression. It is carried to the next step (Kahan).
    """
    eta, b, f, _, _ = solution
    s = state.compression[k]
    residual -= h.compliance_low[k] * f
    if slides(state.friction, k):
        return store_friction(state.friction, state, k, item_or_zero(h.duration, k), (eta, f), residual)
    lost = dissipation_of(law_in_step(contact, h, state), k, s, solution, residual)
    residue = state.compression_compensation[k] + residual
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
def must_be_measured(h, state, k, s, eta, f):
    """True if the energy at contact k has to be measured, because its forces all but cancel: of the move B·f by the
    force itself, so little is left that the rest is rounding. True also if this was so before, and a residue is left of
    it."""
    size = abs(s) + abs(eta)
    return h.compliance[k] * f > CANCELLATION * size or abs(state.compression_compensation[k]) > LARGE_RESIDUE * size


@noinline
def measured_miss(contact, h, state, k, eta, f):
    """Measure how far the bodies move at contact k beyond the step η, m, by the momenta of the drift with all forces.
    `free_displacement` becomes the whole move."""
    move = free_displacement_at(contact, contact.other_rows, h, k, state.drift_momentum)
    move -= surface_move(state.friction, h.duration, k)
    state.free_displacement[k] = move
    return (move - eta) + h.compliance_low[k] * f  # the last is taken off in `store_solution`


@noinline
def energy_created(contact, state, k, s, lost, f):
    """Energy that contact k has gained since its compression was s, and lost, beyond the work of the bodies against its
    force f, J. At a point of friction, what is lost holds that."""
    if slides(state.friction, k):
        return 0.0
    end = state.compression[k]
    return potential_difference(contact.law, k, s, end, end - s) + lost - f * state.free_displacement[k]


# --- events


@inline
def shift_contacts(contact, state, m, change):
    """Let the compressions follow a change of mode m."""
    if contact is not None:
        for k in range(state.compression.shape[0]):
            move = displacement_at_row(contact.rows, k, m, change) + displacement_at_row(
                contact.other_rows, k, m, change
            )
            if move != 0.0 and not slides(state.friction, k):
                state.compression[k] += move
                state.compression_compensation[k] = 0.0


@inline
def nominal_coefficient(contact, state, k):
    """Stiffness of contact k as the patch says, in units of its law."""
    return contact.nominal_stiffness[k] / (state.exponent[k] + 1.0)


@inline
def contact_parameter(contact, kind, k, state):
    """Return what an event of a kind changes of contact k: its stiffness as a share of that of the patch, its exponent,
    or how far its barrier is beyond that of the patch, m."""
    if contact is None:
        return 0.0
    if is_of_friction(kind):
        return friction_parameter(state.friction, kind, k)
    if kind == EventKind.STIFFNESS:
        return state.potential_coefficient[k] / nominal_coefficient(contact, state, k)
    if kind == EventKind.EXPONENT:
        return state.exponent[k]
    return state.barrier[k] - contact.nominal_barrier[k]


@inline
def set_contact_parameter(contact, kind, span, value, state):
    """Set this parameter of contacts. span: the first, and the last + 1"""
    if contact is not None:
        if is_of_friction(kind):
            set_friction_parameter(state.friction, kind, span, value)
            return
        for k in range(span[0], span[1]):
            if kind == EventKind.STIFFNESS:
                state.potential_coefficient[k] = value * nominal_coefficient(contact, state, k)
            elif kind == EventKind.EXPONENT:  # kc stays, and the law counts in kc/(α+1)
                state.potential_coefficient[k] *= (state.exponent[k] + 1.0) / (value + 1.0)
                state.exponent[k] = value
            else:
                moved = contact.nominal_barrier[k] + value
                state.compression[k] -= moved - state.barrier[k]
                state.barrier[k] = moved
