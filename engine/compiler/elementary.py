"""Powers, logarithms and exponentials whose bits are the same on any machine and in a browser: those of the C libraries
differ. In compiled code only.

ln x = k·ln 2 + ln c + ln(1 + r) and e^x = 2^(k + i/128)·e^r, with c and 2^(i/128) from tables and short series for the
rest. The logarithm has twice the digits of a number, so that a power is off by 0.51 of its last digit at most.
"""

import math
from decimal import Decimal, localcontext
from typing import Any

import numpy as np
from llvmlite import ir
from numba.core import types

from engine.compiler.decorators import inline, noinline
from engine.compiler.intrinsic import intrinsic
from engine.compiler.lanes import multiply_add

STEPS = 128  # intervals of an octave
DIGITS = 50  # of what the tables are computed with
SHORT = 2.0**42  # numbers are cut to multiples of its inverse, so that their sums and products with k are exact
MANTISSA, INTERVAL = 52, 45  # bits of a number below its exponent, and below the number of its interval
ONE = 0x3FF0000000000000  # the bits of 1.0
FIRST = ONE - (75 << INTERVAL) - (1 << (INTERVAL - 1))  # where the first interval begins; 1.0 is amid the 75th
LARGEST, SMALLEST = 709.7827128933841, -745.2  # whose exponentials are no more than the largest number, and not 0
SERIES_LIMIT = 0.05  # below it, what a table leaves would have too few digits of e^x - 1
SINE_SERIES = tuple((-1.0) ** n / math.factorial(2 * n + 1) for n in range(1, 13))  # of x³, x⁵, …
TINY = 2.2250738585072014e-308  # below it, numbers have fewer digits


def _number(bits: int) -> float:
    return float(np.int64(bits).view(np.float64))


def _short_and_rest(value: Decimal) -> tuple[float, float]:
    """Return a multiple of 1/SHORT near a value, and what is left."""
    short = round(value * Decimal(SHORT)) / SHORT
    return short, float(value - Decimal(short))


def _logarithm_tables() -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return 1/c for each interval, about whose middle c is, and ln c, cut and the rest."""
    edges = [_number(FIRST + (i << INTERVAL)) for i in range(STEPS + 1)]
    inverse = [2.0 / (edges[i] + edges[i + 1]) for i in range(STEPS)]
    inverse[75] = 1.0  # near 1.0 all digits of the logarithm come from r
    logarithms = [_short_and_rest(-Decimal(one).ln()) for one in inverse]
    return np.array(inverse), *np.array(logarithms).T.copy()


def _exponential_tables() -> tuple[np.ndarray, np.ndarray]:
    """Return 2^(i/128), and how much larger it is than that number, as a share."""
    exact = [Decimal(2) ** (Decimal(i) / STEPS) for i in range(STEPS)]
    near = [float(one) for one in exact]
    return np.array(near), np.array([float(one / Decimal(b) - 1) for one, b in zip(exact, near, strict=True)])


with localcontext() as _context:
    _context.prec = DIGITS
    INVERSE, LOG_SHORT, LOG_REST = _logarithm_tables()
    EXP, EXP_REST = _exponential_tables()
    LN2_SHORT, LN2_REST = _short_and_rest(Decimal(2).ln())
    STEP_SHORT, STEP_REST = _short_and_rest(Decimal(2).ln() / STEPS)
STEPS_PER_UNIT = STEPS / math.log(2.0)


@intrinsic
def bits_of(x: Any) -> Any:
    """Return the bits of a number as an integer."""
    return types.int64(x), lambda context, builder, sig, args: builder.bitcast(args[0], ir.IntType(64))


@intrinsic
def number_of(bits: Any) -> Any:
    """Return the number that has these bits."""
    return types.float64(bits), lambda context, builder, sig, args: builder.bitcast(args[0], ir.DoubleType())


# --- parts


@inline
def log_parts(x):
    """Return ln x as a sum of two numbers, the second far smaller. x: at least TINY, finite"""
    shifted = bits_of(x) - FIRST
    k, i = shifted >> MANTISSA, (shifted >> INTERVAL) & (STEPS - 1)
    z, c = number_of(bits_of(x) - (k << MANTISSA)), INVERSE[i]
    product = z * c
    low = multiply_add(z, c, -product)
    r = (product - 1.0) + low
    r_rest = ((product - 1.0) - r) + low
    begin = k * LN2_SHORT + LOG_SHORT[i]  # exact
    first = begin + r
    half = -0.5 * r
    square = r * half
    high = first + square
    rest = k * LN2_REST + LOG_REST[i] + r_rest + (begin - first + r)
    rest += multiply_add(half, r, -square) + (first - high + square)
    r2 = r * r  # the series in pairs, which a processor finds side by side
    series = (1.0 / 3.0 - r * 0.25) + r2 * ((0.2 - r * (1.0 / 6.0)) + r2 * ((1.0 / 7.0 - r * 0.125) + r2 * (1.0 / 9.0)))
    rest += r2 * r * series
    total = high + rest
    return total, high - total + rest


@inline
def exp_parts(x, rest):
    """Return e^(x + rest) as n, a and b: it is 2^n·(a + a·b), with a from 1 to 2. x: between SMALLEST and LARGEST"""
    steps = math.floor(x * STEPS_PER_UNIT + 0.5)
    number = np.int64(steps)
    r = multiply_add(-steps, STEP_REST, multiply_add(-steps, STEP_SHORT, x)) + rest
    i = number & (STEPS - 1)
    r2 = r * r
    series = r2 * ((0.5 + r * (1.0 / 6.0)) + r2 * (1.0 / 24.0 + r * (1.0 / 120.0)))
    return number >> 7, EXP[i], EXP_REST[i] + (r + series)


@inline
def times_power_of_two(x, n):
    """Return x·2^n for x from 1 to 2."""
    if n >= -1021:
        return number_of(bits_of(x) + (n << MANTISSA))
    return number_of(bits_of(x) + ((n + 200) << MANTISSA)) * 2.0**-200


@inline
def exp_of_sum(x, rest):
    """Return e^(x + rest)."""
    if x > LARGEST:
        return math.inf
    if not x > SMALLEST:
        return 0.0
    n, a, b = exp_parts(x, rest)
    return times_power_of_two(a + a * b, n)


# --- functions


@noinline
def power_of(x, y):
    """Return x^y for x ≥ 0 and a finite y > 0."""
    if not 0.0 < x < math.inf:
        return x  # also if x is not a number
    if x < TINY:
        high, rest = log_parts(x * 2.0**52)
        high -= 52.0 * math.log(2.0)
    else:
        high, rest = log_parts(x)
    product = y * high
    return exp_of_sum(product, multiply_add(y, high, -product) + y * rest)


@noinline
def log1p_of(x):
    """Return ln(1 + x) for x > -1, to the last digit also where x is small."""
    whole = 1.0 + x
    if not 0.0 < whole < math.inf:
        return math.inf if whole > 0.0 else -math.inf if whole == 0.0 else math.nan
    low = x - (whole - 1.0) if abs(x) < 1.0 else 1.0 - (whole - x)  # exact: what rounding took from 1 + x
    high, rest = log_parts(whole)
    return high + (rest + low / whole)


@noinline
def expm1_of(x):
    """Return e^x - 1, to the last digit also where x is small."""
    if x > LARGEST:
        return math.inf
    if x < -40.0:
        return -1.0
    if abs(x) < SERIES_LIMIT:
        series = 1.0
        for n in range(10, 2, -1):
            series = 1.0 + x * series / n
        return x + 0.5 * x * x * series
    n, a, b = exp_parts(x, 0.0)
    scale = times_power_of_two(a, n)
    return (scale - 1.0) + scale * b


@inline
def rise(u):
    """Return (1 - cos πu)/2 for u from 0 to 1: a smooth rise from 0 to 1."""
    sine = sine_to_quarter(0.5 * math.pi * u)
    return sine * sine


@inline
def rise_integral(u):
    """Return the integral of `rise` from 0 to u, for u from 0 to 1: (u - sin(πu)/π)/2."""
    return 0.5 * (u - sine_to_quarter(math.pi * min(u, 1.0 - u)) * (1.0 / math.pi))


@inline
def sine_of_turns(turns):
    """Return sin 2π·turns for any number of turns."""
    part = turns - math.floor(turns)
    sign = 1.0
    if part >= 0.5:
        part, sign = part - 0.5, -1.0
    return sign * sine_to_quarter(2.0 * math.pi * min(part, 0.5 - part))


@inline
def sine_to_quarter(x):
    """Return sin x for x from 0 to π/2, by its series; every second term together, which a processor finds side by
    side."""
    square = x * x
    fourth, even, odd = square * square, 0.0, 0.0
    for n in range(len(SINE_SERIES) - 2, -1, -2):
        even, odd = even * fourth + SINE_SERIES[n], odd * fourth + SINE_SERIES[n + 1]
    return x + x * square * (even + square * odd)
