"""Tips of some width, and what they cover of a body: a disc of a sheet, a piece of a string or a bar.

A contact feels the mean motion of what it covers, and the modes that are left out give way under it by a compliance
that is finite.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from engine.arithmetic.bessel import j0, j1
from engine.arithmetic.elementary import cos, hypot, power, sin
from engine.arithmetic.plain_numbers import log
from engine.arithmetic.products import product
from engine.arithmetic.quadrature import gauss_legendre

Compliance = Callable[[Any, list[Any]], np.ndarray]  # of places [..., position] with others → [..., others], m/N
PANEL_GROWTH, PANEL_NODES = 1.4, 8  # of a sum over wave numbers: the ratio of the ends of a panel, and its nodes
LAST_WAVE = 100.0  # wave number times radius, or distance, up to which such a sum goes …
LAST_BENDING_WAVE = 60.0  # … and of its lowest wave number, where bending makes waves beyond it hardly give way


@dataclass(frozen=True)
class Tip:
    """A place that a tip covers: its middle, a position on the body, and its radius in m."""

    at: Any
    radius: float


def place_of(at: Any, radius: float) -> Any:
    """Return what a tip of a radius (m) covers: a position without any."""
    return Tip(at, radius) if at is not None and radius > 0.0 else at


def middle_of(place: Any) -> Any:
    """Return the position in the middle of a place."""
    return place.at if isinstance(place, Tip) else place


def mean_over_disc(phase: np.ndarray) -> np.ndarray:
    """Return the mean of a wave φ with Δφ = -k²·φ over a disc, for its value in the middle: 2·J1(kr)/(kr). phase: kr"""
    safe = np.maximum(phase, 1e-9)
    return np.asarray(2 * j1(safe) / safe)


def disc_nodes(phase: float) -> tuple[np.ndarray, np.ndarray]:
    """Return places in the unit disc [n, 2], and weights of sum 1, that average waves up to a phase kr at its rim."""
    node, weight = gauss_legendre(4 + math.ceil(phase / 2))
    rays = 2 * math.ceil(phase / 2) + 8
    angle, radius = 2 * np.pi * np.arange(rays) / rays, np.sqrt((node + 1) / 2)  # even in area
    places = np.stack([np.outer(radius, cos(angle)), np.outer(radius, sin(angle))], axis=-1)
    return places.reshape(-1, 2), np.repeat(weight / 2 / rays, rays)


def sum_modes(omega: np.ndarray, shape: Callable[[Any], np.ndarray]) -> Compliance:
    """Return the static compliance of modes, Σ Φᵢ·Φⱼ/ω², between places."""

    def compliance(at: Any, others: list[Any]) -> np.ndarray:
        return np.asarray(product(shape(at) / omega, (np.array([shape(place) for place in others]) / omega).T))

    return compliance


def sum_waves(
    waves: tuple[float, float],
    tension: float,
    rigidity: float,
    radius: Callable[[Any], float],
    metres: Callable[[Any], np.ndarray],
) -> Compliance:
    """Return the static compliance of all waves between two wave numbers in a sheet, far from its rim:
    (1/2π)·∫ fᵢ·fⱼ·J0(kd)·k/(T·k² + D·k⁴) dk, with f = 2·J1(kr)/(kr) of tips, 1 at points, and d their distance.

    waves: wave numbers, 1/m; tension: T, N/m; rigidity: D, N·m
    radius: of a place, m; metres: from positions to coordinates [..., 2], m
    """

    lowest, highest = waves

    def between(first: float, second: float, away: np.ndarray) -> np.ndarray:
        """Return the compliance between two places of radii, m, at distances [n], m."""
        reach = [LAST_WAVE / size for size in (first, second, float(np.min(away))) if size > 0.0]
        if rigidity > 0.0:
            reach.append(LAST_BENDING_WAVE * lowest)
        last = min(highest, max(4.0 * lowest, min(reach, default=math.inf)))
        if not math.isfinite(last):
            return np.full(away.size, math.inf)  # a point on a membrane has no limit
        k, size = wave_nodes(lowest, last, math.pi / (first + second + float(np.max(away)) + 1e-9))
        of_first = mean_over_disc(k * first)
        of_second = of_first if second == first else mean_over_disc(k * second)
        felt = size * of_first * of_second / (k * (tension + rigidity * k * k))
        return np.asarray(product(j0(np.outer(away, k)), felt) / (2 * math.pi))

    def compliance(at: Any, others: list[Any]) -> np.ndarray:
        own, positions = radius(at), metres(at)
        columns = []
        for other in others:
            away = hypot(*np.moveaxis(positions - metres(other), -1, 0))
            columns.append(between(own, radius(other), np.ravel(away)).reshape(away.shape))
        return np.stack(columns, axis=-1)

    return compliance


def wave_nodes(lowest: float, highest: float, longest: float) -> tuple[np.ndarray, np.ndarray]:
    """Return wave numbers, and what part of the range between two of them each stands for [n], 1/m. longest: that a
    part of the range with so many nodes may be, 1/m"""
    grown = math.ceil(log(max(1.0, min(highest, longest / (PANEL_GROWTH - 1)) / lowest)) / log(PANEL_GROWTH))
    ends = np.minimum(lowest * power(PANEL_GROWTH, np.arange(grown + 1)), highest)
    even = math.ceil((highest - ends[-1]) / longest)
    ends = np.append(ends[:-1], np.linspace(ends[-1], highest, even + 1))
    node, weight = gauss_legendre(PANEL_NODES)
    begin, size = ends[:-1, None], np.diff(ends)[:, None]
    return (begin + size * (node + 1) / 2).ravel(), (size * weight / 2).ravel()
