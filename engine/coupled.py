"""The contact solve of an island with several contacts, which push each other through B.

    η_k + Σ_j B_kj f_j(η_j) = g_k

f_k is increasing and B positive semidefinite, so the forces are unique, also where
contacts are redundant. Newton on all contacts at once, and after each linear solve a
return to every contact's own curve by the scalar solve along η + B_kk·f = const
(Minty's projection). Where that stalls, Newton with a line search on the convex
potential of the problem, which cannot fail. B is never inverted: it may be singular.
"""

import math

import numpy as np

from engine.jit import jit, outlined
from engine.laws import exponent
from engine.solve import FAILED, NEWTON, contact_loss, inside, outside, scalar

MINTY_ROUNDS = 16  # usually 3 to 5 are enough; then the line search takes over
LIMIT = 100  # rounds in all

# rows of Scratch.vectors
FORCE, ETA, END, CURVE, SLOPE, MISS, STEP, TRIAL, OTHER = range(9)
VECTORS = 9


@jit
def row_dot(matrix, n, i, x):
    """(B x)_i"""
    total = 0.0
    for j in range(n):
        total += matrix[i * n + j] * x[j]
    return total


@jit
def respond(law, damping, k, s, eta):
    """Mean force and slope df/dη of contact k for a step η."""
    b = s + eta
    rate = contact_loss(damping, k)
    if 1.0 + rate * eta <= 0.0:
        return 0.0, 0.0
    if b > 0.0:
        f, df, _, _ = inside(law, k, s, b, eta, rate)
        return f, df
    if s > 0.0:
        return outside(law, k, s, eta, rate)
    return 0.0, 0.0


@outlined
def cholesky_solve(a, active, n, x):
    """Solve A x = x in place for the listed rows of a positive definite A; destroys A."""
    for i in range(n):
        for j in range(i + 1):
            total = a[i, j]
            for m in range(j):
                total -= a[i, m] * a[j, m]
            if i == j:
                a[i, i] = math.sqrt(max(total, 1e-300))
            else:
                a[i, j] = total / a[j, j]
    for i in range(n):
        total = x[active[i]]
        for m in range(i):
            total -= a[i, m] * x[active[m]]
        x[active[i]] = total / a[i, i]
    for i in range(n - 1, -1, -1):
        total = x[active[i]]
        for m in range(i + 1, n):
            total -= a[m, i] * x[active[m]]
        x[active[i]] = total / a[i, i]


@outlined
def newton_step(matrix, n, scratch):
    """STEP = √J y with (I + √J B √J) y = √J·MISS, over the contacts with slope J > 0.

    The symmetric form of the Newton step: to first order, adding STEP to the forces on the
    curve removes MISS.
    """
    slope, miss, step = scratch.vectors[SLOPE], scratch.vectors[MISS], scratch.vectors[STEP]
    active = scratch.active
    count = 0
    for k in range(n):
        step[k] = 0.0
        if slope[k] > 0.0:
            active[count] = k
            count += 1
    for i in range(count):
        wi = math.sqrt(slope[active[i]])
        step[active[i]] = wi * miss[active[i]]
        for j in range(i + 1):
            scratch.matrix[i, j] = wi * math.sqrt(slope[active[j]]) * matrix[active[i] * n + active[j]]
        scratch.matrix[i, i] += 1.0
    cholesky_solve(scratch.matrix, active, count, step)
    for i in range(count):
        step[active[i]] *= math.sqrt(slope[active[i]])


@outlined
def to_curves(law, damping, matrix, n, s, g, tolerance, scratch):
    """Minty's projection of FORCE onto every contact's own curve; the residual goes to MISS.

    Returns the largest residual in units of what rounding allows (converged: ≤ 1).
    """
    force, eta, end = scratch.vectors[FORCE], scratch.vectors[ETA], scratch.vectors[END]
    curve, slope, miss = scratch.vectors[CURVE], scratch.vectors[SLOPE], scratch.vectors[MISS]
    for k in range(n):
        own = matrix[k * n + k]
        target = g[k] - (row_dot(matrix, n, k, force) - own * force[k])
        eta[k], end[k], curve[k], slope[k], _, _ = scalar(law, damping, k, s[k], target, own, tolerance)
    worst = 0.0
    for k in range(n):
        move = g[k]
        noise = abs(g[k])
        for j in range(n):
            part = matrix[k * n + j] * curve[j]
            move -= part
            noise += abs(part)
        miss[k] = move - eta[k]
        allowed = 1e-15 * noise + 1e-300
        if curve[k] == 0.0 and s[k] <= 0.0 and s[k] + move <= 0.0:
            eta[k] = move  # free, and remains so: its end is where the others leave it
            end[k] = s[k] + move
            miss[k] = 0.0
        worst = max(worst, abs(miss[k]) / allowed)
        if not np.isfinite(worst):
            return np.inf
    return worst


@outlined
def descent(law, damping, matrix, n, s, g, at, scratch):
    """Directional derivative along STEP of the convex potential
    ½ fᵀBf + Σ ∫φ_k dη at f = FORCE + at·STEP, η = g - B f; leaves the response in CURVE."""
    force, step, trial = scratch.vectors[FORCE], scratch.vectors[STEP], scratch.vectors[TRIAL]
    curve, slope, miss = scratch.vectors[CURVE], scratch.vectors[SLOPE], scratch.vectors[MISS]
    for k in range(n):
        trial[k] = force[k] + at * step[k]
    for k in range(n):
        eta = g[k] - row_dot(matrix, n, k, trial)
        curve[k], slope[k] = respond(law, damping, k, s[k], eta)
        miss[k] = trial[k] - curve[k]
    total = 0.0
    for k in range(n):
        total += step[k] * row_dot(matrix, n, k, miss)
    return total


@outlined
def line_search(law, damping, matrix, n, s, g, scratch):
    """One Newton step on the convex potential, with FORCE moved to where it no longer falls."""
    force, step = scratch.vectors[FORCE], scratch.vectors[STEP]
    curve, miss, other = scratch.vectors[CURVE], scratch.vectors[MISS], scratch.vectors[OTHER]
    for k in range(n):
        step[k] = 0.0
    descent(law, damping, matrix, n, s, g, 0.0, scratch)
    for k in range(n):  # Newton: (I + J B) d = φ - f, that is d = (φ - f) - J B (φ - f) + …
        other[k] = curve[k] - force[k]
    for k in range(n):
        miss[k] = -row_dot(matrix, n, k, other)
    newton_step(matrix, n, scratch)
    for k in range(n):
        step[k] += other[k]
    before = descent(law, damping, matrix, n, s, g, 0.0, scratch)
    low, high, at = 0.0, 0.0, 1.0
    for _ in range(60):  # the derivative rises along the ray: find where it changes sign
        here = descent(law, damping, matrix, n, s, g, at, scratch)
        if abs(here) <= 0.1 * abs(before):
            break
        if here < 0.0:
            low = at
            at = 2.0 * at if high == 0.0 else 0.5 * (low + high)
        else:
            high = at
            at = 0.5 * (low + high)
    for k in range(n):
        force[k] += at * step[k]


@jit
def reach(law, damping, k, s, b, eta, f, slope, move):
    """How far off the first-order force is after a small further move: relative error of f."""
    if f <= 0.0:
        return 0.0 if b <= 0.0 or move == 0.0 else np.inf
    scale = max(s, abs(eta)) if s > 0.0 else b
    size = (exponent(law, k) + 1.0) * abs(move) / scale
    return size * max(size, abs(move) * slope / f)


@outlined
def finish(law, damping, matrix, n, s, g, tolerance, scratch):
    """Try to take the last Newton step along the tangents of the curves, without another round.

    Moves CURVE, ETA, END and MISS if every force stays within the tolerance of its curve.
    """
    eta, end, curve = scratch.vectors[ETA], scratch.vectors[END], scratch.vectors[CURVE]
    slope, miss, step = scratch.vectors[SLOPE], scratch.vectors[MISS], scratch.vectors[STEP]
    other = scratch.vectors[OTHER]
    for k in range(n):
        other[k] = miss[k] - row_dot(matrix, n, k, step)
        if slope[k] > 0.0:
            if not reach(law, damping, k, s[k], end[k], eta[k], curve[k], slope[k], other[k]) <= tolerance:
                return False
        elif not respond(law, damping, k, s[k], eta[k] + other[k])[0] <= 0.0:
            return False
    for k in range(n):
        curve[k] += step[k]
    for k in range(n):
        eta[k] += other[k]
        end[k] += other[k]
        miss[k] = (g[k] - row_dot(matrix, n, k, curve)) - eta[k]
    return True


@outlined
def coupled(law, damping, matrix, n, s, g, tolerance, scratch):
    """Solve n contacts together.

    matrix:  B, row by row, m/N
    s, g:    compressions at the start, and their changes without contact force, m [n]
    scratch: FORCE holds the first guess; on return CURVE, ETA and END hold the forces
             (N), steps and end compressions (m)

    Returns rounds and how it ended (NEWTON or FAILED).
    """
    force, curve, step = scratch.vectors[FORCE], scratch.vectors[CURVE], scratch.vectors[STEP]
    best = np.inf
    for count in range(1, LIMIT + 1):
        worst = to_curves(law, damping, matrix, n, s, g, tolerance, scratch)
        newton_step(matrix, n, scratch)
        if finish(law, damping, matrix, n, s, g, tolerance, scratch):
            return count, NEWTON
        if worst <= 64.0 and worst >= 0.5 * best:  # stalled on rounding
            return count, NEWTON
        best = min(best, worst)
        if count < MINTY_ROUNDS:
            for k in range(n):
                force[k] = curve[k] + step[k]
        else:
            if count == MINTY_ROUNDS:  # not from the force it stalled at, which may overflow
                for k in range(n):
                    force[k] = 0.0
                best = np.inf
            line_search(law, damping, matrix, n, s, g, scratch)
    return LIMIT, FAILED
