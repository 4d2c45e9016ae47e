"""Contact solve of an island whose contacts persist: those that are closed stay closed, and the others stay open.

Newton's method finds the steps η, from η = 0. Each round takes one evaluation of each law, where the general solve
takes several, and a sweep before. The force at η is computed from s^α, so that one power serves a contact in all
rounds. All other cases are left to engine.kernel.contact.coupled_contact_solver.
"""

import math

from engine.compiler.decorators import INT64_0, inline, noinline
from engine.compiler.elementary import expm1_of, log1p_of
from engine.kernel.contact.coupled_contact_round import (
    multiply_compliance,
    newton_step,
)
from engine.kernel.contact.coupled_contact_solver import activate, extend_active_set, scatter_solution
from engine.kernel.contact.power_law import ForceEstimate, extrapolation_error, loss_rate_of
from engine.kernel.data.enums import Row

MAX_PERSISTENT_ROUNDS = 6
SERIES_TERMS = 10
SERIES_RANGE = 0.125  # of |η|/s times α or 2: within it, what the series leaves out is below rounding
MIN_STRETCH, MAX_STRETCH = -0.5, 4.0  # of η/s, within which a contact persists for sure
MIN_LOSS_FACTOR = 0.5  # of 1 + μη/h; below, a contact is about to let go


@inline
def mean_of_power(alpha, e):
    """Return the mean of x^α over [1, 1 + e], and its slope; neither cancels."""
    if abs(e) * max(alpha, 2.0) <= SERIES_RANGE:  # Σ binom(α, j)/(j + 1)·e^j, by Horner's rule
        mean, slope = 1.0, 0.0
        for j in range(SERIES_TERMS, 0, -1):
            ratio = (alpha - (j - 1)) * (1.0 / (j + 1))
            slope = ratio * (mean + e * slope)
            mean = 1.0 + ratio * e * mean
        return mean, slope
    growth = expm1_of((alpha + 1.0) * log1p_of(e))
    mean = growth / ((alpha + 1.0) * e)
    return mean, ((1.0 + growth) / (1.0 + e) - mean) / e


@inline
def persistent_response(force, alpha, rate, s, eta):
    """Return the mean force and slope df/dη of a contact that persists, given its elastic force at the start."""
    mean, slope = mean_of_power(alpha, eta / s)
    w = 1.0 + rate * eta
    return force * mean * w, force * (slope / s * w + mean * rate)


@inline
def persists(rate, s, eta):
    """True if a closed contact that moves by η persists for sure; False if η is NaN."""
    return MIN_STRETCH * s <= eta <= MAX_STRETCH * s and 1.0 + rate * eta >= MIN_LOSS_FACTOR


@inline
def take_closed_contacts(problem):
    """Make the closed contacts the active set, with steps η = 0. Returns its size."""
    n, s, vectors = INT64_0, problem.s, problem.scratch.vectors
    for k in range(s.shape[0]):
        problem.scratch.is_active[k] = 0
        if s[k] > 0.0:
            activate(problem, n, k, 0.0, 0.0)
            vectors[Row.ACTIVE_STEP, n] = 0.0
            n += 1
    return n


@inline
def take_newton_step(problem, n):
    """Do a round of Newton's method. Returns the largest relative error of the forces after it; infinite if a contact
    may not persist."""
    scratch = problem.scratch
    vectors, compliance, contacts = scratch.vectors, scratch.active_compliance, scratch.active
    s, g, power = vectors[Row.START], vectors[Row.FREE_MOVE], vectors[Row.START_POWER]
    f, eta, slope = vectors[Row.ACTIVE_FORCE], vectors[Row.ACTIVE_STEP], vectors[Row.SLOPE]
    residual, step, worst = vectors[Row.RESIDUAL], vectors[Row.NEWTON_STEP], 0.0
    for i in range(n):
        k = contacts[i]
        alpha, rate = problem.law.elastic.exponent[k], loss_rate_of(problem.law, k)
        start_force = problem.law.elastic.potential_coefficient[k] * (alpha + 1.0) * power[i]
        f[i], slope[i] = persistent_response(start_force, alpha, rate, s[i], eta[i])
    multiply_compliance(compliance, n, f, residual)
    for i in range(n):
        residual[i] = (g[i] - residual[i]) - eta[i]
    newton_step(scratch, n)
    for i in range(n):
        k, move = contacts[i], step[i] / slope[i]  # residual - B·step would cancel where B·slope is large
        if not (f[i] + step[i] > 0.0 and persists(loss_rate_of(problem.law, k), s[i], eta[i] + move)):
            return math.inf
        estimate = ForceEstimate(eta[i], s[i] + eta[i], f[i], slope[i])
        worst = max(worst, extrapolation_error(problem.law.elastic, k, s[i], estimate, move)[0])
        eta[i] += move
        f[i] += step[i]
    return worst


@inline
def scatter_end_forces(problem, n):
    """Write END_FORCE, the elastic force at the end of the step, of all contacts.

    The mean force φ without loss, times η, is what the potential gains; so its derivative φ + η·dφ/dη is that force.
    """
    vectors, active = problem.scratch.vectors, problem.scratch.active
    f, eta, slope = vectors[Row.ACTIVE_FORCE], vectors[Row.ACTIVE_STEP], vectors[Row.SLOPE]
    for k in range(problem.s.shape[0]):
        vectors[Row.END_FORCE, k] = 0.0
    for i in range(n):
        rate = loss_rate_of(problem.law, active[i])
        w = 1.0 + rate * eta[i]
        mean = f[i] / w
        vectors[Row.END_FORCE, active[i]] = mean + eta[i] * (slope[i] - mean * rate) / w


@noinline
def solve_persistent(problem):
    """Solve the contacts of an island, if they persist: FORCE, STEP, END, MISS and END_FORCE of the scratch then hold
    the solution. Returns rounds; 0 if they may not persist, and then the scratch holds no solution."""
    vectors = problem.scratch.vectors
    f, eta, end = vectors[Row.ACTIVE_FORCE], vectors[Row.ACTIVE_STEP], vectors[Row.ACTIVE_END]
    n = take_closed_contacts(problem)
    for rounds in range(1, MAX_PERSISTENT_ROUNDS + 1):
        error = take_newton_step(problem, n)
        if error <= problem.tolerance:
            for i in range(n):
                end[i] = vectors[Row.START, i] + eta[i]
            if extend_active_set(problem, n, f) > n:
                return INT64_0
            scatter_solution(problem, n)
            scatter_end_forces(problem, n)
            return rounds
        if error == math.inf:
            return INT64_0
    return INT64_0
