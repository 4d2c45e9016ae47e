"""Bodies as modes: angular frequency ω, decay rate σ, mass-normalised mode shape Φ.

A shape is in 1/√kg: a force F at a place drives mode m with Φ_m·F, and the displacement there is
Σ Φ_m·q_m.
"""

import math
from collections.abc import Callable
from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np

from engine.parts import SHEET, Bar, Body, Mass, Membrane, Modes, Oscillator, Plate, String
from engine.spots import places

TO_60_DB = 3 * math.log(10)  # σ·T60: e^(-σ·T60) = 10^-3
MOST = 20_000  # modes of one body
WIDEST = 2_000  # modes among which those of a supported body are found
SLOWEST = 1e-150  # rad/s; below, the square underflows, and a body that hardly turns back would stand still
COUPLED = 0.05  # of the distance of two modes, what a damper may couple them by: decay rates are then right to 1 %


class ModalBody(NamedTuple):
    """A body as the kernels see it."""

    omega: np.ndarray  # [modes], rad/s
    sigma: np.ndarray  # [modes], 1/s
    shape: Callable[[Any], np.ndarray]  # place → [modes], 1/√kg
    q: np.ndarray  # [modes], √kg·m, displacement at time 0
    p: np.ndarray  # [modes], √kg·m/s, momentum at time 0
    weight: np.ndarray  # [modes], √kg: its share of a uniform gravity of 1 m/s²


class TooMany(ValueError):
    """More modes below the highest frequency than can be built."""


class TooDamped(ValueError):
    """Dampers of supports that couple the modes of their body more than can be left out."""


def modal(body: Body, highest: float = math.inf) -> ModalBody:
    """Modes of a body, those of bodies with many only up to `highest` (Hz).

    Raises TooMany if those are more than 20 000 and the body does not limit them, TooDamped if its supports
    damp it too much; ArithmeticError or other ValueErrors if its numbers are beyond what can be computed with.
    """
    if isinstance(body, Mass | Oscillator):
        return _lumped(body)
    with np.errstate(all="ignore"):  # what is not finite is refused in the end (engine.limits)
        if isinstance(body, Modes) or not body.support:
            spread = _SPREAD[type(body)](body, 2 * math.pi * highest)
        else:
            spread = _supported(body, 2 * math.pi * highest)
    omega, sigma, shape = np.where(spread[0] > SLOWEST, spread[0], 0.0), *spread[1:]
    still = np.zeros(omega.size)
    return ModalBody(omega, sigma, shape, still, still, still)


def _lumped(body: Mass | Oscillator) -> ModalBody:
    """A mass is one mode with ω = 0, an oscillator one with ω = √(k/m); the shape is 1/√m for
    both, and σ = γ/2 (paper, eq. 30 and 36: m·ÿ + m·γ·ẏ + k·y = f)."""
    root = math.sqrt(body.mass)
    shape = np.array([1 / root])
    return ModalBody(
        omega=np.array([angular_frequency(body)]),
        sigma=np.array([body.damping / 2]),
        shape=lambda place: shape,
        q=np.array([body.displacement * root]),
        p=np.array([body.velocity * root]),
        weight=np.array([root]),
    )


def angular_frequency(body: Mass | Oscillator) -> float:
    """ω of a body of one mode, rad/s."""
    if not isinstance(body, Oscillator):
        return 0.0
    if body.frequency is not None:
        omega = 2 * math.pi * body.frequency
    else:
        omega = math.sqrt((body.stiffness or 0.0) / body.mass)
    return omega if omega > SLOWEST else 0.0


Spread = tuple[np.ndarray, np.ndarray, Callable[[Any], np.ndarray]]


def decay(body: String | Bar | Membrane | Plate, omega: np.ndarray, wave: np.ndarray) -> np.ndarray:
    """σ of modes of angular frequency ω and wave number β.

    σ0 + σ1·β + σ3·β³ (van Walstijn, Bridges, Mehes, DAFx-16) + b3·ω² (Chaigne & Askenfelt 1994,
    whose b1 is σ0); or T60 at two frequencies, with σ going as ω² between (Bilbao, Numerical Sound
    Synthesis, sec. 7.3).
    """
    if body.t60 is None:
        return np.asarray(body.sigma0 + body.sigma1 * wave + body.sigma3 * wave**3 + body.b3 * omega**2)
    rates = [TO_60_DB / t for t in body.t60]
    if len(rates) == 1 or body.t60_at is None:
        return np.full_like(omega, rates[0])
    a, b = ((2 * math.pi * f) ** 2 for f in body.t60_at)
    slope = (rates[1] - rates[0]) / (b - a)
    return np.asarray(rates[0] + slope * (omega**2 - a))


def line_density(body: String | Bar) -> float:
    """Mass per length, kg/m."""
    return body.density if body.density is not None else (body.mass or 0.0) / body.length


def string_stiffness(body: String) -> tuple[float, float]:
    """Tension T (N) and bending stiffness EI (N·m²), from whichever is given: B = π²·EI/(T·L²), and
    the first partial at √(T·β² + EI·β⁴)/√μ, β = π/L."""
    beta = math.pi / body.length
    if body.tension is not None:
        tension = body.tension
        if body.inharmonicity is not None:
            return tension, body.inharmonicity * tension / beta**2
        return tension, body.bending or 0.0
    square = line_density(body) * (2 * math.pi * (body.frequency or 0.0)) ** 2 / beta**2  # T + EI·β²
    if body.inharmonicity is not None:
        tension = square / (1 + body.inharmonicity)
        return tension, body.inharmonicity * tension / beta**2
    bending = body.bending or 0.0
    return square - bending * beta**2, bending


def _string(body: String, highest: float) -> Spread:
    """Stiff string with simply supported ends: ω² = (T·β² + EI·β⁴)/μ, β = iπ/L; shapes sin βx, with
    modal mass μL/2 (Fletcher & Rossing, Physics of Musical Instruments, sec. 2.18)."""
    density = line_density(body)
    tension, bending = string_stiffness(body)
    root = math.pi / body.length

    def frequencies(n: np.ndarray) -> np.ndarray:
        return np.asarray(np.sqrt((tension + bending * (n * root) ** 2) / density) * (n * root))

    number = _numbers(frequencies, body.modes, highest)
    scale = math.sqrt(2 / (density * body.length))
    omega = frequencies(number)
    return omega, decay(body, omega, number * root), lambda x: scale * np.sin(math.pi * number * x)


def _numbers(frequencies: Callable[[np.ndarray], np.ndarray], limit: int | None, highest: float) -> np.ndarray:
    """1, 2, … as long as the frequency is below the highest, and there are no more than the limit."""
    most = limit or MOST + 1
    number = np.arange(1.0, most + 1)
    number = number[frequencies(number) < highest]
    if limit is None and number.size > MOST:
        raise TooMany(f"has more than {MOST} modes below {highest / 2 / math.pi:.0f} Hz")
    return number


def _bar(body: Bar, highest: float) -> Spread:
    """Euler-Bernoulli bar: ω = β²·√(EI/μ), where cos(βL)·cosh(βL) = 1 (both ends free, or both clamped)
    or -1 (cantilever); shapes of mean square 1 (Fletcher & Rossing, sec. 2.15 to 2.16; Blevins,
    Formulas for Natural Frequency and Mode Shape, table 8-1)."""
    density, length = line_density(body), body.length
    first = float(bar_roots(body.ends, np.array([1.0]))[0])
    speed = 2 * math.pi * (body.frequency or 0.0) * (length / first) ** 2
    if body.bending:
        speed = math.sqrt(body.bending / density)
    if body.ratios is not None:
        root = bar_roots(body.ends, np.arange(1.0, len(body.ratios) + 1))
        omega = speed * (first / length) ** 2 * np.array(body.ratios)
        chosen = omega < highest
        omega, root = omega[chosen][: body.modes], root[chosen][: body.modes]
    else:
        number = _numbers(lambda n: speed * (bar_roots(body.ends, n) / length) ** 2, body.modes, highest)
        root = bar_roots(body.ends, number)
        omega = speed * (root / length) ** 2
    scale = 1 / math.sqrt(density * length)
    return omega, decay(body, omega, root / length), lambda x: scale * bar_shape(body.ends, root, x)


def bar_roots(ends: str, number: np.ndarray) -> np.ndarray:
    """βL of modes 1, 2, …, by Newton's method from its asymptote."""
    sign = -1.0 if ends == "cantilever" else 1.0
    root = (number + 0.5 * sign) * math.pi
    for _ in range(6):  # cos x = sign/cosh x; the right side is a small correction
        small = sign / np.cosh(np.minimum(root, 700.0))
        root = root - (np.cos(root) - small) / (-np.sin(root) + small * np.tanh(root))
    return np.asarray(root)


def bar_shape(ends: str, root: np.ndarray, x: float) -> np.ndarray:
    """Shape of the modes with βL = root at fraction x, of mean square 1: cosh z - s·sinh z ± (cos z - s·sin z),
    z = βL·x, written with falling exponentials only, or the high ones would cancel."""
    z = root * x
    down = np.exp(-root)
    if ends == "cantilever":
        bottom = 1 + down**2 + 2 * down * np.cos(root)
        s = (1 - down**2 - 2 * down * np.sin(root)) / bottom
        rest = (down + np.cos(root) + np.sin(root)) / bottom
    else:
        bottom = 1 - down**2 - 2 * down * np.sin(root)
        s = (1 + down**2 - 2 * down * np.cos(root)) / bottom
        rest = (np.cos(root) - np.sin(root) - down) / bottom
    growing = np.exp(z - root) * rest + 0.5 * (1 + s) * np.exp(-z)
    wave = np.cos(z) - s * np.sin(z)
    return np.asarray(growing + wave if ends == "free" else growing - wave)


def _membrane(body: Membrane, highest: float) -> Spread:
    """Membrane: ω = β·√(T/ρ). On a rectangle as the plate's; on a circle β = j_mn/a, the zeros of J_m,
    and shapes J_m(βr)·cos mθ and sin mθ (Fletcher & Rossing, sec. 3.3)."""
    if body.size is not None:
        lowest = math.hypot(math.pi / body.size[0], math.pi / body.size[1])
        return _rectangle(body, body.size, _speed(body, body.tension, lowest), 1, highest)
    from scipy.special import jn_zeros, jv

    modes = body.modes or SHEET
    radius = body.radius or 1.0
    speed = _speed(body, body.tension, float(jn_zeros(0, 1)[0]) / radius)
    top = min(highest * radius / speed, 2 * math.sqrt(modes) + 10)  # Weyl: about z²/4 zeros below z
    found = [zero for zero in _drum(math.ceil(top)) if zero[0] < top]
    zero, order, turn = np.array(found[:modes]).reshape(-1, 3).T
    area = math.pi * radius**2 * np.where(order == 0, 1.0, 0.5)
    scale = 1 / (np.sqrt(body.density * area) * np.abs(jv(order + 1, zero)))

    def shape(place: Any) -> np.ndarray:
        x, y = 2 * place[0] - 1, 2 * place[1] - 1
        return np.asarray(scale * jv(order, zero * math.hypot(x, y)) * np.cos(order * math.atan2(y, x) - turn))

    omega = speed * zero / radius
    return omega, decay(body, omega, zero / radius), shape


@lru_cache(8)
def _drum(top: int) -> list[tuple[float, int, float]]:
    """Zeros below `top` of the Bessel functions J_m, with m and the turn of each shape, 0 and, but for m = 0, a
    quarter; the lowest first."""
    from scipy.special import jn_zeros

    found: list[tuple[float, int, float]] = []
    for m in range(top + 1):
        zeros = jn_zeros(m, int((top - m) / math.pi) + 2)  # the first is beyond m, the next ones π apart and more
        for zero in zeros[zeros < top].tolist():
            found += [(zero, m, 0.0)] + ([(zero, m, math.pi / 2)] if m else [])
    return sorted(found)


def _speed(body: Membrane | Plate, stiffness: float | None, lowest: float) -> float:
    """√(stiffness/ρ), or what gives the first partial its frequency."""
    return math.sqrt(stiffness / body.density) if stiffness else 2 * math.pi * (body.frequency or 0.0) / lowest


def _plate(body: Plate, highest: float) -> Spread:
    """Simply supported thin plate: ω = β²·√(D/ρ), β² = π²(m²/a² + n²/b²) (Fletcher & Rossing, sec. 3.7)."""
    square = (math.pi / body.size[0]) ** 2 + (math.pi / body.size[1]) ** 2
    return _rectangle(body, body.size, _speed(body, body.rigidity, square), 2, highest)


def _rectangle(body: Membrane | Plate, size: list[float], speed: float, power: int, highest: float) -> Spread:
    """ω = speed·β^power; shapes sin(mπx)·sin(nπy), with modal mass ρab/4; the lowest modes first."""
    a, b = size
    modes = body.modes or SHEET
    # Weyl's law: about ab·β²/4π - (a + b)·β/2π modes lie below β
    enough = (a + b + math.sqrt((a + b) ** 2 + 4 * math.pi * a * b * modes)) / (a * b) + math.pi / min(size)
    top = min((highest / speed) ** (1 / power), enough)
    along, across = (np.arange(1.0, min(top * side / math.pi, modes) + 1) for side in size)
    m, n = (grid.ravel() for grid in np.meshgrid(along, across, indexing="ij"))
    beta = np.hypot(m * math.pi / a, n * math.pi / b)
    order = np.argsort(beta, kind="stable")
    order = order[beta[order] < top]
    order = order[:modes]
    m, n, beta = m[order], n[order], beta[order]
    scale = 2 / math.sqrt(body.density * a * b)
    omega = speed * beta**power
    return (
        omega,
        decay(body, omega, beta),
        lambda place: scale * np.sin(math.pi * m * place[0]) * np.sin(math.pi * n * place[1]),
    )


def _measured(body: Modes, highest: float) -> Spread:
    """Modes as measured."""
    omega = 2 * math.pi * np.array(body.frequency or [], dtype=float)
    sigma = TO_60_DB / np.array(body.t60) if body.t60 else np.array(body.sigma or np.zeros(omega.size), dtype=float)
    chosen = omega < highest
    points = {name: np.array(values, dtype=float)[chosen] for name, values in (body.points or {}).items()}
    return omega[chosen], sigma[chosen], lambda name: points[name]


def _supported(body: String | Bar | Membrane | Plate, highest: float) -> Spread:
    """Modes of a body held by springs: the lowest eigenvectors of diag(ω²) + Σ k·ΦΦᵀ, found among four
    times as many free modes, for a spring bends the body more sharply than its lowest modes can.

    Dampers take the diagonal of Σ r·ΦΦᵀ in those modes: what they couple is left out, as is usual
    for light damping (Fletcher & Rossing, sec. 4.5). Raises TooDamped where it is not light: on a string
    from about a sixth of its impedance √(Tμ) on.
    """
    build = _SPREAD[type(body)]
    free = build(body, highest)
    count = free[0].size
    if count == 0:
        return free
    if count > WIDEST:
        raise TooMany(f"has {count} modes, and supports; with these at most {WIDEST}")
    wide = max(count, min(4 * count, WIDEST))
    omega, sigma, shape = build(body.model_copy(update={"modes": wide}), math.inf)
    stiffness, damping = np.diag(omega**2), np.zeros((omega.size, omega.size))
    for support in body.support:
        at = places(support.at, body)
        for place in at:
            own = shape(place)
            stiffness += np.outer(own, own) * (support.stiffness / len(at))
            damping += np.outer(own, own) * (support.damping / len(at))
    if not np.all(np.isfinite(stiffness)):
        raise FloatingPointError
    square, vectors = np.linalg.eigh(stiffness)
    held = np.sqrt(np.maximum(square, 0.0))[:count]
    vectors = vectors[:, :count][:, held < highest]
    damping = vectors.T @ damping @ vectors
    _refuse_coupled(body, held[held < highest], damping)
    rate = np.einsum("ij,i,ij->j", vectors, sigma, vectors) + 0.5 * np.diag(damping)
    rate = np.maximum(rate, 0.0)  # but for rounding, it is
    return held[held < highest], rate, lambda place: vectors.T @ shape(place)


def _refuse_coupled(body: String | Bar | Membrane | Plate, omega: np.ndarray, damping: np.ndarray) -> None:
    """Refuse dampers that couple modes, whose damping matrix is given, by more than a share of their distance."""
    apart = np.maximum(np.abs(omega[:, None] - omega), 1e-300)
    np.fill_diagonal(apart, np.inf)
    worst = float(np.max(np.abs(damping) / (2 * apart), initial=0.0))
    if worst > COUPLED:
        most = max(s.damping for s in body.support)
        raise TooDamped(f"damping of {most:g} kg/s is too much: right up to {most * COUPLED / worst:.2g} kg/s here")


_SPREAD: dict[type, Callable[[Any, float], Spread]] = {
    String: _string,
    Bar: _bar,
    Membrane: _membrane,
    Plate: _plate,
    Modes: _measured,
}
