"""A step of modes with many connections, as those of a board: their rows four at a time, so that sums stay in
registers."""

import numpy as np

from engine.compiler.decorators import INT64_0, inline, noinline
from engine.compiler.lanes import EightFrom, FewFrom, multiply_add, number_at, put_number, splat
from engine.kernel.codes import LANES
from engine.kernel.connected_modes import add_push, add_step, keep_sums, step_mode
from engine.kernel.rows import ROWS_AT_ONCE
from engine.kernel.sums import lanes_of


@noinline
def step_modes_of_many_parts(connection, acting, h, parts, state):
    """As `step_connected_modes`, of modes with any number of parts."""
    (r, count), joined, total = parts, state.connection, splat(0.0)
    first, end = np.int64(connection.rows.mode_begin[r]), np.int64(connection.rows.mode_end[r])
    whole = first + lanes_of(end - first)
    for m in range(first, end):
        joined.push[m] = add_push(acting.pushes, m, 0.0)
    for n in range(INT64_0, count, ROWS_AT_ONCE):
        rows = four_rows(connection, r + n, count - n)
        forces = four_forces(connection, joined, r + n, count - n)
        for m in range(first, whole, LANES):
            add_pushes(h, eight_in_rows(rows, m), forces, EightFrom(m), joined.push)
        if whole < end:
            few = FewFrom(whole, end - whole)
            add_pushes(h, few_in_rows(rows, few), forces, few, joined.push)
    for m in range(first, whole, LANES):
        total = total + step_pushed_mode(acting, h, EightFrom(m), state)
    if whole < end:
        total = total + step_pushed_mode(acting, h, FewFrom(whole, end - whole), state)
    for n in range(INT64_0, count, ROWS_AT_ONCE):
        rows, zeros = four_rows(connection, r + n, count - n), (splat(0.0), splat(0.0))
        moves = zeros, zeros, zeros, zeros
        for m in range(first, whole, LANES):
            moves = add_moves(h, eight_in_rows(rows, m), moves, EightFrom(m), joined)
        if whole < end:
            few = FewFrom(whole, end - whole)
            moves = add_moves(h, few_in_rows(rows, few), moves, few, joined)
        keep_moves(connection, joined, r + n, count - n, moves)
    return total


@inline
def row_origin(connection, r):
    """Where the entry of mode 0 would be in row r."""
    return np.int64(connection.rows.offset[r]) - np.int64(connection.rows.mode_begin[r])


@inline
def four_rows(connection, r, left):
    """The origins of four rows from r on; of fewer than four, the last stands for the missing ones."""
    last = r + min(left, ROWS_AT_ONCE) - 1
    second, third = row_origin(connection, min(r + 1, last)), row_origin(connection, min(r + 2, last))
    return row_origin(connection, r), second, third, row_origin(connection, last)


@inline
def eight_in_rows(rows, m):
    """Where the entries of eight modes from m on are in four rows."""
    return EightFrom(rows[0] + m), EightFrom(rows[1] + m), EightFrom(rows[2] + m), EightFrom(rows[3] + m)


@inline
def few_in_rows(rows, few):
    """The same of fewer modes."""
    m, size = few
    return (
        FewFrom(rows[0] + m, size),
        FewFrom(rows[1] + m, size),
        FewFrom(rows[2] + m, size),
        FewFrom(rows[3] + m, size),
    )


@inline
def four_forces(connection, joined, r, left):
    """The forces on modes at four rows from r on, N; 0 for those that are missing."""
    f, of = joined.force, connection.coordinate
    b = -f[of[r + 1]] if left > 1 else 0.0
    c = -f[of[r + 2]] if left > 2 else 0.0
    d = -f[of[r + 3]] if left > 3 else 0.0
    return -f[of[r]], b, c, d


@inline
def add_pushes(h, places, forces, m, pushes):
    """Add what forces at four rows give mode m, or eight, in half a kick."""
    kick = h.connection.rows.kick_phi
    push = multiply_add(number_at(kick, places[0]), forces[0], number_at(pushes, m))
    push = multiply_add(number_at(kick, places[1]), forces[1], push)
    push = multiply_add(number_at(kick, places[2]), forces[2], push)
    put_number(pushes, m, multiply_add(number_at(kick, places[3]), forces[3], push))


@inline
def step_pushed_mode(acting, h, m, state):
    """A step of mode m, or of eight, whose push is known; the momenta with which it drifts and will are kept. Returns
    the energy lost."""
    joined = state.connection
    lost, half, coming = step_mode(
        acting.weight, h, state.kick_compensation, number_at(joined.push, m), m, state.q, state.p
    )
    put_number(joined.push, m, half)
    put_number(joined.coming, m, coming)
    return lost


@inline
def add_moves(h, places, moves, m, joined):
    """Add what mode m, or eight, moves at four rows, and will, to these sums."""
    drift, stepped = h.connection.rows.drift_phi, (0.0, number_at(joined.push, m), number_at(joined.coming, m))
    a, b = (
        add_step(moves[0], stepped, number_at(drift, places[0])),
        add_step(moves[1], stepped, number_at(drift, places[1])),
    )
    c, d = (
        add_step(moves[2], stepped, number_at(drift, places[2])),
        add_step(moves[3], stepped, number_at(drift, places[3])),
    )
    return a, b, c, d


@inline
def keep_moves(connection, joined, r, left, moves):
    """Add the sums of four rows from r on, so far as there are any."""
    keep_sums(joined, connection.coordinate[r], moves[0])
    if left > 1:
        keep_sums(joined, connection.coordinate[r + 1], moves[1])
    if left > 2:
        keep_sums(joined, connection.coordinate[r + 2], moves[2])
    if left > 3:
        keep_sums(joined, connection.coordinate[r + 3], moves[3])
