"""What a step makes of a spring, and how that is made up for (docs/design.md, "Connections").

A force that is constant over a step, and follows from the mean of the extensions at its ends, meets a compliance that
is too small at high frequencies: by the factor 1 - θ²/6 to leading order, θ = ωh, whatever mode gives it. With the mode
shapes γₙ·Φₙ in place of Φₙ, γₙ² = θₙ/sin θₙ, each mode gives what it should at its own frequency, and all of them a
constant too much, C₀ = Σ (γₙ² - 1)·Φₙ²/ωₙ². That is taken from the compliance of the spring: 1/k → 1/k - C₀. What holds
harder than that is made up for in part.
"""

from collections.abc import Callable

import numpy as np

MAX_GAIN = 2.2  # γ²: that of 14 kHz at 44.1 kHz; what is higher gives almost the same at every frequency that is heard
MAX_SHARE = 0.75  # of the compliance of the spring that may be taken from it
MAX_SHARE_LATER = 0.95  # the same where an event makes it harder


def compensate_step(
    parts: dict[int, np.ndarray], stiffness: float, omega_of: Callable[[int], np.ndarray | None], step: float
) -> tuple[dict[int, np.ndarray], float]:
    """Rows of bodies for a spring of a stiffness (N/m) between them, so that a step of so many seconds gives the right
    frequencies; and how much compliance they have too much, m/N.

    parts:    the mode shapes at its ends, by number of the body
    omega_of: angular frequencies of a body, rad/s; None if its row is to stay as it is
    """
    gains, excess = dict[int, np.ndarray](), 0.0
    for body, row in parts.items():
        omega = omega_of(body)
        if omega is not None and np.all(omega > 0.0):
            angle = np.minimum(omega * step, 3.0)
            gains[body] = np.minimum(angle / np.sin(angle), MAX_GAIN) - 1
            excess += float(np.sum(gains[body] * (row / omega) ** 2))
    share = min(1.0, MAX_SHARE / max(stiffness * excess, MAX_SHARE))
    return {b: row * np.sqrt(1 + share * gains[b]) if b in gains else row for b, row in parts.items()}, share * excess


def stiffness_beside(excess: float, stiffness: float) -> float:
    """The stiffness (N/m) that, with so much compliance of its rows beyond the right one (m/N), is as this one."""
    return stiffness / (1 - min(stiffness * excess, MAX_SHARE_LATER))
