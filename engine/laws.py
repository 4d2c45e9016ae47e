"""Contact laws: the one-sided power law f(s) = kc·[s]₊^α (paper, eq. 1) and its potential.

The exponent is part of a law's type, so that a kernel holds the arithmetic of
its own exponents only. To add an exponent: a class, and its functions in
`_EXPONENT`, `_POWER`, `_ROOT` and `_SPAN`. Everything else follows from them.

All compressions are in metres; `k` is the contact's index in its law's arrays. Energies and
forces are counted in `unit` = kc/(α+1), in N/m^α: V(s) = unit·[s]₊^(α+1).
"""

import math
from typing import Any, NamedTuple

import numpy as np
from numba.extending import overload

from engine.jit import jit


class Linear(NamedTuple):
    """Contacts with α = 1."""

    unit: np.ndarray
    exponent: np.ndarray


class Hertz(NamedTuple):
    """Contacts with α = 1.5, two smooth elastic bodies."""

    unit: np.ndarray
    exponent: np.ndarray


class Quadratic(NamedTuple):
    """Contacts with α = 2."""

    unit: np.ndarray
    exponent: np.ndarray


class Felt(NamedTuple):
    """Contacts with α = 2.5, as piano hammers have."""

    unit: np.ndarray
    exponent: np.ndarray


class Cubic(NamedTuple):
    """Contacts with α = 3."""

    unit: np.ndarray
    exponent: np.ndarray


class Power(NamedTuple):
    """Contacts with any α ≥ 1, each its own."""

    unit: np.ndarray
    exponent: np.ndarray


Law = Linear | Hertz | Quadratic | Felt | Cubic | Power
OF_EXPONENT = {1.0: Linear, 1.5: Hertz, 2.0: Quadratic, 2.5: Felt, 3.0: Cubic}


def law_of(stiffness: np.ndarray, exponent: np.ndarray, general: bool = False) -> Law:
    """The most special law that holds all the given contacts; the most general if exponents are to change."""
    shared = set(exponent.tolist())
    kind: Any = OF_EXPONENT.get(shared.pop(), Power) if len(shared) == 1 and not general else Power
    law: Law = kind(stiffness / (exponent + 1), exponent)
    return law


# x^α, x^(1/α), and the span (b^(α+1) - a^(α+1))/(b - a), which is α + 1 times the mean of x^α
# over [a, b]; each without cancellation. `span` is given d = |b - a|, known more precisely.


def _span_linear(law, k, a, b, d):
    return a + b


def _span_hertz(law, k, a, b, d):
    u, v = math.sqrt(a), math.sqrt(b)
    return (a * a + b * b + u * v * (a + u * v + b)) / (u + v)


def _span_quadratic(law, k, a, b, d):
    return a * a + a * b + b * b


def _span_felt(law, k, a, b, d):
    u, v = math.sqrt(a), math.sqrt(b)
    a2, b2, uv = a * a, b * b, u * v
    return (a2 * a + b2 * b + uv * (a2 + b2 + a * b) + a * b * (a + b)) / (u + v)


def _span_cubic(law, k, a, b, d):
    return (a + b) * (a * a + b * b)


def _span_power(law, k, a, b, d):
    # based on the larger of the two, or it overflows
    n = law.exponent[k] + 1.0
    m = max(a, b)
    part = d / m
    whole = m ** law.exponent[k]
    if part == 0.0:
        return whole * n
    if part >= 1.0:
        return whole
    return whole * (-math.expm1(n * math.log1p(-part))) / part


_EXPONENT = {
    Linear: lambda law, k: 1.0,
    Hertz: lambda law, k: 1.5,
    Quadratic: lambda law, k: 2.0,
    Felt: lambda law, k: 2.5,
    Cubic: lambda law, k: 3.0,
    Power: lambda law, k: law.exponent[k],
}
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
_SPAN = {
    Linear: _span_linear,
    Hertz: _span_hertz,
    Quadratic: _span_quadratic,
    Felt: _span_felt,
    Cubic: _span_cubic,
    Power: _span_power,
}


def exponent(law: Law, k: int) -> float:
    """α of contact k: a constant of the compiled code where the type says it."""
    return float(_EXPONENT[type(law)](law, k))


def power(law: Law, k: int, x: float) -> float:
    """x^α for x ≥ 0."""
    return float(_POWER[type(law)](law, k, x))


def root(law: Law, k: int, x: float) -> float:
    """x^(1/α) for x ≥ 0."""
    return float(_ROOT[type(law)](law, k, x))


def span(law: Law, k: int, a: float, b: float, d: float) -> float:
    """(b^(α+1) - a^(α+1))/(b - a) with a, b ≥ 0, not both 0, and d = |b - a|."""
    return float(_SPAN[type(law)](law, k, a, b, d))


@overload(exponent)
def _exponent(law, k):
    return _EXPONENT[law.instance_class]


@overload(power)
def _power(law, k, x):
    return _POWER[law.instance_class]


@overload(root)
def _root(law, k, x):
    return _ROOT[law.instance_class]


@overload(span)
def _span(law, k, a, b, d):
    return _SPAN[law.instance_class]


@jit
def elastic(law, k, s):
    """Force f(s) = kc·[s]₊^α, N."""
    if s <= 0.0:
        return 0.0
    return law.unit[k] * (exponent(law, k) + 1.0) * power(law, k, s)


@jit
def potential(law, k, s):
    """Stored energy V(s) = kc·[s]₊^(α+1)/(α+1), in joule."""
    if s <= 0.0:
        return 0.0
    return law.unit[k] * s * power(law, k, s)


@jit
def gain(law, k, s, b, eta):
    """V(b) - V(s) for a step η = b - s, in joule, without cancellation."""
    if s <= 0.0 or b <= 0.0:
        return potential(law, k, b) - potential(law, k, s)
    return law.unit[k] * span(law, k, s, b, abs(eta)) * eta


@jit
def gradient(law, k, s, b, eta):
    """Discrete gradient φ = (V(b) - V(s))/η in units of the law, and its first three derivatives
    with respect to the end compression b.

    For b > 0; s is the start compression and η = b - s, carried apart so that neither
    cancels (DESIGN sec. 3). Relative error a few 1e-16.
    """
    alpha = exponent(law, k)
    end = (alpha + 1.0) * power(law, k, b)  # dV/db
    if s <= 0.0:  # entering: only part of the step is spent in contact
        phi = power(law, k, b) * (b / eta)
    else:
        phi = span(law, k, s, b, abs(eta))
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
