"""The contact solve of an island with several contacts, which push each other through B.

    η_k + Σ_j B_kj f_j(η_j) = g_k

f_k is increasing and B positive semidefinite, so the forces are unique, also where
contacts are redundant. Only a set of them is solved for, which others join when they are
closed by it: it begins with one sweep over those in reach. Each round returns every contact
to its own curve, by the scalar solve along η + ρ·f = const (Minty's projection), and then
takes a Newton step on all at once.
ρ is how much the body gives at the contact while the others' curves are replaced by their
tangents. Where that stalls, Newton with a line search on the convex potential of the
problem, which cannot fail. B is never inverted: it may be singular.

A solve may be capped: after so many rounds it ends with forces that are off the curves, but
whose energy is known and nearly none (DESIGN sec. 3, "A bounded worst case").
"""

import math

import numpy as np

from engine.jit import ZERO, outlined
from engine.model import Scratch
from engine.rounds import (
    AFTER,
    BASE,
    CLOSE,
    END,
    ETA,
    FORCE,
    GO,
    MISS,
    MOVE,
    RHO,
    START,
    STEP,
    TARGET,
    VECTORS,
    F,
    dot,
    finish,
    give,
    line_search,
    newton_step,
    respond,
    scalar_apart,
    to_curves,
)
from engine.solve import CAPPED, FAILED, FREE, NEWTON

EARLY = 6
CYCLE = 10
SHORT = 0.6
SEARCH = 40
LIMIT = 200  # rounds in all
LEAST, MOST = 0.25, 4.0  # how far unfinished forces may be scaled


def room(parts: int, largest: int) -> Scratch:
    """Scratch for each part of a scene whose islands have up to so many contacts."""
    return Scratch(
        np.zeros((parts, VECTORS, largest)),
        np.zeros((parts, largest, largest)),
        np.zeros((parts, largest, largest)),
        *np.zeros((3, parts, largest), np.int64),
    )


@outlined
def join(matrix, total, n, k, guess, target, s, g, scratch):
    """Take contact k into the set of n."""
    vectors, near, contacts = scratch.vectors, scratch.near, scratch.contacts
    contacts[n] = k
    scratch.member[k] = 1
    row = matrix[k * total : (k + 1) * total]
    for j in range(n + 1):
        near[n, j] = near[j, n] = row[contacts[j]]
    vectors[START, n], vectors[GO, n] = s[k], g[k]
    vectors[BASE, n], vectors[TARGET, n], vectors[RHO, n] = guess, target, row[k]


@outlined
def spread(matrix, total, n, f, s, g, scratch):
    """ETA and END of all contacts where the forces f of the set leave them, FORCE and MISS as without force."""
    vectors, contacts = scratch.vectors, scratch.contacts
    force, eta, end, miss = vectors[FORCE], vectors[ETA], vectors[END], vectors[MISS]
    for k in range(total):
        eta[k], force[k], miss[k] = g[k], 0.0, 0.0
    for i in range(n):
        push = f[i]
        if push != 0.0:
            row = matrix[contacts[i] * total : (contacts[i] + 1) * total]
            for k in range(total):
                eta[k] -= row[k] * push
    for k in range(total):
        end[k] = s[k] + eta[k]


@outlined
def grow(matrix, total, n, f, s, g, scratch):
    """Let those join whom the forces f of the set would close. Returns the size of the set."""
    spread(matrix, total, n, f, s, g, scratch)
    for k in range(total):
        if scratch.member[k] == 0 and scratch.vectors[END, k] > 0.0:
            join(matrix, total, n, k, 0.0, scratch.vectors[ETA, k], s, g, scratch)
            n += 1
    return n


@outlined
def gather(law, damping, matrix, total, s, g, tolerance, scratch):
    """The set to begin with, and a guess of its forces: those in contact, and of the others the one
    that would go deepest, again and again, until the forces found keep the rest out.

    Each is solved alone, beside the forces of those before it. Returns the size of the set.
    """
    vectors = scratch.vectors
    eta, end, base = vectors[ETA], vectors[END], vectors[BASE]
    n = ZERO
    for k in range(total):
        scratch.member[k] = 0
        if s[k] > 0.0:
            join(matrix, total, n, k, vectors[FORCE, k], 0.0, s, g, scratch)
            n += 1
    spread(matrix, total, n, base, s, g, scratch)
    for i in range(total):
        if i == n:
            deepest, at = 0.0, ZERO
            for j in range(total):
                if scratch.member[j] == 0 and end[j] > deepest:
                    at, deepest = j, end[j]
            if not deepest > 0.0:
                break
            join(matrix, total, n, at, 0.0, 0.0, s, g, scratch)
            n += 1
        k = scratch.contacts[i]
        row = matrix[k * total : (k + 1) * total]
        _, _, push, _, _, _ = scalar_apart(law, damping, k, s[k], eta[k] + row[k] * base[i], row[k], tolerance)
        more = push - base[i]
        base[i] = push
        if more != 0.0:
            for j in range(total):
                eta[j] -= row[j] * more
                end[j] = s[j] + eta[j]
    return n


@outlined
def settle_set(n, scratch):
    """Write the solution of the set beside the moves of all, as `spread` left them."""
    vectors, contacts = scratch.vectors, scratch.contacts
    for i in range(n):
        k = contacts[i]
        if vectors[F, i] != 0.0 or vectors[START, i] > 0.0 or vectors[END, k] > 0.0:
            vectors[MISS, k] = vectors[ETA, k] - vectors[MOVE, i]
            vectors[FORCE, k], vectors[ETA, k], vectors[END, k] = vectors[F, i], vectors[MOVE, i], vectors[CLOSE, i]


@outlined
def created(law, damping, total, s, g, at, scratch):
    """Energy that the forces at·FORCE create, and its slope by `at`: E = Σ (φ - f)·η, J; with the energy
    they turn over, Σ |f·η|. MISS is B·FORCE."""
    force, give_way = scratch.vectors[FORCE], scratch.vectors[MISS]
    energy, slope, size = 0.0, 0.0, 0.0
    for k in range(total):
        eta, f = g[k] - at * give_way[k], at * force[k]
        if f != 0.0 or s[k] > 0.0 or s[k] + eta > 0.0:
            phi, rise = respond(law, damping, k, s[k], eta)
            energy += (phi - f) * eta
            slope -= (rise * eta + phi - f) * give_way[k] + force[k] * eta
            size += abs(f * eta)
    return energy, slope, size


@outlined
def push_only(law, damping, matrix, total, n, forces, s, g, scratch):
    """Let the forces of the set act where they push. Returns the energy they create."""
    vectors, contacts = scratch.vectors, scratch.contacts
    for i in range(n):
        forces[i] = max(0.0, forces[i])
    spread(matrix, total, n, forces, s, g, scratch)
    for i in range(n):
        vectors[FORCE, contacts[i]] = forces[i]
    for k in range(total):
        vectors[MISS, k] = g[k] - vectors[ETA, k]
    return created(law, damping, total, s, g, 1.0, scratch)[0]


@outlined
def balance(law, damping, total, s, g, scratch):
    """The λ for which the forces λ·FORCE create no energy; 0 if none is near 1. E is convex in λ."""
    at = 1.0
    for _ in range(8):
        energy, slope, size = created(law, damping, total, s, g, at, scratch)
        if abs(energy) <= 1e-14 * size:
            return at
        at -= energy / slope
        if not LEAST <= at <= MOST:
            return 0.0
    return at if abs(energy) <= 1e-6 * size else 0.0


@outlined
def consider(law, damping, matrix, total, n, forces, s, g, least, scratch):
    """Keep these forces of the set in BASE if they create less energy than `least`; returns the least."""
    energy = push_only(law, damping, matrix, total, n, forces, s, g, scratch)
    if not abs(energy) < abs(least):
        return least
    for i in range(n):
        scratch.vectors[BASE, i] = forces[i]
    return energy


@outlined
def make_do(law, damping, matrix, total, n, s, g, budget, least, scratch):
    """End with the forces BASE, which create the energy `least`: scaled so that they create none, or
    after a line search where the budget allows it. Returns the energy they create."""
    base, kept = scratch.vectors[BASE], scratch.vectors[TARGET]
    while True:
        push_only(law, damping, matrix, total, n, base, s, g, scratch)
        at = balance(law, damping, total, s, g, scratch)
        if at > 0.0 or budget[0] <= 0:
            break
        budget[0] -= 1
        for i in range(n):
            kept[i] = base[i]
        line_search(law, damping, n, scratch)
        energy = push_only(law, damping, matrix, total, n, base, s, g, scratch)
        if not abs(energy) < abs(least):
            for i in range(n):
                base[i] = kept[i]
            break
        least = energy
    if at > 0.0:
        for i in range(n):
            base[i] *= at
    energy = push_only(law, damping, matrix, total, n, base, s, g, scratch)
    for k in range(total):
        scratch.vectors[MISS, k] = 0.0
    return energy


@outlined
def coupled(law, damping, matrix, total, s, g, cap, budget, tolerance, scratch):
    """Solve the contacts of an island together.

    matrix:  B, row by row, m/N
    s, g:    compressions at the start, and their changes without contact force, m [total]
    scratch: FORCE holds the first guess; on return FORCE, ETA, END and MISS hold the forces
             (N), steps, end compressions and what the bodies moved beyond the steps (m)
    cap:     rounds after which it makes do with forces off their curves
    budget:  how often it may then try a line search, in budget[0]

    Returns rounds (the first sweep is one), how it ended, and the energy that forces off their curves create, J.
    """
    vectors, near = scratch.vectors, scratch.near
    base, target, rho, f = vectors[BASE], vectors[TARGET], vectors[RHO], vectors[F]
    move, step, after = vectors[MOVE], vectors[STEP], vectors[AFTER]
    n = gather(law, damping, matrix, total, s, g, tolerance, scratch)
    if n == 0:
        return 0, FREE, 0.0
    count, best, search, aim, least = 1 if n > 1 else 0, np.inf, False, True, np.inf
    while count < LIMIT:
        count += 1
        if aim:
            for i in range(n):
                rho[i] = near[i, i]
                target[i] = vectors[GO, i] - (dot(near[i], base, n) - rho[i] * base[i])
        worst, evaluations, how = to_curves(law, damping, n, tolerance, scratch)
        done = n == 1
        if not done:
            newton_step(n, scratch)
            done = finish(law, damping, n, tolerance, scratch)
            done = done or (worst <= 64.0 and worst >= 0.5 * best)  # stalled on rounding
        if done:
            more = grow(matrix, total, n, f, s, g, scratch)
            if more == n:
                settle_set(n, scratch)
                return (evaluations, how, 0.0) if n == 1 else (count, NEWTON, 0.0)
            for i in range(n):
                target[i] = move[i] + rho[i] * f[i]
            n, best, aim = more, np.inf, False
            continue
        best = min(best, worst)
        if count >= cap - 1:
            least = consider(law, damping, matrix, total, n, f, s, g, least, scratch)
        if count >= cap:
            for i in range(n):
                step[i] += f[i]
            least = consider(law, damping, matrix, total, n, step, s, g, least, scratch)
            excess = make_do(law, damping, matrix, total, n, s, g, budget, least, scratch)
            return count, (CAPPED if math.isfinite(least + excess) else FAILED), excess
        search = search or count >= SEARCH or not math.isfinite(worst)
        aim = search
        if search:
            if count == SEARCH or not math.isfinite(worst):  # not from the force it stalled at, which may overflow
                for i in range(n):
                    base[i] = 0.0
            line_search(law, damping, n, scratch)
            count += 1
            continue
        give(n, scratch)
        part = SHORT if count >= CYCLE and count % 2 == 0 else 1.0
        for i in range(n):
            target[i] = (move[i] + rho[i] * f[i]) + part * (after[i] + rho[i] * step[i])
        if count <= EARLY and n < total:
            for i in range(n):
                step[i] += f[i]
            n = grow(matrix, total, n, step, s, g, scratch)
    return LIMIT, FAILED, 0.0
