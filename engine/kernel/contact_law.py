"""Contact laws: the one-sided power law f(s) = kc·[s]₊^α (paper, eq. 1) and its potential.

The exponent is part of a law's type, so that a kernel holds the arithmetic of its own exponents only. The law of type
Power has any exponent, and does for those with a type of their own what their types do, bit for bit. To add an
exponent: a class, its functions in the tables below, and its branch in those of `Power`.

All compressions are in metres; `k` is the contact's index in its law's arrays. Energies and
forces are counted in `potential_coefficient` = kc/(α+1), in N/m^α: V(s) = potential_coefficient·[s]₊^(α+1).
"""

import math

from engine.compiler.decorators import inline, noinline
from engine.compiler.overloads import overload_by_type
from engine.kernel.laws import Cubic, Felt, Hertz, Law, Linear, Power, Quadratic

# x^α, x^(1/α), x^(1/(α+1)), and the quotient (b^(α+1) - a^(α+1))/(b - a), which is α + 1 times the mean of x^α
# over [a, b]; each without cancellation. `power_difference_quotient` is given d = |b - a|, known more precisely.


@inline
def quotient_linear(a, b):
    """The quotient for α = 1."""
    return a + b


@inline
def quotient_hertz(a, b):
    """The quotient for α = 1.5."""
    u, v = math.sqrt(a), math.sqrt(b)
    return (a * a + b * b + u * v * (a + u * v + b)) / (u + v)


@inline
def quotient_quadratic(a, b):
    """The quotient for α = 2."""
    return a * a + a * b + b * b


@inline
def quotient_felt(a, b):
    """The quotient for α = 2.5."""
    u, v = math.sqrt(a), math.sqrt(b)
    a2, b2, uv = a * a, b * b, u * v
    return (a2 * a + b2 * b + uv * (a2 + b2 + a * b) + a * b * (a + b)) / (u + v)


@inline
def quotient_cubic(a, b):
    """The quotient for α = 3."""
    return (a + b) * (a * a + b * b)


@noinline
def quotient_of(alpha, a, b, d):
    """The quotient for any exponent."""
    if alpha == 1.0:
        return quotient_linear(a, b)
    if alpha == 1.5:
        return quotient_hertz(a, b)
    if alpha == 2.0:
        return quotient_quadratic(a, b)
    if alpha == 2.5:
        return quotient_felt(a, b)
    if alpha == 3.0:
        return quotient_cubic(a, b)
    # based on the larger of the two, or it overflows
    n = alpha + 1.0
    m = max(a, b)
    part = d / m
    whole = m**alpha
    if part == 0.0:
        return whole * n
    if part >= 1.0:
        return whole
    return whole * (-math.expm1(n * math.log1p(-part))) / part


@noinline
def power_of(alpha, x):
    """x^α for any exponent."""
    if alpha == 1.0:
        return x
    if alpha == 1.5:
        return x * math.sqrt(x)
    if alpha == 2.0:
        return x * x
    if alpha == 2.5:
        return x * x * math.sqrt(x)
    if alpha == 3.0:
        return x * x * x
    return x**alpha


@noinline
def root_of(n, x):
    """x^(1/n) for any n."""
    if n == 1.0:
        return x
    if n == 2.0:
        return math.sqrt(x)
    return x ** (1.0 / n)


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
    Power: lambda law, k, x: power_of(law.exponent[k], x),
}
_INVERSE_POWER = {
    Linear: lambda law, k, x: x,
    Hertz: lambda law, k, x: x ** (1.0 / 1.5),
    Quadratic: lambda law, k, x: math.sqrt(x),
    Felt: lambda law, k, x: x ** (1.0 / 2.5),
    Cubic: lambda law, k, x: x ** (1.0 / 3.0),
    Power: lambda law, k, x: root_of(law.exponent[k], x),
}
_ROOT_OF_POTENTIAL = {
    Linear: lambda law, k, x: math.sqrt(x),
    Hertz: lambda law, k, x: x ** (1.0 / 2.5),
    Quadratic: lambda law, k, x: x ** (1.0 / 3.0),
    Felt: lambda law, k, x: x ** (1.0 / 3.5),
    Cubic: lambda law, k, x: x ** (1.0 / 4.0),
    Power: lambda law, k, x: root_of(law.exponent[k] + 1.0, x),
}
_POWER_DIFFERENCE_QUOTIENT = {
    Linear: lambda law, k, a, b, d: quotient_linear(a, b),
    Hertz: lambda law, k, a, b, d: quotient_hertz(a, b),
    Quadratic: lambda law, k, a, b, d: quotient_quadratic(a, b),
    Felt: lambda law, k, a, b, d: quotient_felt(a, b),
    Cubic: lambda law, k, a, b, d: quotient_cubic(a, b),
    Power: lambda law, k, a, b, d: quotient_of(law.exponent[k], a, b, d),
}


def exponent(law: Law, k: int) -> float:
    """α of contact k: a constant of the compiled code where the type says it."""
    return float(_EXPONENT[type(law)](law, k))


def power(law: Law, k: int, x: float) -> float:
    """x^α for x ≥ 0."""
    return float(_POWER[type(law)](law, k, x))


def inverse_power(law: Law, k: int, x: float) -> float:
    """x^(1/α) for x ≥ 0."""
    return float(_INVERSE_POWER[type(law)](law, k, x))


def root_of_potential(law: Law, k: int, x: float) -> float:
    """x^(1/(α+1)) for x ≥ 0."""
    return float(_ROOT_OF_POTENTIAL[type(law)](law, k, x))


def power_difference_quotient(law: Law, k: int, a: float, b: float, d: float) -> float:
    """(b^(α+1) - a^(α+1))/(b - a) with a, b ≥ 0, not both 0, and d = |b - a|."""
    return float(_POWER_DIFFERENCE_QUOTIENT[type(law)](law, k, a, b, d))


overload_by_type(exponent, _EXPONENT)
overload_by_type(power, _POWER)
overload_by_type(inverse_power, _INVERSE_POWER)
overload_by_type(root_of_potential, _ROOT_OF_POTENTIAL)
overload_by_type(power_difference_quotient, _POWER_DIFFERENCE_QUOTIENT)


@inline
def elastic_force(law, k, s):
    """Force f(s) = kc·[s]₊^α, N."""
    if s <= 0.0:
        return 0.0
    return law.potential_coefficient[k] * (exponent(law, k) + 1.0) * power(law, k, s)


@inline
def potential(law, k, s):
    """Stored energy V(s) = kc·[s]₊^(α+1)/(α+1), in joule."""
    if s <= 0.0:
        return 0.0
    return law.potential_coefficient[k] * s * power(law, k, s)


@inline
def potential_difference(law, k, s, b, eta):
    """V(b) - V(s) for a step η = b - s, in joule, without cancellation."""
    if s <= 0.0 or b <= 0.0:
        return potential(law, k, b) - potential(law, k, s)
    return law.potential_coefficient[k] * power_difference_quotient(law, k, s, b, abs(eta)) * eta


@inline
def discrete_gradient(law, k, s, b, eta):
    """Discrete gradient φ = (V(b) - V(s))/η in units of the law, and its first three derivatives
    with respect to the end compression b.

    For b > 0; s is the start compression and η = b - s, carried apart so that neither
    cancels (docs/design.md, sec. 3). Relative error a few 1e-16.
    """
    alpha = exponent(law, k)
    end = (alpha + 1.0) * power(law, k, b)  # dV/db
    if s <= 0.0:  # entering: only part of the step is spent in contact
        phi = power(law, k, b) * (b / eta)
    else:
        phi = power_difference_quotient(law, k, s, b, abs(eta))
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
