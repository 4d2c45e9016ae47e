"""The only sample loop. Offline rendering, live sound, bench and tests all run it.

Any block size gives the same samples, bit for bit: nothing here depends on where a block
begins. Sample i is what the scene is like before step i; sample 0 is the initial state.
"""

from engine.contact import back_to_start, let_go, refill, resync, spring_back, stored, touch
from engine.energy import DISSIPATED, SUPPLIED, audit, book, enter, kinetic_and_potential
from engine.force import push, supply
from engine.islands import cut_model, cut_state
from engine.jit import entry, jit, outlined
from engine.model import ACCELERATION, DISPLACEMENT, VELOCITY
from engine.modes import first_half, hush, lose_all, pay, project, second_half, turn_back
from engine.solve import CAPPED, FAILED, FREE

PIECE = 256  # samples an island runs before the next one does: small enough for the fast cache
RESYNC = 64  # samples; out of contact, compressions are read anew from the modes this often


@jit
def settle_up(coupling, model, state, frame, energy):
    """At the end of a step whose contact solve was capped: the motion pays for the energy created.

    If it cannot, it is turned around, and the step run backwards from there, as if the solve had
    failed. Returns whether it could, and the energy lost.
    """
    if coupling is None:
        return True, 0.0
    paid, lost = pay(energy, state.p)
    if not paid:
        undo(model, state, frame)
    return paid, lost


@outlined
def undo(model, state, frame):
    """Back to the beginning of a step, between its two half-steps of loss, with all motion reversed."""
    modes, spring, gravity = model.modes, model.spring, model.gravity
    for m in range(state.p.shape[0]):
        state.p[m] = -state.p[m]
    first_half(modes, spring, None, gravity, state.carry, state.q, state.p)
    push(model.force, frame, state.p)
    spring_back(model.contact, model.partner, state)
    second_half(modes, spring, None, gravity, state.carry, state.q, state.p)
    push(model.force, frame, state.p)
    spring_back(model.contact, model.partner, state)
    back_to_start(state)
    state.regimes[CAPPED] -= 1
    state.regimes[FAILED] += 1


@jit
def step(model, state, frame, ledger, touched):
    """One step of one island; `touched`: the step before had a contact in reach.

    Returns whether this one has, and the evaluations of the contact laws.
    """
    modes, spring, loss, gravity = model.modes, model.spring, model.loss, model.gravity
    contact, partner = model.contact, model.partner
    lost = first_half(modes, spring, loss, gravity, state.carry, state.q, state.p)
    push(model.force, frame, state.p)
    if frame % RESYNC == 0:
        refill(model.coupling, state)
    lost_in_contact, count, how, excess = touch(contact, partner, model.contact_loss, model.coupling, state)
    touching = how != FREE
    if how == FAILED:
        turn_back(modes, state.q, state.p)
        let_go(contact, state)
        work = 0.0
    else:
        work = supply(model.force, frame, state.p)
    if touching or model.force is not None:  # their second half-kick comes before the loss
        second_half(modes, spring, None, gravity, state.carry, state.q, state.p)
        push(model.force, frame, state.p)
        if touching:
            spring_back(contact, partner, state)
            if how == CAPPED:
                paid, more = settle_up(model.coupling, model, state, frame, excess)
                work, lost_in_contact = work if paid else 0.0, lost_in_contact + more if paid else 0.0
        lost += lose_all(loss, state.p)
    else:
        lost += second_half(modes, spring, loss, gravity, state.carry, state.q, state.p)
    if ledger is not None:
        book(state.account, DISSIPATED, lost + lost_in_contact)
        book(state.account, SUPPLIED, work)
    if touching:
        state.contacts[0] += 1
    elif touched or frame % RESYNC == 0:
        resync(contact, partner, state)
        hush(loss, state.q, state.p)
    return touching, count


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
        out[i, pickups.channel[n]] += pickups.gain[n] * value


@jit
def record(trace, i, b0, k0, model, state):
    """Write row i of the trace for an island whose bodies and contacts begin at columns b0, k0."""
    if trace is not None:
        for b in range(model.bodies.first.shape[0]):
            trace.displacement[i, b0 + b] = project(model.bodies, b, state.q)
            trace.velocity[i, b0 + b] = project(model.bodies, b, state.p)
        for k in range(state.compression.shape[0]):
            trace.compression[i, k0 + k] = state.compression[k]
            trace.force[i, k0 + k] = state.contact_force[k]
        trace.iterations[i] += state.evaluations[0]
        kinetic, potential = kinetic_and_potential(model.spring, model.gravity, state.q, state.p)
        trace.kinetic[i] += kinetic
        trace.potential[i] += potential
        trace.contact[i] += stored(model.contact, state)
        trace.dissipated[i] += state.account[0, DISSIPATED]
        trace.supplied[i] += state.account[0, SUPPLIED]


@jit
def note(trace, state, count):
    """Keep the evaluations of a step for the row of the sample it ends at."""
    if trace is not None:
        state.evaluations[0] = count


@jit
def piece(model, state, out, ledger, tally, trace, begin):
    """Render len(out) samples, the first of which is row `begin` of the trace."""
    islands = model.islands
    frame = state.frame[0]
    for n in range(islands.mode.shape[0] - 1):
        island = cut_model(model, n)
        island_state = cut_state(islands, state, n)
        touching = island_state.touching[0] != 0
        for i in range(out.shape[0]):
            listen(island.pickups, island_state, model.samplerate, out, i)
            enter(ledger, i, n == 0, island, island_state)
            record(trace, begin + i, islands.body[n], islands.contact[n], island, island_state)
            touching, count = step(island, island_state, frame + i, ledger, touching)
            note(trace, island_state, count)
        island_state.touching[0] = touching
    audit(ledger, tally, out.shape[0])
    state.frame[0] += out.shape[0]


@entry
def block(model, state, out, ledger, tally, trace):
    """Render len(out) samples.

    out:    [frames, channels], overwritten
    ledger: room for the energies of some samples, [any, engine.energy.COLUMNS]; or None, and
            energy is not measured
    tally:  what the audit of the energies remembers from block to block (engine.energy)
    trace:  a Trace of [frames, …], zeroed, to be filled; or None
    """
    out[:] = 0.0
    for begin in range(0, out.shape[0], PIECE):
        piece(model, state, out[begin : begin + PIECE], ledger, tally, trace, begin)
