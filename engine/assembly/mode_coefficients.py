"""Coefficients of a step of each mode: kick t and drift v (engine.kernel.modes.mode_step), and the factors of loss."""

import math
from collections.abc import Callable
from typing import NamedTuple

import numpy as np

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
    loss: ModalLoss | None  # at either end
    drag: ModalLoss | None  # in the drift


def midpoint_coefficients(omega: np.ndarray, sigma: np.ndarray, h: float) -> tuple[np.ndarray, np.ndarray]:
    """Return kick t and drift v (s) of the paper's midpoint scheme (eq. 8, 29, 36): t = h/2.

    omega: angular frequencies, rad/s; sigma: decay rates, 1/s; h: step, s.
    Frequencies are warped to (2/h)·atan(ωh/2) (paper, sec. 4).
    """
    kick = np.full_like(omega, h / 2)
    return kick, 2 * kick / (1 + (omega * kick) ** 2)


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
    lost = _squares(math.sinh, s * h / 2)
    below = lost + _squares(math.sin, half_angle)  # (1 - cos θ)·cosh(σh)/2
    above = lost + _squares(math.cos, half_angle)  # (1 + cos θ)·cosh(σh)/2
    kick[swings] = np.sqrt(below / above) / w
    drift[swings] = 2 * kick[swings] / (1 + _squares(float, w * kick[swings]))
    for n in np.flatnonzero(~swings):
        kick[n], drift[n] = _exact_creep(float(omega[n]), float(sigma[n]), h)
    return kick, drift


def _squares(function: Callable[[float], float], values: np.ndarray) -> np.ndarray:
    """Return the squares of a function. Those of NumPy round otherwise on each processor."""
    return np.array([function(value) ** 2 for value in values.tolist()])


def _exact_creep(w: float, s: float, h: float) -> tuple[float, float]:
    """Return kick and drift (s) of a mode that does not swing: overdamped, or a free mass."""
    if w == 0.0:
        half = h / 2 * (math.sqrt(math.tanh(s * h) / (s * h)) if s * h > 0.0 else 1.0)
        return half, 2 * half
    slow = math.sqrt((s - w) * (s + w))
    below = math.sinh((s + slow) * h / 2) * math.sinh(w * w / (s + slow) * h / 2)
    above = math.sinh(s * h / 2) ** 2 + math.cosh(slow * h / 2) ** 2
    kick = math.sqrt(below / above) / w
    return kick, 2 * kick / (1 + (w * kick) ** 2)


def damped_coefficients(omega: np.ndarray, sigma: np.ndarray, h: float) -> tuple[np.ndarray, ...]:
    """Return five values for each mode: kick t and drift v (s); the factors of the momentum in each half-step of loss,
    d, and in the drift, x; and the energy lost in the drift over the squared momentum before it.

    With loss in the drift too, the step is the exact motion under a force constant over it,

        q⁺ = a·q + A·p + C·F,   A = e^(-σh)·sin(ω_d·h)/ω_d,   C = ∫₀ʰ A,   a = 1 - ω²C

    p⁺ = b·p - ω²A·q + A·F,   b = a - 2σA,

    if the half-steps of loss keep d² = (A² - C·e^(-2σh))/(C·a) = (e^(-2σh) - b)/(ω²C), t = C·d/A, v = A/d,
    and x = e^(-2σh)/d². The drift then takes the energy ½(1 - x)(1 + x - ω²tv)·p², with p the momentum before x, and
    nothing else, for v·(1 + ω²t²) = t·(1 + x). Valid for any damping, ω_d·h < π.
    """
    slow = np.sqrt((sigma - omega).astype(complex)) * np.sqrt(sigma + omega)  # i·ω_d
    move, give, brake = _responses(sigma, slow, h)
    left = np.exp(-2 * sigma * h)
    stay = 1 - omega**2 * give
    near = np.abs(stay) > 0.5  # of two forms of d², each where it does not cancel
    square = np.where(
        near,
        (move**2 - give * left) / np.where(near, give * stay, 1.0),
        (left - brake) / np.where(near, 1.0, 1 - stay),
    )
    square = np.minimum(square, 1.0)  # but for rounding, it is
    keep = np.sqrt(square)
    kick, inside = give * keep / move, np.minimum(left / square, 1.0)
    drift = kick * (1 + inside) / (1 + (omega * kick) ** 2)
    return kick, drift, keep, inside, 0.5 * (1 - inside) * (1 + inside - omega**2 * kick * drift)


def exact_motion(omega: np.ndarray, sigma: np.ndarray, h: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return a, A and b of the exact motion of each mode on which nothing acts (damped_coefficients)."""
    slow = np.sqrt((sigma - omega).astype(complex)) * np.sqrt(sigma + omega)  # i·ω_d
    move, give, brake = _responses(sigma, slow, h)
    return 1 - omega**2 * give, move, brake


def _responses(sigma: np.ndarray, slow: np.ndarray, h: float) -> tuple[np.ndarray, ...]:
    """Return A and C, the displacement of a mode in a step per momentum and per force, and the factor b."""
    from scipy.special import gammainc  # 0.1 s, which most scenes need not wait for

    close = np.abs(slow) * h < 0.02  # the two rates of decay are nearly one, and their difference would cancel
    apart = np.where(close, 1.0 / h, slow)
    fast = sigma + apart
    late = np.where(close, fast, (sigma - slow) * (sigma + slow) / fast)
    move = (np.exp(-late * h) - np.exp(-fast * h)) / (2 * apart)
    give = (_mean_decay(late, h) - _mean_decay(fast, h)) / (2 * apart)
    brake = (fast * np.exp(-fast * h) - late * np.exp(-late * h)) / (2 * apart)
    x, square = np.maximum(sigma * h, 1e-40), np.real((slow * h) ** 2)
    sine, cosine = 1 + square / 6 * (1 + square / 20), 1 + square / 2 * (1 + square / 12)
    series = [h * np.exp(-x) * sine]
    series.append(h**2 * sum(square**j * gammainc(2 * j + 2, x) / x ** (2 * j + 2) for j in range(3)))
    series.append(np.exp(-x) * (cosine - x * sine))
    exact = (move.real, give.real, brake.real)
    return tuple(np.where(close, a, b) for a, b in zip(series, exact, strict=True))


def _mean_decay(rate: np.ndarray, h: float) -> np.ndarray:
    """Return ∫₀ʰ e^(-rate·s) ds."""
    still = rate == 0.0
    return np.where(still, h, -np.expm1(-rate * h) / np.where(still, 1.0, rate))


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
    return coefficients if sigma.any() or has_dampers else coefficients._replace(loss=None)


def add_loss(
    kick: np.ndarray, drift: np.ndarray, modes: Modes, damped: np.ndarray, h: float, length: float = 1.0
) -> ModeCoefficients:
    """Return the coefficients of a step with loss, whose length is a share of a sample of h seconds.

    kick, drift: without loss in the drift [modes], s; those of damped modes are overwritten
    damped:      True for modes that also lose in the drift [modes]
    """
    decay = np.exp(-modes.sigma * length * h)
    if not damped.any():
        return ModeCoefficients(kick, drift, end_loss(decay), None)
    drag, dragged = np.ones(decay.size), np.zeros(decay.size)
    values = damped_coefficients(modes.omega[damped], modes.sigma[damped], length * h)
    kick[damped], drift[damped], decay[damped], drag[damped], dragged[damped] = values
    return ModeCoefficients(kick, drift, end_loss(decay), ModalLoss(drag, dragged))
