"""The contact solve of an island whose contacts move almost alike, in the space of their basis (B = U·Uᵀ).

Unknown w [rank], the forces seen by each row of the basis:

    η = g - U·w,    f = φ(s, η),    w = Uᵀ·f

w - Uᵀ·f(g - U·w) is the gradient of a convex potential, whose Hessian 1 + Uᵀ·J·U is at least 1, so that Newton's
iteration with a line search cannot fail; it begins at w = 0, where all contacts are deepest. Each evaluation takes
all contacts at once, as vector code without branches.
"""

import math
from typing import Any

from engine.compiler.decorators import INT64_0, INT64_1, inline, noinline, reduction
from engine.compiler.overloads import overload_by_type
from engine.kernel.codes import Row
from engine.kernel.contact_law import exponent, power, power_difference_quotient
from engine.kernel.coupled_contact_round import contact_response
from engine.kernel.laws import Cubic, Felt, Hertz, Linear, Power, Quadratic
from engine.kernel.scalar_contact_solver import loss_rate_of

MAX_EVALUATIONS = 40
CONVERGED_STEP = 4e-16  # of w: a Newton step no larger is what rounding leaves
STALLED_STEP = 1e-11  # of w: below, steps that no longer shrink are rounding
MIN_DECREASE = 0.9  # of the slope along a Newton step, that is left where the step is not shortened
MIN_STEP = 1e-300  # m: nothing is divided by less


@inline
def smooth_response(law, k, unit, rate, s, eta):
    """Mean force (N) and its slope (N/m) for a step η from s, without branches. The slope errs by 1e-5 of itself at
    most, which serves Newton's iteration.

    unit: potential_coefficient of the law; 0 where there is no contact
    """
    alpha = exponent(law, k)
    b = s + eta
    start, end = max(s, 0.0), max(b, 0.0)
    stays = s > 0.0 and b > 0.0
    mean = power_difference_quotient(law, k, start, end, 0.0)
    over = 1.0 / (eta if abs(eta) > MIN_STEP else MIN_STEP)
    phi = mean if stays else mean * ((end - start) * over)
    phi = phi if start + end > 0.0 else 0.0
    at_end = (alpha + 1.0) * power(law, k, end)
    slope = (at_end - phi) * over
    slope = 0.5 * alpha * at_end / end if stays and abs(eta) < 1e-5 * end else slope
    slope = slope if start + end > 0.0 else 0.0
    pushes = max(0.0, 1.0 + rate * eta)
    return unit * phi * pushes, unit * (slope * pushes + (phi * rate if pushes > 0.0 else 0.0))


@reduction
def evaluate_as_vectors(law, loss_rate, count, lanes, vectors):
    """ACTIVE_FORCE and SLOPE of all contacts at the steps ACTIVE_STEP."""
    s, eta, unit, rate = vectors[Row.START], vectors[Row.ACTIVE_STEP], vectors[Row.TARGET], vectors[Row.RHO]
    f, slope = vectors[Row.ACTIVE_FORCE], vectors[Row.SLOPE]
    for k in range(lanes):
        f[k], slope[k] = smooth_response(law, INT64_0, unit[k], rate[k], s[k], eta[k])


@inline
def evaluate_one_by_one(law, loss_rate, count, lanes, vectors):
    """As `evaluate_as_vectors`, for a law whose exponent depends on the contact."""
    s, eta = vectors[Row.START], vectors[Row.ACTIVE_STEP]
    f, slope = vectors[Row.ACTIVE_FORCE], vectors[Row.SLOPE]
    for k in range(count):
        f[k], slope[k] = contact_response(law, loss_rate, k, s[k], eta[k])


def evaluate_laws(law: Any, loss_rate: Any, count: int, lanes: int, vectors: Any) -> None:
    """ACTIVE_FORCE and SLOPE of `count` contacts in so many lanes, at the steps ACTIVE_STEP. In compiled code only."""
    raise TypeError("evaluate_laws is for compiled code")


VECTOR_LAWS = Linear, Hertz, Quadratic, Felt, Cubic
overload_by_type(
    evaluate_laws,
    dict.fromkeys(VECTOR_LAWS, evaluate_as_vectors.py_func) | {Power: evaluate_one_by_one.py_func},
)


@reduction
def load_contacts(law, loss_rate, s, g, lanes, vectors):
    """START, FREE_MOVE, TARGET (the stiffness of the law) and RHO (the rate of the loss) of all contacts; lanes beyond
    them are open, and have none."""
    start, move, unit, rate = vectors[Row.START], vectors[Row.FREE_MOVE], vectors[Row.TARGET], vectors[Row.RHO]
    f, slope = vectors[Row.ACTIVE_FORCE], vectors[Row.SLOPE]
    count = s.shape[0]
    for k in range(count):
        start[k], move[k], unit[k] = s[k], g[k], law.potential_coefficient[k]
    for k in range(count, lanes):
        start[k], move[k], unit[k], f[k], slope[k] = -1.0, 0.0, 0.0, 0.0, 0.0
    for k in range(count):
        rate[k] = loss_rate_of(loss_rate, k)
    for k in range(count, lanes):
        rate[k] = 0.0


@reduction
def add_row(eta, entries, begin, weight, lanes):
    """η ← η - U·w of one row."""
    row = entries[begin : begin + lanes]
    for k in range(lanes):
        eta[k] -= row[k] * weight


@reduction
def dot_row(entries, begin, x, lanes):
    """Σ over the contacts of a row of U times x."""
    row, total = entries[begin : begin + lanes], 0.0
    for k in range(lanes):
        total += row[k] * x[k]
    return total


@reduction
def scale_row(entries, begin, x, lanes, out):
    """A row of U, each entry times that of x."""
    row = entries[begin : begin + lanes]
    for k in range(lanes):
        out[k] = row[k] * x[k]


@reduction
def copy(x, out, lanes):
    """A copy of so many numbers."""
    for k in range(lanes):
        out[k] = x[k]


@noinline
def evaluate(law, loss_rate, basis, at_contacts, w, count, lanes, vectors):
    """Forces and slopes at w; RESIDUAL is the gradient w - Uᵀ·f. Returns the size of Uᵀ·f."""
    eta, gradient, f = vectors[Row.ACTIVE_STEP], vectors[Row.RESIDUAL], vectors[Row.ACTIVE_FORCE]
    copy(vectors[Row.FREE_MOVE], eta, lanes)
    for j in range(basis.shape[0]):
        add_row(eta, at_contacts, basis[j], w[j], lanes)
    evaluate_laws(law, loss_rate, count, lanes, vectors)
    size = 0.0
    for j in range(basis.shape[0]):
        part = dot_row(at_contacts, basis[j], f, lanes)
        gradient[j] = w[j] - part
        size += abs(part)
    return size


@noinline
def newton_direction(basis, at_contacts, lanes, vectors, hessian):
    """NEWTON_STEP = -(1 + Uᵀ·J·U)⁻¹·RESIDUAL, by Cholesky's factor (its diagonal inverted)."""
    rank = basis.shape[0]
    slope, weighted = vectors[Row.SLOPE], vectors[Row.WORK]
    gradient, d = vectors[Row.RESIDUAL], vectors[Row.NEWTON_STEP]
    for i in range(rank):
        scale_row(at_contacts, basis[i], slope, lanes, weighted)
        row = hessian[i]
        for j in range(i + 1):
            row[j] = dot_row(at_contacts, basis[j], weighted, lanes)
        row[i] += 1.0
    for i in range(rank):
        row, y = hessian[i], -gradient[i]
        for j in range(i):
            left, other = row[j], hessian[j]
            for m in range(j):
                left -= row[m] * other[m]
            row[j] = left * other[j]
            y -= row[j] * d[j]
        diagonal = row[i]
        for m in range(i):
            diagonal -= row[m] * row[m]
        row[i] = 1.0 / math.sqrt(max(diagonal, 1e-300))
        d[i] = y * row[i]
    for i in range(rank - 1, -1, -1):
        row = hessian[i]
        d[i] *= row[i]
        for m in range(i):
            d[m] -= row[m] * d[i]


@inline
def step_sizes(rank, vectors):
    """The slope along NEWTON_STEP, the largest part of that step, and of w."""
    gradient, d, w = vectors[Row.RESIDUAL], vectors[Row.NEWTON_STEP], vectors[Row.GUESS]
    slope, step, size = 0.0, 0.0, 0.0
    for j in range(rank):
        slope += gradient[j] * d[j]
        step = max(step, abs(d[j]))
        size = max(size, abs(w[j]))
    return slope, step, size


@noinline
def solve_reduced(law, loss_rate, basis, at_contacts, s, g, scratch):
    """Solve the contacts of an island in the space of their basis.

    basis:       where each row begins in at_contacts
    at_contacts: U of all islands, row by row, √(m/N)
    s, g:        compressions at the start, and their changes without contact force [contacts], m

    On return FORCE, STEP, END and MISS of the scratch hold the solution, as of the coupled solve
    (engine.kernel.coupled_contact_solver). Returns evaluations of the laws; 0 if it did not converge.
    """
    vectors, rank, count = scratch.vectors, basis.shape[0], s.shape[0]
    w, saved, d = vectors[Row.GUESS], vectors[Row.SQRT_SLOPE], vectors[Row.NEWTON_STEP]
    lanes = (count + 7) // 8 * 8
    load_contacts(law, loss_rate, s, g, lanes, vectors)
    for j in range(rank):
        w[j] = 0.0
    size = evaluate(law, loss_rate, basis, at_contacts, w, count, lanes, vectors)
    evaluations, best = INT64_1, math.inf
    while evaluations < MAX_EVALUATIONS:
        newton_direction(basis, at_contacts, lanes, vectors, scratch.cholesky)
        slope, step, largest = step_sizes(rank, vectors)
        if step <= CONVERGED_STEP * largest or (step <= STALLED_STEP * largest and step >= 0.25 * best):
            store_reduced_solution(basis, at_contacts, s, count, lanes, vectors)
            return evaluations
        best = step
        share = 1.0
        for j in range(rank):
            saved[j] = w[j]
        while True:
            for j in range(rank):
                w[j] = saved[j] + share * d[j]
            size = evaluate(law, loss_rate, basis, at_contacts, w, count, lanes, vectors)
            evaluations += 1
            here = step_sizes(rank, vectors)[0]
            if not math.isfinite(size):
                return INT64_0
            if abs(here) <= MIN_DECREASE * abs(slope) or step <= STALLED_STEP * largest:
                break
            if evaluations >= MAX_EVALUATIONS:
                return INT64_0
            share *= max(0.1, min(0.7, slope / (slope - here)))
    return INT64_0


@inline
def store_reduced_solution(basis, at_contacts, s, count, lanes, vectors):
    """FORCE, STEP, END and MISS of all contacts, from the last evaluation."""
    w, gradient, eta = vectors[Row.GUESS], vectors[Row.RESIDUAL], vectors[Row.ACTIVE_STEP]
    force, step, end, miss = vectors[Row.FORCE], vectors[Row.STEP], vectors[Row.END], vectors[Row.MISS]
    f, g = vectors[Row.ACTIVE_FORCE], vectors[Row.FREE_MOVE]
    for k in range(lanes):
        miss[k] = g[k] - eta[k]
    for j in range(basis.shape[0]):
        add_row(miss, at_contacts, basis[j], w[j], lanes)  # what rounding cut from η = g - U·w
        add_row(miss, at_contacts, basis[j], -gradient[j], lanes)  # and the forces, Uᵀ·f, from w
    for k in range(count):
        force[k], step[k], end[k] = f[k], eta[k], s[k] + eta[k]
