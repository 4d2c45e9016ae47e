"""Refinement: a sample in several stages, where contact is possible (DESIGN sec. 2).

A stage is a step of another length, forwards or backwards, without loss; half the loss of the sample
comes before the first stage and half after the last. Heavily damped modes (engine.modes.damped_table) lose in
each stage instead, for all lengths are then positive. Each stage conserves energy, and so does their
product, whose order is that of the lengths (engine.accuracy). Out of contact the `exact` table needs no
stages: it is a flow, and one step of it is their product.
"""

import math

from engine.contact import free_moves
from engine.force import idle
from engine.jit import NO, ZERO, jit, outlined
from engine.model import Contact, ContactLoss, Coupling, Force, Loss, Model, Modes, Rows, Spring
from engine.modes import bound, first_half, lose_all, second_half
from engine.step import advance

# --- the model with the tables of one stage


@jit
def stage_spring(spring, tables, s, count):
    """The restoring force of stage s."""
    if spring is None:
        return None
    return Spring(spring.stiffness, tables.pull[s][0:count])


@jit
def stage_rows(rows, kick, drift):
    """Rows with the kicks and drifts of a stage."""
    if rows is None:
        return None
    return Rows(rows.first, rows.last, rows.at, rows.shape, kick, drift)


@jit
def stage_force(force, tables, s):
    """External forces of stage s."""
    if force is None:
        return None
    rows = stage_rows(force.rows, tables.force_kick[s], tables.force_drift[s])
    return Force(rows, force.start, force.begin, force.table, force.after, force.scale)


@jit
def stage_contact(contact, tables, s, count):
    """Contacts of stage s."""
    return Contact(
        contact.law,
        stage_rows(contact.rows, tables.touch_kick[s], tables.touch_drift[s]),
        contact.barrier,
        contact.base,
        contact.place,
        tables.compliance[s][0:count],
        tables.beneath[s][0:count],
        contact.tolerance,
        contact.cap,
    )


@jit
def loss_at_ends(loss, damped):
    """The loss before the first stage and after the last."""
    if damped is None:
        return loss
    return damped.ends


@jit
def stage_damping(damped, s, count):
    """The half-steps of loss of heavily damped modes in stage s, and their drag."""
    if damped is None:
        return None, None
    loss = Loss(damped.keep[s][0:count], damped.lost[s][0:count])
    return loss, Loss(damped.drag_keep[s][0:count], damped.drag_lost[s][0:count])


@jit
def stage_loss(contact_loss, tables, s, count):
    """Contact loss of stage s."""
    if contact_loss is None:
        return None
    return ContactLoss(tables.rate[s][0:count])


@jit
def stage_coupling(coupling, tables, s):
    """Compliances of stage s."""
    if coupling is None:
        return None
    return Coupling(coupling.begin, tables.matrix[s][0 : coupling.matrix.shape[0]])


@jit
def stage(model, contact, tables, s, modes, contacts):
    """The model of an island with the tables of a stage of kind s."""
    loss, drag = stage_damping(tables.damped, s, modes)
    return Model(
        model.samplerate,
        None,
        Modes(tables.kick[s][0:modes], tables.drift[s][0:modes]),
        stage_spring(model.spring, tables, s, modes),
        loss,
        drag,
        model.gravity,
        stage_force(model.force, tables, s),
        stage_contact(contact, tables, s, contacts),
        stage_rows(model.partner, tables.partner_kick[s], tables.partner_drift[s]),
        stage_loss(model.contact_loss, tables, s, contacts),
        stage_coupling(model.coupling, tables, s),
        None,
        None,
        model.pickups,
        model.bodies,
        None,
        model.silence,
    )


# --- is contact possible within this sample?


@jit
def stray(spring, tables, m, q, p):
    """How far mode m strays from its chord within a sample, √kg·m."""
    if spring is None:
        return tables.curve[m] * abs(p[m]) + tables.sag[m]
    stiffness = spring.stiffness[m]
    if stiffness == 0.0:
        return tables.curve[m] * abs(p[m]) + tables.sag[m]
    return tables.curve[m] * math.sqrt(q[m] * q[m] + p[m] * p[m] / stiffness) + tables.sag[m]


@outlined
def take_margins(model, contact, tables, state):
    """How far each compression may stray from its chord within a sample, until something acts again."""
    for m in range(state.p.shape[0]):
        state.reach[m] = stray(model.spring, tables, m, state.q, state.p)
    for k in range(contact.barrier.shape[0]):
        state.refined.margin[k] = bound(contact.rows, k, state.reach) + margin_of_partner(model.partner, k, state)
    state.refined.known[0] = 1


@jit
def margin_of_partner(partner, k, state):
    """The share of the body that contact k touches."""
    if partner is None:
        return 0.0
    return bound(partner, k, state.reach)


@jit
def stays_off(contact, state):
    """Whether no contact can close within the sample whose free moves are known."""
    for k in range(contact.barrier.shape[0]):
        s = state.compression[k]
        if not max(s, s + state.free_move[k]) + state.refined.margin[k] < 0.0:  # NaN is refined
            return False
    return True


@jit
def keep(state):
    """Remember what the first half of a step changes."""
    for m in range(state.p.shape[0]):
        state.refined.before[m], state.refined.carried[m] = state.p[m], state.carry[m]


@jit
def take_back(state):
    """Undo it."""
    for m in range(state.p.shape[0]):
        state.p[m], state.carry[m] = state.refined.before[m], state.refined.carried[m]


@jit
def fly_by(model, contact, tables, state):
    """A step on which nothing acts, if that is what it is. Returns whether, and the energy lost."""
    if state.refined.known[0] == 0:
        take_margins(model, contact, tables, state)
    modes, spring, loss, drag, gravity = model.modes, model.spring, model.loss, model.drag, model.gravity
    keep(state)
    lost = first_half(modes, spring, loss, gravity, state.carry, state.q, state.p)
    free_moves(contact, model.partner, state)
    if not stays_off(contact, state):
        take_back(state)
        return False, 0.0
    for k in range(contact.barrier.shape[0]):
        state.compression[k] += state.free_move[k]
    lost += second_half(modes, spring, loss, drag, gravity, state.carry, state.q, state.p)
    return True, lost


@jit
def pushed(force, frame):
    """Whether an external force acts in this step."""
    if force is None:
        return False
    return not idle(force, frame, ZERO)


@jit
def refined(model, contact, force, tables, state, frame, touching):
    """A sample in stages, or in one step where that is the same. Returns as `engine.step.advance`.

    touching: whether the sample before ended in contact
    """
    if not tables.always and not touching and not pushed(force, frame):
        free, lost = fly_by(model, contact, tables, state)
        if free:
            return NO, ZERO, lost, 0.0
    return in_stages(model, contact, force, tables, state, frame)


@jit
def in_stages(model, contact, force, tables, state, frame):
    """A sample in stages. Returns as `engine.step.advance`."""
    modes, contacts = state.p.shape[0], contact.barrier.shape[0]
    impulse = state.refined.impulse
    state.refined.known[0] = 0
    for k in range(contacts):
        impulse[k] = 0.0
    touched, evaluations, work = NO, ZERO, 0.0
    ends = loss_at_ends(model.loss, tables.damped)
    lost = lose_all(ends, state.p)
    for i in range(tables.sequence.shape[0]):
        s = tables.sequence[i]
        own = stage(model, contact, tables, s, modes, contacts)
        touching, count, more, done = advance(own, own.contact, own.force, state, frame)
        if touching:
            touched = True
            for k in range(contacts):
                impulse[k] += tables.length[s] * state.contact_force[k]
        else:
            for k in range(contacts):
                state.contact_force[k] = 0.0
        evaluations += count
        lost += more
        work += done
    for k in range(contacts):
        state.contact_force[k] = impulse[k]
    return touched, evaluations, lost + lose_all(ends, state.p), work
