"""One step of one island: what acts is known from the momenta of the coming drift, so that one pass moves all modes.

loss/2 · kick/2 · [find the forces] · drift · kick/2 · loss/2
"""

from typing import NamedTuple

from engine.compiler.decorators import FALSE, INT64_0, TRUE, inline, noinline
from engine.kernel.codes import SolveStatus
from engine.kernel.connected_modes import move_connected_modes
from engine.kernel.connections import (
    answer_contacts,
    find_connection_forces,
    finish_connections,
    has_connections,
    push_by_connections,
)
from engine.kernel.contact_forces import solve_contacts, store_contacts
from engine.kernel.contacts import push_by_contacts
from engine.kernel.external_forces import external_work, push_by_forces
from engine.kernel.modes import find_drift_momenta, forget_drift, forget_moves, rescale_kinetic_energy, reverse_momenta
from engine.kernel.moving_modes import PushedPoint, move_modes
from engine.kernel.near_contacts import contacts_in_reach


class StepOutcome(NamedTuple):
    """Outcome of a step of an island."""

    in_contact: bool  # whether a contact was in reach
    evaluations: int  # of the contact laws
    dissipated: float  # J
    supplied: float  # J, work of the external forces


class Touch(NamedTuple):
    """Outcome of the contacts in a step, before modes move."""

    status: int  # SolveStatus; FREE if no contact was in reach
    evaluations: int  # of the contact laws
    dissipated: float  # J, by contact loss
    excess: float  # J, that forces off their curves create
    is_measured: bool  # True if connections have pushed, and their moves been measured
    point_force: float  # N, of an only contact that pushes in the pass over the modes; or 0


@inline
def step(model, h, kind, state, is_free, frame):
    """Do a step. Returns a StepOutcome.

    h:       StepCoefficients
    kind:    StepKind
    is_free: True if neither contacts nor external forces can act
    """
    find_drift_momenta(h, kind, state)
    is_forced = not is_free and push_by_forces(model.force, h.force, frame, state)
    if is_forced:
        forget_moves(state.connection)
    find_connection_forces(model.connection, h, state)
    touch = push_by_all_contacts(model, model.contact, h, kind, state, is_free, is_forced, frame)
    if touch.status == SolveStatus.FAILED:
        return fail(state, touch.evaluations)
    if is_forced and not touch.is_measured:
        push_by_all_connections(model.connection, h, state)
    work = external_work(model.force, h.force, frame, state) if is_forced else 0.0
    lost = move(model.connection, h, touch, is_forced, state) + finish_connections(model.connection, h, state)
    in_contact = touch.status != SolveStatus.FREE
    if in_contact:
        lost += repay_energy_debt(state, touch.excess)
    return StepOutcome(in_contact, touch.evaluations, lost + touch.dissipated, work)


# --- contacts


@inline
def no_touch(status, evaluations):
    """Return the Touch of a step in which no contact pushes."""
    return Touch(status, evaluations, 0.0, 0.0, FALSE, 0.0)


@inline
def push_by_all_contacts(model, contact, h, kind, state, is_free, is_forced, frame):
    """Find the forces of contacts, and let them push. Returns a Touch."""
    if contact is None:
        return no_touch(SolveStatus.FREE, INT64_0)
    if is_free:
        return no_touch(SolveStatus.FREE, INT64_0)
    return push_by_reached_contacts(model, contact, h, kind, state, is_forced, frame)


@inline
def push_by_reached_contacts(model, contact, h, kind, state, is_forced, frame):
    """Find the forces of contacts, and let them push. Returns a Touch."""
    connection = model.connection
    reach = contacts_in_reach(connection, model, h, kind, state, frame)
    solution = solve_contacts(contact, h.contact, reach, state)
    if solution.status == SolveStatus.FREE or solution.status == SolveStatus.FAILED:
        return no_touch(solution.status, solution.evaluations)
    answer_contacts(connection, h, reach, state)
    is_measured, point_force = is_forced or solution.is_measured, 0.0
    if not is_measured and pushes_in_pass(h.contact.only_kick_phi, connection, state):
        point_force = -solution.single.force
    else:
        push_by_contacts(contact, h.contact, reach.numbers, reach.size, state)
    if is_measured:
        push_by_all_connections(connection, h, state)
    lost, excess = store_contacts(contact, h.contact, reach, solution, state)
    return Touch(solution.status, solution.evaluations, lost, excess, is_measured, point_force)


@inline
def push_by_all_connections(connection, h, state):
    """Let connections push before the pass over the modes, if there are any, and measure how far they move."""
    if connection is not None:
        push_by_connections(connection, h, state)


@inline
def pushes_in_pass(kick_phi, connection, state):
    """True if nothing but its only contact acts on the modes of the island."""
    if kick_phi is None:
        return False
    return state.compression.shape[0] == 1 and not has_connections(connection, state)


# --- the modes move


@inline
def move(connection, h, touch, is_forced, state):
    """Move all modes, with the forces that were found. Returns the energy lost, J."""
    is_measured = is_forced or touch.is_measured
    is_pushed = is_measured or touch.status != SolveStatus.FREE
    if connection is not None:
        if not is_measured and has_connections(connection, state):
            if is_pushed:
                return move_connected_modes(connection, state.push, h, state)
            return move_connected_modes(connection, None, h, state)
    if not is_pushed:
        return move_modes(h, None, None, state)
    return move_pushed(h.contact, h, touch.point_force, state)


@inline
def move_pushed(contact, h, force, state):
    """Move all modes, on which contacts and external forces act. Returns the energy lost, J.

    contact: ContactCoefficients or None
    """
    if contact is not None:
        return move_at_point(contact.only_kick_phi, h, force, state)
    return move_modes(h, state.push, None, state)


@inline
def move_at_point(kick_phi, h, force, state):
    """Move all modes, on which an only contact acts with this force (N) if it is not 0, or else what has pushed.
    Returns the energy lost, J."""
    if kick_phi is not None:
        if force != 0.0:
            return move_modes(h, None, PushedPoint(kick_phi, None, INT64_0, force), state)
    return move_modes(h, state.push, None, state)


# --- the rare


@inline
def repay_energy_debt(state, excess):
    """Take from the kinetic energy, at the end of a step, what a capped contact solve created, or give it what that
    solve took; what cannot be taken at once is owed. Returns the energy lost, J."""
    owed = state.energy_debt[0] + excess
    if owed == 0.0:
        return 0.0
    paid = rescale_kinetic_energy(owed, state.p)
    state.energy_debt[0] = max(0.0, owed - paid)
    forget_drift(state)
    return paid - excess


@noinline
def fail(state, evaluations):
    """End a step whose contact forces were not found: the motion is reversed. Returns a StepOutcome."""
    for m in range(state.push.shape[0]):
        state.push[m] = 0.0
    for k in range(state.contact_force.shape[0]):
        state.contact_force[k] = 0.0
    reverse_momenta(state.p)
    forget_drift(state)
    return StepOutcome(TRUE, evaluations, 0.0, 0.0)
