"""A step of modes with many connections, as those of a board. Rows of connections are taken four at a time, so that
sums stay in registers."""

import numpy as np

from engine.compiler.decorators import INT64_0, inline, noinline
from engine.compiler.lanes import EightFrom, FewFrom, multiply_add, number_at, put_number, splat
from engine.kernel.codes import LANES
from engine.kernel.connected_modes import add_push, add_step, keep_sums, step_mode
from engine.kernel.modes import motion_of
from engine.kernel.rows import ROWS_AT_ONCE
from engine.kernel.sums import lanes_of


@noinline
def step_modes_of_many_parts(connection, pushes, h, parts, state):
    """Step modes that any number of connections hold, and add how far they move these, in this step and in the next.
    Returns the energy lost, in lanes.

    parts: the first row of these modes in the connections, and the number of their rows
    """
    (r, count), joined, total = parts, state.connection, splat(0.0)
    first, end = np.int64(connection.rows.mode_begin[r]), np.int64(connection.rows.mode_end[r])
    whole, motion = first + lanes_of(end - first), motion_of(state)
    for m in range(first, end):
        joined.push[m] = add_push(pushes, m, 0.0)
    for n in range(INT64_0, count, ROWS_AT_ONCE):
        rows = four_rows(connection, r + n, count - n)
        forces = four_forces(connection, joined, r + n, count - n)
        for m in range(first, whole, LANES):
            add_pushes(h, eight_in_rows(rows, m), forces, EightFrom(m), joined.push)
        if whole < end:
            few = FewFrom(whole, end - whole)
            add_pushes(h, few_in_rows(rows, few), forces, few, joined.push)
    for m in range(first, whole, LANES):
        total = total + step_pushed_mode(h, EightFrom(m), joined, motion)
    if whole < end:
        total = total + step_pushed_mode(h, FewFrom(whole, end - whole), joined, motion)
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
    """Index at which the entry of mode 0 would be in row r."""
    return np.int64(connection.rows.offset[r]) - np.int64(connection.rows.mode_begin[r])


@inline
def four_rows(connection, r, left):
    """Return the origins of four rows from r on; of fewer than four, the last stands for the missing ones."""
    last = r + min(left, ROWS_AT_ONCE) - 1
    second, third = row_origin(connection, min(r + 1, last)), row_origin(connection, min(r + 2, last))
    return row_origin(connection, r), second, third, row_origin(connection, last)


@inline
def eight_in_rows(rows, m):
    """Return the indices of the entries of eight modes from m on, in four rows."""
    return EightFrom(rows[0] + m), EightFrom(rows[1] + m), EightFrom(rows[2] + m), EightFrom(rows[3] + m)


@inline
def few_in_rows(rows, few):
    """Return the indices of the entries of fewer than eight modes, in four rows."""
    m, size = few
    return (
        FewFrom(rows[0] + m, size),
        FewFrom(rows[1] + m, size),
        FewFrom(rows[2] + m, size),
        FewFrom(rows[3] + m, size),
    )


@inline
def four_forces(connection, joined, r, left):
    """Return the forces on modes at four rows from r on, N; 0 for those that are missing."""
    f, of = joined.force, connection.coordinate
    b = -f[of[r + 1]] if left > 1 else 0.0
    c = -f[of[r + 2]] if left > 2 else 0.0
    d = -f[of[r + 3]] if left > 3 else 0.0
    return -f[of[r]], b, c, d


@inline
def add_pushes(h, places, forces, m, pushes):
    """Add to the push of mode m, or of eight, the momentum that forces at four rows give it in half a kick."""
    kick = h.connection.rows.kick_phi
    push = multiply_add(number_at(kick, places[0]), forces[0], number_at(pushes, m))
    push = multiply_add(number_at(kick, places[1]), forces[1], push)
    push = multiply_add(number_at(kick, places[2]), forces[2], push)
    put_number(pushes, m, multiply_add(number_at(kick, places[3]), forces[3], push))


@inline
def step_pushed_mode(h, m, joined, motion):
    """Step mode m, or eight, whose push is known, and keep its momenta of the drift in this step and in the next.
    Returns the energy lost."""
    lost, half, coming = step_mode(h, number_at(joined.push, m), m, motion)
    put_number(joined.push, m, half)
    put_number(joined.coming, m, coming)
    return lost


@inline
def add_moves(h, places, moves, m, joined):
    """Return the sums of four rows with the moves by mode m, or by eight, added: those in this step and in the next."""
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
    """Add the sums of four rows from r on, or of as many as there are, to the moves of their connections."""
    keep_sums(joined, connection.coordinate[r], moves[0])
    if left > 1:
        keep_sums(joined, connection.coordinate[r + 1], moves[1])
    if left > 2:
        keep_sums(joined, connection.coordinate[r + 2], moves[2])
    if left > 3:
        keep_sums(joined, connection.coordinate[r + 3], moves[3])
