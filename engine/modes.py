"""The conservative core of every mode: its coefficients, and the kernels that move and read it.

One step of length h under forces constant over the step (external, weight, contact):

    p ← p + t·(force - ω²q)        half a kick
    q ← q + v·p                    drift
    p ← p + t·(force - ω²q)        half a kick,    v = 2t/(1 + ω²t²)

This is the step of DESIGN sec. 1 with c = (1 - ω²t²)/(1 + ω²t²) and e = v·t, written so that
it conserves ½p² + ½ω²q² - force·q for any t: rounding of the coefficients shifts the energy
once, and never makes it drift. The tables are made in engine.tables; a
mode of heavy damping loses momentum in the drift as well.
"""

import math

import numpy as np

from engine.jit import ZERO, jit, outlined, summing

LEAST = 1e-290  # √kg·m, √kg·m/s


@jit
def lose(loss, m, p):
    """Half a step of loss: the momentum left, and the energy lost."""
    if loss is None:
        return p, 0.0
    return loss.keep[m] * p, loss.lost[m] * p * p


@jit
def fall(gravity, carry, kick, m, p):
    """Half a kick by weight.

    The kick is the same at every step, and so would be its rounding: in free fall the energy
    drifts by 5e-13 in a second. The rounding is carried to the next kick instead (Kahan).
    """
    if gravity is None:
        return p
    push = kick[m] * gravity.weight[m] - carry[m]
    moved = p + push
    carry[m] = (moved - p) - push
    return moved


@jit
def pull(spring, m, q):
    """Half a kick by the restoring force."""
    if spring is None:
        return 0.0
    return -spring.pull[m] * q


@jit
def open_mode(modes, spring, loss, gravity, carry, m, q, p):
    """Half a step of loss and half a kick of mode m, without contact: its momentum, and the energy lost."""
    p, lost = lose(loss, m, p)
    p = fall(gravity, carry, modes.kick, m, p)
    return p + pull(spring, m, q), lost


@jit
def close_mode(modes, spring, loss, drag, gravity, carry, m, q, p):
    """Drift, half a kick and half a step of loss of mode m: q, p, and the energy lost."""
    q += modes.drift[m] * p
    p, dragged = lose(drag, m, p)
    p += pull(spring, m, q)
    p, lost = lose(loss, m, fall(gravity, carry, modes.kick, m, p))
    return q, p, lost + dragged


# A loop over modes is compiled to vector code, which first has to check that no two of its arrays
# overlap. For a body of one mode that costs more than the mode; so each loop has a way around it.


@summing
def first_half(modes, spring, loss, gravity, carry, q, p):
    """First half of a step of all modes, up to the contact. Returns the energy lost."""
    if p.shape[0] == 1:
        p[0], lost = open_mode(modes, spring, loss, gravity, carry, ZERO, q[0], p[0])
        return lost
    lost = 0.0
    for m in range(p.shape[0]):
        p[m], own = open_mode(modes, spring, loss, gravity, carry, m, q[m], p[m])
        lost += own
    return lost


@summing
def second_half(modes, spring, loss, drag, gravity, carry, q, p):
    """Second half of a step of all modes, after the contact. Returns the energy lost."""
    if p.shape[0] == 1:
        q[0], p[0], lost = close_mode(modes, spring, loss, drag, gravity, carry, ZERO, q[0], p[0])
        return lost
    lost = 0.0
    for m in range(p.shape[0]):
        q[m], p[m], own = close_mode(modes, spring, loss, drag, gravity, carry, m, q[m], p[m])
        lost += own
    return lost


@summing
def coast(modes, spring, loss, drag, gravity, carry, q, p):
    """A step of all modes on which nothing acts: both halves in one pass. Returns the energy lost."""
    if p.shape[0] == 1:
        half, lost = open_mode(modes, spring, loss, gravity, carry, ZERO, q[0], p[0])
        q[0], p[0], more = close_mode(modes, spring, loss, drag, gravity, carry, ZERO, q[0], half)
        return lost + more
    lost = 0.0
    for m in range(p.shape[0]):
        half, own = open_mode(modes, spring, loss, gravity, carry, m, q[m], p[m])
        q[m], p[m], more = close_mode(modes, spring, loss, drag, gravity, carry, m, q[m], half)
        lost += own + more
    return lost


@outlined
def hush(loss, q, p):
    """Nothing is left of what has decayed into subnormal numbers, which are slow to count with."""
    if loss is not None:
        for m in range(p.shape[0]):
            if abs(p[m]) < LEAST:
                p[m] = 0.0
            if abs(q[m]) < LEAST:
                q[m] = 0.0


@outlined
def turn_back(modes, q, p):
    """Turn the motion around in the middle of a step: after its second half, q is as before the
    step and p is reversed, so that every energy is what it was. No drag acts in that half.

    The last resort where contact forces cannot be found: no force acts, and nothing moves.
    """
    for m in range(p.shape[0]):
        p[m] = -p[m]
        q[m] -= modes.drift[m] * p[m]  # what the drift that follows adds


@outlined
def pay(energy, p):
    """Take an energy from the motion, or give it one (negative), J. Returns what was taken: at most nearly
    all there is; and nothing is given that would more than double it."""
    kinetic = energy_of_motion(p)
    if energy < -kinetic:
        return 0.0
    energy = min(energy, 0.99 * kinetic)
    if kinetic > 0.0:
        part = math.sqrt(1.0 - energy / kinetic)
        for m in range(p.shape[0]):
            p[m] *= part
    return energy


@summing
def energy_of_motion(p):
    """Σ ½p², J."""
    total = 0.0
    for m in range(p.shape[0]):
        total += 0.5 * p[m] * p[m]
    return total


@summing
def lose_all(loss, p):
    """Half a step of loss of all modes. Returns the energy lost."""
    total = 0.0
    if loss is not None:
        for m in range(p.shape[0]):
            p[m], lost = lose(loss, m, p[m])
            total += lost
    return total


@summing
def dot(weights, at, x, first, last):
    """Σ weights[at + m]·x[first + m] over the modes first to last of an island."""
    if last - first == 1:
        return weights[at] * x[first]
    a, b = weights[at : at + (last - first)], x[first:last]
    total = 0.0
    for m in range(b.shape[0]):
        total += a[m] * b[m]
    return total


@jit
def project(rows, r, x):
    """Displacement at row r, from the modes' displacements; or velocity, from their momenta."""
    return dot(rows.shape, rows.at[r], x, rows.first[r], rows.last[r])


@jit
def project_drift(rows, r, p):
    """Displacement at row r that the coming drift brings."""
    return dot(rows.drift, rows.at[r], p, rows.first[r], rows.last[r])


@jit
def kick(rows, r, f, p):
    """Half a kick by a force f (N) at row r."""
    first, last, at = rows.first[r], rows.last[r], rows.at[r]
    if last - first == 1:
        p[first] += rows.kick[at] * f
        return
    a, b = rows.kick[at : at + (last - first)], p[first:last]
    for m in range(b.shape[0]):
        b[m] += a[m] * f


@summing
def swing(modes, spring, gravity, q, p, span, reach):
    """How far each mode can move in `span` seconds on which nothing else acts, √kg·m, into `reach`.

    A mode swings about where its weight holds it, with amplitude A/ω and speed A at most,
    A² = p² + ω²q²; it loses energy, and gains none. A free mass coasts and falls. Returns the
    energy of vibration, Σ ½A², J.
    """
    energy = 0.0
    for m in range(p.shape[0]):
        speed, fallen, widest = abs(p[m]), 0.0, np.inf
        if spring is not None:
            stiffness = spring.stiffness[m]
            if stiffness > 0.0:
                away = q[m]
                if gravity is not None:
                    away -= gravity.weight[m] / stiffness
                square = p[m] * p[m] + stiffness * away * away
                energy += 0.5 * square
                speed = math.sqrt(square)
                widest = 2.0 * speed / math.sqrt(stiffness)
            elif gravity is not None:
                fallen = abs(gravity.weight[m]) * span
        elif gravity is not None:
            fallen = abs(gravity.weight[m]) * span
        reach[m] = min((speed + 0.5 * fallen) * span, widest)
    return energy


@summing
def bound(rows, r, reach):
    """How far the point of row r can move, m, if each mode moves no further than `reach`."""
    first, last, at = rows.first[r], rows.last[r], rows.at[r]
    a, b = rows.shape[at : at + (last - first)], reach[first:last]
    total = 0.0
    for m in range(b.shape[0]):
        total += abs(a[m]) * b[m]
    return total
