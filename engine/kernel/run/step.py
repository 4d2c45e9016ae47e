"""One step of one island: what acts is known from the momenta of the coming drift, so that one pass moves all modes.

loss/2 · kick/2 · [find the forces] · drift · kick/2 · loss/2
"""

from typing import NamedTuple

from engine.compiler.decorators import INT64_0, inline, noinline
from engine.kernel.contact.law import prepare_laws, update_laws, work_of_drives
from engine.kernel.data.effects import CONTACTS, EFFECTS, STRETCHING
from engine.kernel.data.enums import EnergyTotal, SolveStatus
from engine.kernel.interactions.connected_modes import move_connected_modes
from engine.kernel.interactions.connections import (
    find_connection_forces,
    finish_connections,
    has_connections,
    push_by_connections,
)
from engine.kernel.interactions.contact_forces import finish_contacts, push_by_contacts
from engine.kernel.interactions.contacts import invalidate_margins
from engine.kernel.interactions.external_forces import finish_external_forces, push_by_external_forces
from engine.kernel.interactions.island_energy import island_energy
from engine.kernel.interactions.near_contacts import keep_all_contacts
from engine.kernel.interactions.stretching_bodies import push_stretched
from engine.kernel.interactions.tension import stretches
from engine.kernel.modes.event_dampers import is_damping
from engine.kernel.modes.mode_step import find_drift_momenta, forget_drift, reverse_momenta
from engine.kernel.modes.moving_modes import PushedPoint, move_modes
from engine.kernel.modes.ordered_sums import accumulate

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
    is_forced = not settings.is_free and push_by_external_forces(model, settings, state)
    if not settings.is_free:
        prepare_laws(model.contact, settings, state)
    outcome = push_by_interactions(model, settings, is_forced, state)
    if outcome.status == SolveStatus.FAILED:
        reverse_motion(state)
    else:
        if is_forced:
            if not outcome.are_moves_measured:
                push_by_connections(model.connection, h.connection, state)
            work = finish_external_forces(model.force, h.force, state)
        work += work_of_drives(model.contact, h.contact.duration, state)
        lost = move(model.connection, h, outcome, is_forced, state)
        lost += finish_connections(h.connection, state) + finish_contacts(outcome, state)
    return StepOutcome(outcome.status != SolveStatus.FREE, outcome.evaluations, lost, work)


@inline
def push_by_interactions(model, settings, is_forced, state):
    """Find the forces of the step, and let those of contacts push. Returns a ContactOutcome."""
    if EFFECTS & STRETCHING:
        if stretches(state):
            return push_stretched(model, settings, state)
    find_connection_forces(model.connection, settings.h, state)
    return push_by_contacts(model, settings, is_forced, state)


@inline
def are_modes_independent(state):
    """True if each mode moves by itself where no contact or force acts: exactly, in steps of any length, as in a
    flight."""
    return not (has_connections(state) or stretches(state) or is_damping(state))


# --- the modes move


@inline
def move(connection, h, outcome, is_forced, state):
    """Move all modes, with the forces that were found. Returns the energy lost, J."""
    is_measured = is_forced or outcome.are_moves_measured
    is_pushed = is_measured or outcome.status != SolveStatus.FREE
    if not is_measured and has_connections(state):
        if is_pushed:
            return move_connected_modes(connection, state.push, h, state)
        return move_connected_modes(connection, None, h, state)
    if not is_pushed:
        return move_modes(h, None, None, state)
    if EFFECTS & CONTACTS:
        if outcome.point_force != 0.0:
            return move_modes(h, None, PushedPoint(h.contact.only_kick_phi, None, INT64_0, outcome.point_force), state)
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


# --- changes by anything but a step, such as events: the energy that they bring counts as supplied


@inline
def begin_change(model, state, time):
    """Bring all contacts up to date before a change at a time, frames. Returns the energy of the island, J."""
    update_laws(state, time)
    keep_all_contacts(model.contact, state)
    return island_energy(model, state)


@inline
def end_change(model, state, before):
    """Count what a change has supplied, and forget what was known of the motion. before: energy of the island, J"""
    accumulate(state.energy_totals, EnergyTotal.SUPPLIED, island_energy(model, state) - before)
    forget_drift(state)
    invalidate_margins(state.refinement)
