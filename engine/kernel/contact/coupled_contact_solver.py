"""Contact solve of an island with several contacts, which push each other through their compliance matrix B.

    η_k + Σ_j B_kj f_j(η_j) = g_k

Each f_k is increasing and B is positive semidefinite, so the forces are unique, even where contacts are redundant. Only
an active set of contacts is solved; a contact joins the set when the forces of the set would close it. The set begins
with one sweep over the contacts in reach. Each round projects every contact onto its own law, by the scalar solve along
η + ρ·f = const (Minty's parametrisation), and then takes a Newton step on all at once. ρ is the compliance at the
contact while the laws of the others are replaced by their tangents. Where that stalls, the solve goes on by Newton's
method with a line search on the convex potential of the problem, which cannot fail. B is never inverted: it may be
singular.

A solve may be capped: after so many rounds it ends with forces that are off the laws. The energy that these create is
known, and nearly none (docs/design.md, sec. 3, "A bounded worst case").
"""

import math
from typing import Any, NamedTuple

import numpy as np

from engine.compiler.decorators import INT64_0, inline, noinline
from engine.kernel.contact.coupled_contact_round import (
    line_search,
    multiply_compliance,
    newton_step,
    project_onto_laws,
    solve_apart,
    tangent_compliances,
    try_extrapolate,
)
from engine.kernel.contact.law import closes, follows_modes, may_act, respond, step_start
from engine.kernel.contact.power_law import StepStart
from engine.kernel.contact.scalar_contact_solver import ContactEquation
from engine.kernel.data.enums import LINE_SEARCHES, MAX_ROUNDS, Row, SolveStatus

NO_CAP = MAX_ROUNDS + 1
GROW_ROUNDS = 6  # in which contacts may join after each; later, when the others have converged
DAMP_FROM_ROUND = 10  # every other step is shortened from here on: it may go back and forth
DAMPING = 0.6  # of such a step
LINE_SEARCH_FROM_ROUND = 40
CONVERGED = 64.0  # residual in units of rounding at which a solve that no longer improves has converged
SWEEP_TOLERANCE = 1e-4  # of the forces that the first sweep guesses: it leaves out more by taking contacts alone
MIN_SCALE, MAX_SCALE = 0.25, 4.0  # by which forces off their laws may be multiplied


class CoupledProblem(NamedTuple):
    """The contact equations of an island."""

    law: Any  # Laws
    compliance: Any  # B, row by row, m/N
    s: Any  # [contacts], m: compressions at the start
    g: Any  # [contacts], m: their changes without contact force
    tolerance: float  # relative error of each force
    scratch: Any  # Scratch: FORCE holds the first guess


@noinline
def activate(problem, n, k, guess, target):
    """Add contact k to the active set of n contacts, with a guess of its force and the target of its projection."""
    scratch, total = problem.scratch, problem.s.shape[0]
    vectors, compliance, active = scratch.vectors, scratch.active_compliance, scratch.active
    active[n] = k
    scratch.is_active[k] = 1
    row = problem.compliance[k * total : (k + 1) * total]
    for j in range(n + 1):
        compliance[n, j] = compliance[j, n] = row[active[j]]
    vectors[Row.START, n], vectors[Row.START_POWER, n] = step_start(problem.law, k, problem.s[k])
    vectors[Row.FREE_MOVE, n] = problem.g[k]
    vectors[Row.GUESS, n], vectors[Row.TARGET, n], vectors[Row.RHO, n] = guess, target, row[k]
    vectors[Row.ACTIVE_END, n] = 0.0


@noinline
def apply_active_forces(problem, n, f):
    """Write STEP and END of all contacts under the forces f of the active set; FORCE and MISS become 0."""
    scratch, total = problem.scratch, problem.s.shape[0]
    vectors, active, s, g = scratch.vectors, scratch.active, problem.s, problem.g
    force, eta, end, residual = vectors[Row.FORCE], vectors[Row.STEP], vectors[Row.END], vectors[Row.STEP_RESIDUAL]
    for k in range(total):
        eta[k], force[k], residual[k] = g[k], 0.0, 0.0
    for i in range(n):
        push = f[i]
        if push != 0.0:
            row = problem.compliance[active[i] * total : (active[i] + 1) * total]
            for k in range(total):
                eta[k] -= row[k] * push
    for k in range(total):
        end[k] = s[k] + eta[k]


@noinline
def extend_active_set(problem, n, f):
    """Add to the active set every contact that the forces f would close. Returns its new size."""
    scratch = problem.scratch
    apply_active_forces(problem, n, f)
    for k in range(problem.s.shape[0]):
        if scratch.is_active[k] == 0 and closes(problem.law, k, scratch.vectors[Row.END, k]):
            activate(problem, n, k, 0.0, scratch.vectors[Row.STEP, k])
            n += 1
    return n


@noinline
def initial_active_set(problem):
    """Choose the first active set, and guess its forces. The set holds the contacts that are closed. Of the others, the
    one that would go deepest is added, again and again, until the forces keep the rest open.

    Each contact is solved alone, under the forces of those before it. Returns the size of the set.
    """
    scratch, s, total = problem.scratch, problem.s, problem.s.shape[0]
    vectors = scratch.vectors
    eta, end, guess = vectors[Row.STEP], vectors[Row.END], vectors[Row.GUESS]
    n = INT64_0
    for k in range(total):
        scratch.is_active[k] = 0
        if may_act(problem.law, k, s[k], 0.0):
            activate(problem, n, k, vectors[Row.FORCE, k], 0.0)
            n += 1
    apply_active_forces(problem, n, guess)
    for i in range(total):
        if i == n:
            deepest, at = 0.0, INT64_0
            for j in range(total):
                if scratch.is_active[j] == 0 and end[j] > deepest and follows_modes(problem.law, j):
                    at, deepest = j, end[j]
            if not deepest > 0.0:
                break
            activate(problem, n, at, 0.0, 0.0)
            n += 1
        k = scratch.active[i]
        row = problem.compliance[k * total : (k + 1) * total]
        target = eta[k] + row[k] * guess[i]
        start, near = StepStart(s[k], vectors[Row.START_POWER, i]), end[k] if guess[i] > 0.0 else 0.0
        push = solve_apart(ContactEquation(problem.law, k, start, target, row[k], SWEEP_TOLERANCE), near)[2]
        change = push - guess[i]
        guess[i] = push
        if change != 0.0:
            for j in range(total):
                eta[j] -= row[j] * change
                end[j] = s[j] + eta[j]
    for i in range(n):
        vectors[Row.ACTIVE_END, i] = end[scratch.active[i]]
    return n


@noinline
def scatter_solution(problem, n):
    """Write FORCE, STEP, END and MISS of the active set; the other contacts keep what `apply_active_forces` wrote."""
    vectors, active = problem.scratch.vectors, problem.scratch.active
    for i in range(n):
        k = active[i]
        if vectors[Row.ACTIVE_FORCE, i] != 0.0 or vectors[Row.START, i] > 0.0 or vectors[Row.END, k] > 0.0:
            vectors[Row.STEP_RESIDUAL, k] = vectors[Row.STEP, k] - vectors[Row.ACTIVE_STEP, i]
            vectors[Row.FORCE, k] = vectors[Row.ACTIVE_FORCE, i]
            vectors[Row.STEP, k], vectors[Row.END, k] = vectors[Row.ACTIVE_STEP, i], vectors[Row.ACTIVE_END, i]


# --- the end of a capped solve


@noinline
def energy_defect(problem, scale):
    """Return the energy that the forces scale·FORCE create, E = Σ (φ - f)·η, J, its slope by the scale, and the energy
    that these forces exchange, Σ |f·η|. MISS is B·FORCE."""
    s, g, vectors = problem.s, problem.g, problem.scratch.vectors
    force, response = vectors[Row.FORCE], vectors[Row.STEP_RESIDUAL]
    energy, slope, size = 0.0, 0.0, 0.0
    for k in range(s.shape[0]):
        eta, f = g[k] - scale * response[k], scale * force[k]
        if f != 0.0 or s[k] > 0.0 or s[k] + eta > 0.0:
            phi, rise = respond(problem.law, k, s[k], eta)
            energy += (phi - f) * eta
            slope -= (rise * eta + phi - f) * response[k] + force[k] * eta
            size += abs(f * eta)
    return energy, slope, size


@noinline
def clamp_and_respond(problem, n, forces):
    """Set negative forces of the active set to zero, and find how all contacts respond. Returns the energy that the
    forces create, J."""
    vectors, active, g = problem.scratch.vectors, problem.scratch.active, problem.g
    for i in range(n):
        forces[i] = max(0.0, forces[i])
    apply_active_forces(problem, n, forces)
    for i in range(n):
        vectors[Row.FORCE, active[i]] = forces[i]
    for k in range(g.shape[0]):
        vectors[Row.STEP_RESIDUAL, k] = g[k] - vectors[Row.STEP, k]
    return energy_defect(problem, 1.0)[0]


@noinline
def energy_neutral_scale(problem):
    """Return the λ for which the forces λ·FORCE create no energy; 0 if none is near 1. E is convex in λ."""
    scale = 1.0
    for _ in range(8):
        energy, slope, size = energy_defect(problem, scale)
        if abs(energy) <= 1e-14 * size:
            return scale
        scale -= energy / slope
        if not MIN_SCALE <= scale <= MAX_SCALE:
            return 0.0
    return scale if abs(energy) <= 1e-6 * size else 0.0


@noinline
def keep_if_better(problem, n, forces, least):
    """Keep these forces of the active set as GUESS if they create less energy than `least`. Returns the least, J."""
    energy = clamp_and_respond(problem, n, forces)
    if not abs(energy) < abs(least):
        return least
    for i in range(n):
        problem.scratch.vectors[Row.GUESS, i] = forces[i]
    return energy


@noinline
def finish_capped(problem, n, budget, least):
    """End a capped solve with the forces GUESS, which create the energy `least`. They are scaled so that they create
    none; where no scale does that, line searches improve them, as far as the budget goes. Returns the energy they
    create, J."""
    vectors = problem.scratch.vectors
    guess, saved = vectors[Row.GUESS], vectors[Row.TARGET]
    while True:
        clamp_and_respond(problem, n, guess)
        scale = energy_neutral_scale(problem)
        if scale > 0.0 or budget[0] <= 0:
            break
        budget[0] -= 1
        for i in range(n):
            saved[i] = guess[i]
        line_search(problem, n)
        energy = clamp_and_respond(problem, n, guess)
        if not abs(energy) < abs(least):
            for i in range(n):
                guess[i] = saved[i]
            break
        least = energy
    if scale > 0.0:
        for i in range(n):
            guess[i] *= scale
    energy = clamp_and_respond(problem, n, guess)
    for k in range(problem.s.shape[0]):
        vectors[Row.STEP_RESIDUAL, k] = 0.0
    return energy


@inline
def end_at_cap(problem, n, budget, least):
    """End a solve at its cap with the better of two sets of forces: those on the laws, and those after the Newton step.
    Returns SolveStatus, and the energy that the forces create, J."""
    vectors = problem.scratch.vectors
    f, step = vectors[Row.ACTIVE_FORCE], vectors[Row.NEWTON_STEP]
    for i in range(n):
        step[i] += f[i]
    least = keep_if_better(problem, n, step, least)
    excess = finish_capped(problem, n, budget, least)
    status = SolveStatus.CAPPED if math.isfinite(least + excess) else SolveStatus.FAILED
    return status, excess


# --- the solve


@inline
def aim_at_guess(problem, n):
    """Set the targets of the projections by the forces GUESS: each contact alone, the forces of the others fixed."""
    vectors, compliance = problem.scratch.vectors, problem.scratch.active_compliance
    guess, target, rho = vectors[Row.GUESS], vectors[Row.TARGET], vectors[Row.RHO]
    multiply_compliance(compliance, n, guess, target)
    for i in range(n):
        rho[i] = compliance[i, i]
        target[i] = vectors[Row.FREE_MOVE, i] - (target[i] - rho[i] * guess[i])


@inline
def aim_by_newton(problem, n, rounds):
    """Set the targets of the projections by the Newton step, and let contacts join that it would close. Returns the
    size of the active set."""
    vectors = problem.scratch.vectors
    f, move, target, rho = (
        vectors[Row.ACTIVE_FORCE],
        vectors[Row.ACTIVE_STEP],
        vectors[Row.TARGET],
        vectors[Row.RHO],
    )
    step, further = vectors[Row.NEWTON_STEP], vectors[Row.FURTHER_MOVE]
    tangent_compliances(problem.scratch, n)
    share = DAMPING if rounds >= DAMP_FROM_ROUND and rounds % 2 == 0 else 1.0
    for i in range(n):
        target[i] = (move[i] + rho[i] * f[i]) + share * (further[i] + rho[i] * step[i])
    if rounds <= GROW_ROUNDS and n < problem.s.shape[0]:
        for i in range(n):
            step[i] += f[i]
        n = extend_active_set(problem, n, step)
    return n


@noinline
def solve_coupled(problem, cap, budget):
    """Solve the contacts of an island together.

    problem: CoupledProblem; on return FORCE, STEP, END and MISS of its scratch hold the forces
             (N), steps, end compressions and what the bodies moved beyond the steps (m)
    cap:     rounds after which it ends with forces off their laws, once the budget has no more rounds
    budget:  number of further rounds and, when these are used up, of LINE_SEARCHES that it may try, in budget[0]

    Returns rounds (the first sweep is one), SolveStatus, and the energy that forces off their laws create, J.
    """
    vectors = problem.scratch.vectors
    guess, target, rho, f = vectors[Row.GUESS], vectors[Row.TARGET], vectors[Row.RHO], vectors[Row.ACTIVE_FORCE]
    move = vectors[Row.ACTIVE_STEP]
    n = initial_active_set(problem)
    if n == 0:
        return 0, SolveStatus.FREE, 0.0
    rounds, best, use_line_search, retarget, least = 1 if n > 1 else 0, np.inf, False, True, np.inf
    while rounds < MAX_ROUNDS:
        rounds += 1
        if retarget:
            aim_at_guess(problem, n)
        residual, evaluations, status = project_onto_laws(problem, n)
        done = n == 1
        if not done:
            newton_step(problem.scratch, n)
            done = try_extrapolate(problem, n)
            done = done or (residual <= CONVERGED and residual >= 0.5 * best)  # stalled on rounding
        if done:
            size = extend_active_set(problem, n, f)
            if size == n:
                scatter_solution(problem, n)
                return (evaluations, status, 0.0) if n == 1 else (rounds, SolveStatus.NEWTON, 0.0)
            for i in range(n):
                target[i] = move[i] + rho[i] * f[i]
            n, best, retarget = size, np.inf, False
            continue
        best = min(best, residual)
        if rounds >= cap - 1:
            least = keep_if_better(problem, n, f, least)
        if rounds >= cap:
            if budget[0] <= LINE_SEARCHES or rounds >= LINE_SEARCH_FROM_ROUND - 1:
                status, excess = end_at_cap(problem, n, budget, least)
                return rounds, status, excess
            budget[0] -= 1
        use_line_search = use_line_search or rounds >= LINE_SEARCH_FROM_ROUND or not math.isfinite(residual)
        retarget = use_line_search
        if use_line_search:
            if rounds == LINE_SEARCH_FROM_ROUND or not math.isfinite(residual):
                for i in range(n):  # not from the force it stalled at, which may overflow
                    guess[i] = 0.0
            line_search(problem, n)
            rounds += 1
            continue
        n = aim_by_newton(problem, n, rounds)
    return MAX_ROUNDS, SolveStatus.FAILED, 0.0
