"""Contacts within a step: after the first half-kick, find the forces and let them act.

A solve that fails, or whose forces are not finite, acts on nothing: the step then turns the
island's motion around (engine.modes.turn_back), which keeps every energy as it is.
"""

import math

import numpy as np

from engine.coupled import LIMIT, coupled
from engine.jit import ZERO, jit, outlined
from engine.laws import elastic, gain, potential
from engine.modes import bound, energy_of_motion, kick, project, project_drift
from engine.rounds import END, ETA, FORCE, MISS, respond
from engine.solve import CAPPED, FAILED, FREE, NEWTON, contact_loss, scalar

UNCAPPED = LIMIT + 1
UNTOUCHED = np.int64(FREE)

CANCELLED = 100.0  # times compression and step: what B·f may be before moves are measured instead
BUDGET = 16  # line searches that the capped solves of an island may spend between two refills


@jit
def loss_of_step(contact, damping, k, s, b, eta, f):
    """Energy that contact loss takes over one step: (f - φ)·η, J."""
    rate = contact_loss(damping, k)
    if rate == 0.0:
        return 0.0
    w = 1.0 + rate * eta
    if w > 0.5:
        return f * eta * (rate * eta) / w
    return f * eta - gain(contact.law, k, s, b, eta)  # f/w would cancel


@jit
def push_apart(contact, partner, state, k, f):
    """Half a kick by the force f of contact k on the bodies it joins."""
    kick(contact.rows, k, -f, state.p)
    if partner is not None:
        kick(partner, k, -f, state.p)


@jit
def spring_back(contact, partner, state):
    """Half a kick by all contact forces."""
    if contact is not None:
        for k in range(contact.barrier.shape[0]):
            f = state.contact_force[k]
            if f != 0.0:
                push_apart(contact, partner, state, k, f)


@jit
def settle(contact, damping, state, k, eta, b, f, response, miss):
    """Give contact k its new compression and force; returns the energy lost. `response` is the force
    of the contact law, `miss` what the bodies moved at the contact beyond η.

    What rounding leaves of a step has the same sign at every step of a contact, and would add up
    (2e-13 of the energy in 60 ms): the part of B beneath its last digit, the residual of the
    solution, and the step's part beneath the last digit of the compression. It is carried to the
    next step (Kahan).
    """
    lost = 0.0
    s = state.compression[k]
    miss -= contact.beneath[k] * f
    if damping is not None:
        lost = loss_of_step(contact, damping, k, s, b, eta, response)
        lost += (f - elastic(contact.law, k, b)) * miss  # where bodies move beyond the step, the force works on
    residue = state.residue[k] + miss
    if 2.0 * abs(eta) < b:
        end = s + (eta + residue)
        residue = (eta + residue) - (end - s)
    else:  # beside a long step to a small compression, what rounding left of the step is no longer small
        end = b
    state.residue[k] = residue
    state.compression[k] = end
    state.contact_force[k] = f
    return lost


@jit
def cancels(contact, k, s, eta, f):
    """Whether forces all but cancel at contact k: of what a force moves by itself, B·f, so little is left that
    the rest is rounding."""
    return contact.compliance[k] * f > CANCELLED * (abs(s) + abs(eta))


@outlined
def measured_miss(contact, partner, state, k, eta, f):
    """How far the bodies move at contact k beyond the step η, m, from the momenta they have by now; `free_move` is
    then the whole move."""
    move = project_drift(contact.rows, k, state.p)
    if partner is not None:
        move += project_drift(partner, k, state.p)
    state.free_move[k] = move
    return (move - eta) + contact.beneath[k] * f  # the last is taken off in `settle`


@outlined
def created(contact, state, k, s, lost, f):
    """Energy that contact k has gained since its compression was s, and lost, beyond the work of its force on what
    moves, J."""
    end = state.compression[k]
    return gain(contact.law, k, s, end, end - s) + lost - f * state.free_move[k]


@jit
def count_solve(state, count, how):
    """Keep the telemetry."""
    state.regimes[how] += 1
    if how >= NEWTON:
        state.iterations[count] += 1


@jit
def solve_one(contact, partner, damping, state, k):
    """Solve contact k alone, and give the first half-kick.

    Returns the energy lost, the evaluations of its law, how the solve ended, and the energy created.
    """
    eta, b, f, _, count, how = scalar(
        contact.law,
        damping,
        k,
        state.compression[k],
        state.free_move[k],
        contact.compliance[k],
        contact.tolerance,
    )
    if not math.isfinite(eta + b + f):
        how = FAILED
    count_solve(state, count, how)
    if how == FAILED:
        return 0.0, count, how, 0.0
    push_apart(contact, partner, state, k, f)
    s, excess = state.compression[k], 0.0
    if cancels(contact, k, s, eta, f):
        miss = measured_miss(contact, partner, state, k, eta, f)
        lost = settle(contact, damping, state, k, eta, b, f, f, miss)
        excess = created(contact, state, k, s, lost, f)
    else:
        miss = (state.free_move[k] - eta) - contact.compliance[k] * f
        lost = settle(contact, damping, state, k, eta, b, f, f, miss)
    return lost, count, how, excess


@outlined
def solve_many(contact, partner, damping, coupling, state):
    """Solve all contacts of an island. Returns as `solve_one`."""
    law, s, vectors = contact.law, state.compression, state.scratch.vectors
    n = contact.barrier.shape[0]
    for k in range(n):
        vectors[FORCE, k] = state.contact_force[k]
    count, how, excess, cap = ZERO, CAPPED, np.inf, contact.cap
    while how == CAPPED and not excess < 0.5 * energy_of_motion(state.p):
        # a second time, without a cap, if the motion could not pay for the energy created
        count, how, excess = coupled(
            law,
            damping,
            coupling.matrix,
            n,
            s,
            state.free_move,
            cap,
            state.budget,
            contact.tolerance,
            state.scratch,
        )
        cap = UNCAPPED
    for k in range(n):
        if not math.isfinite(vectors[ETA, k] + vectors[END, k] + vectors[FORCE, k]):
            how = FAILED
    count_solve(state, count, how)
    lost = 0.0
    if how == FAILED:
        return lost, count, how, 0.0
    for k in range(n):
        state.contact_force[k] = vectors[FORCE, k]
    spring_back(contact, partner, state)
    measured = False
    for k in range(n):
        measured = measured or cancels(contact, k, s[k], vectors[ETA, k], vectors[FORCE, k])
    if measured:
        excess = 0.0
        for k in range(n):
            vectors[MISS, k] = measured_miss(contact, partner, state, k, vectors[ETA, k], vectors[FORCE, k])
    for k in range(n):
        begin = s[k]
        eta, b, f = vectors[ETA, k], vectors[END, k], vectors[FORCE, k]
        response = f  # the force of the law, which that of an unfinished solve is not
        if how == CAPPED and damping is not None:
            response = respond(law, damping, k, s[k], eta)[0]
        own = settle(contact, damping, state, k, eta, b, f, response, vectors[MISS, k])
        lost += own
        if measured:
            excess += created(contact, state, k, begin, own, f)
    return lost, count, how, excess


@jit
def refill(coupling, state):
    """A new budget for capped solves."""
    if coupling is not None:
        state.budget[0] = BUDGET


@jit
def touch(contact, partner, damping, coupling, state):
    """Solve for the contact forces of an island and give their first half-kick.

    Returns the energy lost, the evaluations of the contact law, how the solve ended, FREE if no contact
    was in reach, and the energy that an unfinished solve creates.
    """
    if contact is None:
        return 0.0, 0, FREE, 0.0
    touching, only = ZERO, ZERO
    free_moves(contact, partner, state)
    for k in range(contact.barrier.shape[0]):
        s = state.compression[k]
        if s > 0.0 or s + state.free_move[k] > 0.0:
            touching += 1
            only = k
    if touching == 0:
        for k in range(contact.barrier.shape[0]):
            state.compression[k] += state.free_move[k]
        return 0.0, ZERO, UNTOUCHED, 0.0
    if coupling is not None:  # by type, where no island of the scene has several contacts
        if contact.barrier.shape[0] > 1:
            return solve_many(contact, partner, damping, coupling, state)
    return solve_one(contact, partner, damping, state, only)


@jit
def free_moves(contact, partner, state):
    """How the coming drift changes each compression."""
    for k in range(contact.barrier.shape[0]):
        g = project_drift(contact.rows, k, state.p)
        if partner is not None:
            g += project_drift(partner, k, state.p)
        state.free_move[k] = g


@jit
def forget(moving):
    """The margins of a refined sample (engine.refine) hold no longer."""
    if moving is not None:
        moving.known[0] = 0


@jit
def let_go(contact, state):
    """No contact force in this step."""
    if contact is not None:
        for k in range(contact.barrier.shape[0]):
            state.contact_force[k] = 0.0


@jit
def separated(contact, partner, state, k):
    """Compression of contact k as the modes have it, m."""
    if contact is None:
        return 0.0
    s = project(contact.rows, k, state.q) - contact.barrier[k]
    if partner is not None:
        s += project(partner, k, state.q)
    return s


@jit
def out_of_reach(contact, partner, state):
    """Whether no contact can close if each mode moves no further than `state.reach`."""
    if contact is not None:
        for k in range(contact.barrier.shape[0]):
            far = bound(contact.rows, k, state.reach)
            if partner is not None:
                far += bound(partner, k, state.reach)
            if not state.compression[k] + 1.01 * far < 0.0:  # NaN is in reach
                return False
    return True


@jit
def resync(contact, partner, state):
    """Out of contact, read the compressions from the modes.

    Never in contact, where it would cost 1e-12 of the energy at kc = 1e13 (DESIGN sec. 3).
    """
    if contact is None:
        return
    for k in range(contact.barrier.shape[0]):
        state.contact_force[k] = 0.0
        state.compression[k] = min(separated(contact, partner, state, k), 0.0)


@jit
def stored(contact, state):
    """Potential energy of the contacts, J."""
    total = 0.0
    if contact is not None:
        for k in range(contact.barrier.shape[0]):
            total += potential(contact.law, k, state.compression[k])
    return total
