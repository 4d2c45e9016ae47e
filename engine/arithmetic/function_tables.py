"""Numbers of which elementary functions are made, computed with 60 digits (engine.arithmetic.elementary)."""

import math
from decimal import Decimal, localcontext

import numpy as np

STEPS = 128  # intervals of an octave
LARGEST = 746.0  # beyond, exponentials are inf and 0
ALL_DIGITS = 700.0  # below it, they have all digits
EXPONENTIAL = 0.5, 1.0 / 6.0, 1.0 / 24.0, 1.0 / 120.0, 1.0 / 720.0  # of x², x³, …
PI = "3.14159265358979323846264338327950288419716939937510582097494"
TURN_STEPS = 128  # of a turn
LARGEST_ANGLE = 2.0**29  # beyond, an angle is reduced with 60 digits
ROOT_HALF, LN10 = 0.7071067811865476, 2.302585092994046
LARGE_POWER = 32  # whole exponents up to it are products
ARTANH = tuple(2.0 / (2 * n + 1) for n in range(1, 13))  # of x³, x⁵, …
SINE = tuple((-1.0) ** n / math.factorial(2 * n + 1) for n in range(1, 4))  # of x³, x⁵, …
COSINE = tuple((-1.0) ** n / math.factorial(2 * n) for n in range(1, 4))  # of x², x⁴, …
ARCTAN = tuple((-1.0) ** n / (2 * n + 1) for n in range(1, 7))  # of x³, x⁵, …
ARCTAN_EIGHTHS = np.array(  # arctan(i/8)
    [
        *(0.0, 0.12435499454676144, 0.24497866312686414, 0.35877067027057225, 0.4636476090008061),
        *(0.5585993153435624, 0.6435011087932844, 0.7188299996216245, 0.7853981633974483),
    ]
)
ARCTAN_REST = np.array(  # what rounding has left of it
    [
        *(0.0, -3.1253241424539383e-18, 1.0698755618734451e-17, -2.4623815582638635e-17, 2.2698777452961687e-17),
        *(-5.4556305485916264e-18, 1.5834785051444286e-17, -2.1478388444456983e-17, 3.061616997868383e-17),
    ]
)


def _cut(value: Decimal, bits: int) -> tuple[float, Decimal]:
    """Return a multiple of 2^-bits near a value, and what is left: products of it with whole numbers are exact."""
    short = float(round(value * 2**bits)) / 2.0**bits
    return short, value - Decimal(short)


def _octave() -> tuple[np.ndarray, np.ndarray]:
    """Return 2^(i/128), and how much larger it is than that number, as a share."""
    step = Decimal(2) ** (Decimal(1) / STEPS)
    exact = [Decimal(1)]
    while len(exact) < STEPS:
        exact.append(exact[-1] * step)
    near = [float(one) for one in exact]
    return np.array(near), np.array([float(one / Decimal(b) - 1) for one, b in zip(exact, near, strict=True)])


def _circle() -> tuple[np.ndarray, np.ndarray]:
    """Return the sines of the steps of a turn, and what rounding has left of them."""
    exact = [Decimal(0)]
    x = 2 * Decimal(PI) / TURN_STEPS
    sine, cosine = (sum((-1) ** n * x ** (2 * n + m) / math.factorial(2 * n + m) for n in range(20)) for m in (1, 0))
    along = Decimal(1)
    for _ in range(TURN_STEPS // 4):
        exact.append(exact[-1] * cosine + along * sine)
        along = along * cosine - exact[-2] * sine
    exact[-1] = Decimal(1)
    half = [*exact, *exact[-2:0:-1]]
    near = [float(one) for one in half]
    rest = [float(one - Decimal(b)) for one, b in zip(half, near, strict=True)]
    return np.array([*near, *(-b for b in near)]), np.array([*rest, *(-b for b in rest)])


with localcontext() as _context:
    _context.prec = 60
    EXP, EXP_REST = _octave()
    _ln2 = Decimal(2).ln()
    LN2_SHORT, LN2_REST = (float(part) for part in _cut(_ln2, 42))
    STEP_SHORT, STEP_REST = (float(part) for part in _cut(_ln2 / STEPS, 42))
    TURN_1, _rest = _cut(2 * Decimal(PI) / TURN_STEPS, 23)
    TURN_2, _rest = _cut(_rest, 42)
    TURN_3, _rest = _cut(_rest, 61)
    TURN_4 = float(_rest)
    SIN, SIN_REST = _circle()
STEPS_PER_UNIT = STEPS / 0.6931471805599453
TURN_STEPS_PER_UNIT = TURN_STEPS / 6.283185307179586
COS, COS_REST = np.roll(SIN, -TURN_STEPS // 4), np.roll(SIN_REST, -TURN_STEPS // 4)
HALF_PI, HALF_PI_REST = 1.5707963267948966, 6.123233995736766e-17
