"""One step of one island in which forces may act:

loss/2 · kick/2 · [find contact forces] · drift · kick/2 · loss/2
"""

from typing import NamedTuple

from engine.compiler.decorators import inline
from engine.kernel.codes import SolveStatus
from engine.kernel.contacts import apply_contact_forces, clear_forces, solve_contacts
from engine.kernel.external_forces import apply_forces, external_work
from engine.kernel.model import StepCoefficients
from engine.kernel.modes import apply_loss_all, begin_step, end_step, rescale_kinetic_energy, reverse_motion


class StepOutcome(NamedTuple):
    """What a step did to an island."""

    in_contact: bool  # whether a contact was in reach
    evaluations: int  # of the contact laws
    dissipated: float  # J
    supplied: float  # J, work of the external forces


@inline
def repay_energy_debt(state, excess):
    """At the end of a step, take from the kinetic energy what a capped contact solve created, or give it what that
    took; what cannot be taken at once is owed. Returns the energy lost, J."""
    owed = state.energy_debt[0] + excess
    if owed == 0.0:
        return 0.0
    paid = rescale_kinetic_energy(owed, state.p)
    state.energy_debt[0] = max(0.0, owed - paid)
    return paid - excess


@inline
def without_end_loss(h):
    """The coefficients of a step without loss at its ends."""
    return StepCoefficients(h.kick, h.drift, h.spring_kick, None, h.drag, h.contact, h.force)


@inline
def without_loss(h):
    """The coefficients of a step without any loss of its modes."""
    return StepCoefficients(h.kick, h.drift, h.spring_kick, None, None, h.contact, h.force)


@inline
def end_step_before_loss(h, drag, weight, state, failed):
    """The second half of a step without the half-step of loss at its end. A motion that is reversed loses nothing to
    drag. Returns the energy lost, J."""
    if drag is not None:
        if not failed:
            return end_step(without_end_loss(h), weight, state.kick_compensation, state.q, state.p)
    return end_step(without_loss(h), weight, state.kick_compensation, state.q, state.p)


@inline
def step(contact, force, weight, h, state, frame):
    """A step with contacts and external forces. Returns a StepOutcome.

    h: StepCoefficients
    """
    dissipated = begin_step(h, weight, state.kick_compensation, state.q, state.p)
    apply_forces(force, h.force, frame, state.p)
    solution = solve_contacts(contact, h.contact, state)  # and their first half-kick
    in_contact, failed = solution.status != SolveStatus.FREE, solution.status == SolveStatus.FAILED
    dissipated_in_contact, work = solution.dissipated, 0.0
    if failed:
        reverse_motion(h.drift, state.q, state.p)
        clear_forces(contact, state)
    else:
        work = external_work(force, h.force, frame, state.p)
    if in_contact or force is not None:  # their second half-kick comes before the loss
        dissipated += end_step_before_loss(h, h.drag, weight, state, failed)
        apply_forces(force, h.force, frame, state.p)
        if in_contact:
            apply_contact_forces(contact, h.contact, state)
            dissipated_in_contact += repay_energy_debt(state, solution.excess)
        dissipated += apply_loss_all(h.loss, state.p)
    else:
        dissipated += end_step(h, weight, state.kick_compensation, state.q, state.p)
    return StepOutcome(in_contact, solution.evaluations, dissipated + dissipated_in_contact, work)
