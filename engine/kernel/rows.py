"""Points of bodies: how modes move them, and how forces at them push modes. A row of mode shapes is a point
(engine.kernel.model.ModeShapeRows)."""

import numpy as np

from engine.compiler.decorators import INT64_0, INT64_1, inline
from engine.compiler.lanes import lane_sum, load_lanes, multiply_add, splat
from engine.kernel.codes import LANES
from engine.kernel.sums import sum_products, sum_sizes_of_products

ROWS_AT_ONCE = 4


@inline
def weighted_sum(weights, offset, x, begin, end):
    """Return Σ weights[offset + m]·x[begin + m] over the modes begin to end of an island."""
    first = np.int64(begin)
    return sum_products(weights, np.int64(offset), x, first, np.int64(end) - first)


@inline
def project(rows, r, x):
    """Displacement at row r (m) from the modes' displacements; or velocity (m/s) from their momenta."""
    return weighted_sum(rows.phi, rows.offset[r], x, rows.mode_begin[r], rows.mode_end[r])


@inline
def project_drift(rows, coefficients, r, p):
    """Displacement at row r by the coming drift, m."""
    return weighted_sum(coefficients.drift_phi, rows.offset[r], p, rows.mode_begin[r], rows.mode_end[r])


@inline
def rows_of_same_modes(rows, r, total):
    """Return how many rows from r on weigh the same modes, up to ROWS_AT_ONCE. total: number of all rows"""
    begin, end, count = rows.mode_begin[r], rows.mode_end[r], INT64_1
    while count < ROWS_AT_ONCE and r + count < total:
        if rows.mode_begin[r + count] != begin or rows.mode_end[r + count] != end:
            break
        count += 1
    return count


@inline
def drifts_of_same_modes(rows, coefficients, r, count, p):
    """Return the displacements by the coming drift, m, at two to four rows from r on; each momentum is read once for
    all of them. Of fewer than four, the last stands for the missing ones."""
    of, begin = coefficients.drift_phi, np.int64(rows.mode_begin[r])
    modes, last = rows.mode_end[r] - begin, r + count - 1
    i, j = np.int64(rows.offset[r]), np.int64(rows.offset[r + 1])
    k, n = np.int64(rows.offset[min(r + 2, last)]), np.int64(rows.offset[last])
    a, b, c, d = splat(0.0), splat(0.0), splat(0.0), splat(0.0)
    vectors = modes // LANES * LANES
    for m in range(0, vectors, LANES):
        x = load_lanes(p, begin + m)
        a = multiply_add(load_lanes(of, i + m), x, a)
        b = multiply_add(load_lanes(of, j + m), x, b)
        c = multiply_add(load_lanes(of, k + m), x, c)
        d = multiply_add(load_lanes(of, n + m), x, d)
    e, f, g, h = lane_sum(a), lane_sum(b), lane_sum(c), lane_sum(d)
    for m in range(vectors, modes):
        x = p[begin + m]
        e += of[i + m] * x
        f += of[j + m] * x
        g += of[k + m] * x
        h += of[n + m] * x
    return e, f, g, h


@inline
def add_drifts_of_same_modes(rows, coefficients, r, count, p, moves):
    """Add the displacements by the coming drift, m, at two to four rows from r on to `moves`."""
    e, f, g, h = drifts_of_same_modes(rows, coefficients, r, count, p)
    moves[r] += e
    moves[r + 1] += f
    if count > 2:
        moves[r + 2] += g
    if count > 3:
        moves[r + 3] += h


@inline
def add_drifts(rows, coefficients, p, moves):
    """Add the displacement by the coming drift, m, at each row to `moves`, if there are rows."""
    if rows is not None:
        r, total = INT64_0, moves.shape[0]
        while r < total:
            count = rows_of_same_modes(rows, r, total)
            if count > 1:
                add_drifts_of_same_modes(rows, coefficients, r, count, p, moves)
            else:
                moves[r] += project_drift(rows, coefficients, r, p)
            r += count


@inline
def push_at_row(rows, weights, r, amount, p):
    """Change the momenta of the modes that row r weighs by their weights times an amount, N·s."""
    begin, end, offset = rows.mode_begin[r], rows.mode_end[r], rows.offset[r]
    if end - begin == 1:
        p[begin] += weights[offset] * amount
        return
    a, b = weights[offset : offset + (end - begin)], p[begin:end]
    for m in range(b.shape[0]):
        b[m] += a[m] * amount


@inline
def push_both_at_row(rows, coefficients, r, f, state):
    """Do half a kick by a force f (N) at row r on the momenta of the coming drift, and keep it for the second half."""
    begin, end, offset = rows.mode_begin[r], rows.mode_end[r], rows.offset[r]
    kick = coefficients.kick_phi[offset : offset + (end - begin)]
    momentum, push = state.drift_momentum[begin:end], state.push[begin:end]
    for m in range(momentum.shape[0]):
        change = kick[m] * f
        momentum[m] += change
        push[m] += change


@inline
def push_both_at_rows_of_same_modes(rows, coefficients, r, count, forces, state):
    """Do half a kick by four forces (N) at two to four rows from r on, of which the last stands for missing ones, and
    keep it for the second half."""
    of, begin = coefficients.kick_phi, np.int64(rows.mode_begin[r])
    modes, last = rows.mode_end[r] - begin, r + count - 1
    i, j = np.int64(rows.offset[r]), np.int64(rows.offset[r + 1])
    k, n = np.int64(rows.offset[min(r + 2, last)]), np.int64(rows.offset[last])
    (a, b, c, d), momentum, push = forces, state.drift_momentum, state.push
    for m in range(modes):
        change = (of[i + m] * a + of[j + m] * b) + (of[k + m] * c + of[n + m] * d)
        momentum[begin + m] += change
        push[begin + m] += change


@inline
def bound_at_row(rows, r, bound):
    """Return how far the point of row r can move, m, if each mode moves no further than `bound`."""
    begin, first = np.int64(rows.mode_begin[r]), np.int64(rows.offset[r])
    return sum_sizes_of_products(rows.phi, first, bound, begin, np.int64(rows.mode_end[r]) - begin)
