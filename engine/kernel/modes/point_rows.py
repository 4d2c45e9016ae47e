"""Points of bodies: how modes move them, and how forces at them push modes. A row of mode shapes is a point
(engine.kernel.data.model.ModeShapeRows)."""

import numpy as np

from engine.compiler.decorators import INT64_0, INT64_1, inline
from engine.compiler.lanes import lane_sum, multiply_add, number_at, place_after, splat
from engine.kernel.modes.ordered_sums import fold_lanes, sum_products, sum_sizes_of_products

ROWS_AT_ONCE = 4


@inline
def sum_of_shapes(shapes, offset, x, begin, end):
    """Return Σ shapes[offset + m]·x[begin + m] over the modes begin to end of an island."""
    first = np.int64(begin)
    return sum_products(shapes, np.int64(offset), x, first, np.int64(end) - first)


@inline
def project(rows, r, x):
    """Displacement at row r (m) from the modes' displacements; or velocity (m/s) from their momenta."""
    return sum_of_shapes(rows.phi, rows.offset[r], x, rows.mode_begin[r], rows.mode_end[r])


@inline
def project_drift(rows, coefficients, r, p):
    """Displacement at row r by the coming drift, m."""
    return sum_of_shapes(coefficients.drift_phi, rows.offset[r], p, rows.mode_begin[r], rows.mode_end[r])


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
def offsets_of_rows(rows, r, count):
    """Return the offsets of two to four rows from r on, of which the last stands for missing ones."""
    last = r + count - 1
    i, j = np.int64(rows.offset[r]), np.int64(rows.offset[r + 1])
    return i, j, np.int64(rows.offset[min(r + 2, last)]), np.int64(rows.offset[last])


@inline
def add_drift_of_four(of, m, sums):
    """Add how far mode m of a body moves four points to the sums."""
    shapes, (i, j, k, n), p, begin = of
    x, (a, b, c, d) = number_at(p, place_after(m, begin)), sums
    a = multiply_add(number_at(shapes, place_after(m, i)), x, a)
    b = multiply_add(number_at(shapes, place_after(m, j)), x, b)
    c = multiply_add(number_at(shapes, place_after(m, k)), x, c)
    return a, b, c, multiply_add(number_at(shapes, place_after(m, n)), x, d)


@inline
def drifts_of_same_modes(rows, coefficients, r, count, p):
    """Return the displacements by the coming drift, m, at two to four rows from r on; each momentum is read once for
    all of them. Of fewer than four, the last stands for the missing ones."""
    begin, zeros = np.int64(rows.mode_begin[r]), splat(0.0)
    of = coefficients.drift_phi, offsets_of_rows(rows, r, count), p, begin
    return lane_sum(fold_lanes(add_drift_of_four, of, np.int64(rows.mode_end[r]) - begin, (zeros, zeros, zeros, zeros)))


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
def push_at_row(rows, shapes, r, amount, p):
    """Change the momenta of the modes that row r weighs by their shapes times an amount, N·s."""
    begin, end, offset = rows.mode_begin[r], rows.mode_end[r], rows.offset[r]
    if end - begin == 1:
        p[begin] += shapes[offset] * amount
        return
    a, b = shapes[offset : offset + (end - begin)], p[begin:end]
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
def bound_at_row(rows, r, bound):
    """Return how far the point of row r can move, m, if each mode moves no further than `bound`."""
    begin, first = np.int64(rows.mode_begin[r]), np.int64(rows.offset[r])
    return sum_sizes_of_products(rows.phi, first, bound, begin, np.int64(rows.mode_end[r]) - begin)


@inline
def displacement_at_row(rows, r, m, change):
    """Displacement at row r by a change of mode m; 0 without rows."""
    if rows is None:
        return 0.0
    if rows.mode_begin[r] <= m and m < rows.mode_end[r]:
        return rows.phi[rows.offset[r] + (m - rows.mode_begin[r])] * change
    return 0.0
