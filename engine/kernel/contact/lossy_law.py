"""The law of a contact with loss (Hunt and Crossley): f = φ(s, b)·max(0, 1 + μη/h), with φ the discrete gradient of the
contact's potential (paper, eq. 41; docs/design.md, sec. 3).

A step begins at compression s and ends at b, m, with η = b - s beside them, so that none is formed from the others.
"""

from typing import Any, NamedTuple

from engine.compiler.decorators import inline
from engine.kernel.contact.contact_law import discrete_gradient, elastic_force, potential_difference, power


class LossyLaw(NamedTuple):
    """The law of contacts, with their loss in a step."""

    elastic: Any  # a Law
    loss_rate: Any  # μ/h of each contact, 1/m; None where the scene has no contact loss


@inline
def law_in_step(contact, h):
    """Return the LossyLaw of all contacts in a step. h: ContactCoefficients"""
    return LossyLaw(contact.law, h.loss_rate)


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
def response_in_contact(law, k, s, b, eta, rate):
    """Return the mean force and its first three derivatives by η for a step that ends at b > 0; 1 + rate·η ≥ 0."""
    unit = law.potential_coefficient[k]
    f, df, ddf, dddf = discrete_gradient(law, k, s, b, eta)
    if rate > 0.0:
        w = max(0.0, 1.0 + rate * eta)
        f, df, ddf, dddf = f * w, df * w + f * rate, ddf * w + 2.0 * df * rate, dddf * w + 3.0 * ddf * rate
    return unit * f, unit * df, unit * ddf, unit * dddf


@inline
def contact_response(law, k, s, eta):
    """Return the mean force and slope df/dη of contact k for a step η."""
    b = s + eta
    rate = loss_rate_of(law, k)
    if 1.0 + rate * eta <= 0.0:
        return 0.0, 0.0
    if b > 0.0:
        f, df, _, _ = response_in_contact(law.elastic, k, s, b, eta, rate)
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
