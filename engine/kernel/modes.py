"""The conservative core of every mode: the kernels that move and read it.

One step of length h under forces constant over the step (external, weight, contact):

    p ← p + t·(force - ω²q)        half a kick
    q ← q + v·p                    drift
    p ← p + t·(force - ω²q)        half a kick,    v = 2t/(1 + ω²t²)

This is the step of docs/design.md, sec. 1, with c = (1 - ω²t²)/(1 + ω²t²) and e = v·t, written so that
it conserves ½p² + ½ω²q² - force·q for any t: rounding of the coefficients shifts the energy
once, and never makes it drift. The coefficients t and v are made in engine.build.mode_coefficients; a
mode of heavy damping loses momentum in the drift as well.
"""

import math

from engine.compiler.decorators import INT64_0, inline, noinline
from engine.compiler.lanes import (
    EightFrom,
    FewFrom,
    lane_sum,
    load_first_lanes,
    load_lanes,
    multiply_add,
    number_at,
    put_number,
    splat,
    zero_like,
)
from engine.kernel.codes import LANES
from engine.kernel.sums import lanes_of

DENORMAL_LIMIT = 1e-290  # √kg·m, √kg·m/s


# What is written for one mode does the same with eight, or fewer: m is an index, EightFrom or FewFrom one. Sums over
# modes are taken in eight lanes, then over the lanes; a single mode that is left comes last. So their bits depend
# neither on the processor's vectors nor on what else a kernel does.


@inline
def apply_loss(loss, m, p):
    """Take the loss of mode m from its momentum: the momentum left, and the energy lost."""
    if loss is None:
        return p, zero_like(p)
    left = number_at(loss.decay_factor, m) * p
    return left, energy_of_loss(loss.dissipation_factor, m, p, left)


@inline
def energy_of_loss(dissipation_factor, m, p, left):
    """The energy that a loss takes from momentum p of mode m, J. Without a factor, twice that energy, from what is
    left: one array less to read, and one product less for each mode."""
    if dissipation_factor is None:
        return (p - left) * (p + left)
    return number_at(dissipation_factor, m) * p * p


@inline
def kick_by_weight(weight, compensation, kick, m, p):
    """Half a kick by weight.

    The kick is the same at every step, and so would be its rounding: in free fall the energy
    drifts by 5e-13 in a second. The rounding is carried to the next kick instead (Kahan).
    """
    if weight is None:
        return p
    push = number_at(kick, m) * number_at(weight, m) - number_at(compensation, m)
    moved = p + push
    put_number(compensation, m, (moved - p) - push)
    return moved


@inline
def kick_by_spring(spring_kick, m, q, p):
    """Half a kick by the restoring force."""
    if spring_kick is None:
        return p
    return p - number_at(spring_kick, m) * q


@inline
def begin_step_mode(h, weight, compensation, m, q, p):
    """Half a step of loss and half a kick of mode m, without contact: its momentum, and the energy lost."""
    p, lost = apply_loss(h.loss, m, p)
    p = kick_by_weight(weight, compensation, h.kick, m, p)
    return kick_by_spring(h.spring_kick, m, q, p), lost


@inline
def end_step_mode(h, weight, compensation, m, q, p):
    """Drift, half a kick and half a step of loss of mode m: q, p, and the energy lost."""
    return end_step_mode_pushed(h, None, weight, compensation, m, q, p)


@inline
def kick_by_force(push, p):
    """Half a kick by a force, if there is one."""
    if push is None:
        return p
    return p + push


@inline
def end_step_mode_pushed(h, push, weight, compensation, m, q, p):
    """As `end_step_mode`, of a mode that takes `push` in the second half of the kick."""
    q = q + number_at(h.drift, m) * p
    p, dragged = apply_loss(h.drag, m, p)
    p = kick_by_spring(h.spring_kick, m, q, p)
    p = kick_by_force(push, kick_by_weight(weight, compensation, h.kick, m, p))
    p, lost = apply_loss(h.loss, m, p)
    return q, p, add_drag(h.drag, lost, dragged)


@inline
def add_drag(drag, lost, dragged):
    """The energy lost at the end of a step and in its drift."""
    if drag is None:
        return lost
    return lost + dragged


@inline
def begin_step_at(h, weight, compensation, m, q, p):
    """First half of a step of mode m, up to the contact. Returns the energy lost, and its momentum."""
    half, lost = begin_step_mode(h, weight, compensation, m, number_at(q, m), number_at(p, m))
    put_number(p, m, half)
    return lost, half


@inline
def end_step_at(h, weight, compensation, m, q, p):
    """Second half of a step of mode m, after the contact. Returns the energy lost."""
    moved, left, lost = end_step_mode(h, weight, compensation, m, number_at(q, m), number_at(p, m))
    put_number(q, m, moved)
    put_number(p, m, left)
    return lost


@inline
def end_step_pushed_at(h, kick_phi, force, weight, compensation, m, q, p):
    """As `end_step_at`, with both half-kicks by a force (N) at a point whose t·Φ are given."""
    push = number_at(kick_phi, m) * force
    moved, left, lost = end_step_mode_pushed(h, push, weight, compensation, m, number_at(q, m), number_at(p, m) + push)
    put_number(q, m, moved)
    put_number(p, m, left)
    return lost


@inline
def free_step_at(h, weight, compensation, m, q, p):
    """A step of mode m on which nothing acts. Returns the energy lost."""
    x = number_at(q, m)
    half, lost_first = begin_step_mode(h, weight, compensation, m, x, number_at(p, m))
    moved, left, lost_later = end_step_mode(h, weight, compensation, m, x, half)
    put_number(q, m, moved)
    put_number(p, m, left)
    return lost_first + lost_later


@inline
def begin_step(h, weight, compensation, q, p):
    """First half of a step of all modes, up to the contact. Returns the energy lost."""
    lanes, total = lanes_of(p.shape[0]), splat(0.0)
    for m in range(INT64_0, lanes, LANES):
        total = total + begin_step_at(h, weight, compensation, EightFrom(m), q, p)[0]
    left = p.shape[0] - lanes
    if left > 1:
        total = total + begin_step_at(h, weight, compensation, FewFrom(lanes, left), q, p)[0]
    lost = lane_sum(total)
    if left == 1:
        lost += begin_step_at(h, weight, compensation, lanes, q, p)[0]
    return lost


@inline
def end_step(h, weight, compensation, q, p):
    """Second half of a step of all modes, after the contact. Returns the energy lost."""
    lanes, total = lanes_of(p.shape[0]), splat(0.0)
    for m in range(INT64_0, lanes, LANES):
        total = total + end_step_at(h, weight, compensation, EightFrom(m), q, p)
    left = p.shape[0] - lanes
    if left > 1:
        total = total + end_step_at(h, weight, compensation, FewFrom(lanes, left), q, p)
    lost = lane_sum(total)
    if left == 1:
        lost += end_step_at(h, weight, compensation, lanes, q, p)
    return lost


@inline
def begin_step_towards(h, drift_phi, weight, compensation, q, p):
    """As `begin_step`; returns also how far the coming drift moves a contact, m, whose v·Φ are given."""
    lanes, total, moves = lanes_of(p.shape[0]), splat(0.0), splat(0.0)
    for m in range(INT64_0, lanes, LANES):
        lost_by_modes, half = begin_step_at(h, weight, compensation, EightFrom(m), q, p)
        total = total + lost_by_modes
        moves = multiply_add(number_at(drift_phi, EightFrom(m)), half, moves)
    left = p.shape[0] - lanes
    if left > 1:
        lost_by_modes, half = begin_step_at(h, weight, compensation, FewFrom(lanes, left), q, p)
        total = total + lost_by_modes
        moves = multiply_add(number_at(drift_phi, FewFrom(lanes, left)), half, moves)
    lost, move = lane_sum(total), lane_sum(moves)
    if left == 1:
        lost_by_mode, last = begin_step_at(h, weight, compensation, lanes, q, p)
        lost += lost_by_mode
        move += number_at(drift_phi, lanes) * last
    return lost, move


@inline
def end_step_pushed(h, kick_phi, force, weight, compensation, q, p):
    """As `end_step`, with both half-kicks by a force (N) at a point whose t·Φ are given. Returns the energy lost."""
    lanes, total = lanes_of(p.shape[0]), splat(0.0)
    for m in range(INT64_0, lanes, LANES):
        total = total + end_step_pushed_at(h, kick_phi, force, weight, compensation, EightFrom(m), q, p)
    left = p.shape[0] - lanes
    if left > 1:
        total = total + end_step_pushed_at(h, kick_phi, force, weight, compensation, FewFrom(lanes, left), q, p)
    lost = lane_sum(total)
    if left == 1:
        lost += end_step_pushed_at(h, kick_phi, force, weight, compensation, lanes, q, p)
    return lost


@inline
def free_step(h, weight, compensation, q, p):
    """A step of all modes on which nothing acts: both halves in one pass. Returns the energy lost."""
    lanes, total = lanes_of(p.shape[0]), splat(0.0)
    for m in range(INT64_0, lanes, LANES):
        total = total + free_step_at(h, weight, compensation, EightFrom(m), q, p)
    left = p.shape[0] - lanes
    if left > 1:
        total = total + free_step_at(h, weight, compensation, FewFrom(lanes, left), q, p)
    lost = lane_sum(total)
    if left == 1:
        lost += free_step_at(h, weight, compensation, lanes, q, p)
    return lost


@inline
def apply_loss_at(loss, m, p):
    """Take the loss of mode m from its momentum. Returns the energy lost."""
    left, lost = apply_loss(loss, m, number_at(p, m))
    put_number(p, m, left)
    return lost


@inline
def apply_loss_all(loss, p):
    """Take the loss of all modes from their momenta. Returns the energy lost."""
    if loss is None:
        return 0.0
    lanes, total = lanes_of(p.shape[0]), splat(0.0)
    for m in range(INT64_0, lanes, LANES):
        total = total + apply_loss_at(loss, EightFrom(m), p)
    left = p.shape[0] - lanes
    if left > 1:
        total = total + apply_loss_at(loss, FewFrom(lanes, left), p)
    lost = lane_sum(total)
    if left == 1:
        lost += apply_loss_at(loss, lanes, p)
    return lost


@noinline
def flush_denormals(q, p):
    """Set what has decayed into subnormal numbers to zero; they are slow to compute with."""
    for m in range(p.shape[0]):
        if abs(p[m]) < DENORMAL_LIMIT:
            p[m] = 0.0
        if abs(q[m]) < DENORMAL_LIMIT:
            q[m] = 0.0


@noinline
def reverse_motion(drift, q, p):
    """Reverse the motion in the middle of a step: after its second half, q is as before the
    step and p is reversed, so that every energy is what it was. No drag acts in that half.

    The last resort where contact forces cannot be found: no force acts, and nothing moves.
    """
    for m in range(p.shape[0]):
        p[m] = -p[m]
        q[m] -= drift[m] * p[m]  # what the drift that follows adds


@noinline
def rescale_kinetic_energy(energy, p):
    """Take an energy from the motion, or give it one (negative), J. Returns what was taken: at most nearly
    all there is; and nothing is given that would more than double it."""
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
def kinetic_energy(p):
    """Σ ½p², J."""
    lanes, total = lanes_of(p.shape[0]), splat(0.0)
    for m in range(INT64_0, lanes, LANES):
        x = load_lanes(p, m)
        total = total + 0.5 * x * x
    if lanes < p.shape[0]:
        x = load_first_lanes(p, lanes, p.shape[0] - lanes)
        total = total + 0.5 * x * x
    return lane_sum(total)
