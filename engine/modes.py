"""The conservative core of every mode: its coefficients, and the kernels that move and read it.

One step of length h under forces constant over the step (external, weight, contact):

    p ← p + t·(force - ω²q)        half a kick
    q ← q + v·p                    drift
    p ← p + t·(force - ω²q)        half a kick,    v = 2t/(1 + ω²t²)

This is the step of DESIGN sec. 1 with c = (1 - ω²t²)/(1 + ω²t²) and e = v·t, written so that
it conserves ½p² + ½ω²q² - force·q for any t: rounding of the coefficients shifts the energy
once, and never makes it drift. The two tables differ in t alone. A mode of heavy damping loses
momentum in the drift as well (`damped_table`).
"""

import math

import numpy as np
from scipy.special import gammainc

from engine.jit import ZERO, jit, outlined, summing

LEAST = 1e-290  # √kg·m, √kg·m/s
HEAVY = 0.05  # σh, from which loss in the drift is worth its time
MOST_BACK = 0.15  # σh, beyond which loss apart from the core is too coarse, and steps back in time are refused


def fdh_table(omega: np.ndarray, sigma: np.ndarray, h: float) -> tuple[np.ndarray, np.ndarray]:
    """Kick t and drift v (s) of the paper's midpoint scheme (eq. 8, 29, 36): t = h/2.

    omega: angular frequencies, rad/s; sigma: decay rates, 1/s; h: step, s.
    Frequencies are warped to (2/h)·atan(ωh/2) (paper, sec. 4).
    """
    kick = np.full_like(omega, h / 2)
    return kick, 2 * kick / (1 + (omega * kick) ** 2)


def exact_table(omega: np.ndarray, sigma: np.ndarray, h: float) -> tuple[np.ndarray, np.ndarray]:
    """Kick t and drift v (s) that give free vibration its exact frequency and decay.

    Together with the half-steps of loss, the mode's roots are exp(-σh ± iω_d·h),
    ω_d² = ω² - σ², if cos θ = cos(ω_d·h)/cosh(σh) and t = tan(θ/2)/ω (DESIGN sec. 1).
    Overdamped modes have cosh in place of cos. For ω = 0, t = (h/2)·√(tanh(σh)/σh): a free mass
    falls as it should, and coasts to (σh)²/3; `damped_table` does both. Valid for ω_d·h < π.
    """
    found = [_exact(w, s, h) for w, s in zip(omega.tolist(), sigma.tolist(), strict=True)]
    table = np.array(found).reshape(-1, 2)
    return table[:, 0].copy(), table[:, 1].copy()


def _exact(w: float, s: float, h: float) -> tuple[float, float]:
    if w == 0.0:
        half = h / 2 * (math.sqrt(math.tanh(s * h) / (s * h)) if s * h > 0.0 else 1.0)
        return half, 2 * half
    if s < w:
        half_angle = math.sqrt((w - s) * (w + s)) * h / 2
        below = math.sinh(s * h / 2) ** 2 + math.sin(half_angle) ** 2  # (1 - cos θ)·cosh(σh)/2
        above = math.sinh(s * h / 2) ** 2 + math.cos(half_angle) ** 2  # (1 + cos θ)·cosh(σh)/2
    else:
        slow = math.sqrt((s - w) * (s + w))
        below = math.sinh((s + slow) * h / 2) * math.sinh(w * w / (s + slow) * h / 2)
        above = math.sinh(s * h / 2) ** 2 + math.cosh(slow * h / 2) ** 2
    kick = math.sqrt(below / above) / w
    return kick, 2 * kick / (1 + (w * kick) ** 2)


def damped_table(omega: np.ndarray, sigma: np.ndarray, h: float) -> tuple[np.ndarray, ...]:
    """Kick t and drift v (s); what is kept of the momentum in each half-step of loss, d, and in the drift, x; and the
    energy lost in the drift over the squared momentum before it.

    With loss in the drift too, the step is the exact motion under a force constant over it,

        q⁺ = a·q + A·p + C·F,   A = e^(-σh)·sin(ω_d·h)/ω_d,   C = ∫₀ʰ A,   a = 1 - ω²C

    p⁺ = b·p - ω²A·q + A·F,   b = a - 2σA,

    if the half-steps of loss keep d² = (A² - C·e^(-2σh))/(C·a) = (e^(-2σh) - b)/(ω²C), t = C·d/A, v = A/d,
    and x = e^(-2σh)/d². Of the momentum p before x, the drift then takes ½(1 - x)(1 + x - ω²tv)·p² and nothing
    of the rest, for v·(1 + ω²t²) = t·(1 + x). Any damping, ω_d·h < π.
    """
    slow = np.sqrt((sigma - omega).astype(complex)) * np.sqrt(sigma + omega)  # i·ω_d
    move, give, brake = _responses(sigma, slow, h)
    left = np.exp(-2 * sigma * h)
    stay = 1 - omega**2 * give
    near = np.abs(stay) > 0.5  # of two forms of d², each where it does not cancel
    square = np.where(
        near,
        (move**2 - give * left) / np.where(near, give * stay, 1.0),
        (left - brake) / np.where(near, 1.0, 1 - stay),
    )
    square = np.minimum(square, 1.0)  # but for rounding, it is
    keep = np.sqrt(square)
    kick, inside = give * keep / move, np.minimum(left / square, 1.0)
    drift = kick * (1 + inside) / (1 + (omega * kick) ** 2)
    return kick, drift, keep, inside, 0.5 * (1 - inside) * (1 + inside - omega**2 * kick * drift)


def _responses(sigma: np.ndarray, slow: np.ndarray, h: float) -> tuple[np.ndarray, ...]:
    """A and C, how far a mode moves in a step per momentum and per force; and b."""
    close = np.abs(slow) * h < 0.02  # the two rates of decay are nearly one, and their difference would cancel
    apart = np.where(close, 1.0 / h, slow)
    fast = sigma + apart
    late = np.where(close, fast, (sigma - slow) * (sigma + slow) / fast)
    move = (np.exp(-late * h) - np.exp(-fast * h)) / (2 * apart)
    give = (_mean_decay(late, h) - _mean_decay(fast, h)) / (2 * apart)
    brake = (fast * np.exp(-fast * h) - late * np.exp(-late * h)) / (2 * apart)
    x, square = np.maximum(sigma * h, 1e-40), np.real((slow * h) ** 2)
    sine, cosine = 1 + square / 6 * (1 + square / 20), 1 + square / 2 * (1 + square / 12)
    series = [h * np.exp(-x) * sine]
    series.append(h**2 * sum(square**j * gammainc(2 * j + 2, x) / x ** (2 * j + 2) for j in range(3)))
    series.append(np.exp(-x) * (cosine - x * sine))
    exact = (move.real, give.real, brake.real)
    return tuple(np.where(close, a, b) for a, b in zip(series, exact, strict=True))


def _mean_decay(rate: np.ndarray, h: float) -> np.ndarray:
    """∫₀ʰ e^(-rate·s) ds."""
    still = rate == 0.0
    return np.where(still, h, -np.expm1(-rate * h) / np.where(still, 1.0, rate))


def heavily_damped(omega: np.ndarray, sigma: np.ndarray, h: float) -> np.ndarray:
    """Which modes need `damped_table`: free masses with damping, which no other table moves as it should both
    where they coast and where they are pushed; and what loses much within a step [modes], bool."""
    return np.asarray((sigma * h > HEAVY) | ((omega == 0.0) & (sigma > 0.0)))


def stage_table(kick: np.ndarray, omega: np.ndarray, scheme: str, length: float) -> tuple[np.ndarray, np.ndarray]:
    """Kick and drift (s) of a stage, whose length is a share of the step with the kicks given, and may be negative.

    A step of the exact table turns a mode by θ = 2·atan(ω·kick), a stage by that share of θ. A stage of the
    paper's scheme is a step of its own of that length.
    """
    angle = np.arctan(omega * kick)
    exact = np.where(omega > 0.0, np.tan(length * angle) / np.where(omega > 0.0, omega, 1.0), length * kick)
    own = length * kick if scheme == "fdh" else exact
    return own, 2 * own / (1 + (omega * own) ** 2)


TABLES = {"exact": exact_table, "fdh": fdh_table}


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
