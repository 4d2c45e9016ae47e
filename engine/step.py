"""One step of one island in which forces may act."""

from engine.contact import let_go, spring_back, touch
from engine.force import push, supply
from engine.jit import jit
from engine.modes import first_half, lose_all, pay, second_half, turn_back
from engine.solve import FAILED, FREE


@jit
def settle_up(state, excess):
    """At the end of a step, the motion pays for the energy that an unfinished contact solve created,
    or is given what it took; what cannot be paid at once is owed. Returns the energy lost, J."""
    owed = state.debt[0] + excess
    if owed == 0.0:
        return 0.0
    paid = pay(owed, state.p)
    state.debt[0] = max(0.0, owed - paid)
    return paid - excess


@jit
def drift_on(model, drag, state, failed):
    """The second half of a step without the half-step of loss. Returns the energy lost to drag, J."""
    modes, spring, gravity = model.modes, model.spring, model.gravity
    if drag is not None:
        if not failed:
            return second_half(modes, spring, None, drag, gravity, state.carry, state.q, state.p)
    return second_half(modes, spring, None, None, gravity, state.carry, state.q, state.p)


@jit
def advance(model, contact, force, state, frame):
    """A step with contacts and external forces.

    Returns whether a contact was in reach, the evaluations of the contact laws, the energy lost and the
    work supplied, J.
    """
    modes, spring, loss, gravity, partner = model.modes, model.spring, model.loss, model.gravity, model.partner
    failed = False
    lost = first_half(modes, spring, loss, gravity, state.carry, state.q, state.p)
    push(force, frame, state.p)
    lost_in_contact, count, how, excess = touch(contact, partner, model.contact_loss, model.coupling, state)
    touching = how != FREE
    if how == FAILED:
        failed = True
        turn_back(modes, state.q, state.p)
        let_go(contact, state)
        work = 0.0
    else:
        work = supply(force, frame, state.p)
    if touching or force is not None:  # their second half-kick comes before the loss
        lost += drift_on(model, model.drag, state, failed)
        push(force, frame, state.p)
        if touching:
            spring_back(contact, partner, state)
            lost_in_contact += settle_up(state, excess)
        lost += lose_all(loss, state.p)
    else:
        lost += second_half(modes, spring, loss, model.drag, gravity, state.carry, state.q, state.p)
    return touching, count, lost + lost_in_contact, work
