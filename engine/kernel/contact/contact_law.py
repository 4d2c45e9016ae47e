"""Arithmetic of contact laws (engine.kernel.data.laws): force f(s) = kc·[s]₊^α, potential and discrete gradient.

All compressions are in metres; `k` is the contact's index in its law's arrays. Energies and forces are computed from
`potential_coefficient` = kc/(α+1), in N/m^α: V(s) = potential_coefficient·[s]₊^(α+1).
"""

from collections.abc import Callable, Mapping
from typing import Any, NamedTuple

from engine.compiler.decorators import inline
from engine.compiler.elementary import expm1_of, log1p_of, power_of
from engine.compiler.overloads import overload_by_type
from engine.kernel.contact.friction_law import respond_by_friction, slides
from engine.kernel.data.laws import SPECIAL_LAWS, Law, Power

# --- laws of one exponent, and of any


def branch_on_exponent(cases: Mapping[Any, Any], otherwise: Any) -> Any:
    """Return a compiled function of an exponent and a value, which calls the case of the law of that exponent.

    cases:     compiled functions of the value, by the class of the law
    otherwise: a function of both, for all other exponents
    """
    branch = inline(otherwise)
    for law in reversed(SPECIAL_LAWS):
        branch = inline(_either(law.ALPHA, cases[law], branch))
    return branch


def _either(exponent: float, case: Any, otherwise: Any) -> Callable[[Any, Any], Any]:
    def branch(alpha, value):
        if alpha == exponent:
            return case(value)
        return otherwise(alpha, value)

    return branch


def _overload_of_one(function: Callable[..., Any], name: str, otherwise: Any) -> None:
    """Compile a function of x for laws of all kinds.

    name:      of the function that laws of one exponent may have for it
    otherwise: a function of the exponent and x, for all other laws
    """
    of_exponent = inline(otherwise)

    def at(alpha: float) -> Any:
        return lambda x: of_exponent(alpha, x)

    cases = {law: inline(getattr(law, name, None) or at(law.ALPHA)) for law in SPECIAL_LAWS}
    branch = branch_on_exponent(cases, otherwise)

    def of_kind(case: Any) -> Any:
        return lambda law, k, x: case(x)

    of_any = {Power: lambda law, k, x: branch(law.exponent[k], x)}
    overload_by_type(function, {law: of_kind(case) for law, case in cases.items()} | of_any)


def exponent(law: Law, k: int) -> float:
    """Return α of contact k: a constant of the compiled code where the type of the law says it. In compiled code
    only."""
    raise TypeError("exponent is for compiled code")


def power(law: Law, k: int, x: float) -> float:
    """Return x^α for x ≥ 0. In compiled code only."""
    raise TypeError("power is for compiled code")


def inverse_power(law: Law, k: int, x: float) -> float:
    """Return x^(1/α) for x ≥ 0. In compiled code only."""
    raise TypeError("inverse_power is for compiled code")


def root_of_potential(law: Law, k: int, x: float) -> float:
    """Return x^(1/(α+1)) for x ≥ 0. In compiled code only."""
    raise TypeError("root_of_potential is for compiled code")


def power_difference_quotient(law: Law, k: int, a: float, b: float, d: float, larger_power: float) -> float:
    """Return (b^(α+1) - a^(α+1))/(b - a) with a, b ≥ 0, not both 0. In compiled code only.

    d:            |b - a|, which is known more precisely than they are
    larger_power: x^α of the larger of the two; laws of one exponent do without
    """
    raise TypeError("power_difference_quotient is for compiled code")


def general_quotient(alpha, value):
    """Return (b^(α+1) - a^(α+1))/(b - a) for any exponent. value: a, b, d and larger_power, as in
    `power_difference_quotient`"""
    # based on the larger of the two, or it overflows
    a, b, d, whole = value
    n, part = alpha + 1.0, d / max(a, b)
    if part == 0.0:
        return whole * n
    if part >= 1.0:
        return whole
    return whole * (-expm1_of(n * log1p_of(-part))) / part


def _constant(alpha: float) -> Any:
    return lambda law, k: alpha


def _quotient(law: Any) -> tuple[Any, Any]:
    """Return the quotient of a law of one exponent twice: as a function of a value, and of arguments."""
    case = inline(law.quotient)
    return inline(lambda value: case(value[0], value[1])), lambda law, k, a, b, d, larger_power: case(a, b)


_quotients = {law: _quotient(law) for law in SPECIAL_LAWS}
_any_quotient = branch_on_exponent({law: of_value for law, (of_value, _) in _quotients.items()}, general_quotient)
_overload_of_one(power, "power", lambda alpha, x: power_of(x, alpha))
_overload_of_one(inverse_power, "inverse_power", lambda alpha, x: power_of(x, 1.0 / alpha))
_overload_of_one(root_of_potential, "root_of_potential", lambda alpha, x: power_of(x, 1.0 / (alpha + 1.0)))
overload_by_type(
    exponent, {law: _constant(law.ALPHA) for law in SPECIAL_LAWS} | {Power: lambda law, k: law.exponent[k]}
)
overload_by_type(
    power_difference_quotient,
    {law: of_arguments for law, (_, of_arguments) in _quotients.items()}
    | {Power: lambda law, k, a, b, d, larger_power: _any_quotient(law.exponent[k], (a, b, d, larger_power))},
)


# --- force and energy


class StepStart(NamedTuple):
    """A contact at the begin of a step."""

    s: float  # compression, m (negative: gap); of friction, how far the bristle is bent
    power: float  # s^α; 0 of an open contact, and of friction


@inline
def elastic_force(law, k, s):
    """Elastic force f(s) = kc·[s]₊^α, N."""
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
    """Difference of stored energy V(b) - V(s) for a step η = b - s, in joule, without cancellation."""
    if s <= 0.0 or b <= 0.0:
        return potential(law, k, b) - potential(law, k, s)
    larger_power = power(law, k, max(s, b))
    return law.potential_coefficient[k] * power_difference_quotient(law, k, s, b, abs(eta), larger_power) * eta


@inline
def discrete_gradient(law, k, start, b, eta):
    """Discrete gradient φ = (V(b) - V(s))/η in units of the law, and its first three derivatives
    with respect to the end compression b.

    For b > 0, with η = b - s carried apart so that neither cancels (docs/design.md, sec. 3). Relative error a few
    1e-16. start: StepStart, whose power counts where b < s
    """
    s, start_power = start
    alpha, end_power = exponent(law, k), power(law, k, b)
    end = (alpha + 1.0) * end_power  # dV/db
    if s <= 0.0:  # entering: only part of the step is spent in contact
        phi = end_power * (b / eta)
    else:
        phi = power_difference_quotient(law, k, s, b, abs(eta), start_power if b < s else end_power)
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
        per_length = 1.0 / eta
        first = (end - phi) * per_length
        second = (one - 2.0 * first) * per_length
        third = (two - 3.0 * second) * per_length
    return phi, first, second, third


# --- with loss: f = φ(s, b)·max(0, 1 + μη/h), φ the discrete gradient (Hunt and Crossley; paper, eq. 41)


class LossyLaw(NamedTuple):
    """The law of contacts, with their loss in a step."""

    elastic: Any  # a Law
    loss_rate: Any  # μ/h of each contact, 1/m; None where the scene has no contact loss
    friction: Any  # State.friction


@inline
def law_in_step(contact, h, state):
    """Return the LossyLaw of all contacts in a step. h: ContactCoefficients"""
    return LossyLaw(contact.law, h.loss_rate, state.friction)


@inline
def step_start(law, k, s):
    """Return the StepStart of contact k, or of a point of friction. law: LossyLaw"""
    if s <= 0.0 or slides(law.friction, k):
        return StepStart(s, 0.0)
    return StepStart(s, power(law.elastic, k, s))


@inline
def loss_rate_of(law, k):
    """Hunt-Crossley rate μ/h of contact k in 1/m. law: LossyLaw"""
    return item_or_zero(law.loss_rate, k)


@inline
def item_or_zero(items, k):
    """Return item k of an array; 0 if there is no array."""
    if items is None:
        return 0.0
    return items[k]


@inline
def response_leaving(law, k, s, eta, rate):
    """Return the mean force and its slope df/dη for a step that begins at s > 0 and ends outside contact."""
    w = 1.0 + rate * eta
    if w <= 0.0:
        return 0.0, 0.0
    rise = law.potential_coefficient[k] * s * power(law, k, s) / -eta
    return rise * w, rise / -eta


@inline
def response_in_contact(law, k, start, b, eta, rate):
    """Return the mean force and its first three derivatives by η for a step that ends at b > 0; 1 + rate·η ≥ 0.
    start: StepStart, whose power counts where b < s"""
    unit = law.potential_coefficient[k]
    f, df, ddf, dddf = discrete_gradient(law, k, start, b, eta)
    if rate > 0.0:
        w = max(0.0, 1.0 + rate * eta)
        f, df, ddf, dddf = f * w, df * w + f * rate, ddf * w + 2.0 * df * rate, dddf * w + 3.0 * ddf * rate
    return unit * f, unit * df, unit * ddf, unit * dddf


@inline
def contact_response(law, k, s, eta):
    """Return the mean force and slope df/dη of contact k, or of a point of friction, for a step η."""
    if slides(law.friction, k):
        return respond_by_friction(law.friction, k, s, eta)
    b = s + eta
    rate = loss_rate_of(law, k)
    if 1.0 + rate * eta <= 0.0:
        return 0.0, 0.0
    if b > 0.0:
        start = StepStart(s, power(law.elastic, k, s) if b < s else 0.0)
        f, df, _, _ = response_in_contact(law.elastic, k, start, b, eta, rate)
        return f, df
    if s > 0.0:
        return response_leaving(law.elastic, k, s, eta, rate)
    return 0.0, 0.0


@inline
def end_force_of(law, k, b):
    """Elastic force at the end compression b, N; 0 where there is no loss, and it is not needed."""
    if loss_rate_of(law, k) == 0.0:
        return 0.0
    return elastic_force(law.elastic, k, b)


@inline
def force_of_lossy_law(law, k, s, eta, f):
    """Force of the contact law for a step, N, if there is contact loss: that of a capped solve, f, may differ."""
    if loss_rate_of(law, k) > 0.0:
        return contact_response(law, k, s, eta)[0]
    return f


# --- energy


@inline
def contact_dissipation(law, k, s, solution):
    """Energy that contact loss takes over one step: (f - φ)·η, J."""
    eta, b, _, f, _ = solution
    rate = loss_rate_of(law, k)
    w = 1.0 + rate * eta
    if w > 0.5:
        return f * eta * (rate * eta) / w
    return f * eta - potential_difference(law.elastic, k, s, b, eta)  # f/w would cancel


@inline
def dissipation_of(law, k, s, solution, residual):
    """Energy that the contact loss of a solution takes, J."""
    _, _, f, _, end_force = solution
    if loss_rate_of(law, k) == 0.0:
        return 0.0
    lost = contact_dissipation(law, k, s, solution)
    return lost + (f - end_force) * residual  # where bodies move beyond the step, the force works on


@inline
def energy_gained(law, k, moved, solution):
    """Return the energy that a contact which persists has gained, J: its potential is that of the solution, but for
    what rounding moved the compression beyond it. moved: how far it moved in all, m"""
    eta, _, f, _, end_force = solution
    return f / (1.0 + loss_rate_of(law, k) * eta) * eta + end_force * (moved - eta)
