"""Arithmetic of contact laws (engine.kernel.data.laws): force f(s) = kc·[s]₊^α, potential and discrete gradient.

All compressions are in metres; `k` is the contact's index in its law's arrays. Energies and forces are computed from
`potential_coefficient` = kc/(α+1), in N/m^α: V(s) = potential_coefficient·[s]₊^(α+1).
"""

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np

from engine.compiler.decorators import inline
from engine.compiler.elementary import expm1_of, log1p_of, power_of
from engine.kernel.data.effects import CONTACT_LOSS, EFFECTS
from engine.kernel.data.laws import SPECIAL_EXPONENTS, Law

# --- functions of any exponent


def branch_on_exponent(name: str, otherwise: Callable[..., Any]) -> Any:
    """Return a compiled function of an exponent and a value: that which a special exponent has by this name
    (engine.kernel.data.laws), and for all others `otherwise`, a function of both."""
    branch = inline(otherwise)
    for special in reversed(SPECIAL_EXPONENTS):
        if hasattr(special, name):
            branch = inline(_either(special.ALPHA, inline(getattr(special, name)), branch))
    return branch


def _either(exponent: float, case: Any, otherwise: Any) -> Callable[[Any, Any], Any]:
    def branch(alpha, value):
        if alpha == exponent:
            return case(value)
        return otherwise(alpha, value)

    return branch


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


any_power = branch_on_exponent("power", lambda alpha, x: power_of(x, alpha))
any_inverse_power = branch_on_exponent("inverse_power", lambda alpha, x: power_of(x, 1.0 / alpha))
any_root_of_potential = branch_on_exponent("root_of_potential", lambda alpha, x: power_of(x, 1.0 / (alpha + 1.0)))
any_quotient = branch_on_exponent("quotient", general_quotient)


@inline
def power(law, k, x):
    """Return x^α of contact k for x ≥ 0."""
    return any_power(law.exponent[k], x)


@inline
def inverse_power(law, k, x):
    """Return x^(1/α) of contact k for x ≥ 0."""
    return any_inverse_power(law.exponent[k], x)


@inline
def root_of_potential(law, k, x):
    """Return x^(1/(α+1)) of contact k for x ≥ 0."""
    return any_root_of_potential(law.exponent[k], x)


@inline
def power_difference_quotient(law, k, a, b, d, larger_power):
    """Return (b^(α+1) - a^(α+1))/(b - a) of contact k with a, b ≥ 0, not both 0.

    d:            |b - a|, which is known more precisely than they are
    larger_power: x^α of the larger of the two; special exponents do without
    """
    return any_quotient(law.exponent[k], (a, b, d, larger_power))


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
    return law.potential_coefficient[k] * (law.exponent[k] + 1.0) * power(law, k, s)


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
    alpha, end_power = law.exponent[k], power(law, k, b)
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


@inline
def elastic_law(state):
    """Return the Law of all contacts."""
    return Law(state.potential_coefficient, state.exponent)


@inline
def loss_rate_of(law, k):
    """Hunt-Crossley rate μ/h of contact k in 1/m. law: Laws"""
    if EFFECTS & CONTACT_LOSS:
        return law.loss_rate[k]
    return 0.0


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
def respond_by_power_law(law, k, s, eta):
    """Return the mean force and slope df/dη of contact k for a step η."""
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
        return respond_by_power_law(law, k, s, eta)[0]
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


# --- after a small further move, in the middle of a solve


class ForceEstimate(NamedTuple):
    """Estimate of the force of a contact in the middle of a solve."""

    eta: float  # change of compression, m
    end: float  # compression at the end of the step, m
    force: float  # N
    slope: float  # of the force, N/m


@inline
def extrapolation_error(law, k, s, estimate, move):
    """Return the relative errors of the force after a small further move, to first order and to second."""
    eta, b, f, slope = estimate
    if f <= 0.0:
        none = 0.0 if b <= 0.0 or move == 0.0 else np.inf
        return none, none
    scale = max(s, abs(eta)) if s > 0.0 else b
    size = (law.exponent[k] + 1.0) * abs(move) / scale
    change = max(size, abs(move) * slope / f)
    near = size * max(1.0, scale / abs(b))  # beyond the first, derivatives have a kink at b = 0
    return size * change, near * near * max(change, near)


@inline
def second_order_change(law, k, start, estimate, move):
    """Return the change of the force of contact k of second order in a small move."""
    eta, b, f, _ = estimate
    if b > 0.0:
        _, _, ddf, _ = response_in_contact(law.elastic, k, start, b, eta, loss_rate_of(law, k))
        return 0.5 * ddf * move * move
    return f * (move / eta) * (move / eta)


# --- a solution is stored


@inline
def store_power_law(law, state, k, solution, residual):
    """Store the new compression and force of contact k. Returns the energy lost, J.

    law: Laws; solution, residual: as of engine.kernel.contact.law.store_solution

    The rounding of a step has the same sign at every step of a contact, and would add up (2e-13 of the energy in 60
    ms). It consists of the low part of B, the residual of the solution, and the step's part beneath the last digit of
    the compression. It is carried to the next step (Kahan).
    """
    eta, b, f, _, _ = solution
    s = state.compression[k]
    lost = dissipation_of(law, k, s, solution, residual)
    residue = state.compression_compensation[k] + residual
    if 2.0 * abs(eta) < b:
        end = s + (eta + residue)
        residue = (eta + residue) - (end - s)
    else:  # beside a long step to a small compression, what rounding left of the step is no longer small
        end = b
    state.compression_compensation[k] = residue
    state.compression[k] = end
    state.contact_force[k] = f
    return lost


@inline
def energy_beyond_work(state, k, s, lost, f):
    """Energy that contact k has gained since its compression was s, and lost, beyond the work of the bodies against its
    force f, J."""
    end = state.compression[k]
    return potential_difference(elastic_law(state), k, s, end, end - s) + lost - f * state.free_displacement[k]
