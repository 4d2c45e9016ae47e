"""Bessel functions of whole orders with the same bits on every machine.

J_n and e^-x·I_n by Miller's backward recurrence, with J0 + 2·(J2 + J4 + …) = 1 and I0 + 2·(I1 + I2 + …) = e^x (Olver &
others, NIST Handbook of Mathematical Functions, 3.6(iii), 10.12 and 10.35); by power series at small arguments. J0 and
J1 of large arrays by Taylor series about the nodes of a table, beyond it from the size and
the phase (10.18).
"""

import math
from fractions import Fraction
from functools import lru_cache
from typing import Any

import numpy as np

from engine.arithmetic import function_tables as t
from engine.arithmetic.elementary import arctan2, exp, square

SMALL = 0.01  # arguments below it: power series, …
SERIES_TERMS = 4  # of which so many have all digits
FIRST, LARGE = 2.0**-300, 2.0**300  # a recurrence begins with the one, and is scaled down beyond the other, …
COLUMNS = 4096  # arguments at once, at most
STEPS_BETWEEN = 8  # after so many steps, in which it grows by 2²⁰⁰ at most up to orders of 10⁷
NODES_PER_UNIT, TABLE_END = 16, 32.0  # of the table of J0 and J1
TAYLOR_TERMS = 8
BLOCK = 15_000  # arguments at once, below the size from which memory is taken from the system each time
FAR_TERMS = 7  # beyond the table, of series in 1/x²
LARGE_OF_I = 40.0  # arguments beyond it, and beyond n²/2: Hankel's expansion of I_n …
HANKEL_TERMS_OF_I = 36  # … with so many terms
PHASE_STEPS, NEWTON_STEPS = 6, 4  # for the zeros: of the first guess, right to 0.1, and from there


# --- recurrences


def _start_order(order: np.ndarray, x: np.ndarray, is_growing: bool) -> np.ndarray:
    """Return from which order a recurrence down to an order has all digits there, and in its sum."""
    if is_growing:
        start = np.sqrt(order * order + 80.0 * x) + 24.0
    else:
        root = 1.95 + 0.276 * np.sqrt(x)  # x^(1/3) or more: a tangent of it as a function of √x
        start = np.maximum(x + 12.0 * root, order + 4.0 * root + 20.0)
    return np.asarray(start.astype(np.int64))


def _recur(order: np.ndarray, x: np.ndarray, is_growing: bool) -> np.ndarray:
    """Return J_n and J_n+1, or e^-x·I_n and e^-x·I_n+1 if these functions grow [2, n], for x ≥ SMALL.

    order: whole; both [n]
    """
    start = _start_order(order, x, is_growing)
    rank = np.argsort(-start, kind="stable")  # the first ones begin first
    buffer = np.empty((int(start[rank[0]]) + 2, min(x.size, COLUMNS)))
    columns, order = np.arange(COLUMNS), order.astype(np.int64)
    out = np.empty((2, x.size))
    for k in range(0, x.size, COLUMNS):
        some = rank[k : k + COLUMNS]
        rows, total = _fill_rows(start[some], x[some], is_growing, buffer)
        at = columns[: some.size]
        out[0, some], out[1, some] = rows[order[some], at] / total, rows[order[some] + 1, at] / total
    return out


def _fill_rows(start: np.ndarray, x: np.ndarray, is_growing: bool, buffer: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return rows of a recurrence [order, n], and what they are to be divided by [n].

    start: falling, [n]; buffer: that is used, [orders, at least n]
    """
    top = int(start[0])
    begun = np.searchsorted(-start, -np.arange(top + 1), "right").tolist()
    rows, total = buffer[: top + 2, : x.size], np.zeros(x.size)
    rows[...] = 0.0
    rows[start, np.arange(x.size)] = FIRST
    add = np.add if is_growing else np.subtract
    for k in range(top, 0, -1):
        count = begun[k]
        here, below = rows[k, :count], rows[k - 1, :count]
        if is_growing or not k % 2:
            total[:count] += here
        np.divide(2.0 * k, x[:count], below)
        below *= here
        add(below, rows[k + 1, :count], below)
        if not k % STEPS_BETWEEN and np.abs(below).max() > LARGE:
            down = np.where(np.abs(below) > LARGE, FIRST, 1.0)
            rows[k - 1 :, :count] *= down
            total[:count] *= down
    return rows, rows[0] + 2.0 * total


def _sum_powers(order: np.ndarray, x: np.ndarray, sign: float) -> np.ndarray:
    """Return (x/2)^n/n!·(1 ± (x/2)²/(n + 1) + …) for x < SMALL; sign: that of the second term."""
    half = 0.5 * x
    begin, series = np.ones(x.size), np.ones(x.size)
    if not half.any():
        return np.where(order == 0, 1.0, 0.0)
    for k in range(1, int(order.max()) + 1):
        begin = np.where(order >= k, begin * (half / k), begin)
    step = sign * half * half
    for k in range(SERIES_TERMS, 0, -1):
        series = 1.0 + series * step / (k * (order + k))
    return np.asarray(begin * series)


def _pair(order: Any, x: Any, is_growing: bool) -> tuple[np.ndarray, np.ndarray]:
    """Return J_n and J_n+1, or e^-x·I_n and e^-x·I_n+1, of arrays that are broadcast, with x ≥ 0."""
    order, x = np.broadcast_arrays(np.asarray(order, float), np.asarray(x, float))
    shape, order, x = x.shape, order.ravel(), x.ravel()
    is_small = x < SMALL
    is_far = (x > np.maximum(LARGE_OF_I, 0.5 * square(order + 1.0))) if is_growing else np.zeros(x.size, bool)
    rest = ~(is_small | is_far)
    if rest.all() and x.size:
        values = _recur(order, x, is_growing)
        return values[0].reshape(shape), values[1].reshape(shape)
    pair = np.empty((2, x.size))
    if rest.any():
        pair[:, rest] = _recur(order[rest], x[rest], is_growing)
    for n in (0, 1):
        if is_small.any():
            low = _sum_powers(order[is_small] + n, x[is_small], 1.0 if is_growing else -1.0)
            pair[n, is_small] = low * exp(-x[is_small]) if is_growing else low
        if is_far.any():
            pair[n, is_far] = _expand_i(order[is_far] + n, x[is_far])
    return pair[0].reshape(shape), pair[1].reshape(shape)


def _expand_i(order: np.ndarray, x: np.ndarray) -> np.ndarray:
    """Return e^-x·I_n by Hankel's expansion, for large x."""
    series, four = np.ones(x.size), 4.0 * order * order
    for k in range(HANKEL_TERMS_OF_I, 0, -1):
        series = 1.0 - series * (four - square(2 * k - 1)) / (8 * k * x)
    return np.asarray(series / np.sqrt(2.0 * math.pi * x))


def bessel_j(order: Any, x: Any) -> np.ndarray:
    """Return J_n(x), to 2e-15. order: whole, 0 or more; x: 0 or more; arrays that are broadcast"""
    return _pair(order, x, False)[0]


def bessel_j_pair(order: Any, x: Any) -> tuple[np.ndarray, np.ndarray]:
    """Return J_n(x) and J_n+1(x), as bessel_j."""
    return _pair(order, x, False)


def scaled_i(order: Any, x: Any) -> np.ndarray:
    """Return e^-x·I_n(x), to 1e-14 of it. order: whole, 0 or more; x: 0 or more; arrays that are broadcast"""
    return _pair(order, x, True)[0]


def scaled_i_pair(order: Any, x: Any) -> tuple[np.ndarray, np.ndarray]:
    """Return e^-x·I_n(x) and e^-x·I_n+1(x), as scaled_i."""
    return _pair(order, x, True)


# --- J0 and J1 of large arrays


@lru_cache(1)
def _taylor_tables() -> tuple[np.ndarray, np.ndarray]:
    """Return the coefficients of J0 and J1 about the nodes of the table [power of the distance, node].

    Derivatives are sums of Bessel functions: 2·J_n' = J_n-1 - J_n+1, with J_-n = (-1)^n·J_n, and J1 = -J0'.
    """
    nodes = np.arange(int(TABLE_END) * NODES_PER_UNIT + 1) / NODES_PER_UNIT
    orders = np.arange(TAYLOR_TERMS + 1)
    start = np.full(nodes.size - 1, _start_order(orders[-1:], nodes[-1:], False)[0])
    rows, total = _fill_rows(start, nodes[1:], False, np.empty((int(start[0]) + 2, nodes.size - 1)))
    values = np.concatenate([orders[:, None] == 0.0, rows[: orders.size] / total], axis=1)
    table = np.zeros((TAYLOR_TERMS + 1, nodes.size))
    for k in range(TAYLOR_TERMS + 1):
        for j in range(k, -1, -1):  # of J_(2j - k), with the sign (-1)^j
            n = 2 * j - k
            is_minus = (j + (n if n < 0 else 0)) % 2
            table[k] += (-1 if is_minus else 1) * math.comb(k, j) * values[abs(n)]
        table[k] /= (1 << k) * math.factorial(k)
    return table[:-1], -table[1:] * (orders[:-1, None] + 1.0)


def _near(order: int, x: np.ndarray) -> np.ndarray:
    """Return J0 or J1 below the end of the table."""
    table = _taylor_tables()[order]
    node = (x * NODES_PER_UNIT + 0.5).astype(np.int64)
    beside = x - node / NODES_PER_UNIT
    out = table[-1].take(node, mode="clip")
    for row in table[-2::-1]:
        out *= beside
        out += row.take(node, mode="clip")
    return np.asarray(out)


@lru_cache(2)
def _phase_and_size(order: int) -> tuple[list[float], list[float]]:
    """Return the coefficients of θ - x + (n + ½)·π/2, of x^-1, x^-3, …, and of M²·πx/2, of 1, x^-2, …, for J_n =
    M·cos θ at large x: those of M² by 10.18.17 of the handbook, and dθ/dx = 2/(πx·M²)."""
    size = [Fraction(1)]
    for k in range(1, FAR_TERMS + 1):
        size.append(size[-1] * Fraction((2 * k - 1) * (4 * order - (2 * k - 1) * (2 * k - 1)), 8 * k))
    slope = [Fraction(1)]
    for k in range(1, FAR_TERMS + 1):
        slope.append(-sum((size[j] * slope[k - j] for j in range(1, k + 1)), Fraction(0)))
    return [float(slope[k] / (1 - 2 * k)) for k in range(1, FAR_TERMS + 1)], [float(one) for one in size]


def _far(order: int, x: np.ndarray) -> np.ndarray:
    """Return J0 or J1 of large x, beyond the end of the table."""
    of_phase, of_size = _phase_and_size(order)
    inverse = 1.0 / x
    step = inverse * inverse
    r, size = step * of_phase[-1], step * of_size[-1]
    for a, b in zip(of_phase[-2:0:-1], of_size[-2:1:-1], strict=True):
        r += a
        r *= step
        size += b
        size *= step
    r += of_phase[0]
    r *= inverse
    size += of_size[1]
    size *= step
    size += 1.0
    size *= inverse
    size *= 2.0 / math.pi
    # whole steps of a turn, and what is left: its error is multiplied by M, so that fewer digits do than in a sine
    turns = np.floor(x * t.TURN_STEPS_PER_UNIT + 0.5)
    r += ((x - turns * t.TURN_1) - turns * t.TURN_2) - turns * (t.TURN_3 + t.TURN_4)
    i = turns.astype(np.int64)
    i -= t.TURN_STEPS // 8 * (2 * order + 1)
    i &= t.TURN_STEPS - 1
    square_r = r * r
    sine = square_r * t.SINE[2]
    sine += t.SINE[1]
    sine *= square_r
    sine += t.SINE[0]
    sine *= square_r
    sine *= r
    sine += r
    less = square_r * t.COSINE[2]
    less += t.COSINE[1]
    less *= square_r
    less += t.COSINE[0]
    less *= square_r
    along = t.COS.take(i, mode="clip")
    less *= along
    sine *= t.SIN.take(i, mode="clip")
    less -= sine
    less += along
    less *= np.sqrt(size, out=size)
    return less


def _j0_or_j1(order: int, x: Any) -> np.ndarray:
    """Return J0 or J1 of an array of numbers, 0 or more."""
    x = np.asarray(x, float)
    flat = x.ravel()
    near = np.flatnonzero(flat < TABLE_END)
    if near.size == flat.size:
        return _near(order, flat).reshape(x.shape)
    out = np.empty(flat.size)
    for k in range(0, flat.size, BLOCK):
        out[k : k + BLOCK] = _far(order, np.maximum(flat[k : k + BLOCK], TABLE_END))
    out[near] = _near(order, flat[near])
    return out.reshape(x.shape)


def j0(x: Any) -> np.ndarray:
    """Return J0(x), to 1e-15. x: 0 or more, an array"""
    return _j0_or_j1(0, x)


def j1(x: Any) -> np.ndarray:
    """Return J1(x), to 1e-15, and of x where it is small. x: 0 or more, an array"""
    return _j0_or_j1(1, x)


# --- zeros


def zeros_of_j(order: Any, number: Any) -> np.ndarray:
    """Return zeros of J_n beyond 0. order: n, whole; number: of the zero, from 1; arrays that are broadcast

    A guess from the phase far from the turning point, √(x² - n²) - n·arccos(n/x) = (number - 1/4)·π, which is right to
    0.03 radians (Debye's expansion, NIST Handbook of Mathematical Functions, 10.19(iii)), then Newton's method.
    """
    order, number = np.broadcast_arrays(np.asarray(order, float), np.asarray(number, float))
    phase = (number - 0.25) * math.pi
    x = order + phase  # below the zero; the phase is convex, so that Newton's method comes from above afterwards
    for _ in range(PHASE_STEPS):
        root = np.sqrt((x - order) * (x + order))
        x = x - (root - order * arctan2(root, order) - phase) * x / root
    for _ in range(NEWTON_STEPS):
        value, above = bessel_j_pair(order, x)
        x = x - value / (order / x * value - above)
    return np.asarray(x)
