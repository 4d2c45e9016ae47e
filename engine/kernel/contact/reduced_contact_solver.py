"""Contact solve of an island whose contacts move almost alike, in the space of their basis (B = U·Uᵀ).

The unknown w [rank] holds the force at each row of the basis:

    η = g - U·w,    f = φ(s, η),    w = Uᵀ·f

w - Uᵀ·f(g - U·w) is the gradient of a convex potential, whose Hessian 1 + Uᵀ·J·U is at least 1, J = df/dη; so Newton's
iteration with a line search cannot fail. It begins at w = 0, where contacts are deepest. Eight contacts are evaluated
at a time, without branches. Eight that are open, and would be so without any force, take part only if the solution of
the others closes one of them.
"""

import math
from typing import Any, NamedTuple

from engine.compiler.decorators import INT64_0, INT64_1, inline, noinline
from engine.compiler.lanes import lane_sum, load_lanes, multiply_add, splat, store_lanes, where_positive
from engine.compiler.overloads import overload_by_type
from engine.kernel.contact.contact_law import (
    branch_on_exponent,
    contact_response,
    exponent,
    loss_rate_of,
    power,
    power_difference_quotient,
)
from engine.kernel.data.enums import COLUMNS, LANES, MAX_RANK, ROWS_COLUMN, Row
from engine.kernel.data.laws import SPECIAL_LAWS, Power

MAX_NEWTON_STEPS = 100
LAST_STEP = 1e-3  # of w: a Newton step no larger may be taken along the tangents of the laws
LAST_STEP_ERROR = 1e-15  # of the forces that it may leave
STALLED_STEP = 1e-7  # of w: below, steps that no longer shrink are what rounding makes of stiff contacts
MIN_DECREASE = 0.9  # of the slope along a Newton step: more of it left, and the step is shortened
TINY = 1e-300  # m: nothing is divided by less


class Basis(NamedTuple):
    """The basis of an island's contacts."""

    rank: int
    contacts: int
    lanes: int  # contacts, rounded up to a multiple of eight
    at_contacts: Any  # U [5 × lanes], row by row, √(m/N)
    low: Any  # U·E, likewise: what rounding adds to U·w where the bodies move by w
    products: Any  # [lanes × 24]: at each contact U_i·U_j of each pair j ≤ i, and U


class Groups(NamedTuple):
    """Contacts that take part in a solve, in groups of eight."""

    used: int
    begin: Any  # the first contact of each eight


@inline
def basis_of_island(basis, coefficients, contacts):
    """Return the Basis of an island that has one. contacts: their number in the island"""
    lanes = (contacts + LANES - 1) // LANES * LANES
    begin, first = basis.at_contacts_begin[0], basis.products_begin[0]
    at_contacts = coefficients.at_contacts[begin : begin + MAX_RANK * lanes]
    low = coefficients.at_contacts[begin + MAX_RANK * lanes : begin + 2 * MAX_RANK * lanes]
    products = coefficients.products[first : first + COLUMNS * lanes]
    return Basis(basis.at_contacts_begin.shape[0], contacts, lanes, at_contacts, low, products)


@noinline
def spread_rows(basis, at_rows, padded, at_contacts):
    """Multiply numbers of the rows by U, into `at_contacts`. padded: memory for all lanes"""
    for k in range(0, basis.lanes, LANES):
        total = splat(0.0)
        for j in range(basis.rank):
            total = multiply_add(load_lanes(basis.at_contacts, j * basis.lanes + k), at_rows[j], total)
        store_lanes(padded, k, total)
    for k in range(basis.contacts):
        at_contacts[k] = padded[k]


@noinline
def gather_rows(basis, at_contacts, padded, at_rows):
    """Multiply numbers of the contacts by Uᵀ, into `at_rows`. padded: memory for all lanes"""
    for k in range(basis.contacts, basis.lanes):
        padded[k] = 0.0
    for k in range(basis.contacts):
        padded[k] = at_contacts[k]
    for j in range(basis.rank):
        total = splat(0.0)
        for k in range(0, basis.lanes, LANES):
            total = multiply_add(load_lanes(basis.at_contacts, j * basis.lanes + k), load_lanes(padded, k), total)
        at_rows[j] = lane_sum(total)


@inline
def smooth_response(law, unit, rate, s, eta):
    """Return the mean forces (N) of eight contacts and their slopes (N/m), for steps η from s. The slopes have an error
    of 1e-8 at most.

    unit: potential_coefficient of the law; 0 where there is no contact
    rate: of the contact loss, 1/m
    """
    alpha = exponent(law, INT64_0)
    b = s + eta
    start, end = where_positive(s, s, 0.0), where_positive(b, b, 0.0)
    stays = where_positive(s, b, 0.0)  # positive where a step begins and ends in contact
    size = where_positive(eta, eta, 0.0 - eta)
    end_power = power(law, INT64_0, end)
    at_end = (alpha + 1.0) * end_power
    is_short = where_positive(1e-8 * end - size, stays, 0.0)  # or the difference below would cancel
    per_length = 1.0 / where_positive(is_short, end, where_positive(size - TINY, eta, TINY))
    mean = power_difference_quotient(law, INT64_0, start, end, size, end_power)
    phi = where_positive(start + end, where_positive(stays, mean, mean * ((end - start) * per_length)), 0.0)
    slope = where_positive(is_short, (0.5 * alpha) * at_end, at_end - phi) * per_length
    slope = where_positive(start + end, slope, 0.0)
    w = 1.0 + rate * eta
    return where_positive(w, unit * phi * w, 0.0), where_positive(w, unit * (slope * w + phi * rate), 0.0)


@inline
def add_rows(u, width, w, k, lanes):
    """Return these lanes with U·w of eight contacts from contact k on added; `width` is the length of a row."""
    lanes = multiply_add(load_lanes(u, k), w[0], lanes)
    lanes = multiply_add(load_lanes(u, k + width), w[1], lanes)
    lanes = multiply_add(load_lanes(u, k + 2 * width), w[2], lanes)
    lanes = multiply_add(load_lanes(u, k + 3 * width), w[3], lanes)
    return multiply_add(load_lanes(u, k + 4 * width), w[4], lanes)


@noinline
def respond_in_lanes(law, lossy_law, basis, groups, minus_w, vectors):
    """Write ACTIVE_STEP, ACTIVE_FORCE and SLOPE of the contacts that take part, eight at a time. minus_w: minus the
    forces of the rows"""
    g, s = vectors[Row.FREE_MOVE], vectors[Row.START]
    unit, rate = vectors[Row.TARGET], vectors[Row.RHO]
    for n in range(groups.used):
        k = groups.begin[n]
        eta = add_rows(basis.at_contacts, basis.lanes, minus_w, k, load_lanes(g, k))
        f, slope = smooth_response(law, load_lanes(unit, k), load_lanes(rate, k), load_lanes(s, k), eta)
        store_lanes(vectors[Row.ACTIVE_STEP], k, eta)
        store_lanes(vectors[Row.ACTIVE_FORCE], k, f)
        store_lanes(vectors[Row.SLOPE], k, slope)


def respond_one_by_one(_, of):
    """Write ACTIVE_STEP, ACTIVE_FORCE and SLOPE of the contacts that take part, one by one: the exponent of the law
    depends on the contact."""
    lossy_law, basis, groups, minus_w, vectors = of
    g, s, eta = vectors[Row.FREE_MOVE], vectors[Row.START], vectors[Row.ACTIVE_STEP]
    f, slope = vectors[Row.ACTIVE_FORCE], vectors[Row.SLOPE]
    for n in range(groups.used):
        begin = groups.begin[n]
        store_lanes(eta, begin, add_rows(basis.at_contacts, basis.lanes, minus_w, begin, load_lanes(g, begin)))
        for k in range(begin, min(begin + LANES, basis.contacts)):
            f[k], slope[k] = contact_response(lossy_law, k, s[k], eta[k])


def respond_as(kind: Any) -> Any:
    """Return a function that does `respond_in_lanes` with a law of any exponent, taken as a law of this kind."""

    def respond_as_kind(of):
        lossy_law, basis, groups, minus_w, vectors = of
        law = lossy_law.elastic
        respond_in_lanes(kind(law.potential_coefficient, law.exponent), lossy_law, basis, groups, minus_w, vectors)

    return inline(respond_as_kind)


@inline
def shared_exponent(law, contacts):
    """Return the exponent that all contacts have; 0 if they have several."""
    alpha = law.exponent[0]
    for k in range(1, contacts):
        if law.exponent[k] != alpha:
            alpha = 0.0
    return alpha


def respond(law: Any, lossy_law: Any, basis: Any, groups: Any, minus_w: Any, vectors: Any) -> None:
    """Write ACTIVE_STEP, ACTIVE_FORCE and SLOPE of the contacts that take part. minus_w: minus the forces of the rows.
    In compiled code only."""
    raise TypeError("respond is for compiled code")


respond_as_any = branch_on_exponent({kind: respond_as(kind) for kind in SPECIAL_LAWS}, respond_one_by_one)


def respond_with_power_law(law, lossy_law, basis, groups, minus_w, vectors):
    """Write ACTIVE_STEP, ACTIVE_FORCE and SLOPE of the contacts that take part, for a law of any exponent: eight at a
    time if all share an exponent that has its own law, or else one by one."""
    of = (lossy_law, basis, groups, minus_w, vectors)
    respond_as_any(shared_exponent(law, basis.contacts), of)


overload_by_type(respond, dict.fromkeys(SPECIAL_LAWS, respond_in_lanes.py_func) | {Power: respond_with_power_law})


@inline
def load_contacts(law, s, g, basis, vectors):
    """Write START, FREE_MOVE, TARGET (the stiffness of the law) and RHO (the rate of the loss) of all contacts. Lanes
    beyond them are open, without stiffness and loss."""
    start, move, unit, rate = vectors[Row.START], vectors[Row.FREE_MOVE], vectors[Row.TARGET], vectors[Row.RHO]
    for k in range(basis.contacts, basis.lanes):
        start[k], move[k], unit[k], rate[k] = -1.0, 0.0, 0.0, 0.0
        vectors[Row.ACTIVE_FORCE, k], vectors[Row.SLOPE, k] = 0.0, 0.0
    for k in range(basis.contacts):
        start[k], move[k], unit[k], rate[k] = s[k], g[k], law.elastic.potential_coefficient[k], loss_rate_of(law, k)


@inline
def groups_in_reach(basis, vectors, begin):
    """Return the Groups with a contact that is closed, or would be closed without forces."""
    used = INT64_0
    for k in range(0, basis.lanes, LANES):
        s = load_lanes(vectors[Row.START], k)
        end = s + load_lanes(vectors[Row.FREE_MOVE], k)
        if lane_sum(where_positive(s, 1.0, where_positive(end, 1.0, 0.0))) > 0.0:
            begin[used] = k
            used += 1
    return Groups(used, begin)


@inline
def all_groups(basis, begin):
    """Return the Groups of all contacts."""
    used = basis.lanes // LANES
    for n in range(used):
        begin[n] = n * LANES
    return Groups(used, begin)


@noinline
def evaluate(law, basis, groups, w, vectors):
    """Find forces and slopes of the contacts for the forces w of the rows. WORK becomes two sums over the contacts: of
    the products times the slopes, the lower triangle of Uᵀ·J·U; and of the rows times the forces, Uᵀ·f."""
    minus_w = (-w[0], -w[1], -w[2], -w[3], -w[4])
    respond(law.elastic, law, basis, groups, minus_w, vectors)
    f, slope, sums, table = vectors[Row.ACTIVE_FORCE], vectors[Row.SLOPE], vectors[Row.WORK], basis.products
    a0, a1, a2 = splat(0.0), splat(0.0), splat(0.0)
    b0, b1, b2 = splat(0.0), splat(0.0), splat(0.0)
    for n in range(groups.used):
        begin = groups.begin[n]
        for k in range(begin, begin + LANES, 2):
            at, j, push = k * COLUMNS, slope[k], f[k]
            a0 = multiply_add(load_lanes(table, at), j, a0)
            a1 = multiply_add(load_lanes(table, at + LANES), j, a1)
            a2 = multiply_add(load_lanes(table, at + ROWS_COLUMN), push, a2)
            at, j, push = at + COLUMNS, slope[k + 1], f[k + 1]
            b0 = multiply_add(load_lanes(table, at), j, b0)
            b1 = multiply_add(load_lanes(table, at + LANES), j, b1)
            b2 = multiply_add(load_lanes(table, at + ROWS_COLUMN), push, b2)
    store_lanes(sums, 0, a0 + b0)
    store_lanes(sums, LANES, a1 + b1)
    store_lanes(sums, ROWS_COLUMN, a2 + b2)


@inline
def gradient_at(w, sums):
    """Return the gradient w - Uᵀ·f of the potential."""
    at = ROWS_COLUMN
    return w[0] - sums[at], w[1] - sums[at + 1], w[2] - sums[at + 2], w[3] - sums[at + 3], w[4] - sums[at + 4]


@inline
def newton_direction(r, sums):
    """Return the Newton step -(1 + Uᵀ·J·U)⁻¹·r from the gradient r, by the factors L·D·Lᵀ."""
    i0 = 1.0 / (1.0 + sums[0])
    a10, a20, a30, a40 = sums[1], sums[3], sums[6], sums[10]
    l10, l20, l30, l40 = a10 * i0, a20 * i0, a30 * i0, a40 * i0
    i1 = 1.0 / (1.0 + sums[2] - l10 * a10)
    a21, a31, a41 = sums[4] - l20 * a10, sums[7] - l30 * a10, sums[11] - l40 * a10
    l21, l31, l41 = a21 * i1, a31 * i1, a41 * i1
    i2 = 1.0 / (1.0 + sums[5] - l20 * a20 - l21 * a21)
    a32, a42 = sums[8] - l30 * a20 - l31 * a21, sums[12] - l40 * a20 - l41 * a21
    l32, l42 = a32 * i2, a42 * i2
    i3 = 1.0 / (1.0 + sums[9] - l30 * a30 - l31 * a31 - l32 * a32)
    a43 = sums[13] - l40 * a30 - l41 * a31 - l42 * a32
    l43 = a43 * i3
    i4 = 1.0 / (1.0 + sums[14] - l40 * a40 - l41 * a41 - l42 * a42 - l43 * a43)
    y0 = -r[0]
    y1 = -r[1] - l10 * y0
    y2 = -r[2] - l20 * y0 - l21 * y1
    y3 = -r[3] - l30 * y0 - l31 * y1 - l32 * y2
    y4 = -r[4] - l40 * y0 - l41 * y1 - l42 * y2 - l43 * y3
    d4 = y4 * i4
    d3 = y3 * i3 - l43 * d4
    d2 = y2 * i2 - l32 * d3 - l42 * d4
    d1 = y1 * i1 - l21 * d2 - l31 * d3 - l41 * d4
    return y0 * i0 - l10 * d1 - l20 * d2 - l30 * d3 - l40 * d4, d1, d2, d3, d4


@inline
def dot(a, b):
    """Return Σ a·b over the rows."""
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2] + a[3] * b[3] + a[4] * b[4]


@inline
def largest(a):
    """Return the largest absolute value of the rows."""
    return max(max(max(abs(a[0]), abs(a[1])), max(abs(a[2]), abs(a[3]))), abs(a[4]))


@inline
def move_along(w, d, share):
    """Return w + share·d."""
    return w[0] + share * d[0], w[1] + share * d[1], w[2] + share * d[2], w[3] + share * d[3], w[4] + share * d[4]


@noinline
def solve_reduced(law, basis, s, g, scratch):
    """Solve the contacts of an island in the space of their basis.

    basis:   Basis
    s, g:    compressions at the start, and their changes without contact force [contacts], m
    scratch: Scratch; on return FORCE, STEP, END and MISS hold the solution, as of the coupled solve
             (engine.kernel.contact.coupled_contact_solver)

    Returns evaluations of the laws; 0 if it did not converge.
    """
    vectors = scratch.vectors
    sums = vectors[Row.WORK]
    load_contacts(law, s, g, basis, vectors)
    groups = groups_in_reach(basis, vectors, scratch.active)
    w = (0.0, 0.0, 0.0, 0.0, 0.0)
    evaluate(law, basis, groups, w, vectors)
    evaluations, best = INT64_1, math.inf
    while evaluations < MAX_NEWTON_STEPS:
        gradient = gradient_at(w, sums)
        d = newton_direction(gradient, sums)
        step, size = largest(d), largest(w)
        is_stalled = step <= STALLED_STEP * size and step >= 0.25 * best
        if step <= LAST_STEP * size and (last_step_error(basis, groups, d, vectors) <= LAST_STEP_ERROR or is_stalled):
            if store_reduced_solution(basis, groups, move_along(w, d, 1.0), vectors):
                return evaluations
            groups, best = all_groups(basis, scratch.active), math.inf
            evaluate(law, basis, groups, w, vectors)
            continue
        slope, saved, best, share, low, high = dot(gradient, d), w, step, 1.0, 0.0, 0.0
        while True:
            w = move_along(saved, d, share)
            evaluate(law, basis, groups, w, vectors)
            evaluations += 1
            here = dot(gradient_at(w, sums), d)
            is_short = here < 0.0 and high == 0.0  # of the minimum: the next step is as long
            if abs(here) <= MIN_DECREASE * abs(slope) or is_short or step <= STALLED_STEP * size:
                break
            if evaluations >= MAX_NEWTON_STEPS or not math.isfinite(here):
                return INT64_0
            if here < 0.0:  # along a step the slope rises: it is 0 between low and high
                low = share
            else:
                high = share
            share = low + (high - low) * (0.5 if here < 0.0 else max(0.1, min(0.7, slope / (slope - here))))
    return INT64_0


@inline
def last_step_error(basis, groups, d, vectors):
    """Take a Newton step d along the tangents of the laws: write ACTIVE_FORCE, ACTIVE_STEP and ACTIVE_END of the
    contacts that take part. Returns the error of second order that it leaves in the forces, as a share of all
    forces."""
    u, width, minus_d = basis.at_contacts, basis.lanes, (-d[0], -d[1], -d[2], -d[3], -d[4])
    error, total = splat(0.0), splat(TINY)
    for n in range(groups.used):
        k = groups.begin[n]
        s, eta = load_lanes(vectors[Row.START], k), load_lanes(vectors[Row.ACTIVE_STEP], k)
        f = load_lanes(vectors[Row.ACTIVE_FORCE], k)
        move = add_rows(u, width, minus_d, k, splat(0.0))
        b = s + eta
        scale = where_positive(b, b, where_positive(s, eta, 1.0))  # of a force, or of none that remains so
        share = move / scale
        closes = where_positive(f, 0.0, where_positive(b + move, b + move, 0.0))  # with less than the force of α = 1
        error += f * (share * share) + closes * load_lanes(vectors[Row.TARGET], k)
        total += f
        store_lanes(vectors[Row.ACTIVE_FORCE], k, multiply_add(load_lanes(vectors[Row.SLOPE], k), move, f))
        store_lanes(vectors[Row.ACTIVE_STEP], k, eta + move)
        store_lanes(vectors[Row.ACTIVE_END], k, b + move)
    return lane_sum(error) / lane_sum(total)


@inline
def store_reduced_solution(basis, groups, w, vectors):
    """Write FORCE, STEP, END and MISS of all contacts. Returns True if those that took no part stay open."""
    free_move, u, width = vectors[Row.FREE_MOVE], basis.at_contacts, basis.lanes
    minus_w = (-w[0], -w[1], -w[2], -w[3], -w[4])
    closed, next_used = splat(0.0), INT64_0
    for k in range(0, basis.lanes, LANES):
        if next_used < groups.used and groups.begin[next_used] == k:
            next_used += 1
            f, step = load_lanes(vectors[Row.ACTIVE_FORCE], k), load_lanes(vectors[Row.ACTIVE_STEP], k)
            end = load_lanes(vectors[Row.ACTIVE_END], k)
        else:
            f, step = splat(0.0), add_rows(u, width, minus_w, k, load_lanes(free_move, k))
            end = load_lanes(vectors[Row.START], k) + step
            closed += where_positive(end, 1.0, 0.0)
        # the bodies move by g - U·(1 + E)·w
        residual = add_rows(u, width, minus_w, k, load_lanes(free_move, k) - step)
        store_lanes(vectors[Row.MISS], k, add_rows(basis.low, width, minus_w, k, residual))
        store_lanes(vectors[Row.STEP], k, step)
        store_lanes(vectors[Row.END], k, end)
        store_lanes(vectors[Row.FORCE], k, f)
    return not lane_sum(closed) > 0.0
