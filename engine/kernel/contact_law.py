"""Contact laws: the one-sided power law f(s) = kc·[s]₊^α (paper, eq. 1) and its potential.

The exponent is part of a law's type, so that a kernel holds the arithmetic of its own exponents only. The law of type
Power has any exponent, and does for those with a type of their own what their types do, bit for bit. To add an
exponent: a class, and its entries in the tables below. Everything else follows from them.

All compressions are in metres; `k` is the contact's index in its law's arrays. Energies and
forces are counted in `potential_coefficient` = kc/(α+1), in N/m^α: V(s) = potential_coefficient·[s]₊^(α+1).
"""

import math
from collections.abc import Mapping
from types import MappingProxyType
from typing import Any

from engine.compiler.decorators import inline
from engine.compiler.overloads import overload_by_type
from engine.kernel.laws import OF_EXPONENT, Cubic, Felt, Hertz, Law, Linear, Power, Quadratic

NONE: Mapping[str, Any] = MappingProxyType({})

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


def general_quotient(law, k, a, b, d):
    """The quotient for any exponent."""
    # based on the larger of the two, or it overflows
    alpha, m = law.exponent[k], max(a, b)
    n, part, whole = alpha + 1.0, d / m, m**alpha
    if part == 0.0:
        return whole * n
    if part >= 1.0:
        return whole
    return whole * (-math.expm1(n * math.log1p(-part))) / part


def branch_on_exponent(
    cases: Mapping[Any, Any], otherwise: Any, exponent: str, arguments: str, functions: Mapping[str, Any] = NONE
) -> Any:
    """A function, for compiled code, that does for each exponent with a law of its own what the case of that law does.

    cases:     functions of these arguments, by the class of the law
    otherwise: the function for all other exponents
    exponent:  what gives it, in terms of the arguments
    functions: that it names
    """
    names: dict[str, Any] = {"otherwise": inline(otherwise), **functions}
    lines = [f"def branch({arguments}):", f"    alpha = {exponent}"]
    for alpha, law in OF_EXPONENT.items():
        names[law.__name__] = inline(cases[law])
        lines += [f"    if alpha == {alpha!r}:", f"        return {law.__name__}({arguments})"]
    exec("\n".join([*lines, f"    return otherwise({arguments})"]), names)
    return names["branch"]


def with_power_law(cases: Mapping[Any, Any], otherwise: Any, arguments: str) -> dict[Any, Any]:
    """The cases, and that of the law of any exponent."""
    return {**cases, Power: branch_on_exponent(cases, otherwise, "law.exponent[k]", f"law, k, {arguments}")}


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
}
_INVERSE_POWER = {
    Linear: lambda law, k, x: x,
    Hertz: lambda law, k, x: x ** (1.0 / 1.5),
    Quadratic: lambda law, k, x: math.sqrt(x),
    Felt: lambda law, k, x: x ** (1.0 / 2.5),
    Cubic: lambda law, k, x: x ** (1.0 / 3.0),
}
_ROOT_OF_POTENTIAL = {
    Linear: lambda law, k, x: math.sqrt(x),
    Hertz: lambda law, k, x: x ** (1.0 / 2.5),
    Quadratic: lambda law, k, x: x ** (1.0 / 3.0),
    Felt: lambda law, k, x: x ** (1.0 / 3.5),
    Cubic: lambda law, k, x: x ** (1.0 / 4.0),
}
_POWER_DIFFERENCE_QUOTIENT = {
    Linear: lambda law, k, a, b, d: quotient_linear(a, b),
    Hertz: lambda law, k, a, b, d: quotient_hertz(a, b),
    Quadratic: lambda law, k, a, b, d: quotient_quadratic(a, b),
    Felt: lambda law, k, a, b, d: quotient_felt(a, b),
    Cubic: lambda law, k, a, b, d: quotient_cubic(a, b),
}
_POWER = with_power_law(_POWER, lambda law, k, x: x ** law.exponent[k], "x")
_INVERSE_POWER = with_power_law(_INVERSE_POWER, lambda law, k, x: x ** (1.0 / law.exponent[k]), "x")
_ROOT_OF_POTENTIAL = with_power_law(_ROOT_OF_POTENTIAL, lambda law, k, x: x ** (1.0 / (law.exponent[k] + 1.0)), "x")
_POWER_DIFFERENCE_QUOTIENT = with_power_law(_POWER_DIFFERENCE_QUOTIENT, general_quotient, "a, b, d")


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
