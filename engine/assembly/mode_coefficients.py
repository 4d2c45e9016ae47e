"""Coefficients of a step of each mode: kick t and drift v (engine.kernel.modes.mode_step), and the factors of loss."""

import math
from typing import Any, NamedTuple

import numpy as np

from engine.arithmetic.double_double import two_product
from engine.arithmetic.elementary import cosh, exp, expm1, sin, sin_and_cos, sinh, square, tanh
from engine.arithmetic.plain_numbers import whole_power
from engine.assembly.array_memory import ABSENT
from engine.assembly.modes import Modes
from engine.faults import BuildError, Fault
from engine.kernel.data.model import ModalLoss
from engine.patch.accuracy import Accuracy

HEAVY_DAMPING = 0.05  # σh, from which loss in the drift is worth its time
MAX_DAMPING_BACKWARDS = 0.15  # σh: beyond, loss apart from the core is too coarse, and steps back in time are refused


class ModeCoefficients(NamedTuple):
    """Coefficients of a step of each mode, without contact."""

    kick: np.ndarray  # t [modes], s
    drift: np.ndarray  # v [modes], s
    loss: ModalLoss  # at either end; or ABSENT
    drag: ModalLoss  # in the drift; or ABSENT


def midpoint_coefficients(omega: np.ndarray, sigma: np.ndarray, h: float) -> tuple[np.ndarray, np.ndarray]:
    """Return kick t and drift v (s) of the paper's midpoint scheme (eq. 8, 29, 36): t = h/2.

    omega: angular frequencies, rad/s; sigma: decay rates, 1/s; h: step, s.
    Frequencies are warped to (2/h)·atan(ωh/2) (paper, sec. 4).
    """
    kick = np.full_like(omega, h / 2)
    return kick, 2 * kick / (1 + square(omega * kick))


def exact_coefficients(omega: np.ndarray, sigma: np.ndarray, h: float) -> tuple[np.ndarray, np.ndarray]:
    """Return kick t and drift v (s) that give free vibration its exact frequency and decay.

    Together with the half-steps of loss, the mode's roots are exp(-σh ± iω_d·h), ω_d² = ω² - σ², if
    cos θ = cos(ω_d·h)/cosh(σh) and t = tan(θ/2)/ω (docs/design.md, sec. 1). Overdamped modes have cosh in place of cos.
    For ω = 0, t = (h/2)·√(tanh(σh)/σh): a free mass falls exactly, and coasts with an error of about (σh)²/3;
    `damped_coefficients` makes both exact. Valid for ω_d·h < π.
    """
    kick, drift = np.empty((2, omega.size))
    swings = sigma < omega
    w, s = omega[swings], sigma[swings]
    half_angle = np.sqrt((w - s) * (w + s)) * h / 2
    lost = square(sinh(s * h / 2))
    sine, cosine = sin_and_cos(half_angle)
    below, above = lost + square(sine), lost + square(cosine)  # (1 ∓ cos θ)·cosh(σh)/2
    kick[swings], drift[swings] = _closest_pair(np.sqrt(below / above) / w, w)
    if not np.all(swings):
        kick[~swings], drift[~swings] = _exact_creep(omega[~swings], sigma[~swings], h)
    return kick, drift


def _closest_pair(kick: np.ndarray, omega: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return kick t and drift v with the least rounding error of v·(ω² + a²) = 2a, a = ω²·t, of kicks that differ in
    their last digits: what it leaves of the energy, each step adds (docs/design.md, sec. 1)."""
    kicks = kick * (1 + 2.0**-52 * np.arange(-4, 5))[:, None]
    drifts = 2 * kicks / (1 + square(omega * kicks))
    stiffness = square(omega)
    a = kicks * stiffness
    (x, x_rest), (y, y_rest) = two_product(drifts, stiffness), two_product(a, a)
    z, z_rest = two_product(drifts, y)
    left = ((2 * a - x) - z) - (x_rest + z_rest + drifts * y_rest)
    best = np.argmin(np.abs(left), axis=0), np.arange(kick.size)
    return kicks[best], drifts[best]


def _exact_creep(omega: np.ndarray, sigma: np.ndarray, h: float) -> tuple[np.ndarray, np.ndarray]:
    """Return kick and drift (s) of modes that do not swing: overdamped, or free masses."""
    is_free, x = omega == 0.0, sigma * h
    of_mass = h / 2 * np.sqrt(np.where(x > 0.0, tanh(x) / np.where(x > 0.0, x, 1.0), 1.0))
    if np.all(is_free):
        return of_mass, 2 * of_mass
    w, s = np.where(is_free, 1.0, omega), np.where(is_free, 1.0, sigma)
    slow = np.sqrt((s - w) * (s + w))
    below = sinh((s + slow) * h / 2) * sinh(w * w / (s + slow) * h / 2)
    above = square(sinh(s * h / 2)) + square(cosh(slow * h / 2))
    kick = np.where(is_free, of_mass, np.sqrt(below / above) / w)
    return kick, 2 * kick / (1 + square(omega * kick))


def damped_coefficients(omega: np.ndarray, sigma: np.ndarray, h: float) -> tuple[np.ndarray, ...]:
    """Return five values for each mode: kick t and drift v (s); the factors of the momentum in each half-step of loss,
    d, and in the drift, x; and the energy lost in the drift over the squared momentum before it.

    With loss in the drift too, the step is the exact motion under a force constant over it,

        q⁺ = a·q + A·p + C·F,   A = e^(-σh)·sin(ω_d·h)/ω_d,   C = ∫₀ʰ A,   a = 1 - ω²C

    p⁺ = b·p - ω²A·q + A·F,   b = a - 2σA,

    if the half-steps of loss keep d² = (A² - C·e^(-2σh))/(C·a) = (e^(-2σh) - b)/(ω²C), t = C·d/A, v = A/d,
    and x = e^(-2σh)/d². The drift then takes the energy ½(1 - x)(1 + x - ω²tv)·p², with p the momentum before x, and
    nothing else, for v·(1 + ω²t²) = t·(1 + x). Valid for any damping, ω_d·h < π. A mode that turns further, such as a
    residual one for shorter steps than h, is at rest after the step: t = v = 1/ω, d = 0.
    """
    is_beyond = square(omega) - square(sigma) >= square(math.pi / h)
    if np.any(is_beyond):
        slow = damped_coefficients(np.where(is_beyond, 1.0 / h, omega), np.where(is_beyond, 0.0, sigma), h)
        fast: tuple[Any, ...] = (1 / omega, 1 / omega, 0.0, 1.0, 0.0)
        return tuple(np.where(is_beyond, one, other) for one, other in zip(fast, slow, strict=True))
    move, give, brake = _responses(omega, sigma, h)
    left = exp(-2 * sigma * h)
    stay = 1 - square(omega) * give
    near = np.abs(stay) > 0.5  # of two forms of d², each where it does not cancel
    kept = np.where(
        near,
        (square(move) - give * left) / np.where(near, give * stay, 1.0),
        (left - brake) / np.where(near, 1.0, 1 - stay),
    )
    kept = np.minimum(kept, 1.0)  # but for rounding, it is
    keep = np.sqrt(kept)
    kick, inside = give * keep / move, np.minimum(left / kept, 1.0)
    drift = kick * (1 + inside) / (1 + square(omega * kick))
    return kick, drift, keep, inside, 0.5 * (1 - inside) * (1 + inside - square(omega) * kick * drift)


def exact_motion(omega: np.ndarray, sigma: np.ndarray, h: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return a, A and b of the exact motion of each mode on which nothing acts (damped_coefficients)."""
    move, give, brake = _responses(omega, sigma, h)
    return 1 - square(omega) * give, move, brake


GAMMA_TERMS = 60  # of a series in σh, which is below 4 where it is used


def _responses(omega: np.ndarray, sigma: np.ndarray, h: float) -> tuple[np.ndarray, ...]:
    """Return A and C, the displacement of a mode in a step per momentum and per force, and the factor b."""
    turned = (omega - sigma) * (omega + sigma) * h * h  # (ω_d·h)²
    close = np.abs(turned) < square(0.02)  # the two rates of decay are nearly one, and their difference would cancel
    swings = (turned > 0.0) & ~close
    out = np.empty((3, omega.size))
    for chosen, respond in ((close, _respond_closely), (swings, _swing), (~close & ~swings, _creep)):
        if np.any(chosen):
            out[:, chosen] = respond(omega[chosen], sigma[chosen], h)
    return tuple(out)


def _swing(omega: np.ndarray, sigma: np.ndarray, h: float) -> tuple[np.ndarray, ...]:
    """Return A, C and b of modes that swing."""
    rate = np.sqrt((omega - sigma) * (omega + sigma))
    (sine, cosine), decay = sin_and_cos(rate * h), exp(-sigma * h)
    move = decay * sine / rate
    less = expm1(-sigma * h) * cosine - 2 * square(sin(rate * h / 2))  # e^(-σh)·cos(ω_d·h) - 1
    return move, -(less + sigma * move) / square(omega), decay * cosine - sigma * move


def _creep(omega: np.ndarray, sigma: np.ndarray, h: float) -> tuple[np.ndarray, ...]:
    """Return A, C and b of modes that do not swing."""
    apart = np.sqrt((sigma - omega) * (sigma + omega))
    fast = sigma + apart
    late = square(omega) / fast
    of_late, of_fast = exp(-late * h), exp(-fast * h)
    give = (_mean_decay(late, h) - _mean_decay(fast, h)) / (2 * apart)
    return (of_late - of_fast) / (2 * apart), give, (fast * of_fast - late * of_late) / (2 * apart)


def _respond_closely(omega: np.ndarray, sigma: np.ndarray, h: float) -> tuple[np.ndarray, ...]:
    """Return A, C and b of modes whose two rates of decay are nearly one."""
    x, apart = sigma * h, (sigma - omega) * (sigma + omega) * h * h
    sine, cosine, decay = 1 + apart / 6 * (1 + apart / 20), 1 + apart / 2 * (1 + apart / 12), exp(-x)
    give = h * h * sum(whole_power(apart, j) * _incomplete_gamma(2 * j + 2, x) for j in range(3))
    return h * decay * sine, give, decay * (cosine - x * sine)


def _incomplete_gamma(a: int, x: np.ndarray) -> np.ndarray:
    """Return P(a, x)/x^a = e^(-x)/Γ(a)·Σ xᵏ/(a·(a + 1)…(a + k)), the regularised incomplete gamma function (DLMF
    8.7.1)."""
    term = np.full(x.size, 1.0 / math.factorial(a))
    total = term.copy()
    for k in range(1, GAMMA_TERMS):
        term = term * x / (a + k)
        total += term
    return np.asarray(exp(-x) * total)


def _mean_decay(rate: np.ndarray, h: float) -> np.ndarray:
    """Return ∫₀ʰ e^(-rate·s) ds."""
    still = rate == 0.0
    return np.where(still, h, -expm1(-rate * h) / np.where(still, 1.0, rate))


def loses_in_drift(omega: np.ndarray, sigma: np.ndarray, h: float, accuracy: Accuracy) -> np.ndarray:
    """True for modes that need `damped_coefficients` [modes], bool. These modes lose much within a step, or are free
    masses with damping, for which no other table is exact both when they coast and when they are pushed. If a sample
    has several steps, they are all modes with loss, for only these steps together are the exact motion over a
    sample."""
    if accuracy.scheme != "exact":
        return np.zeros(omega.size, np.bool_)
    if accuracy.is_refined:
        return np.asarray(sigma > 0.0)
    return np.asarray((sigma * h > HEAVY_DAMPING) | ((omega == 0.0) & (sigma > 0.0)))


def end_loss(decay_factor: np.ndarray) -> ModalLoss:
    """Return the half-step of loss that multiplies each momentum by its decay factor [modes]."""
    # from the rounded factor: the two must agree, or the energy balance drifts
    return ModalLoss(decay_factor, 0.5 * (1 - decay_factor) * (1 + decay_factor))


SCHEMES = {"exact": exact_coefficients, "fdh": midpoint_coefficients}


def mode_coefficients(modes: Modes, samplerate: float, accuracy: Accuracy, has_dampers: bool) -> ModeCoefficients:
    """Return the coefficients of a step of a sample. Raises BuildError if damping is too heavy for steps back in time.

    has_dampers: True if events may damp modes in steps of a whole sample: their loss is a part of the modes'
                 (engine.kernel.modes.event_dampers)
    """
    omega, sigma, h = modes.omega, modes.sigma, 1.0 / samplerate
    limit = MAX_DAMPING_BACKWARDS * samplerate * accuracy.substeps
    if accuracy.order > 2 and sigma.max(initial=0.0) > limit:
        message = f"order {accuracy.order} has steps back in time, in which heavy damping would create energy"
        message += f", and allows decay rates up to {limit:.4g} 1/s ({sigma.max():.4g} here)"
        raise BuildError(Fault("accuracy.order", f"{message}; use more substeps, or order = 2"))
    damped = loses_in_drift(omega, sigma, h, accuracy)
    kick, drift = np.empty((2, omega.size))
    kick[~damped], drift[~damped] = SCHEMES[accuracy.scheme](omega[~damped], sigma[~damped], h)
    coefficients = add_loss(kick, drift, modes, damped, h)
    return coefficients if sigma.any() or has_dampers else coefficients._replace(loss=ABSENT)


def add_loss(
    kick: np.ndarray, drift: np.ndarray, modes: Modes, damped: np.ndarray, h: float, length: float = 1.0
) -> ModeCoefficients:
    """Return the coefficients of a step with loss, whose length is a share of a sample of h seconds.

    kick, drift: without loss in the drift [modes], s; those of damped modes are overwritten
    damped:      True for modes that also lose in the drift [modes]
    """
    decay = exp(-modes.sigma * length * h)
    if not damped.any():
        return ModeCoefficients(kick, drift, end_loss(decay), ABSENT)
    drag, dragged = np.ones(decay.size), np.zeros(decay.size)
    values = damped_coefficients(modes.omega[damped], modes.sigma[damped], length * h)
    kick[damped], drift[damped], decay[damped], drag[damped], dragged[damped] = values
    return ModeCoefficients(kick, drift, end_loss(decay), ModalLoss(drag, dragged))
