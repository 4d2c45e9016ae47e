"""The only sample loop. Offline rendering, live sound, bench and tests all run it.

Any block size gives the same samples, bit for bit: nothing here depends on where a block
begins. Sample i is what the scene is like before step i; sample 0 is the initial state.
"""

import numpy as np

from engine.contact import forget, out_of_reach, refill, resync, separated, stored
from engine.energy import DISSIPATED, SUPPLIED, book, enter, kinetic_and_potential
from engine.events import finish_score, keep_score, quiet
from engine.force import idle
from engine.held import let
from engine.islands import cut_model, cut_state
from engine.jit import NO, ONE, ZERO, entry, jit
from engine.model import ACCELERATION, DISPLACEMENT, VELOCITY
from engine.modes import coast, hush, project, swing
from engine.refine import refined
from engine.rest import HUSHED, UNTIL, fall_asleep, flies, fly, hear, nap, sleep_on, sleeps_through
from engine.step import advance

PIECE = 256  # samples an island runs before the next one does: small enough for the fast cache
LONG = np.int64(64 * 64)  # samples an island sleeps at a time if nothing in it moves
RESYNC = np.int64(64)  # samples; out of contact, compressions are read anew from the modes this often


@jit
def look_ahead(model, state, frame):
    """Find out whether anything can act on the island in the steps up to the next look.

    If not, they need no test for contact and go through the modes once instead of twice; and if
    nothing vibrates either, the island sleeps.
    """
    if idle(model.force, frame + 1, RESYNC) and quiet(model.events, state, frame + 1, RESYNC):
        span = RESYNC / model.samplerate
        forget(state.refined)  # falling masses are faster by now
        energy = swing(model.modes, model.spring, model.gravity, state.q, state.p, span, state.reach)
        if out_of_reach(model.contact, model.partner, state):
            state.clear[0] = frame + RESYNC + 1
            fall_asleep(model.silence, model.gravity, model.loose, state, frame, RESYNC, energy)


@jit
def step(model, contact, force, refinement, state, frame, touching, ledger):
    """One step of one island, the short way where nothing can act on it.

    touching: whether the step before had a contact in reach
    Returns whether a contact was in reach, and the evaluations of the contact laws.
    """
    if contact is None:
        if force is None:
            return coasting_step(model, state, ledger)
    if frame < state.clear[0]:
        return coasting_step(model, state, ledger)
    if refinement is None:
        touching, count, lost, work = advance(model, contact, force, state, frame)
    else:
        touching, count, lost, work = refined(model, contact, force, refinement, state, frame, touching)
    if ledger is not None:
        book(state.account, DISSIPATED, lost)
        book(state.account, SUPPLIED, work)
    return touching, count


@jit
def coasting_step(model, state, ledger):
    """One step in which no force can act. Returns as `step`."""
    lost = coast(model.modes, model.spring, model.loss, model.drag, model.gravity, state.carry, state.q, state.p)
    if ledger is not None:
        book(state.account, DISSIPATED, lost)
    return False, ZERO


@jit
def look_around(model, state, frame, touching, touched):
    """After a step: keep count of contact, and out of contact, on the scene's own grid of samples, read
    the compressions anew and look ahead."""
    if touching:
        state.contacts[0] += 1
    elif touched or frame % RESYNC == 0:
        resync(model.contact, model.partner, state)
        hush(model.loss, state.q, state.p)
        if frame % RESYNC == 0:
            look_ahead(model, state, frame)
    if frame % RESYNC == 0:
        refill(model.coupling, state)


@jit
def room_to_sleep(gravity, loose, state, ledger, trace, room):
    """How many samples may be slept through at once: one, if the flight of a mass is to be recorded."""
    if ledger is None:
        if trace is None:
            return room
    return 1 if flies(gravity, loose, state) else room


@jit
def wake(model, loose, state, frame, slept):
    """After samples slept through: free masses have flown on and may be near; else, once the sleep is over,
    see whether anything is due."""
    last = frame + slept - 1
    if flies(model.gravity, loose, state):
        fly(model.modes, model.spring, model.loss, model.drag, model.gravity, loose, state, slept)
        if last % RESYNC == 0:
            look_around(model, state, last, NO, NO)
    elif state.asleep[UNTIL] == last + 1:
        if state.asleep[HUSHED] != 0:  # what it was put to sleep until is due
            state.asleep[HUSHED] = 0
            return
        sleep_on(model.force, model.events, state, last + 1, LONG)
        if state.asleep[UNTIL] <= last + 1:
            sleep_on(model.force, model.events, state, last + 1, RESYNC)


@jit
def listen(pickups, state, samplerate, out, i):
    """Add what the pickups hear to row i of the output."""
    for n in range(pickups.quantity.shape[0]):
        quantity = pickups.quantity[n]
        if quantity == VELOCITY:
            value = project(pickups.rows, n, state.p)
        elif quantity == DISPLACEMENT:
            value = project(pickups.rows, n, state.q)
        elif quantity == ACCELERATION:  # its mean over the step that ends here
            velocity = project(pickups.rows, n, state.p)
            value = (velocity - state.heard[n]) * samplerate
            state.heard[n] = velocity
        else:
            value = 0.0
            for item in range(pickups.begin[n], pickups.begin[n + 1]):
                value += pickups.sign[item] * state.contact_force[pickups.contact[item]]
        value *= pickups.gain[n]
        hear(state, value)
        out[i, pickups.channel[n]] += value


@jit
def record(trace, begin, count, b0, k0, model, state, frame):
    """Write `count` rows of the trace from `begin` on for an island whose bodies and contacts begin at
    columns b0, k0."""
    for i in range(begin, begin + count):
        for b in range(model.bodies.first.shape[0]):
            trace.displacement[i, b0 + b] = project(model.bodies, b, state.q)
            trace.velocity[i, b0 + b] = project(model.bodies, b, state.p)
        for k in range(state.compression.shape[0]):
            s = state.compression[k]
            if frame < state.clear[0]:  # not kept up to date
                s = separated(model.contact, model.partner, state, k)
            trace.compression[i, k0 + k] = s
            trace.force[i, k0 + k] = state.contact_force[k]
        trace.iterations[i] += state.evaluations[0]
        kinetic, potential = kinetic_and_potential(model.spring, model.gravity, state.q, state.p)
        trace.kinetic[i] += kinetic
        trace.potential[i] += potential
        trace.contact[i] += stored(model.contact, state)
        trace.dissipated[i] += state.account[DISSIPATED]
        trace.supplied[i] += state.account[SUPPLIED]


@entry
def block(model, state, room, part, frames):
    """Render the next samples of one part of the scene into its room; engine.runner adds the parts.

    model, state, room: Held
    part:   its number; parts have nothing in common, and may run at the same time
    frames: how many samples; they fill the first rows of the room
    """
    place = let(room)
    sound(let(model), let(state), part, frames, place.out, place.ledger, place.trace)


@jit
def sound(model, state, part, frames, out, ledger, trace):
    """As `block`, of what is held; ledger and trace may be None."""
    out[:frames] = 0.0
    islands = model.islands
    first, last = islands.part[part], islands.part[part + 1]
    for begin in range(0, frames, PIECE):
        end = min(begin + PIECE, frames)
        start = state.frame[part] - begin
        for n in range(first, last):
            if sleeps_through(state.asleep, n, start + begin, end - begin, ledger, trace):
                continue
            island = cut_model(model, state, n)
            own = cut_state(islands, state, part, n)
            touching = own.touching[0] != 0
            i = begin
            while i < end:
                frame = start + i
                slept = nap(own, frame, room_to_sleep(island.gravity, island.loose, own, ledger, trace, end - i))
                if slept > 0:
                    if ledger is not None:
                        enter(ledger, i, slept, n == first, island, own)
                    if trace is not None:
                        record(trace, i, slept, islands.body[n], islands.contact[n], island, own, frame)
                    i += slept
                    wake(island, island.loose, own, frame, slept)
                    continue
                listen(island.pickups, own, model.samplerate, out, i)
                if ledger is not None:
                    enter(ledger, i, ONE, n == first, island, own)
                if trace is not None:
                    record(trace, i, ONE, islands.body[n], islands.contact[n], island, own, frame)
                keep_score(island, island.events, own, frame)
                touched = touching
                touching, count = step(
                    island, island.contact, island.force, island.refinement, own, frame, touched, ledger
                )
                finish_score(island.events, own, frame)
                look_around(island, own, frame, touching, touched)
                if trace is not None:
                    own.evaluations[0] = count  # kept for the row of the sample that the step ends at
                i += 1
            own.touching[0] = touching
        state.frame[part] += end - begin
