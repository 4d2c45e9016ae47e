"""One step of one island: what acts is known from the momenta of the coming drift, so that one pass moves all modes.

loss/2 · kick/2 · [find the forces] · drift · kick/2 · loss/2
"""

from typing import NamedTuple

from engine.compiler.decorators import INT64_0, inline, noinline
from engine.kernel.data.enums import SolveStatus
from engine.kernel.interactions.connected_modes import move_connected_modes
from engine.kernel.interactions.connections import (
    find_connection_forces,
    finish_connections,
    has_connections,
    push_by_connections,
)
from engine.kernel.interactions.contact_forces import finish_contacts, push_by_contacts
from engine.kernel.interactions.external_forces import finish_external_forces, push_by_external_forces
from engine.kernel.interactions.friction import prepare_friction, work_of_surfaces
from engine.kernel.interactions.stretching_bodies import push_stretched
from engine.kernel.interactions.tension import stretches
from engine.kernel.modes.mode_step import find_drift_momenta, forget_drift, reverse_momenta
from engine.kernel.modes.moving_modes import PushedPoint, move_modes

SAMPLE = 0.0, 1.0  # span of a step that is a whole sample


class StepOutcome(NamedTuple):
    """Outcome of a step of an island."""

    in_contact: bool  # whether a contact was in reach
    evaluations: int  # of the contact laws
    dissipated: float  # J
    supplied: float  # J, work of the external forces


@inline
def step(model, settings, state):
    """Do a step. Returns a StepOutcome."""
    h, work, lost = settings.h, 0.0, 0.0
    find_drift_momenta(h, settings.kind, state)
    is_forced = not settings.is_free and push_by_external_forces(model.force, model, settings, state)
    if not settings.is_free:
        prepare_friction(model.contact, h.contact, state)
    touch = push_by_interactions(model.tension, model, settings, is_forced, state)
    if touch.status == SolveStatus.FAILED:
        reverse_motion(state)
    else:
        if is_forced:
            if not touch.is_measured:
                push_by_connections(model.connection, h, state)
            work = finish_external_forces(model.force, h.force, state)
        work += work_of_surfaces(model.contact, h.contact, state)
        lost = move(model.connection, h, touch, is_forced, state)
        lost += finish_connections(model.connection, h, state) + finish_contacts(touch, state)
    return StepOutcome(touch.status != SolveStatus.FREE, touch.evaluations, lost, work)


@inline
def push_by_interactions(tension, model, settings, is_forced, state):
    """Find the forces of the step, and let those of contacts push. Returns a Touch."""
    if tension is not None:
        if stretches(tension, state):
            return push_stretched(model, model.contact, settings, state)
    find_connection_forces(model.connection, settings.h, state)
    return push_by_contacts(model, model.contact, settings.h.contact, settings, is_forced, state)


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


# --- where no forces are found


@noinline
def reverse_motion(state):
    """End a step whose contact forces were not found, or are not finite: nothing acts, and the motion of the island is
    reversed, which keeps every energy as it is."""
    for m in range(state.push.shape[0]):
        state.push[m] = 0.0
    for k in range(state.contact_force.shape[0]):
        state.contact_force[k] = 0.0
    reverse_momenta(state.p)
    forget_drift(state)
    state.solve_outcomes[SolveStatus.REVERSED] += 1
