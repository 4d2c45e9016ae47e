"""Modes of circular thin plates, also under tension."""

import math
from typing import Any, NamedTuple

import numpy as np

from engine.arithmetic.bessel import bessel_j, bessel_j_pair, scaled_i, scaled_i_pair, zeros_of_j
from engine.arithmetic.elementary import arctan2, cos, exp, hypot, power, square
from engine.bodies.plate_modes import PlateModes
from engine.bodies.side_functions import Edge


class RimValues(NamedTuple):
    """J_m(β1·r) and I_m(β2·r)/I_m(β2), and their derivatives, at the rim r = 1; arrays of one shape."""

    order: np.ndarray  # m
    beta1: np.ndarray
    beta2: np.ndarray
    j: np.ndarray
    j_slope: np.ndarray  # β1·J'
    i_slope: np.ndarray  # β2·I'/I


def circular_plate_modes(
    radius: float,
    rigidity: float,
    poisson: float,
    density: float,
    tension: float = 0.0,
    edge: Edge = "free",
    count: int = 100,
    max_omega: float = math.inf,
) -> PlateModes:
    """Modes of a circular isotropic plate. A position is [x, y], fractions of the square around it.

    w = J_m(β1·r) + g·I_m(β2·r), times cos mθ or sin mθ, with D·β1⁴ + T·β1² = ρω² and β2² = β1² + T/D (Leissa,
    Vibration of Plates, sec. 2.1). A free plate has its three motions as a rigid body, with ω = 0.

    radius: m; rigidity: D, N·m; poisson: ν, 0 to 0.5; density: ρ, kg/m²; tension: T, N/m, none at a free edge
    count: of modes at most; max_omega: all are below it, rad/s
    """
    if edge == "free" and tension:
        raise ValueError("a plate with a free edge cannot be under tension")
    pull = tension * square(radius) / rigidity
    scale = math.sqrt(rigidity / density) / square(radius)
    most = square(max_omega / scale)  # β1⁴ + pull·β1²
    highest = math.sqrt(2 * most / (pull + math.sqrt(square(pull) + 4 * most))) if most < math.inf else math.inf
    # a clamped plate, which has the fewest modes, has about z²/4 - z with β1 < z
    order, beta = characteristic_roots(edge, poisson, pull, min(highest, 2 * math.sqrt(count) + 10))
    if edge == "free":
        order, beta = np.concatenate([[0.0, 1.0], order]), np.concatenate([[0.0, 0.0], beta])
    omega = scale * beta * np.sqrt(square(beta) + pull)
    rising = np.argsort(omega, kind="stable")
    rising = rising[omega[rising] < max_omega]
    which = np.repeat(rising, np.where(order[rising] == 0, 1, 2))[:count]
    order, beta, omega = order[which], beta[which], omega[which]
    is_second = np.concatenate([[False], which[1:] == which[:-1]])[: which.size]
    turn = np.where(is_second, math.pi / 2, 0.0)

    is_rigid = beta == 0
    rim = rim_values(order, np.where(is_rigid, 1.0, beta), pull)
    share = np.where(is_rigid, 0.0, share_of_i(edge, poisson, rim))
    radial = np.where(is_rigid, 1 / (2 * order + 2), radial_integral(rim, share))
    mass = density * square(radius) * radial * np.where(order == 0, 2 * math.pi, math.pi)
    of_rim = scaled_i(order, rim.beta2)

    def shape(position: Any) -> np.ndarray:
        x, y = np.moveaxis(2 * np.asarray(position, float) - 1, -1, 0)[..., None]
        r = hypot(x, y)
        growing = scaled_i(order, rim.beta2 * r) / of_rim * exp(rim.beta2 * (r - 1))
        bending = bessel_j(order, rim.beta1 * r) + share * growing
        return np.asarray(
            np.where(is_rigid, power(r, order), bending) * cos(order * arctan2(y, x) - turn) / np.sqrt(mass)
        )

    return PlateModes(omega, shape)


def rim_values(order: np.ndarray, beta: np.ndarray, pull: float) -> RimValues:
    """pull: T·R²/D"""
    beta2 = np.sqrt(square(beta) + pull)
    (j, j_above), (i, i_above) = bessel_j_pair(order, beta), scaled_i_pair(order, beta2)
    return RimValues(order, beta, beta2, j, order * j - beta * j_above, order + beta2 * i_above / i)


def free_conditions(poisson: float, rim: RimValues) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Bending moments of J and of I at the rim, and shear forces with those of the twist, over -D/R² and -D/R³.

    ∇²w - (1 - ν)(w_r + w_θθ) and ∂∇²w/∂r + (1 - ν)(w_rθθ - w_θθ), at r = 1.
    """
    rest, beta2, m2 = 1 - poisson, square(rim.beta1), square(rim.order)
    moment_j = -beta2 * rim.j - rest * (rim.j_slope - m2 * rim.j)
    shear_j = -beta2 * rim.j_slope - rest * m2 * (rim.j_slope - rim.j)
    moment_i = beta2 - rest * (rim.i_slope - m2)
    shear_i = beta2 * rim.i_slope - rest * m2 * (rim.i_slope - 1)
    return moment_j, moment_i, shear_j, shear_i


def characteristic_function(edge: Edge, poisson: float, rim: RimValues) -> np.ndarray:
    """Zero at the modes; finite everywhere."""
    if edge == "clamped":
        return np.asarray(rim.i_slope * rim.j - rim.j_slope)
    if edge == "supported":
        both = square(rim.beta1) + square(rim.beta2)
        return np.asarray((1 - poisson) * (rim.i_slope * rim.j - rim.j_slope) - both * rim.j)
    moment_j, moment_i, shear_j, shear_i = free_conditions(poisson, rim)
    return np.asarray(moment_j * shear_i - moment_i * shear_j)


def share_of_i(edge: Edge, poisson: float, rim: RimValues) -> np.ndarray:
    """g of w = J_m(β1·r) + g·I_m(β2·r)/I_m(β2)."""
    if edge != "free":
        return np.asarray(-rim.j)
    moment_j, moment_i, _, _ = free_conditions(poisson, rim)
    return np.asarray(-moment_j / moment_i)


def radial_integral(rim: RimValues, share: np.ndarray) -> np.ndarray:
    """∫ w²·r dr from 0 to 1, by Lommel's integrals."""
    square1, square2, m2 = square(rim.beta1), square(rim.beta2), square(rim.order)
    of_j = ((1 - m2 / square1) * square(rim.j) + square(rim.j_slope) / square1) / 2
    of_i = (1 + (m2 - square(rim.i_slope)) / square2) / 2
    of_both = (rim.i_slope * rim.j - rim.j_slope) / (square1 + square2)
    return np.asarray(of_j + 2 * share * of_both + square(share) * of_i)


def characteristic_roots(edge: Edge, poisson: float, pull: float, top: float) -> tuple[np.ndarray, np.ndarray]:
    """m and β1 > 0 of all modes with β1 < `top`, by bisection.

    The characteristic equations are β1·J_{m+1}/J_m = a function of β1 without poles, whose left side rises from -∞ to
    ∞ between two zeros of J_m, so one root lies between; of a clamped plate it lies below the zero of J_{m+1}. Below
    the first zero a clamped plate has none, and a free one none for m = 0 and 1.
    """
    orders, lows, highs = [np.zeros(0)], [np.zeros(0)], [np.zeros(0)]
    for m in range(int(1.05 * top) + 3):
        number = max(int((top - m) / math.pi), 0) + 2  # the first zero is beyond m, the next ones π apart and more
        zeros = zeros_of_j(m, np.arange(1, number + 1))
        if edge == "clamped":
            low, high = zeros, zeros_of_j(m + 1, np.arange(1, number + 1))
        else:
            low, high = np.concatenate([[m / 2 if m else 1e-2], zeros[:-1]]), zeros
            if edge == "free" and m < 2:
                low, high = low[1:], high[1:]
        orders.append(np.full(low.size, float(m)))
        lows.append(low)
        highs.append(high)
    order, low, high = np.concatenate(orders), np.concatenate(lows), np.concatenate(highs)
    possible = low < top
    order, low, high = order[possible], low[possible], high[possible]
    sign = np.sign(characteristic_function(edge, poisson, rim_values(order, high, pull)))
    for _ in range(60):
        middle = (low + high) / 2
        is_above = np.sign(characteristic_function(edge, poisson, rim_values(order, middle, pull))) == sign
        low, high = np.where(is_above, low, middle), np.where(is_above, middle, high)
    is_below = high < top
    return order[is_below], high[is_below]
