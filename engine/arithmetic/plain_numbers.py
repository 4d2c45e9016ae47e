"""The elementary functions of single numbers, 20 times as fast as those of arrays (engine.arithmetic.elementary), with
the same bits and with the errors of Python's `math`: ValueError outside of where a function is defined, OverflowError
beyond the largest number."""

import math
from decimal import Decimal, localcontext
from typing import Any, cast

import numpy as np

from engine.arithmetic import function_tables as t
from engine.arithmetic.double_double import Number, two_product

EXP, EXP_REST = t.EXP.tolist(), t.EXP_REST.tolist()
SIN, SIN_REST, COS, COS_REST = (table.tolist() for table in (t.SIN, t.SIN_REST, t.COS, t.COS_REST))
E_2, E_3, E_4, E_5, E_6 = t.EXPONENTIAL
SINE_3, SINE_5, SINE_7 = t.SINE
COSINE_2, COSINE_4, COSINE_6 = t.COSINE
LARGE_POWER = t.LARGE_POWER


def exp(x: float) -> float:
    """Return e^x."""
    return _checked(exp_or_inf(x), x)


def _checked(value: float, x: float) -> float:
    """Return a value; raise OverflowError if it is infinite, but what it is of is not."""
    if value in (math.inf, -math.inf) and math.isfinite(x):
        raise OverflowError("math range error")
    return value


def exp_or_inf(x: float, rest: float = 0.0) -> float:
    """Return e^(x + rest), or inf where it is too large."""
    if not -t.LARGEST < x < t.LARGEST:
        return x if x != x else math.inf if x > 0.0 else 0.0
    steps = math.floor(x * t.STEPS_PER_UNIT + 0.5)
    r = (x - steps * t.STEP_SHORT) - steps * t.STEP_REST + rest
    a = EXP[steps & 127]
    b = EXP_REST[steps & 127] + (r + r * r * (E_2 + r * (E_3 + r * (E_4 + r * (E_5 + r * E_6)))))
    try:
        return math.ldexp(a + a * b, steps >> 7)
    except OverflowError:
        return math.inf


def _log_parts(x: float) -> tuple[float, float]:
    m, k = math.frexp(x)
    if m < t.ROOT_HALF:
        m, k = 2.0 * m, k - 1
    below = m + 1.0
    s = (m - 1.0) / below
    product, error = two_product(s, below)
    s_rest = (((m - 1.0) - product) - error - s * (m - (below - 1.0))) / below
    square = s * s
    series = 0.0
    for factor in reversed(t.ARTANH):
        series = series * square + factor
    begin, first = k * t.LN2_SHORT, 2.0 * s
    high = begin + first
    lost = (begin - (high - (high - begin))) + (first - (high - begin))
    rest = lost + (k * t.LN2_REST + (2.0 * s_rest + s * square * series))
    total = high + rest
    return total, (high - total) + rest


def log(x: float) -> float:
    """Return ln x."""
    if not 0.0 < x < math.inf:
        if x <= 0.0:
            raise ValueError("math domain error")
        return x
    return _log_parts(x)[0]


def log10(x: float) -> float:
    """Return the decimal logarithm of x, exactly where it is whole."""
    value = log(x) / t.LN10
    whole = float(round(value)) if abs(value) < 300.0 else value
    return whole if float(f"1e{int(whole)}") == x else value


def power(x: float, y: float) -> float:
    """Return x^y."""
    if abs(y) <= LARGE_POWER and float(2.0 * y).is_integer():
        whole, half = divmod(abs(y), 1.0)
        if half and x < 0.0:
            raise ValueError("math domain error")
        total = whole_power(x, int(whole)) * (math.sqrt(x) if half else 1.0)
        if y < 0.0:
            if total == 0.0:
                raise ValueError("math domain error")
            total = 1.0 / total
        if math.isinf(total) and not math.isinf(x):
            raise OverflowError("math range error")
        return total
    if not 0.0 < x < math.inf or not math.isfinite(y):
        if x < 0.0 and math.isfinite(x) and float(y).is_integer():
            return -power(-x, y) if y % 2.0 else power(-x, y)
        return math.pow(x, y)  # of zeros and infinities, which all libraries have alike, and its errors
    high, rest = _log_parts(x)
    product, error = two_product(y, high)
    return _checked(exp_or_inf(product, error + y * rest), product)


def sin(x: float) -> float:
    """Return sin x."""
    return sin_or_nan(_finite(x))


def cos(x: float) -> float:
    """Return cos x."""
    return cos_or_nan(_finite(x))


def _finite(x: float) -> float:
    """Return a number; raise ValueError if it is infinite."""
    if math.isinf(x):
        raise ValueError("math domain error")
    return x


def sin_or_nan(x: float) -> float:
    """Return sin x; of infinity, no number."""
    return _sine_and_cosine(x)[0]


def cos_or_nan(x: float) -> float:
    """Return cos x; of infinity, no number."""
    return _sine_and_cosine(x)[1]


def _sine_and_cosine(x: float) -> tuple[float, float]:
    if not abs(x) < t.LARGEST_ANGLE:
        k, r, rest = turn_steps_of_far(x)
    else:
        k = math.floor(x * t.TURN_STEPS_PER_UNIT + 0.5)
        first, second, third = x - k * t.TURN_1, k * t.TURN_2, k * t.TURN_3
        middle = first - second
        high = middle - third
        low = (((first - middle) - second) + ((middle - high) - third)) - k * t.TURN_4
        r = high + low
        rest = (high - r) + low
    i = k & (t.TURN_STEPS - 1)
    x2 = r * r
    sine = r + (rest + r * x2 * (((x2 * SINE_7) + SINE_5) * x2 + SINE_3))
    less = x2 * (((x2 * COSINE_6) + COSINE_4) * x2 + COSINE_2)
    s, c = SIN[i], COS[i]
    return s + (SIN_REST[i] + s * less + c * sine), c + (COS_REST[i] + c * less - s * sine)


def hypot(x: float, y: float) -> float:
    """Return √(x² + y²)."""
    return math.sqrt(x * x + y * y)


def whole_power(x: Number, n: int) -> Number:
    """Return x^n for n ≥ 0, by products."""
    total: Any = np.ones_like(x) if isinstance(x, np.ndarray) else 1.0
    while n:
        if n & 1:
            total = total * x
        n >>= 1
        if n:
            x = x * x
    return cast(Number, total)


def turn_steps_of_far(x: float) -> tuple[int, float, float]:
    """Return the same of one angle of many turns, a whole number of turns less; not a number where x is not finite."""
    if not math.isfinite(x):
        return 0, math.nan, math.nan
    with localcontext() as context:
        context.prec = 400
        step = 2 * Decimal(t.PI) / t.TURN_STEPS
        turned = Decimal(x) % (2 * Decimal(t.PI))
        k = round(turned / step)
        rest = turned - k * step
        return k, float(rest), float(rest - Decimal(float(rest)))
