"""Points of bodies: how modes move them, and how forces at them push modes. A row of mode shapes is a point
(engine.kernel.data.model.ModeShapeRows)."""

import numpy as np

from engine.compiler.decorators import inline
from engine.kernel.modes.ordered_sums import sum_products, sum_sizes_of_products


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
def add_drifts(rows, coefficients, p, moves):
    """Add the displacement by the coming drift, m, at each row to `moves`."""
    for r in range(moves.shape[0]):
        moves[r] += project_drift(rows, coefficients, r, p)


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
    """Displacement at row r by a change of mode m."""
    if rows.mode_begin[r] <= m and m < rows.mode_end[r]:
        return rows.phi[rows.offset[r] + (m - rows.mode_begin[r])] * change
    return 0.0
