"""Parts of one round of the coupled contact solve, on the contacts of the active set
(engine.kernel.contact.coupled_contact_solver).

All numbers lie in the Scratch: a row for each quantity (engine.kernel.data.enums.Row), and B of the active set. Names
in capitals are rows.
"""

import math

import numpy as np

from engine.compiler.decorators import INT64_0, inline, noinline
from engine.compiler.lanes import (
    load_lanes,
    magnitude,
    multiply_add,
    splat,
    store_lanes,
)
from engine.kernel.contact.law import bend, errors_of_move, follows_modes, respond, solve_alone
from engine.kernel.contact.power_law import ForceEstimate, StepStart
from engine.kernel.contact.scalar_contact_solver import ContactEquation
from engine.kernel.data.enums import LANES, Row, SolveStatus
from engine.kernel.modes.ordered_sums import sum_products

solve_apart = noinline(solve_alone.py_func)  # inlined in every round, it would take 10 s more to compile
MIN_RHO = 1e-8  # of B_kk; below, ρ is rounding


# Products with the compliance of the active set, which is symmetric, are taken column by column: eight contacts at a
# time, without a sum over lanes for each. Its rows and those of the vectors have room for a multiple of eight.


@noinline
def multiply_compliance(compliance, n, x, product):
    """Write Σ_j B_ij·x_j of each contact i of an active set of n to `product`."""
    for i in range(INT64_0, n, LANES):
        even, odd, j = splat(0.0), splat(0.0), INT64_0
        while j + 1 < n:
            even = multiply_add(load_lanes(compliance[j], i), x[j], even)
            odd = multiply_add(load_lanes(compliance[j + 1], i), x[j + 1], odd)
            j += 2
        if j < n:
            even = multiply_add(load_lanes(compliance[j], i), x[j], even)
        store_lanes(product, i, even + odd)


@noinline
def sum_sizes(compliance, n, x, sizes):
    """Write Σ_j |B_ij·x_j| of each contact i of an active set of n to `sizes`."""
    for i in range(INT64_0, n, LANES):
        total = splat(0.0)
        for j in range(n):
            total = total + magnitude(load_lanes(compliance[j], i) * x[j])
        store_lanes(sizes, i, total)


@inline
def take_out(column, k, share, n, y):
    """Take a share of column k of the Cholesky factor from the numbers y after k; those up to k are of no more use."""
    for i in range(k - k % LANES, n, LANES):
        store_lanes(y, i, multiply_add(load_lanes(column, i), -share, load_lanes(y, i)))


@noinline
def substitute(scratch, n, residual, out):
    """Solve (I + √J B √J) y = √J·residual by the present Cholesky factor, and write √J y to `out`."""
    a, root, rest = scratch.cholesky, scratch.vectors[Row.SQRT_SLOPE], scratch.vectors[Row.WORK]
    for i in range(n):
        rest[i] = root[i] * residual[i]
    for k in range(n):
        out[k] = rest[k] * a[k, k]
        take_out(a[k], k, out[k], n, rest)
    for k in range(n - 1, -1, -1):
        out[k] = (out[k] - sum_products(a[k], np.int64(k + 1), out, np.int64(k + 1), np.int64(n - k - 1))) * a[k, k]
    for i in range(n):
        out[i] *= root[i]


@noinline
def newton_step(scratch, n):
    """Write NEWTON_STEP = √J y with (I + √J B √J) y = √J·RESIDUAL; J is 0 for a contact without slope.

    This is the symmetric form of the Newton step: to first order, adding NEWTON_STEP to the forces on the laws removes
    RESIDUAL. The Cholesky factor, column by column, its diagonal inverted, stays in the scratch.
    """
    compliance, a = scratch.active_compliance, scratch.cholesky
    slope, root = scratch.vectors[Row.SLOPE], scratch.vectors[Row.SQRT_SLOPE]
    for i in range(n):
        root[i] = math.sqrt(slope[i]) if slope[i] > 0.0 else 0.0
    for k in range(n):
        column, first = a[k], k - k % LANES
        for i in range(first, n, LANES):
            total, odd = load_lanes(compliance[k], i) * (load_lanes(root, i) * root[k]), splat(0.0)
            for j in range(0, k - 1, 2):
                total = multiply_add(load_lanes(a[j], i), -a[j, k], total)
                odd = multiply_add(load_lanes(a[j + 1], i), -a[j + 1, k], odd)
            if k % 2 == 1:
                total = multiply_add(load_lanes(a[k - 1], i), -a[k - 1, k], total)
            store_lanes(column, i, total + odd)
        inverse = 1.0 / math.sqrt(max(column[k] + 1.0, 1e-300))
        for i in range(first, n, LANES):
            store_lanes(column, i, load_lanes(column, i) * inverse)
        column[k] = inverse
    substitute(scratch, n, scratch.vectors[Row.RESIDUAL], scratch.vectors[Row.NEWTON_STEP])


@noinline
def tangent_compliances(scratch, n):
    """Write the tangent compliance of each contact, RHO: the Schur complement of I + √J B √J with the other contacts
    linearised, from the present factor.

    With A = I + √J B √J it is (1/(A⁻¹)_kk - 1)/J_k, or without a slope B_kk - (B √J A⁻¹ √J B)_kk.
    """
    compliance, a, slope = scratch.active_compliance, scratch.cholesky, scratch.vectors[Row.SLOPE]
    root, rho, rest = scratch.vectors[Row.SQRT_SLOPE], scratch.vectors[Row.RHO], scratch.vectors[Row.WORK]
    for k in range(n):
        begin, total = k if slope[k] > 0.0 else 0, 0.0
        for i in range(n):
            rest[i] = np.float64(i == k) if slope[k] > 0.0 else root[i] * compliance[k, i]
        for i in range(begin, n):
            here = rest[i] * a[i, i]
            take_out(a[i], i, here, n, rest)
            total += here * here
        alone = compliance[k, k]
        less = (1.0 / total - 1.0) / slope[k] if slope[k] > 0.0 else alone - total
        rho[k] = min(alone, max(less, MIN_RHO * alone))


@noinline
def project_onto_laws(problem, n):
    """Project each contact onto its law (Minty's parametrisation): find (η, f) on the curve with η + RHO·f = TARGET.
    RESIDUAL becomes the error of the contact equations.

    Returns the largest residual in units of what rounding allows (converged: ≤ 1). For a set of one, which this solves,
    it also returns the evaluations of its law and SolveStatus.
    """
    scratch = problem.scratch
    vectors, compliance, contacts = scratch.vectors, scratch.active_compliance, scratch.active
    s, g, target, rho = vectors[Row.START], vectors[Row.FREE_MOVE], vectors[Row.TARGET], vectors[Row.RHO]
    f, move = vectors[Row.ACTIVE_FORCE], vectors[Row.ACTIVE_STEP]
    close, slope, power = vectors[Row.ACTIVE_END], vectors[Row.SLOPE], vectors[Row.START_POWER]
    residual = vectors[Row.RESIDUAL]
    count, how = 0, SolveStatus.FREE
    for i in range(n):
        start = StepStart(s[i], power[i])
        equation = ContactEquation(problem.law, contacts[i], start, target[i], rho[i], problem.tolerance)
        move[i], close[i], f[i], slope[i], count, how = solve_apart(equation, close[i])
    worst, sizes = 0.0, vectors[Row.WORK]
    multiply_compliance(compliance, n, f, residual)
    sum_sizes(compliance, n, f, sizes)
    for i in range(n):
        linear_move, size = g[i] - residual[i], sizes[i]
        residual[i] = linear_move - move[i]
        if f[i] == 0.0 and s[i] <= 0.0 and s[i] + linear_move <= 0.0 and follows_modes(problem.law, contacts[i]):
            move[i] = linear_move  # free, and remains so: its end is where the others leave it
            close[i] = s[i] + linear_move
            residual[i] = 0.0
        worst = max(worst, abs(residual[i]) / (1e-15 * (abs(g[i]) + size) + 1e-300))
        if not math.isfinite(residual[i]):
            return np.inf, count, SolveStatus.FAILED
    return worst, count, how


@noinline
def line_search(problem, n):
    """Move the forces GUESS along one Newton step on the convex potential ½ fᵀBf + Σ ∫φ_k dη, η = g - B f, as far as
    the potential falls."""
    scratch = problem.scratch
    vectors, compliance, contacts = scratch.vectors, scratch.active_compliance, scratch.active
    s, g = vectors[Row.START], vectors[Row.FREE_MOVE]
    f, off = vectors[Row.GUESS], vectors[Row.ACTIVE_FORCE]
    slope = vectors[Row.SLOPE]
    residual, step = vectors[Row.RESIDUAL], vectors[Row.NEWTON_STEP]
    after, eta = vectors[Row.FURTHER_MOVE], vectors[Row.ACTIVE_STEP]
    multiply_compliance(compliance, n, f, residual)
    for i in range(n):
        eta[i] = g[i] - residual[i]
        off[i], slope[i] = respond(problem.law, contacts[i], s[i], eta[i])
        off[i] -= f[i]
    # Newton: (I + J B) d = φ - f, that is d = (φ - f) - J B (φ - f) + …
    multiply_compliance(compliance, n, off, residual)
    for i in range(n):
        residual[i] = -residual[i]
    newton_step(scratch, n)
    for i in range(n):
        step[i] += off[i]
    before = 0.0
    multiply_compliance(compliance, n, step, after)
    for i in range(n):
        before -= after[i] * off[i]
    low, upper, at = 0.0, 0.0, 1.0
    for _ in range(60):  # the derivative rises along the ray: find where it changes sign
        here = 0.0
        for i in range(n):
            force, _ = respond(problem.law, contacts[i], s[i], eta[i] - at * after[i])
            here += after[i] * (f[i] + at * step[i] - force)
        if abs(here) <= 0.1 * abs(before):
            break
        if here < 0.0:
            low = at
            at = 2.0 * at if upper == 0.0 else 0.5 * (low + upper)
        else:
            upper = at
            at = 0.5 * (low + upper)
    for i in range(n):
        f[i] += at * step[i]


@noinline
def try_extrapolate(problem, n):
    """Try to take the last Newton step along the tangents of the laws, or to second order, without another round.

    This changes ACTIVE_FORCE, ACTIVE_STEP and ACTIVE_END, and returns True, if every force stays within the tolerance
    of its law. FURTHER_MOVE becomes how much further each contact moves with the Newton step.
    """
    scratch = problem.scratch
    vectors, compliance, contacts = scratch.vectors, scratch.active_compliance, scratch.active
    s, f, eta, end = vectors[Row.START], vectors[Row.ACTIVE_FORCE], vectors[Row.ACTIVE_STEP], vectors[Row.ACTIVE_END]
    slope, residual = vectors[Row.SLOPE], vectors[Row.RESIDUAL]
    step, after = vectors[Row.NEWTON_STEP], vectors[Row.FURTHER_MOVE]
    multiply_compliance(compliance, n, step, after)
    for i in range(n):
        after[i] = residual[i] - after[i]
    first = 0.0
    for i in range(n):
        estimate = ForceEstimate(eta[i], end[i], f[i], slope[i])
        one, two = errors_of_move(problem.law, contacts[i], s[i], estimate, after[i], step[i])
        if not min(one, two) <= problem.tolerance:
            return False
        first = max(first, one)
    if first > problem.tolerance:  # (I + J B) d = ½ f'' move², that is d = ½ f'' move² - J B (½ f'' move²) + …
        bent, more, power = vectors[Row.GUESS], vectors[Row.TARGET], vectors[Row.START_POWER]
        for i in range(n):
            estimate = ForceEstimate(eta[i], end[i], f[i], slope[i])
            bent[i] = bend(problem.law, contacts[i], StepStart(s[i], power[i]), estimate, after[i])
        multiply_compliance(compliance, n, bent, residual)
        for i in range(n):
            residual[i] = -residual[i]
        substitute(problem.scratch, n, residual, more)
        for i in range(n):
            more[i] += bent[i]
            step[i] += more[i]
        multiply_compliance(compliance, n, more, residual)
        for i in range(n):
            after[i] -= residual[i]
    for i in range(n):
        f[i] += step[i]
        eta[i] += after[i]
        end[i] += after[i]
    return True
