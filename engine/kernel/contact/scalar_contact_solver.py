"""Contact solve of one contact: its compression at the end of a step, given how far it would move without force.

`solve_power_law` solves an island with one contact. The unknown is the end compression b, with η = b - s beside
it, so that neither is ever formed from the other (docs/design.md, sec. 3):

    (b - G) + B·f = 0,    f = φ(s, b)·max(0, 1 + μη/h),    G = s + g

with B the compliance of the bodies at the contact over one step (m/N), φ the discrete gradient of the contact's
potential. The left side is convex and increasing in b, so the root is unique (paper, sec. 2.1.2). No function here
raises; failure is a returned status.
"""

import math
from typing import Any, NamedTuple

from engine.compiler.decorators import inline
from engine.kernel.contact.power_law import (
    StepStart,
    inverse_power,
    loss_rate_of,
    response_in_contact,
    root_of_potential,
)
from engine.kernel.data.enums import SolveStatus

MIN_COMPRESSION = 1e-150  # m; a compression below it is none: its square underflows
BRACKET_SLACK = 1e-15  # its ends are rounded
MAX_HALLEY_EVALUATIONS = 60  # bisection alone would be done by then


class ContactEquation(NamedTuple):
    """Equation of one contact for its force (docs/design.md, sec. 3)."""

    law: Any  # Laws
    k: int  # number of the contact in it
    start: StepStart
    g: float  # change of compression if there were no contact force, m
    compliance: float  # B, change of compression per newton of contact force, m/N
    tolerance: float  # relative error left in the end compression


@inline
def solve_separation(law, k, start, g, rate, elastic):
    """Solve for the end of a step that begins in contact and ends outside it, in closed form.

    `elastic` is B·V(s), m². Returns η, b, f, df/dη.
    """
    s = start.s
    free_end = s + g
    rise = g + rate * elastic
    width = math.sqrt(rise * rise + 4.0 * elastic)
    if rise < 0.0:
        eta = 0.5 * (rise - width)
    else:
        eta = -2.0 * elastic / (rise + width)
    total = 2.0 * s + rise
    if total <= 0.0:
        b = 0.5 * (total - width)
    else:
        b = 2.0 * (s * free_end - elastic * (1.0 - rate * s)) / (total + width)
    mean = law.potential_coefficient[k] * s * start.power / -eta
    # 1 + rate·η, which is a root of w² - (1 + lossy_move + lossy_force)·w + lossy_move, without cancellation
    lossy_move, lossy_force = 1.0 + rate * g, 1.0 + rate * rate * elastic
    w = 2.0 * lossy_move / (lossy_move + lossy_force + rate * width)
    return eta, b, mean * w, mean / -eta


@inline
def solve_linear(law, k, s, g, scale):
    """Solve for the end of a step in contact for α = 1 without contact loss, in closed form. Returns η, b, f, df/dη."""
    unit = law.potential_coefficient[k]
    free_end = s + g
    c = 1.0 + scale
    if s <= 0.0:
        less = free_end + s
        width = math.sqrt(less * less - 4.0 * c * s * free_end)
        b = (less + width) / (2.0 * c) if less >= 0.0 else -2.0 * s * free_end / (width - less)
        eta = b - s
        force = unit * b * (b / eta)
        return eta, b, force, (2.0 * unit * b - force) / eta
    per_c = 1.0 / c
    eta = (g - 2.0 * scale * s) * per_c
    b = (free_end - scale * s) * per_c
    # c is rounded alike at every step, which would feed the motion (3e-17 of its energy a step)
    eta += ((g - eta) - scale * (2.0 * s + eta)) * per_c
    b += ((free_end - b) - scale * (s + b)) * per_c
    return eta, b, unit * (2.0 * s + eta), unit


@inline
def solve_quadratic(law, k, s, g, scale):
    """Solve for the end of a step within contact for α = 2 without contact loss, in closed form. Returns η, b, f,
    df/dη.

    The quotient of x³ over [s, b] is s² + sb + b², so the contact equation is quadratic.
    """
    constant = (s + g) - scale * s * s  # > 0, or the step would separate
    c = 1.0 + scale * s
    width = math.sqrt(c * c + 4.0 * scale * constant)
    eta = 2.0 * (g - 3.0 * scale * s * s) / (c + 2.0 * scale * s + width)
    b = 2.0 * constant / (c + width)
    return eta, b, law.potential_coefficient[k] * (s * s + b * (s + b)), law.potential_coefficient[k] * (s + 2.0 * b)


@inline
def initial_guess(law, k, start, g, scale):
    """Return an end compression to begin with, from the asymptotes of the solution (docs/design.md, sec. 3)."""
    s = start.s
    free_end = s + g
    alpha = law.exponent[k]
    n = alpha + 1.0
    if s <= 0.0:  # (G - b)(b - s) = scale·b^n, where b^n is known at both asymptotes
        free = free_end / scale
        if not free < 1e150:
            return free_end
        weak, stiff = inverse_power(law, k, free), root_of_potential(law, k, -s * free)
        b, whole = (weak, free_end * weak) if weak >= stiff else (stiff, -s * free_end)
        if b >= free_end:
            return free_end
        residual = whole - (free_end - b) * (b - s)
        slope = n * whole / b - (free_end + s - 2.0 * b)
        bottom = 2.0 * slope * slope - residual * (n * alpha * whole / (b * b) + 2.0)
        step = -2.0 * residual * slope / bottom if bottom > 0.0 else -residual / slope
        return min(free_end, max(b + step, 0.5 * b))
    kappa = n * scale * start.power / s
    away = (g / s - kappa) / (1.0 + 0.5 * alpha * kappa)  # Newton from b = s
    if abs(away) * alpha < 0.5:
        return s + s * away
    t = free_end / s
    if away > 0.0:  # loading
        q = inverse_power(law, k, t / kappa)
        return min(free_end, s * min(min(t, 1.0 + away), min(2.0 * q - 1.0, inverse_power(law, k, n) * q)))
    excess = n * t - kappa  # unloading
    mid = n + alpha * t
    return s * 2.0 * excess / (mid + math.sqrt(max(0.0, mid * mid - 4.0 * alpha * excess)))


@inline
def initial_guess_lossy(lossy_law, k, start, g, scale, b):
    """Return an end compression to begin with under contact loss, given that without loss, b."""
    law, rate, s = lossy_law.elastic, loss_rate_of(lossy_law, k), start.s
    if s <= 0.0:
        return min(b, root_of_potential(law, k, (s + g) / (scale * rate)))
    force = (law.exponent[k] + 1.0) * scale * start.power
    newton = s + (g - force) / (1.0 + force * (0.5 * law.exponent[k] / s + rate))  # from b = s; never below the root
    return b if s - 1.0 / rate < b < newton else newton


@inline
def solve_power_law(equation, near):
    """Solve the ContactEquation of a power law. near, result: as of engine.kernel.contact.law.solve_alone"""
    lossy_law, k, start, g, compliance, _ = equation
    s = start.s
    free_end = s + g
    if s < MIN_COMPRESSION and free_end < MIN_COMPRESSION:
        return g, free_end, 0.0, 0.0, 0, SolveStatus.FREE
    law, rate = lossy_law.elastic, loss_rate_of(lossy_law, k)
    alpha = law.exponent[k]
    scale = compliance * law.potential_coefficient[k]
    if s > 0.0:
        if rate * g <= -1.0:  # leaves faster than the loss allows a push: Hunt-Crossley never pulls
            return g, free_end, 0.0, 0.0, 0, SolveStatus.SEPARATION
        elastic = scale * s * start.power
        if s * free_end <= elastic * (1.0 - rate * s):
            eta, b, force, slope = solve_separation(law, k, start, g, rate, elastic)
            return eta, b, force, slope, 0, SolveStatus.SEPARATION
    if rate == 0.0:
        if alpha == 1.0:
            eta, b, force, slope = solve_linear(law, k, s, g, scale)
            return eta, b, force, slope, 0, SolveStatus.CLOSED_FORM
        if alpha == 2.0 and s > 0.0:
            eta, b, force, slope = solve_quadratic(law, k, s, g, scale)
            return eta, b, force, slope, 0, SolveStatus.CLOSED_FORM
    if scale <= 0.0:
        b, eta = free_end, g
    elif near > 0.0 and (s <= 0.0 or 1.0 + rate * (near - s) > 0.0):  # beyond, the loss allows no push
        b, eta = near, near - s
    else:
        b = initial_guess(law, k, start, g, scale)
        if rate > 0.0:
            b = initial_guess_lossy(lossy_law, k, start, g, scale, b)
        eta = b - s
    return bracketed_halley(equation, b, eta)


@inline
def bracketed_halley(equation, b, eta):
    """Solve a contact equation by Halley's iteration from b (> 0), kept inside a bracket. Returns η, b, mean force f,
    slope df/dη, evaluations of the contact law, and SolveStatus.

    The force is extrapolated over the last step, so no evaluation is spent on confirming it.
    """
    lossy_law, k, start, g, compliance, tolerance = equation
    law, rate, s, free_end = lossy_law.elastic, loss_rate_of(lossy_law, k), start.s, start.s + g
    lower, upper = 0.0, free_end
    if s > 0.0 and rate == 0.0:  # the sign of the residual at b = s is the sign of κ - g/s
        if g > compliance * law.potential_coefficient[k] * (law.exponent[k] + 1.0) * start.power:
            lower = s
        else:
            upper = s
    elif s > 0.0:
        lower, upper = max(0.0, s - 1.0 / rate), max(free_end, s)
    degree = law.exponent[k] + 1.0
    for evaluations in range(1, MAX_HALLEY_EVALUATIONS + 1):
        f, df, ddf, dddf = response_in_contact(law, k, start, b, eta, rate)
        contact_displacement = compliance * f
        residual = (eta - g) + contact_displacement if abs(eta) < b else (b - free_end) + contact_displacement
        derivative = 1.0 + compliance * df
        halley_denominator = 2.0 * derivative * derivative - residual * compliance * ddf
        step = -2.0 * residual * derivative / halley_denominator if halley_denominator > 0.0 else -residual / derivative
        if residual > 0.0:
            upper = min(upper, b)
        else:
            lower = max(lower, b)
        is_bracketed = lower <= b + step <= upper
        if not is_bracketed:
            step = -residual / derivative
            is_bracketed = lower * (1.0 - BRACKET_SLACK) <= b + step <= upper * (1.0 + BRACKET_SLACK)
            if not is_bracketed:
                step = 0.5 * (lower + upper) - b
        # Halley leaves an error of third order in its step, times how much the contact matters;
        # the force is extrapolated to third order, and errs by the fourth
        size = degree * abs(step) / max(s, min(b, b + step))
        change = abs(step) * (derivative - 1.0)  # of the force, times B
        error = max(size * size * (derivative - 1.0) / derivative, size * size * size) * change
        after = contact_displacement + step * (
            derivative - 1.0
        )  # a force that falls by orders of magnitude is not extrapolated
        done = (is_bracketed and error <= tolerance * after and contact_displacement <= 8.0 * after) or abs(
            residual
        ) <= 4.4e-16 * (contact_displacement + min(abs(g), abs(free_end)))
        if done:
            f += step * (df + step * (0.5 * ddf + step * dddf / 6.0))
            df += step * (ddf + step * 0.5 * dddf)
        b += step
        eta += step
        if done:
            return eta, b, f, df, evaluations, SolveStatus.NEWTON
    return eta, b, f, df, MAX_HALLEY_EVALUATIONS, SolveStatus.FAILED
