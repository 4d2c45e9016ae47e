"""What a round of the coupled contact solve is made of (engine.coupled), on the contacts of its set.

Everything lies in the Scratch: a row each of what is known of the contacts, and B of the set.
"""

import math

import numpy as np

from engine.jit import jit, outlined, summing
from engine.laws import exponent
from engine.solve import FAILED, FREE, contact_loss, inside, outside, scalar

scalar_apart = outlined(scalar.py_func)  # inlined in every round, it would take 10 s more to compile
LEAST_RHO = 1e-8  # of B_kk; below, ρ is rounding

# rows of Scratch.vectors: of all contacts
FORCE, ETA, END, MISS = range(4)
# and of those in the set
START, GO, BASE, TARGET, RHO, F, MOVE, CLOSE, SLOPE, LEFT, STEP, AFTER, ROOT, Y = range(4, 18)
VECTORS = 18


@summing
def dot(a, b, n):
    """Σ a·b over the first n."""
    total = 0.0
    for j in range(n):
        total += a[j] * b[j]
    return total


@summing
def dot_and_size(a, b, n):
    """Σ a·b and Σ |a·b| over the first n."""
    total, size = 0.0, 0.0
    for j in range(n):
        part = a[j] * b[j]
        total += part
        size += abs(part)
    return total, size


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
def substitute(n, left, out, scratch):
    """out = √J y with (I + √J B √J) y = √J·left, by the factor at hand."""
    a, hot = scratch.factor, scratch.hot
    slope, root, y = scratch.vectors[SLOPE], scratch.vectors[ROOT], scratch.vectors[Y]
    count = 0
    for i in range(n):
        out[i] = 0.0
        if slope[i] > 0.0:
            y[count] = root[count] * left[i]
            count += 1
    for i in range(count):
        row = a[i]
        y[i] = (y[i] - dot(row, y, i)) * row[i]
    for i in range(count - 1, -1, -1):
        row = a[i]
        here = y[i] * row[i]
        y[i] = here
        for j in range(i):
            y[j] -= row[j] * here
    for i in range(count):
        out[hot[i]] = root[i] * y[i]


@outlined
def newton_step(n, scratch):
    """STEP = √J y with (I + √J B √J) y = √J·LEFT, over the contacts with slope J > 0.

    The symmetric form of the Newton step: to first order, adding STEP to the forces on the
    curve removes LEFT. The factor (Cholesky, its diagonal inverted) stays in the scratch.
    """
    near, a, hot = scratch.near, scratch.factor, scratch.hot
    slope, root = scratch.vectors[SLOPE], scratch.vectors[ROOT]
    count = 0
    for i in range(n):
        if slope[i] > 0.0:
            hot[count] = i
            root[count] = math.sqrt(slope[i])
            count += 1
    for i in range(count):
        row, source, w = a[i], near[hot[i]], root[i]
        for j in range(i + 1):
            row[j] = w * root[j] * source[hot[j]]
        row[i] += 1.0
        for j in range(i):
            row[j] = (row[j] - dot(row, a[j], j)) * a[j, j]
        row[i] = 1.0 / math.sqrt(max(row[i] - dot(row, row, i), 1e-300))
    substitute(n, scratch.vectors[LEFT], scratch.vectors[STEP], scratch)


@outlined
def give(n, scratch):
    """RHO: compliance at each contact while the others keep to their tangents, from the factor at hand.

    With A = I + √J B √J it is (1/(A⁻¹)_kk - 1)/J_k, or without a slope B_kk - (B √J A⁻¹ √J B)_kk.
    """
    near, a, hot = scratch.near, scratch.factor, scratch.hot
    slope, root, rho, y = scratch.vectors[SLOPE], scratch.vectors[ROOT], scratch.vectors[RHO], scratch.vectors[Y]
    count = 0
    for i in range(n):
        if slope[i] > 0.0:
            count += 1
    place = 0
    for k in range(n):
        begin, total = 0, 0.0
        if slope[k] > 0.0:
            begin = place
            place += 1
            y[begin] = 1.0
            for i in range(begin + 1, count):
                y[i] = 0.0
        else:
            for i in range(count):
                y[i] = root[i] * near[k, hot[i]]
        for i in range(begin, count):
            row = a[i]
            y[i] = (y[i] - dot(row[begin:], y[begin:], i - begin)) * row[i]
            total += y[i] * y[i]
        own = near[k, k]
        less = (1.0 / total - 1.0) / slope[k] if slope[k] > 0.0 else own - total
        rho[k] = min(own, max(less, LEAST_RHO * own))


@outlined
def to_curves(law, damping, n, tolerance, scratch):
    """Each contact alone, to the point of its curve with η + RHO·f = TARGET; the residual goes to LEFT.

    Returns the largest residual in units of what rounding allows (converged: ≤ 1); and for a
    set of one, which this solves, the evaluations of its law and how it ended.
    """
    vectors, near, contacts = scratch.vectors, scratch.near, scratch.contacts
    s, g, target, rho = vectors[START], vectors[GO], vectors[TARGET], vectors[RHO]
    f, move, close, slope, left = vectors[F], vectors[MOVE], vectors[CLOSE], vectors[SLOPE], vectors[LEFT]
    count, how = 0, FREE
    for i in range(n):
        move[i], close[i], f[i], slope[i], count, how = scalar_apart(
            law, damping, contacts[i], s[i], target[i], rho[i], tolerance
        )
    worst = 0.0
    for i in range(n):
        total, size = dot_and_size(near[i], f, n)
        leaves = g[i] - total
        left[i] = leaves - move[i]
        if f[i] == 0.0 and s[i] <= 0.0 and s[i] + leaves <= 0.0:
            move[i] = leaves  # free, and remains so: its end is where the others leave it
            close[i] = s[i] + leaves
            left[i] = 0.0
        worst = max(worst, abs(left[i]) / (1e-15 * (abs(g[i]) + size) + 1e-300))
        if not math.isfinite(left[i]):
            return np.inf, count, FAILED
    return worst, count, how


@outlined
def line_search(law, damping, n, scratch):
    """Move the forces BASE by one Newton step on the convex potential ½ fᵀBf + Σ ∫φ_k dη, η = g - B f,
    as far as it falls."""
    vectors, near, contacts = scratch.vectors, scratch.near, scratch.contacts
    s, g, f, off, slope = vectors[START], vectors[GO], vectors[BASE], vectors[F], vectors[SLOPE]
    left, step, after, eta = vectors[LEFT], vectors[STEP], vectors[AFTER], vectors[MOVE]
    for i in range(n):
        eta[i] = g[i] - dot(near[i], f, n)
        off[i], slope[i] = respond(law, damping, contacts[i], s[i], eta[i])
        off[i] -= f[i]
    for i in range(n):  # Newton: (I + J B) d = φ - f, that is d = (φ - f) - J B (φ - f) + …
        left[i] = -dot(near[i], off, n)
    newton_step(n, scratch)
    for i in range(n):
        step[i] += off[i]
    before = 0.0
    for i in range(n):
        after[i] = dot(near[i], step, n)
        before -= after[i] * off[i]
    low, high, at = 0.0, 0.0, 1.0
    for _ in range(60):  # the derivative rises along the ray: find where it changes sign
        here = 0.0
        for i in range(n):
            force, _ = respond(law, damping, contacts[i], s[i], eta[i] - at * after[i])
            here += after[i] * (f[i] + at * step[i] - force)
        if abs(here) <= 0.1 * abs(before):
            break
        if here < 0.0:
            low = at
            at = 2.0 * at if high == 0.0 else 0.5 * (low + high)
        else:
            high = at
            at = 0.5 * (low + high)
    for i in range(n):
        f[i] += at * step[i]


@jit
def reach(law, k, s, b, eta, f, slope, move):
    """Relative errors of the force after a small further move, to first order and to second."""
    if f <= 0.0:
        none = 0.0 if b <= 0.0 or move == 0.0 else np.inf
        return none, none
    scale = max(s, abs(eta)) if s > 0.0 else b
    size = (exponent(law, k) + 1.0) * abs(move) / scale
    change = max(size, abs(move) * slope / f)
    near = size * max(1.0, scale / abs(b))  # beyond the first, derivatives have a kink at b = 0
    return size * change, near * near * max(change, near)


@jit
def bend(law, damping, k, s, b, eta, f, move):
    """Change of the force of contact k of second order in a small move."""
    if b > 0.0:
        _, _, ddf, _ = inside(law, k, s, b, eta, contact_loss(damping, k))
        return 0.5 * ddf * move * move
    return f * (move / eta) * (move / eta)


@outlined
def finish(law, damping, n, tolerance, scratch):
    """Try to take the last Newton step along the curves' tangents, or to second order, without another round.

    Moves F, MOVE and CLOSE if every force stays within the tolerance of its curve. AFTER is how
    much further each contact moves with the Newton step.
    """
    vectors, near, contacts = scratch.vectors, scratch.near, scratch.contacts
    s, f, eta, end = vectors[START], vectors[F], vectors[MOVE], vectors[CLOSE]
    slope, left, step, after = vectors[SLOPE], vectors[LEFT], vectors[STEP], vectors[AFTER]
    for i in range(n):
        after[i] = left[i] - dot(near[i], step, n)
    first = 0.0
    for i in range(n):
        k = contacts[i]
        if slope[i] > 0.0:
            one, two = reach(law, k, s[i], end[i], eta[i], f[i], slope[i], after[i])
            if not min(one, two) <= tolerance:
                return False
            first = max(first, one)
        elif not respond(law, damping, k, s[i], eta[i] + after[i])[0] <= 0.0:
            return False
    if first > tolerance:  # (I + J B) d = ½ f'' AFTER², that is d = ½ f'' AFTER² - J B (½ f'' AFTER²) + …
        curl, more = vectors[BASE], vectors[TARGET]
        for i in range(n):
            curl[i] = 0.0
            if slope[i] > 0.0:
                curl[i] = bend(law, damping, contacts[i], s[i], end[i], eta[i], f[i], after[i])
        for i in range(n):
            left[i] = -dot(near[i], curl, n)
        substitute(n, left, more, scratch)
        for i in range(n):
            more[i] += curl[i]
            step[i] += more[i]
        for i in range(n):
            after[i] -= dot(near[i], more, n)
    for i in range(n):
        f[i] += step[i]
        eta[i] += after[i]
        end[i] += after[i]
    return True
