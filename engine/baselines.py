"""Other schemes for one body and one-sided power laws, for comparison: y'' = a(y), unit mass.

Each steps (y, v) from n to n+1 and is judged by the energy of the continuous system. A `Body`
has a spring and two walls: a(y) = -ω²y - k·[y - above]₊^α + k·[below - y]₊^α - gravity.
"""

import math
from typing import NamedTuple

import numpy as np

from engine.jit import entry


class Body(NamedTuple):
    stiffness: float  # ω², 1/s²
    wall: float  # k, N/m^α
    alpha: float
    above: float  # m
    below: float  # m
    gravity: float  # m/s²


@entry
def compression(b, y):
    """Into the wall above (positive), or into the one below (negative)."""
    return max(0.0, y - b.above) - max(0.0, b.below - y)


@entry
def pull(b, y):
    s = compression(b, y)
    return -b.stiffness * y - b.gravity - math.copysign(b.wall * abs(s) ** b.alpha, s)


@entry
def wall_energy(b, y):
    return b.wall / (b.alpha + 1.0) * abs(compression(b, y)) ** (b.alpha + 1.0)


@entry
def hamiltonian(b, y, v):
    return 0.5 * v * v + 0.5 * b.stiffness * y * y + b.gravity * y + wall_energy(b, y)


@entry
def keep(row, y, v, energy):
    """A row of what is kept of a step."""
    row[0], row[1], row[2] = y, v, energy


@entry
def verlet(b, y, v, h, n, out):
    """Störmer-Verlet, in its velocity form."""
    for i in range(n):
        keep(out[i], y, v, hamiltonian(b, y, v))
        v += 0.5 * h * pull(b, y)
        y += h * v
        v += 0.5 * h * pull(b, y)


@entry
def fdn(b, y, v, h, n, out):
    """The paper's FDN (eq. 4; α = 1 and 3 only): the force is averaged over its neighbours."""
    before = y - h * v + 0.5 * h * h * pull(b, y)
    for i in range(n):
        s = compression(b, y)
        place = b.above if s > 0.0 else b.below
        k = b.wall * (abs(s) ** (b.alpha - 1.0) if s != 0.0 else 0.0)
        free = 2.0 * y - before - h * h * (b.stiffness * y + b.gravity)
        after = place + ((free - place) - 0.5 * h * h * k * (before - place)) / (1.0 + 0.5 * h * h * k)
        speed = (after - before) / (2.0 * h)
        keep(out[i], y, speed, hamiltonian(b, y, speed))
        before, y = y, after


@entry
def midpoint(b, y, v, h, n, out):
    """Implicit midpoint, with the force at the middle place, found by Newton's method between bounds."""
    for i in range(n):
        keep(out[i], y, v, hamiltonian(b, y, v))
        goal, middle = y + 0.5 * h * v, y + 0.5 * h * v
        low, high = -math.inf, math.inf
        for _ in range(200):
            off = middle - 0.25 * h * h * pull(b, middle) - goal
            low, high = (low, middle) if off > 0.0 else (middle, high)
            s = abs(compression(b, middle))
            slope = b.stiffness + (b.wall * b.alpha * s ** (b.alpha - 1.0) if s > 0.0 else 0.0)
            after = middle - off / (1.0 + 0.25 * h * h * slope)
            if not low <= after <= high:
                after = 0.5 * (low + high)
            if abs(after - middle) <= 1e-16 * (1.0 + abs(middle)):
                break
            middle = after
        force = pull(b, middle)
        y, v = y + h * v + 0.5 * h * h * force, v + h * force


@entry
def rk4(b, y, v, h, n, out):
    """The classical Runge-Kutta method."""
    for i in range(n):
        keep(out[i], y, v, hamiltonian(b, y, v))
        y1, v1 = v, pull(b, y)
        y2, v2 = v + 0.5 * h * v1, pull(b, y + 0.5 * h * y1)
        y3, v3 = v + 0.5 * h * v2, pull(b, y + 0.5 * h * y2)
        y4, v4 = v + h * v3, pull(b, y + h * y3)
        y += h / 6.0 * (y1 + 2.0 * y2 + 2.0 * y3 + y4)
        v += h / 6.0 * (v1 + 2.0 * v2 + 2.0 * v3 + v4)


@entry
def sav(b, y, v, h, n, out):
    """Energy quadratised: ψ = √(2V) is a state of its own, and each step is explicit."""
    psi = math.sqrt(2.0 * wall_energy(b, y))
    for i in range(n):
        keep(out[i], y, v, hamiltonian(b, y, v))
        ahead = y + 0.5 * h * v
        root = math.sqrt(2.0 * wall_energy(b, ahead) + 1e-30)
        slope = -(pull(b, ahead) + b.stiffness * ahead + b.gravity) / root
        mean = (2.0 * v / h - b.stiffness * y - b.gravity - slope * psi) / (
            2.0 / h + 0.5 * h * (b.stiffness + slope * slope)
        )
        psi += slope * h * mean
        y += h * mean
        v = 2.0 * mean - v


SCHEMES = {
    "Störmer-Verlet": verlet,
    "FDN (eq. 4)": fdn,
    "implicit midpoint": midpoint,
    "RK4": rk4,
    "SAV": sav,
}


def simulate(scheme: str, body: Body, y: float, v: float, h: float, steps: int) -> np.ndarray:
    """Places (m), velocities (m/s) and energies (J): [steps, 3]."""
    out = np.full((steps, 3), np.nan)
    SCHEMES[scheme](body, y, v, h, steps, out)
    return out
