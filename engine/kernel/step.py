"""One step of one island in which forces may act:

loss/2 · kick/2 · [find forces of connections and contacts] · drift · kick/2 · loss/2
"""

from typing import Any, NamedTuple

from engine.compiler.decorators import FALSE, INT64_0, inline, noinline
from engine.compiler.overloads import overload_by_type
from engine.kernel.codes import SolveStatus
from engine.kernel.connections import (
    begin_connections,
    finish_connections,
    has_connections,
    hold_connections,
    measure_moves,
    push_by_connections,
)
from engine.kernel.contact_forces import (
    count_outcome,
    find_contact_force,
    solve_contacts,
    store_single_solution,
    use_single_solution,
)
from engine.kernel.contacts import apply_contact_forces, clear_forces, must_be_measured
from engine.kernel.external_forces import apply_forces, external_work, has_forces
from engine.kernel.model import SingleContact, StepCoefficients
from engine.kernel.modes import (
    apply_loss_all,
    begin_step,
    begin_step_towards,
    end_step,
    end_step_pushed,
    motion_of,
    rescale_kinetic_energy,
    reverse_motion,
)


class Acting(NamedTuple):
    """Records of what may act on an island in a step, beside its own modes; None where it does not."""

    contact: Any  # Contact
    connection: Any  # Connections
    force: Any  # ExternalForce


class StepOutcome(NamedTuple):
    """Outcome of a step of an island."""

    in_contact: bool  # whether a contact was in reach
    evaluations: int  # of the contact laws
    dissipated: float  # J
    supplied: float  # J, work of the external forces


@inline
def repay_energy_debt(state, excess):
    """Take from the kinetic energy, at the end of a step, what a capped contact solve created, or give it what that
    solve took; what cannot be taken at once is owed. Returns the energy lost, J."""
    owed = state.energy_debt[0] + excess
    if owed == 0.0:
        return 0.0
    paid = rescale_kinetic_energy(owed, state.p)
    state.energy_debt[0] = max(0.0, owed - paid)
    return paid - excess


@inline
def without_end_loss(h):
    """Return the coefficients of a step without loss at its ends."""
    spring, weight = h.spring_kick, h.weight_kick
    return StepCoefficients(h.kick, h.drift, spring, weight, None, h.drag, h.connection, h.contact, h.force)


@inline
def without_loss(h):
    """Return the coefficients of a step without any loss of its modes."""
    return StepCoefficients(h.kick, h.drift, h.spring_kick, h.weight_kick, None, None, h.connection, h.contact, h.force)


@inline
def end_step_before_loss(h, drag, state, failed):
    """Do the second half of a step without the half-step of loss at its end. Motion that is reversed because the
    contact solve failed loses nothing to drag. Returns the energy lost, J."""
    if drag is not None:
        if not failed:
            return end_step(without_end_loss(h), motion_of(state))
    return end_step(without_loss(h), motion_of(state))


@inline
def step(model, force, h, state, frame):
    """Do a step with connections, contacts and external forces. Returns a StepOutcome.

    h: StepCoefficients
    """
    acting = Acting(model.contact, model.connection, force)
    return step_if_contacts(model.contact, acting, h, state, frame)


@inline
def step_if_contacts(contact, acting, h, state, frame):
    """Do a step; where there are contacts, in two passes over the modes if possible. Returns a StepOutcome."""
    if contact is None:
        return step_in_passes(None, acting, h, state, frame)
    return step_with_contacts(h.contact.single, acting, h, state, frame)


def step_with_contacts(single: Any, acting: Any, h: Any, state: Any, frame: int) -> StepOutcome:
    """A step with contacts: in two passes over the modes where islands have but one. In compiled code only."""
    raise TypeError("step_with_contacts is for compiled code")


@inline
def step_in_passes(single, acting, h, state, frame):
    """Do a step whose parts each make a pass over the modes that they act on. Returns a StepOutcome."""
    dissipated = begin_step(h, motion_of(state))
    apply_forces(acting.force, h.force, frame, state)
    begin_connections(acting.connection, h, state)
    solution = solve_contacts(acting.contact, acting.connection, h, state)  # and their first half-kick
    return finish_step_in_passes(acting, h, state, frame, (solution, dissipated))


@inline
def finish_step_in_passes(acting, h, state, frame, begun):
    """Finish a step after the first half-kick of the contacts. Returns a StepOutcome.

    begun: the ContactSolution, and the energy lost before it
    """
    contact, connection, force = acting
    solution, dissipated = begun
    in_contact, failed = solution.status != SolveStatus.FREE, solution.status == SolveStatus.FAILED
    dissipated_in_contact, work = solution.dissipated, 0.0
    if failed:
        reverse_motion(h.drift, state.q, state.p)
        clear_forces(contact, state)
        hold_connections(connection, state)
    else:
        work = external_work(force, h.force, frame, state)
        measure_moves(connection, h, state)
    dissipated += finish_connections(connection, h, state)
    if in_contact or has_forces(force) or has_connections(connection, state):
        dissipated += end_step_before_loss(h, h.drag, state, failed)
        apply_forces(force, h.force, frame, state)  # their second half-kicks come before the loss
        push_by_connections(connection, h, state)
        if in_contact:
            apply_contact_forces(contact, h.contact, state)
            dissipated_in_contact += repay_energy_debt(state, solution.excess)
        dissipated += apply_loss_all(h.loss, state.p)
    else:
        dissipated += end_step(h, motion_of(state))
    return StepOutcome(in_contact, solution.evaluations, dissipated + dissipated_in_contact, work)


@noinline
def finish_rare_step(contact, h, state, solution, dissipated):
    """Finish a step whose contact solve failed, or whose forces all but cancel. Returns a StepOutcome."""
    used = use_single_solution(contact, None, h, state, INT64_0, solution)
    acting = Acting(contact, None, None)
    return finish_step_in_passes(acting, h, state, INT64_0, (used, dissipated))


@inline
def step_in_two_passes(single, contact, h, state):
    """Do a step of an island with one contact at most, and without connections and external forces. It takes a pass
    over the modes before the solve and one after it, instead of seven. Returns a StepOutcome."""
    dissipated, move = begin_step_towards(h, motion_of(state), single.drift_phi)
    if state.compression.shape[0] == 0:
        dissipated += end_step(h, motion_of(state))
        return StepOutcome(FALSE, INT64_0, dissipated, 0.0)
    s = state.compression[0]
    state.free_displacement[0] = move
    if not (s > 0.0 or s + move > 0.0):
        state.compression[0] = s + move
        dissipated += end_step(h, motion_of(state))
        return StepOutcome(FALSE, INT64_0, dissipated, 0.0)
    solution = find_contact_force(contact, h.contact, state, INT64_0)
    count_outcome(state, solution.evaluations, solution.status)
    is_rare = must_be_measured(h.contact, state, 0, s, solution.eta, solution.force)
    if is_rare or solution.status == SolveStatus.FAILED or state.energy_debt[0] != 0.0:
        return finish_rare_step(contact, h, state, solution, dissipated)
    lost = store_single_solution(contact, h.contact, state, INT64_0, solution)
    dissipated += end_step_pushed(h, motion_of(state), single.kick_phi, -solution.force)
    return StepOutcome(solution.status != SolveStatus.FREE, solution.evaluations, dissipated + lost, 0.0)


@inline
def has_several_contacts(coupling, state):
    """True if the island has several contacts; known by type where no island of the scene has."""
    if coupling is None:
        return False
    return state.compression.shape[0] > 1


@inline
def step_as_contacts_allow(single, acting, h, state, frame):
    """Step an island with contacts; in two passes over the modes where one contact at most and nothing else acts on it.
    In compiled code only."""
    is_pushed = has_forces(acting.force) or has_connections(acting.connection, state)
    if has_several_contacts(h.contact.coupling, state) or is_pushed:
        return step_in_passes(single, acting, h, state, frame)
    return step_in_two_passes(single, acting.contact, h, state)


overload_by_type(
    step_with_contacts, {type(None): step_in_passes.py_func, SingleContact: step_as_contacts_allow.py_func}
)
