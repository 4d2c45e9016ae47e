"""Elementary functions of the tables, against sixty digits: no C library is in them, so that their bits are the same
everywhere."""

import math
from decimal import Decimal, localcontext

import numpy as np
import pytest

from engine.arithmetic import elementary as functions
from engine.arithmetic import function_tables, plain_numbers

PI = Decimal(function_tables.PI)
NUMBERS = 300


@pytest.fixture(autouse=True)
def digits():
    with localcontext() as context:
        context.prec = 60
        yield


def series(x: Decimal, first: Decimal, n: int) -> Decimal:
    """Return the sum of terms first, first·(-x²)/((n + 1)(n + 2)), …"""
    total = term = first
    while abs(term) > Decimal(10) ** -55 * max(abs(total), Decimal(10) ** -400):
        n += 2
        term *= -x * x / (n * (n - 1))
        total += term
    return total


def exact_sine(x: float) -> Decimal:
    rest = (Decimal(x) + PI) % (2 * PI) - PI
    return series(rest, rest, 1)


def exact_cosine(x: float) -> Decimal:
    return series((Decimal(x) + PI) % (2 * PI) - PI, Decimal(1), 0)


def exact_arctan(t: Decimal) -> Decimal:
    halvings = 0
    while abs(t) > Decimal("0.02"):
        t, halvings = t / (1 + (1 + t * t).sqrt()), halvings + 1
    total = term = t
    n = 1
    while abs(term) > Decimal(10) ** -58:
        n, term = n + 2, -term * t * t
        total += term / n
    return total * 2**halvings


def errors(found, exact) -> float:
    """Return the largest error in units of the last place."""
    pairs = zip(np.atleast_1d(found).tolist(), exact, strict=True)
    return max(float(abs(Decimal(a) - b) / Decimal(math.ulp(float(b)))) for a, b in pairs)


def spread(seed: int, low: float, high: float) -> np.ndarray:
    """Return numbers from 10^low to 10^high of both signs, evenly by their logarithms."""
    rng = np.random.default_rng(seed)
    return rng.choice([-1.0, 1.0], NUMBERS) * np.array([10.0**p for p in rng.uniform(low, high, NUMBERS)])


EXPONENTS = np.concatenate([spread(1, -3, 2.8), spread(2, -17, 0), np.arange(-5.0, 6.0)])


def functions_of_exponents():
    def less(x):
        return Decimal(x).exp() - 1

    yield functions.exp, lambda x: Decimal(x).exp(), EXPONENTS, 0.51
    yield functions.expm1, less, EXPONENTS, 2.0
    yield functions.sinh, lambda x: (Decimal(x).exp() - (-Decimal(x)).exp()) / 2, EXPONENTS, 3.0
    yield functions.cosh, lambda x: (Decimal(x).exp() + (-Decimal(x)).exp()) / 2, EXPONENTS, 2.0
    yield (
        functions.tanh,
        lambda x: less(2 * Decimal(x)) / (less(2 * Decimal(x)) + 2),
        EXPONENTS[np.abs(EXPONENTS) < 20],
        3.0,
    )
    yield (
        functions.log,
        lambda x: Decimal(x).ln(),
        np.abs(np.concatenate([spread(3, -300, 300), 1 + spread(4, -12, -1)])),
        0.55,
    )
    yield functions.log1p, lambda x: (1 + Decimal(x)).ln(), np.abs(spread(5, -17, 9)), 1.5
    angles = np.concatenate([spread(6, -9, 3), spread(7, 3, 12), np.arange(-20, 21) * (math.pi / 4)])
    yield functions.sin, exact_sine, angles, 1.1
    yield functions.cos, exact_cosine, angles, 1.1
    yield functions.tan, lambda x: exact_sine(x) / exact_cosine(x), angles, 3.0


@pytest.mark.parametrize("function, exact, x, limit", [*functions_of_exponents()])
def test_functions_are_right_to_their_last_digits(function, exact, x, limit):
    assert errors(function(x), [exact(float(one)) for one in x]) < limit
    assert [float(function(float(one))) for one in x[:50]] == function(x)[:50].tolist()


@pytest.mark.hard
@pytest.mark.parametrize("seed", range(3))
def test_powers_are_right_to_their_last_digits(seed):
    rng = np.random.default_rng(seed)
    x, y = np.abs(spread(seed, -8, 8)), rng.uniform(-30, 30, NUMBERS)
    exact = [(Decimal(b) * Decimal(a).ln()).exp() for a, b in zip(x.tolist(), y.tolist(), strict=True)]
    assert errors(functions.power(x, y), exact) < 1.0
    for whole in (-2, -1, 2, 3, 4, 5, 0.5, 1.5, -0.5):
        of_all = [(Decimal(whole) * Decimal(a).ln()).exp() for a in x.tolist()]
        assert errors(functions.power(x, whole), of_all) < 1.0 + abs(whole)


@pytest.mark.parametrize("x", [-2.5, -1.0, -0.0, 0.0, 0.3, 1.0, 7.0, math.inf, -math.inf, math.nan])
@pytest.mark.parametrize("y", [-40.0, -3.0, -0.3, 0.0, 0.7, 3.0, 33.0, 41.5])
def test_powers_at_the_ends(x, y):
    with np.errstate(all="ignore"):
        want = np.float64(x) ** np.float64(y)
    if not (math.isinf(x) and y == round(y) and y % 2):  # -inf: only of even powers, which is all that tables ask for
        np.testing.assert_allclose(functions.power(x, y), want, rtol=1e-14)


@pytest.mark.parametrize("name", ["exp", "expm1", "cosh", "tanh", "log", "log1p", "sin", "cos", "tan"])
def test_functions_at_the_ends(name):
    x = np.array([0.0, 1e-320, 1e5, 1e9, math.inf, math.nan] + [-800.0, -math.inf] * (name in ("exp", "expm1", "tanh")))
    with np.errstate(all="ignore"):
        np.testing.assert_allclose(getattr(functions, name)(x), getattr(np, name)(x), rtol=1e-15, atol=1e-320)


def test_angles_of_places():
    x, y = spread(9, -3, 3), spread(10, -3, 3)
    quadrant = [Decimal(0) if a > 0 else (PI if b >= 0 else -PI) for a, b in zip(x.tolist(), y.tolist(), strict=True)]
    exact = [
        exact_arctan(Decimal(b) / Decimal(a)) + c for a, b, c in zip(x.tolist(), y.tolist(), quadrant, strict=True)
    ]
    assert errors(functions.arctan2(y, x), exact) < 2.0
    ends = np.array([0.0, -0.0, 1.0, -1.0])
    np.testing.assert_allclose(functions.arctan2(ends[:, None], ends), np.arctan2(ends[:, None], ends), rtol=1e-15)
    assert (
        errors(
            functions.hypot(x, y),
            [(Decimal(a) ** 2 + Decimal(b) ** 2).sqrt() for a, b in zip(x.tolist(), y.tolist(), strict=True)],
        )
        < 1.5
    )


@pytest.mark.parametrize("name", ["exp", "log", "sin", "cos"])
def test_single_numbers_have_the_same_bits(name):
    x = np.abs(spread(11, -6, 2.7)) if name == "log" else spread(11, -6, 2.7)
    of_one = [getattr(plain_numbers, name)(value) for value in x.tolist()]
    assert of_one == getattr(functions, name)(x).tolist()


@pytest.mark.parametrize("y", [-3.0, -1.5, 0.3, 2.0, 7.5, 40.0, 0.0])
def test_powers_of_single_numbers_have_the_same_bits(y):
    x = np.abs(spread(12, -6, 6))
    assert [plain_numbers.power(value, y) for value in x.tolist()] == functions.power(x, y).tolist()
    if y == round(y):
        assert [plain_numbers.power(-value, y) for value in x.tolist()] == functions.power(-x, y).tolist()


def test_logarithms_of_powers_of_ten_are_whole():
    assert [plain_numbers.log10(float(f"1e{n}")) for n in range(-300, 301)] == [float(n) for n in range(-300, 301)]


@pytest.mark.parametrize(
    "call", ["exp(800)", "log(0)", "log(-1)", "sin(inf)", "power(-2, 0.5)", "power(0, -1)", "power(10, 400)"]
)
def test_single_numbers_raise_what_math_raises(call):
    names = {"inf": math.inf} | {name: getattr(math, name) for name in ("exp", "log", "sin")} | {"power": math.pow}
    with pytest.raises(ArithmeticError if call in ("exp(800)", "power(10, 400)") else ValueError):
        eval(call, names)
    with pytest.raises(ArithmeticError if call in ("exp(800)", "power(10, 400)") else ValueError):
        eval(call, {"inf": math.inf} | {name: getattr(plain_numbers, name) for name in ("exp", "log", "sin", "power")})
