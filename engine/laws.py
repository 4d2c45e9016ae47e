"""Contact laws: the one-sided power law f(s) = kc·[s]₊^α (paper, eq. 1) and its potential.

The exponent is part of a law's type, so that a kernel holds the arithmetic of
its own exponents only. To add an exponent: a class, and three functions in
`_POWER`, `_ROOT` and `_MEAN`. Everything else follows from them.

All compressions are in metres; `k` is the contact's index in its law's arrays.
"""

import math
from typing import Any, NamedTuple

import numpy as np
from numba.extending import overload

from engine.jit import jit


class Linear(NamedTuple):
    """Contacts with α = 1."""

    stiffness: np.ndarray
    exponent: np.ndarray


class Hertz(NamedTuple):
    """Contacts with α = 1.5, two smooth elastic bodies."""

    stiffness: np.ndarray
    exponent: np.ndarray


class Quadratic(NamedTuple):
    """Contacts with α = 2."""

    stiffness: np.ndarray
    exponent: np.ndarray


class Felt(NamedTuple):
    """Contacts with α = 2.5, as piano hammers have."""

    stiffness: np.ndarray
    exponent: np.ndarray


class Cubic(NamedTuple):
    """Contacts with α = 3."""

    stiffness: np.ndarray
    exponent: np.ndarray


class Power(NamedTuple):
    """Contacts with any α ≥ 1, each its own."""

    stiffness: np.ndarray
    exponent: np.ndarray


Law = Linear | Hertz | Quadratic | Felt | Cubic | Power
OF_EXPONENT = {1.0: Linear, 1.5: Hertz, 2.0: Quadratic, 2.5: Felt, 3.0: Cubic}


def law_of(stiffness: np.ndarray, exponent: np.ndarray) -> Law:
    """The most special law that holds all the given contacts."""
    shared = set(exponent.tolist())
    kind: Any = OF_EXPONENT.get(shared.pop(), Power) if len(shared) == 1 else Power
    return kind(stiffness, exponent)


# x^α, x^(1/α), and the mean of x^α over [a, b], which is (b^(α+1) - a^(α+1)) / ((α+1)(b - a)),
# each without cancellation. `mean` is given d = |b - a|, which is known more precisely.


def _mean_linear(law, k, a, b, d):
    return 0.5 * (a + b)


def _mean_hertz(law, k, a, b, d):
    u, v = math.sqrt(a), math.sqrt(b)
    return 0.4 * (a * a + b * b + u * v * (a + u * v + b)) / (u + v)


def _mean_quadratic(law, k, a, b, d):
    return (a * a + a * b + b * b) / 3.0


def _mean_felt(law, k, a, b, d):
    u, v = math.sqrt(a), math.sqrt(b)
    a2, b2, uv = a * a, b * b, u * v
    return (a2 * a + b2 * b + uv * (a2 + b2 + a * b) + a * b * (a + b)) / (3.5 * (u + v))


def _mean_cubic(law, k, a, b, d):
    return 0.25 * (a + b) * (a * a + b * b)


def _mean_power(law, k, a, b, d):
    # based on the larger of the two, or it overflows
    n = law.exponent[k] + 1.0
    m = max(a, b)
    part = d / m
    whole = m ** law.exponent[k]
    if part == 0.0:
        return whole
    if part >= 1.0:
        return whole / n
    return whole * (-math.expm1(n * math.log1p(-part))) / (n * part)


_POWER = {
    Linear: lambda law, k, x: x,
    Hertz: lambda law, k, x: x * math.sqrt(x),
    Quadratic: lambda law, k, x: x * x,
    Felt: lambda law, k, x: x * x * math.sqrt(x),
    Cubic: lambda law, k, x: x * x * x,
    Power: lambda law, k, x: x ** law.exponent[k],
}
_ROOT = {
    Linear: lambda law, k, x: x,
    Hertz: lambda law, k, x: x ** (2.0 / 3.0),
    Quadratic: lambda law, k, x: math.sqrt(x),
    Felt: lambda law, k, x: x**0.4,
    Cubic: lambda law, k, x: x ** (1.0 / 3.0),
    Power: lambda law, k, x: x ** (1.0 / law.exponent[k]),
}
_MEAN = {
    Linear: _mean_linear,
    Hertz: _mean_hertz,
    Quadratic: _mean_quadratic,
    Felt: _mean_felt,
    Cubic: _mean_cubic,
    Power: _mean_power,
}


def power(law: Law, k: int, x: float) -> float:
    """x^α for x ≥ 0."""
    return _POWER[type(law)](law, k, x)


def root(law: Law, k: int, x: float) -> float:
    """x^(1/α) for x ≥ 0."""
    return _ROOT[type(law)](law, k, x)


def mean(law: Law, k: int, a: float, b: float, d: float) -> float:
    """Mean of x^α over [a, b] with a, b ≥ 0, not both 0, and d = |b - a|."""
    return _MEAN[type(law)](law, k, a, b, d)


@overload(power)
def _power(law, k, x):
    return _POWER[law.instance_class]


@overload(root)
def _root(law, k, x):
    return _ROOT[law.instance_class]


@overload(mean)
def _mean(law, k, a, b, d):
    return _MEAN[law.instance_class]


@jit
def potential(law, k, s):
    """Stored energy V(s) = kc·[s]₊^(α+1)/(α+1), in joule."""
    if s <= 0.0:
        return 0.0
    return law.stiffness[k] / (law.exponent[k] + 1.0) * s * power(law, k, s)


@jit
def gradient(law, k, s, b, eta):
    """Discrete gradient per unit stiffness, φ/kc = (V(b) - V(s)) / (kc·η), and its first three
    derivatives with respect to the end compression b.

    For b > 0; s is the start compression and η = b - s, carried apart so that neither
    cancels (DESIGN sec. 3). Relative error a few 1e-16.
    """
    alpha = law.exponent[k]
    end = power(law, k, b)
    if s <= 0.0:  # entering: only part of the step is spent in contact
        phi = end * (b / eta) / (alpha + 1.0)
    else:
        phi = mean(law, k, s, b, abs(eta))
    e = eta / b
    one = alpha * end / b
    two = (alpha - 1.0) * one / b
    if abs(e) < 1e-3:  # series of the mean about b; the quotients below would cancel
        c = (alpha - 2.0) * e
        d = (alpha - 3.0) * e
        first = one * (0.5 - (alpha - 1.0) * e * (1.0 / 6.0 - c * (1.0 / 24.0 - d / 120.0)))
        second = two * (1.0 / 3.0 - c * (1.0 / 12.0 - d / 60.0))
        third = two * (alpha - 2.0) / b * 0.25
    else:
        over = 1.0 / eta
        first = (end - phi) * over
        second = (one - 2.0 * first) * over
        third = (two - 3.0 * second) * over
    return phi, first, second, third
