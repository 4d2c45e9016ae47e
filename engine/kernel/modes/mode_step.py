"""The conservative core of every mode: the kernels that move and read it.

One step of length h under forces constant over the step (external, weight, contact):

    p ← p + t·(force - ω²q)        half a kick
    q ← q + v·p                    drift
    p ← p + t·(force - ω²q)        half a kick,    v = 2t/(1 + ω²t²)

This is the step of docs/design.md, sec. 1, with c = (1 - ω²t²)/(1 + ω²t²) and e = v·t, written so that
it conserves ½p² + ½ω²q² - force·q for any t: rounding of the coefficients shifts the energy
once, and never makes it drift. The coefficients t and v are made in engine.assembly.mode_coefficients; a
mode of heavy damping loses momentum in the drift as well.
"""

import math
from typing import Any, NamedTuple

from engine.compiler.decorators import inline, noinline
from engine.compiler.lanes import number_at, put_number, splat, zero_like
from engine.kernel.data.effects import CONNECTIONS, DRAG, EFFECTS, LOSS
from engine.kernel.data.enums import StepKind
from engine.kernel.modes.ordered_sums import fold
from engine.kernel.modes.potential import kick_by_spring, kick_by_weight

DENORMAL_LIMIT = 1e-290  # √kg·m, √kg·m/s


# What is written for one mode does the same with eight, or fewer: m is an index, EightFrom or FewFrom one
# (engine.kernel.modes.ordered_sums.fold). So the bits depend neither on the processor's vectors nor on what else a
# kernel does.


@inline
def apply_loss(loss, m, p):
    """Take the loss of mode m from its momentum. Return the damped momentum, and the energy lost."""
    damped = number_at(loss.decay_factor, m) * p
    return damped, energy_of_loss(loss.dissipation_factor, m, p, damped)


@inline
def lose_at_end(loss, m, p):
    """Do half a step of loss of mode m. Return the damped momentum, and the energy lost."""
    if EFFECTS & LOSS:
        return apply_loss(loss, m, p)
    return p, zero_like(p)


@inline
def lose_in_drift(drag, m, p):
    """Take the loss of mode m in a drift. Return the damped momentum, and the energy lost. drag: None where no mode of
    the island has such a loss"""
    if drag is not None:
        if EFFECTS & DRAG:
            return apply_loss(drag, m, p)
    return p, zero_like(p)


@inline
def energy_of_loss(dissipation_factor, m, p, damped):
    """Return the energy that a loss takes from momentum p of mode m, J. Without a factor, return twice that energy,
    from the damped momentum: this reads one array less, and saves one product for each mode."""
    if dissipation_factor is None:
        return (p - damped) * (p + damped)
    return number_at(dissipation_factor, m) * p * p


@inline
def kick_by_force(push, p):
    """Return the momentum after half a kick by a force, if there is one."""
    if push is None:
        return p
    return p + push


@inline
def begin_step_mode(h, compensation, m, q, p):
    """Do half a step of loss and half a kick of mode m, without contact. Returns its momentum, and the energy lost."""
    p, lost = lose_at_end(h.loss, m, p)
    p = kick_by_weight(h.weight_kick, compensation, m, p)
    return kick_by_spring(h.spring_kick, m, q, p), lost


@inline
def end_step_mode(h, push, compensation, m, q, p):
    """Do the drift, half a kick and half a step of loss of mode m. Returns q, p, and the energy lost.

    push: what forces add to its momentum in half a kick, or None
    """
    q = q + number_at(h.drift, m) * p
    p, dragged = lose_in_drift(h.drag, m, p)
    p = kick_by_spring(h.spring_kick, m, q, p)
    p = kick_by_force(push, kick_by_weight(h.weight_kick, compensation, m, p))
    p, lost = lose_at_end(h.loss, m, p)
    return q, p, add_drag(h.drag, lost, dragged)


@inline
def add_drag(drag, lost, dragged):
    """Return the energy lost at the end of a step, with that lost in its drift."""
    if drag is not None:
        if EFFECTS & DRAG:
            return lost + dragged
    return lost


class Motion(NamedTuple):
    """Displacements and momenta of modes."""

    q: Any  # √kg·m [modes]
    p: Any  # √kg·m/s [modes]
    compensation: Any  # √kg·m/s [modes]: rounding carried from kick to kick, of weights


@inline
def motion_of(state):
    """Return the Motion of a State, or of the motion saved in a free flight."""
    return Motion(state.q, state.p, state.kick_compensation)


@inline
def put_motion(motion, m, q, p):
    """Write the displacement and the momentum of mode m, or of eight."""
    put_number(motion.q, m, q)
    put_number(motion.p, m, p)


# --- passes over all modes; h: StepCoefficients


@inline
def add_first_half(of, m, sums):
    """Find the momentum of mode m in the coming drift, and add the energy lost up to there to the sums."""
    h, motion, momentum = of
    half, lost = begin_step_mode(h, motion.compensation, m, number_at(motion.q, m), number_at(motion.p, m))
    put_number(momentum, m, half)
    return (sums[0] + lost,)


@inline
def find_drift_momenta(h, kind, state):
    """Find the momenta of the coming drift without the forces that are still to be found, unless they are known.

    kind: StepKind of the step
    """
    if state.drift_kind[0] != kind:
        of = h, motion_of(state), state.drift_momentum
        state.drift_loss[0] = fold(add_first_half, of, state.p.shape[0], (splat(0.0),))[0]
        state.drift_kind[0] = kind
        forget_moves(state)


@inline
def forget_moves(state):
    """Mark how far the coming drift moves connections as unknown."""
    if EFFECTS & CONNECTIONS:
        state.connection.is_move_known[0] = 0


@inline
def forget_drift(state):
    """Mark the momenta of the coming drift as unknown: motion has changed from outside."""
    state.drift_kind[0] = StepKind.UNKNOWN


@inline
def add_free_step(of, m, sums):
    """Do a step of mode m on which nothing acts, and add the energy lost to the sums."""
    h, motion = of
    q = number_at(motion.q, m)
    half, lost_first = begin_step_mode(h, motion.compensation, m, q, number_at(motion.p, m))
    moved, momentum, lost_later = end_step_mode(h, None, motion.compensation, m, q, half)
    put_motion(motion, m, moved, momentum)
    return (sums[0] + (lost_first + lost_later),)


@inline
def free_step(h, motion):
    """Do a step of all modes on which nothing acts: both halves in one pass. Returns the energy lost."""
    return fold(add_free_step, (h, motion), motion.p.shape[0], (splat(0.0),))[0]


@noinline
def flush_denormals(q, p):
    """Set momenta and displacements that have decayed into subnormal numbers to zero; these are slow to compute
    with."""
    for m in range(p.shape[0]):
        if abs(p[m]) < DENORMAL_LIMIT:
            p[m] = 0.0
        if abs(q[m]) < DENORMAL_LIMIT:
            q[m] = 0.0


@noinline
def reverse_momenta(p):
    """Reverse the motion. This is the last resort where contact forces cannot be found: no force acts, nothing moves,
    and every energy is what it was."""
    for m in range(p.shape[0]):
        p[m] = -p[m]


@noinline
def rescale_kinetic_energy(energy, p):
    """Take an energy, J, from the motion, or give it one (negative). Returns the energy taken: at most nearly all there
    is. Nothing is given that would more than double the kinetic energy."""
    kinetic = kinetic_energy(p)
    if energy < -kinetic:
        return 0.0
    energy = min(energy, 0.99 * kinetic)
    if kinetic > 0.0:
        factor = math.sqrt(1.0 - energy / kinetic)
        for m in range(p.shape[0]):
            p[m] *= factor
    return energy


@inline
def add_kinetic_energy(p, m, sums):
    """Add ½p² of mode m, J, to the sums."""
    x = number_at(p, m)
    return (sums[0] + 0.5 * x * x,)


@inline
def kinetic_energy(p):
    """Kinetic energy of all modes, Σ ½p², J."""
    return fold(add_kinetic_energy, p, p.shape[0], (splat(0.0),))[0]
