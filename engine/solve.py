"""The contact solve: given how far a contact would move without force, where it ends.

`scalar` solves an island with one contact. Unknown: the end compression b, with
η = b - s beside it, so that neither is ever formed from the other (DESIGN sec. 3):

    (b - G) + B·f = 0,    f = φ(s, b)·max(0, 1 + μη/h),    G = s + g

with B the compliance of the bodies at the contact over one step (m/N), φ the
discrete gradient of the contact's potential. The left side is convex and
increasing in b, so the root is unique (paper, sec. 2.1.2). No function here
raises; failure is a returned status.
"""

import math

from engine.jit import jit
from engine.laws import exponent, gradient, power, root

# How a solve ended; also the index of its counter in the telemetry.
FREE, SEPARATION, CLOSED, NEWTON, FAILED, CAPPED = 0, 1, 2, 3, 4, 5

LEAST = 1e-150  # m; a compression below it is none: its square underflows
SLACK = 1e-15  # of a bracket: its ends are rounded
LIMIT = 60  # evaluations; bisection alone would be done by then


@jit
def contact_loss(damping, k):
    """Hunt-Crossley rate μ/h of contact k in 1/m; 0 where the scene has no contact loss."""
    if damping is None:
        return 0.0
    return damping.rate[k]


@jit
def outside(law, k, s, eta, rate):
    """Mean force and its slope df/dη for a step that begins at s > 0 and ends outside contact."""
    w = 1.0 + rate * eta
    if w <= 0.0:
        return 0.0, 0.0
    lift = law.unit[k] * s * power(law, k, s) / -eta
    return lift * w, lift / -eta


@jit
def inside(law, k, s, b, eta, rate):
    """Mean force and its first three derivatives by η for a step that ends at b > 0; 1 + rate·η ≥ 0."""
    unit = law.unit[k]
    f, df, ddf, dddf = gradient(law, k, s, b, eta)
    if rate > 0.0:
        w = max(0.0, 1.0 + rate * eta)
        f, df, ddf, dddf = f * w, df * w + f * rate, ddf * w + 2.0 * df * rate, dddf * w + 3.0 * ddf * rate
    return unit * f, unit * df, unit * ddf, unit * dddf


@jit
def separate(law, k, s, g, rate, elastic):
    """End of a step that begins in contact and ends outside it, in closed form.

    `elastic` is B·V(s), m². Returns η, b, f, df/dη.
    """
    big = s + g
    lift = g + rate * elastic
    width = math.sqrt(lift * lift + 4.0 * elastic)
    if lift < 0.0:
        eta = 0.5 * (lift - width)
    else:
        eta = -2.0 * elastic / (lift + width)
    total = 2.0 * s + lift
    if total <= 0.0:
        b = 0.5 * (total - width)
    else:
        b = 2.0 * (s * big - elastic * (1.0 - rate * s)) / (total + width)
    mean = law.unit[k] * s * power(law, k, s) / -eta
    # 1 + rate·η, which is a root of w² - (1 + left + fade)·w + left, without cancellation
    left, fade = 1.0 + rate * g, 1.0 + rate * rate * elastic
    w = 2.0 * left / (left + fade + rate * width)
    return eta, b, mean * w, mean / -eta


@jit
def linear_step(law, k, s, g, scale):
    """End of a step in contact for α = 1 without contact loss, in closed form: η, b, f, df/dη."""
    unit = law.unit[k]
    big = s + g
    c = 1.0 + scale
    if s <= 0.0:
        less = big + s
        width = math.sqrt(less * less - 4.0 * c * s * big)
        b = (less + width) / (2.0 * c) if less >= 0.0 else -2.0 * s * big / (width - less)
        eta = b - s
        force = unit * b * (b / eta)
        return eta, b, force, (2.0 * unit * b - force) / eta
    over = 1.0 / c
    eta = (g - 2.0 * scale * s) * over
    b = (big - scale * s) * over
    # c is rounded alike at every step, which would feed the motion (3e-17 of its energy a step)
    eta += ((g - eta) - scale * (2.0 * s + eta)) * over
    b += ((big - b) - scale * (s + b)) * over
    return eta, b, unit * (2.0 * s + eta), unit


@jit
def quadratic_step(law, k, s, g, scale):
    """End of a step within contact for α = 2 without contact loss, in closed form: η, b, f, df/dη.

    The span of x² over [s, b] is s² + sb + b², so the contact equation is quadratic.
    """
    over = (s + g) - scale * s * s  # > 0, or the step would separate
    c = 1.0 + scale * s
    width = math.sqrt(c * c + 4.0 * scale * over)
    eta = 2.0 * (g - 3.0 * scale * s * s) / (c + 2.0 * scale * s + width)
    b = 2.0 * over / (c + width)
    return eta, b, law.unit[k] * (s * s + b * (s + b)), law.unit[k] * (s + 2.0 * b)


@jit
def first_guess(law, k, s, g, scale):
    """Where to begin: the asymptotes of the solution (DESIGN sec. 3)."""
    big = s + g
    alpha = exponent(law, k)
    n = alpha + 1.0
    if s <= 0.0:  # (G - b)(b - s) = scale·b^n, where b^n is known at both asymptotes
        free = big / scale
        if not free < 1e150:
            return big
        near, far = root(law, k, free), (-s * free) ** (1.0 / n)
        b, whole = (near, big * near) if near >= far else (far, -s * big)
        if b >= big:
            return big
        miss = whole - (big - b) * (b - s)
        tilt = n * whole / b - (big + s - 2.0 * b)
        bottom = 2.0 * tilt * tilt - miss * (n * alpha * whole / (b * b) + 2.0)
        step = -2.0 * miss * tilt / bottom if bottom > 0.0 else -miss / tilt
        return min(big, max(b + step, 0.5 * b))
    kappa = n * scale * power(law, k, s) / s
    away = (g / s - kappa) / (1.0 + 0.5 * alpha * kappa)  # Newton from b = s
    if abs(away) * alpha < 0.5:
        return s + s * away
    t = big / s
    if away > 0.0:  # loading
        q = root(law, k, t / kappa)
        return min(big, s * min(min(t, 1.0 + away), min(2.0 * q - 1.0, n ** (1.0 / alpha) * q)))
    over = n * t - kappa  # unloading
    mid = n + alpha * t
    return s * 2.0 * over / (mid + math.sqrt(max(0.0, mid * mid - 4.0 * alpha * over)))


@jit
def lossy_guess(law, k, s, g, scale, rate, b):
    """Where to begin with contact loss, given where to begin without it."""
    n = exponent(law, k) + 1.0
    if s <= 0.0:
        return min(b, ((s + g) / (scale * rate)) ** (1.0 / n))
    force = n * scale * power(law, k, s)
    newton = s + (g - force) / (1.0 + force * (0.5 * exponent(law, k) / s + rate))  # from b = s; never below the root
    return b if s - 1.0 / rate < b < newton else newton


@jit
def scalar(law, damping, k, s, g, compliance, tolerance):
    """Solve one contact equation.

    law, damping, k: contact k's law and loss (engine.laws, engine.contact)
    s:          compression at the start of the step, m (negative: gap)
    g:          change of compression if there were no contact force, m
    compliance: B, change of compression per newton of contact force, m/N
    tolerance:  relative error left in b

    Returns η (m), b (m), mean force f (N), slope df/dη (N/m), evaluations of the contact law,
    and how it ended (FREE, SEPARATION, CLOSED, NEWTON or FAILED).
    """
    big = s + g
    if s < LEAST and big < LEAST:
        return g, big, 0.0, 0.0, 0, FREE
    alpha = exponent(law, k)
    scale = compliance * law.unit[k]
    rate = contact_loss(damping, k)
    if s > 0.0:
        if rate * g <= -1.0:  # leaves faster than the loss allows a push: Hunt-Crossley never pulls
            return g, big, 0.0, 0.0, 0, SEPARATION
        elastic = scale * s * power(law, k, s)
        if s * big <= elastic * (1.0 - rate * s):
            eta, b, force, slope = separate(law, k, s, g, rate, elastic)
            return eta, b, force, slope, 0, SEPARATION
    if rate == 0.0:
        if alpha == 1.0:
            eta, b, force, slope = linear_step(law, k, s, g, scale)
            return eta, b, force, slope, 0, CLOSED
        if alpha == 2.0 and s > 0.0:
            eta, b, force, slope = quadratic_step(law, k, s, g, scale)
            return eta, b, force, slope, 0, CLOSED
    if scale <= 0.0:
        b, eta = big, g
    else:
        b = first_guess(law, k, s, g, scale)
        if rate > 0.0:
            b = lossy_guess(law, k, s, g, scale, rate, b)
        eta = b - s
    return iterate(law, k, s, g, compliance, rate, tolerance, b, eta)


@jit
def iterate(law, k, s, g, compliance, rate, tolerance, b, eta):
    """Halley's iteration from b (> 0), kept inside a bracket; returns as `scalar` does.

    The force is extrapolated over the last step, so no evaluation is spent on confirming.
    """
    big = s + g
    low, high = 0.0, big
    if s > 0.0 and rate == 0.0:  # the sign of the residual at b = s is the sign of κ - g/s
        if g > compliance * law.unit[k] * (exponent(law, k) + 1.0) * power(law, k, s):
            low = s
        else:
            high = s
    elif s > 0.0:
        low, high = max(0.0, s - 1.0 / rate), max(big, s)
    degree = exponent(law, k) + 1.0
    for count in range(1, LIMIT + 1):
        f, df, ddf, dddf = inside(law, k, s, b, eta, rate)
        push = compliance * f
        miss = (eta - g) + push if abs(eta) < b else (b - big) + push
        slope = 1.0 + compliance * df
        bottom = 2.0 * slope * slope - miss * compliance * ddf
        step = -2.0 * miss * slope / bottom if bottom > 0.0 else -miss / slope
        if miss > 0.0:
            high = min(high, b)
        else:
            low = max(low, b)
        trusted = low <= b + step <= high
        if not trusted:
            step = -miss / slope
            trusted = low * (1.0 - SLACK) <= b + step <= high * (1.0 + SLACK)
            if not trusted:
                step = 0.5 * (low + high) - b
        # Halley leaves an error of third order in its step, times how much the contact matters;
        # the force is extrapolated to third order, and errs by the fourth
        size = degree * abs(step) / max(s, min(b, b + step))
        change = abs(step) * (slope - 1.0)  # of the force, times B
        error = max(size * size * (slope - 1.0) / slope, size * size * size) * change
        after = push + step * (slope - 1.0)  # a force that falls by orders of magnitude is not extrapolated
        done = (trusted and error <= tolerance * after and push <= 8.0 * after) or abs(miss) <= 4.4e-16 * (
            push + min(abs(g), abs(big))
        )
        if done:
            f += step * (df + step * (0.5 * ddf + step * dddf / 6.0))
            df += step * (ddf + step * 0.5 * dddf)
        b += step
        eta += step
        if done:
            return eta, b, f, df, count, NEWTON
    return eta, b, f, df, LIMIT, FAILED
