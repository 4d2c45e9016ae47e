"""Events: what the score says happens at the start of a step.

All that an event adds to the stored energy counts as supplied, all that it takes as dissipated, so
the ledger stays closed: turning a knob cannot blow up the sound.
"""

import math

from engine.contact import forget, stored
from engine.energy import DISSIPATED, SUPPLIED, book, kinetic_and_potential
from engine.jit import jit, outlined

# what an event does, and to what
STRIKE = 0  # mode `first` gets q = a, p = b
DAMP = 1  # modes first:last keep the share a of their momenta in each step, half of it at either end
STIFFEN = 2  # the stiffness of contacts first:last glides to a times what the model says
MOVE = 3  # the barriers of contacts first:last glide to a beyond where the model has them
BEND = 4  # the exponents of contacts first:last glide to a
LIFT = 5  # what damps modes first:last ends, and what was to damp them for good does not begin
THROW = 6  # as STRIKE, and what damps the bodies that mode `first` has contacts with is lifted, as a key does
FOREVER = 1 << 60  # when an event ends that stays for good
NEVER = 1 << 61  # when an event begins that has not come yet: room for those of a player


@jit
def quiet(events, state, frame, ahead):
    """Whether no event but damping goes on at this frame, or begins within `ahead` samples."""
    if events is None:
        return True
    last = state.next_event[1]
    for j in range(state.next_event[0], last):
        if events.kind[j] != DAMP and frame < events.end[j]:
            return False
    return last == events.kind.shape[0] or events.start[last] > frame + ahead


@jit
def glide(events, state, j, frame, now):
    """Where a value that was `now` at the start of event j is at the end of this step."""
    if frame == events.start[j]:
        state.event_from[j] = now
    if frame + 1 >= events.end[j]:
        return events.a[j]
    share = (frame + 1 - events.start[j]) / (events.end[j] - events.start[j])
    return state.event_from[j] + (events.a[j] - state.event_from[j]) * 0.5 * (1.0 - math.cos(math.pi * share))


@outlined
def strike(model, state, m, q, p):
    """Put mode m at displacement q with momentum p, and its contacts where that takes them."""
    follow(model.contact, model.partner, state, m, q - state.q[m])
    state.q[m] = q
    state.p[m] = p
    state.carry[m] = 0.0


@jit
def follow(contact, partner, state, m, change):
    """Let the compressions follow a change of mode m."""
    if contact is not None:
        for k in range(contact.barrier.shape[0]):
            move = shift(contact.rows, k, m, change)
            if partner is not None:
                move += shift(partner, k, m, change)
            if move != 0.0:
                state.compression[k] += move
                state.residue[k] = 0.0


@jit
def shift(rows, r, m, change):
    """Displacement at row r that a change of mode m brings."""
    if rows.first[r] <= m and m < rows.last[r]:
        return rows.shape[rows.at[r] + (m - rows.first[r])] * change
    return 0.0


@outlined
def damp(state, first, last, share):
    """Take from the momenta of some modes, at one end of a step in which they keep a share; returns the energy lost."""
    lost, keep = 0.0, math.sqrt(share)
    for m in range(first, last):
        lost += 0.5 * state.p[m] * state.p[m] * (1.0 - keep) * (1.0 + keep)
        state.p[m] *= keep
    return lost


@outlined
def lift(events, following, j, first, last, frame):
    """Let event j lift the dampers of modes first:last."""
    for i in range(following[0], events.kind.shape[0]):
        same = events.kind[i] == DAMP and events.first[i] < last and first < events.last[i]
        if same and (i < j or events.end[i] >= FOREVER):
            events.end[i] = min(events.end[i], frame)


@jit
def lift_touched(model, partner, state, j, frame):
    """Let event j lift the dampers of what its mode has contacts with."""
    if partner is not None:
        rows, m = model.contact.rows, model.events.first[j]
        for k in range(rows.first.shape[0]):
            if rows.first[k] <= m and m < rows.last[k]:
                lift(model.events, state.next_event, j, partner.first[k], partner.last[k], frame)
            elif partner.first[k] <= m and m < partner.last[k]:
                lift(model.events, state.next_event, j, rows.first[k], rows.last[k], frame)


@jit
def whole(contact, state, k):
    """Stiffness of contact k as the patch says, in units of its law."""
    return contact.base[k] / (state.exponent[k] + 1.0)


@jit
def turn(contact, events, state, j, frame):
    """Glide on with the stiffness, the exponents or the barriers that event j changes."""
    if contact is not None:
        first, last = events.first[j], events.last[j]
        if events.kind[j] == STIFFEN:
            ratio = glide(events, state, j, frame, state.unit[first] / whole(contact, state, first))
            for k in range(first, last):
                state.unit[k] = ratio * whole(contact, state, k)
        elif events.kind[j] == BEND:
            exponent = glide(events, state, j, frame, state.exponent[first])
            for k in range(first, last):  # kc stays, and the law counts in kc/(α+1)
                state.unit[k] *= (state.exponent[k] + 1.0) / (exponent + 1.0)
                state.exponent[k] = exponent
        else:
            beyond = glide(events, state, j, frame, state.barrier[first] - contact.place[first])
            for k in range(first, last):
                moved = contact.place[k] + beyond
                state.compression[k] -= moved - state.barrier[k]
                state.barrier[k] = moved


@outlined
def happen(model, state, j, frame):
    """Let event j, which is not damping, act at the start of this step."""
    events = model.events
    if events.kind[j] == STRIKE or events.kind[j] == THROW:
        strike(model, state, events.first[j], events.a[j], events.b[j])
        if events.kind[j] == THROW:
            lift_touched(model, model.partner, state, j, frame)
    elif events.kind[j] == LIFT:
        lift(events, state.next_event, j, events.first[j], events.last[j], frame)
    else:
        turn(model.contact, events, state, j, frame)


@outlined
def held(model, state):
    """Energy of an island, J."""
    kinetic, potential = kinetic_and_potential(model.spring, model.gravity, state.q, state.p)
    return kinetic + potential + stored(model.contact, state)


@outlined
def run_events(model, state, frame):
    """All that happens at the start of this step, with the energy it takes and gives."""
    events, following = model.events, state.next_event
    while following[1] < events.kind.shape[0] and events.start[following[1]] <= frame:
        following[1] += 1
    for j in range(following[0], following[1]):
        if frame >= events.end[j]:
            continue
        if events.kind[j] == DAMP:
            book(state.account, DISSIPATED, damp(state, events.first[j], events.last[j], events.a[j]))
        else:
            before = held(model, state)
            happen(model, state, j, frame)
            book(state.account, SUPPLIED, held(model, state) - before)
            state.clear[0] = 0
            forget(state.refined)
    while following[0] < following[1] and events.end[following[0]] <= frame:
        following[0] += 1


@outlined
def damp_on(events, state, frame):
    """The second half of all damping in this step."""
    for j in range(state.next_event[0], state.next_event[1]):
        if events.kind[j] == DAMP and frame < events.end[j]:
            book(state.account, DISSIPATED, damp(state, events.first[j], events.last[j], events.a[j]))


@jit
def finish_score(events, state, frame):
    """What the score says for the end of this step."""
    if events is not None:
        if state.next_event[0] < state.next_event[1]:
            damp_on(events, state, frame)


@jit
def keep_score(model, events, state, frame):
    """What the score says for the start of this step."""
    if events is not None:
        following = state.next_event
        if following[0] < following[1] or (following[1] < events.kind.shape[0] and events.start[following[1]] <= frame):
            run_events(model, state, frame)
