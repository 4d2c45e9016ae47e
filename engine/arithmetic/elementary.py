"""Elementary functions of arrays and numbers, in double precision, with the same bits on every machine: those of NumPy
and of the C libraries differ by processor. Errors are about one unit in the last place, unless said otherwise.

e^x = 2^(n + i/128)·e^r, with 2^(i/128) from a table computed with 50 digits and a short series for the rest; ln x =
k·ln 2 + 2·artanh((m - 1)/(m + 1)), with twice the digits of a number where powers need them. Sines and cosines of what
is left of an angle beside whole 128ths of a turn are series.
"""

import math
from collections.abc import Callable
from typing import Any

import numpy as np

from engine.arithmetic import function_tables as t
from engine.arithmetic import plain_numbers
from engine.arithmetic.double_double import Number, two_product

FEW = 24  # numbers: of so few, one by one takes half the time at most


def _series(x: Any, factors: tuple[float, ...]) -> Any:
    """Return c0 + c1·x + c2·x² + …"""
    total = x * factors[-1]
    total += factors[-2]
    for factor in factors[-3::-1]:
        total *= x
        total += factor
    return total


# --- exponentials


def _exp_parts(x: Any, rest: Any = 0.0) -> tuple[Any, Any, Any]:
    """Return e^(x + rest) as n, a and b: it is 2^n·(a + a·b), with a from 1 to 2. x: at most t.LARGEST in size"""
    steps = np.floor(x * t.STEPS_PER_UNIT + 0.5)
    r = (x - steps * t.STEP_SHORT) - steps * t.STEP_REST + rest
    number = steps.astype(np.int64)
    i = number & (t.STEPS - 1)
    return number >> 7, t.EXP[i], t.EXP_REST[i] + (r + r * r * _series(r, t.EXPONENTIAL))


def _exp_of_sum(x: Any, rest: Any) -> Any:
    """Return e^(x + rest)."""
    if x.size and not np.abs(x).max() < t.ALL_DIGITS:
        bounded = np.where(x == x, np.minimum(np.maximum(x, -t.LARGEST), t.LARGEST), 0.0)
        n, a, b = _exp_parts(bounded, rest)
        with np.errstate(over="ignore", under="ignore"):
            return np.where(x == x, np.ldexp(a + a * b, n), x)[()]
    n, a, b = _exp_parts(x, rest)
    return np.ldexp(a + a * b, n)


def exp(x: Any) -> Any:
    """Return e^x."""
    x = np.asarray(x, float)
    if x.size <= FEW:
        return _of_each(plain_numbers.exp_or_inf, x)
    return _exp_of_sum(x, 0.0)


def _of_each(function: Callable[[float], float], x: np.ndarray) -> Any:
    """Return a function of each number of a small array."""
    return np.array([function(value) for value in x.ravel().tolist()]).reshape(x.shape)[()]


def expm1(x: Any) -> Any:
    """Return e^x - 1, also where x is small, to two units in the last place."""
    x = np.asarray(x, float)
    if x.size and not np.abs(x).max() < t.ALL_DIGITS:
        return np.where(np.abs(x) < 40.0, expm1(np.where(np.abs(x) < 40.0, x, 0.0)), exp(x) - 1.0)[()]
    n, a, b = _exp_parts(x)
    scale = np.ldexp(a, n)
    return (scale - 1.0) + scale * b


def sinh(x: Any) -> Any:
    """Return sinh x, to three units in the last place."""
    x = np.asarray(x, float)
    less = expm1(np.abs(x))
    with np.errstate(invalid="ignore"):
        half = 0.5 * (less + np.where(np.isinf(less), 1.0, less / (less + 1.0)))
    return np.copysign(half, x)


def cosh(x: Any) -> Any:
    """Return cosh x, to two units in the last place."""
    whole = exp(np.abs(np.asarray(x, float)))
    return 0.5 * whole + 0.5 / whole


def tanh(x: Any) -> Any:
    """Return tanh x, to three units in the last place."""
    x = np.asarray(x, float)
    less = expm1(2.0 * np.minimum(np.abs(x), 30.0))
    return np.copysign(less / (less + 2.0), x)


# --- logarithms and powers


def _log_parts(x: Any) -> tuple[Any, Any]:
    """Return ln x as a sum of two numbers, the second far smaller; x: positive and finite."""
    m, k = np.frexp(x)
    low = m < t.ROOT_HALF
    m, k = np.where(low, 2.0 * m, m), k - low
    below = m + 1.0
    s = (m - 1.0) / below
    product, error = two_product(s, below)
    s_rest = (((m - 1.0) - product) - error - s * (m - (below - 1.0))) / below
    square = s * s
    begin, first = k * t.LN2_SHORT, 2.0 * s  # the first exact
    high = begin + first
    lost = (begin - (high - (high - begin))) + (first - (high - begin))
    rest = lost + (k * t.LN2_REST + (2.0 * s_rest + s * square * _series(square, t.ARTANH)))
    total = high + rest
    return total, (high - total) + rest


def log(x: Any) -> Any:
    """Return ln x: -inf of 0, and no number of what is below."""
    x = np.asarray(x, float)
    is_plain = (x > 0.0) & (x < math.inf)
    total, _ = _log_parts(np.where(is_plain, x, 1.0))
    return np.where(is_plain, total, np.where(x == 0.0, -math.inf, np.where(x > 0.0, x, math.nan)))[()]


def log1p(x: Any) -> Any:
    """Return ln(1 + x), also where x is small, to two units in the last place."""
    x = np.asarray(x, float)
    whole = 1.0 + x
    near = (whole > 0.0) & (whole < math.inf)
    safe, part = np.where(near, whole, 1.0), np.where(near, x, 0.0)
    high, rest = _log_parts(safe)
    lost = np.where(np.abs(part) < 1.0, part - (safe - 1.0), 1.0 - (safe - part))
    return np.where(near, high + (rest + lost / safe), log(whole))[()]


def power(x: Any, y: Any) -> Any:
    """Return x^y; for x < 0 where y is whole. Whole powers up to 32 are products, to about |y|/2 units in the last
    place, and powers of ½ are square roots."""
    if np.ndim(y) == 0 and float(2 * y).is_integer() and abs(y) <= t.LARGE_POWER:
        whole, half = divmod(abs(float(y)), 1.0)
        total = plain_numbers.whole_power(np.asarray(x, float), int(whole))
        total = total * np.sqrt(np.asarray(x, float)) if half else total
        with np.errstate(divide="ignore"):
            return 1.0 / total if y < 0 else total
    x, y = np.asarray(x, float), np.asarray(y, float)
    size = np.abs(x)
    is_plain = (size > 0.0) & (size < math.inf)
    high, rest = _log_parts(np.where(is_plain, size, 1.0))
    product, error = two_product(np.minimum(np.maximum(y, -1e18), 1e18), high)
    total = _exp_of_sum(product, error + y * rest)
    with np.errstate(divide="ignore", invalid="ignore"):
        at_end = np.where((size == 0.0) == (y > 0.0), 0.0, math.inf)
        total = np.where(is_plain, total, np.where(y == 0.0, 1.0, np.where(size == size, at_end, math.nan)))
        is_whole = (np.floor(y) == y) | ~is_plain
        odd = (np.floor(y) == y) & (np.floor(0.5 * y) != 0.5 * y)
    return np.where(x < 0.0, np.where(is_whole, np.where(odd, -total, total), math.nan), total)[()]


def square(x: Number) -> Number:
    """Return x·x."""
    product: Number = x * x
    return product


def interpolate(x: Any, places: Any, values: Any) -> np.ndarray:
    """Return a function that goes in straight lines through its values at rising places, and is constant outside."""
    places, values, x = np.asarray(places, float), np.asarray(values, float), np.asarray(x, float)
    n = np.clip(np.searchsorted(places, x, "right"), 1, max(1, places.size - 1))
    if places.size == 1:
        return np.full(x.shape, values[0])
    begin, end = places[n - 1], places[n]
    share = np.clip((x - begin) / np.where(end > begin, end - begin, 1.0), 0.0, 1.0)
    return np.asarray(np.where(x >= end, values[n], values[n - 1] + share * (values[n] - values[n - 1])))


# --- angles


def _turn_steps(x: Any) -> tuple[Any, Any, Any]:
    """Return how many steps of a turn are nearest to an angle, and what is left of it as a sum of two numbers."""
    if x.size and not np.abs(x).max() < t.LARGEST_ANGLE:
        return _turn_steps_of_any(x)
    k = np.floor(x * t.TURN_STEPS_PER_UNIT + 0.5)
    first, second, third = x - k * t.TURN_1, k * t.TURN_2, k * t.TURN_3  # exact
    middle = first - second
    high = middle - third
    low = (((first - middle) - second) + ((middle - high) - third)) - k * t.TURN_4
    r = high + low
    return k.astype(np.int64), r, (high - r) + low


def _turn_steps_of_any(x: np.ndarray) -> tuple[Any, Any, Any]:
    """Return the same where some angles are of many turns, or not finite."""
    far = ~(np.abs(x) < t.LARGEST_ANGLE)
    parts = tuple(np.array(part, ndmin=1) for part in _turn_steps(np.where(far, 0.0, x)))
    for place in np.argwhere(np.atleast_1d(far)):
        for part, value in zip(
            parts, plain_numbers.turn_steps_of_far(float(np.atleast_1d(x)[tuple(place)])), strict=True
        ):
            part[tuple(place)] = value
    k, r, rest = (part.reshape(np.shape(x)) for part in parts)
    return k, r, rest


def sin(x: Any) -> Any:
    """Return sin x."""
    x = np.asarray(x, float)
    return _of_each(plain_numbers.sin_or_nan, x) if x.size <= FEW else sin_and_cos(x)[0]


def cos(x: Any) -> Any:
    """Return cos x."""
    x = np.asarray(x, float)
    return _of_each(plain_numbers.cos_or_nan, x) if x.size <= FEW else sin_and_cos(x)[1]


def sin_and_cos(x: Any) -> tuple[Any, Any]:
    """Return sin x and cos x."""
    k, r, rest = _turn_steps(np.asarray(x, float))
    i = k & (t.TURN_STEPS - 1)
    x2 = r * r
    sine, less = r + (rest + r * x2 * _series(x2, t.SINE)), x2 * _series(x2, t.COSINE)  # of what is left, cosine - 1
    s, c = t.SIN[i], t.COS[i]
    return s + (t.SIN_REST[i] + s * less + c * sine), c + (t.COS_REST[i] + c * less - s * sine)


def sinc(x: Any) -> Any:
    """Return sin(πx)/(πx)."""
    angle = math.pi * np.asarray(x, float)
    is_zero = angle == 0.0
    return np.where(is_zero, 1.0, sin(angle) / np.where(is_zero, 1.0, angle))[()]


def tan(x: Any) -> Any:
    """Return tan x, to three units in the last place."""
    sine, cosine = sin_and_cos(x)
    return sine / cosine


def arctan2(y: Any, x: Any) -> Any:
    """Return the angle of (x, y) from the axis of x, from -π to π, to two units in the last place."""
    y, x = np.asarray(y, float), np.asarray(x, float)
    up, along = np.abs(y), np.abs(x)
    steep = up > along
    low, high = np.where(steep, along, up), np.where(steep, up, along)
    i = np.floor(8.0 * (low / np.where(high == 0.0, 1.0, high)) + 0.5)
    r = (8.0 * low - i * high) / np.where(high == 0.0, 1.0, 8.0 * high + i * low)
    i = np.where(i == i, i, 0.0).astype(np.int64)
    square = r * r
    rest = t.ARCTAN_REST[i] + r * square * _series(square, t.ARCTAN)
    angle = t.ARCTAN_EIGHTHS[i] + (r + rest)
    angle = np.where(steep, (t.HALF_PI - angle) + t.HALF_PI_REST, angle)
    angle = np.where(np.signbit(x), (2.0 * t.HALF_PI - angle) + 2.0 * t.HALF_PI_REST, angle)
    return np.copysign(angle, y)[()]


def hypot(x: Any, y: Any) -> Any:
    """Return √(x² + y²), to one unit in the last place; neither may be beyond 1e150."""
    x, y = np.asarray(x, float), np.asarray(y, float)
    return np.sqrt(x * x + y * y)
