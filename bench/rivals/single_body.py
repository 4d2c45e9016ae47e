"""Kernels of other methods, for comparison: one body of unit mass, y'' = a(y), with one-sided power laws.

Each method steps (y, v) from n to n+1, and is judged by the energy of the continuous system.
"""

import math
from typing import NamedTuple

import numpy as np

from engine.compiler.decorators import kernel


class SingleBody(NamedTuple):
    """A body of unit mass with a spring and two walls.

    a(y) = -ω²·y - k·[y - upper_wall]₊^α + k·[lower_wall - y]₊^α - gravity
    """

    stiffness: float  # ω², 1/s²
    wall_stiffness: float  # k, N/m^α
    alpha: float
    upper_wall: float  # m
    lower_wall: float  # m
    gravity: float  # m/s²


@kernel
def compression(b, y):
    """Return the compression of the upper wall, positive, or of the lower one, negative, m."""
    return max(0.0, y - b.upper_wall) - max(0.0, b.lower_wall - y)


@kernel
def acceleration(b, y):
    """Return the acceleration at a displacement, m/s²."""
    s = compression(b, y)
    return -b.stiffness * y - b.gravity - math.copysign(b.wall_stiffness * abs(s) ** b.alpha, s)


@kernel
def wall_energy(b, y):
    """Return the potential energy of the walls, J per kg."""
    return b.wall_stiffness / (b.alpha + 1.0) * abs(compression(b, y)) ** (b.alpha + 1.0)


@kernel
def hamiltonian(b, y, v):
    """Return the energy of the continuous system, J per kg."""
    return 0.5 * v * v + 0.5 * b.stiffness * y * y + b.gravity * y + wall_energy(b, y)


@kernel
def write_row(row, y, v, energy):
    """Store the state of a step in its row of the output."""
    row[0], row[1], row[2] = y, v, energy


@kernel
def verlet(b, y, v, h, n, out):
    """Simulate by the Störmer-Verlet method in its velocity form."""
    for i in range(n):
        write_row(out[i], y, v, hamiltonian(b, y, v))
        v += 0.5 * h * acceleration(b, y)
        y += h * v
        v += 0.5 * h * acceleration(b, y)


@kernel
def fdn(b, y, v, h, n, out):
    """Simulate by the paper's FDN (eq. 4; α = 1 and 3 only): the contact force is averaged over the neighbouring
    steps."""
    previous = y - h * v + 0.5 * h * h * acceleration(b, y)
    for i in range(n):
        s = compression(b, y)
        wall = b.upper_wall if s > 0.0 else b.lower_wall
        k = b.wall_stiffness * (abs(s) ** (b.alpha - 1.0) if s != 0.0 else 0.0)
        free = 2.0 * y - previous - h * h * (b.stiffness * y + b.gravity)
        following = wall + ((free - wall) - 0.5 * h * h * k * (previous - wall)) / (1.0 + 0.5 * h * h * k)
        velocity = (following - previous) / (2.0 * h)
        write_row(out[i], y, velocity, hamiltonian(b, y, velocity))
        previous, y = y, following


@kernel
def midpoint(b, y, v, h, n, out):
    """Simulate by the implicit midpoint rule; Newton's method between bounds finds the middle displacement."""
    for i in range(n):
        write_row(out[i], y, v, hamiltonian(b, y, v))
        target, middle = y + 0.5 * h * v, y + 0.5 * h * v
        lower, upper = -math.inf, math.inf
        for _ in range(200):
            residual = middle - 0.25 * h * h * acceleration(b, middle) - target
            lower, upper = (lower, middle) if residual > 0.0 else (middle, upper)
            s = abs(compression(b, middle))
            slope = b.stiffness + (b.wall_stiffness * b.alpha * s ** (b.alpha - 1.0) if s > 0.0 else 0.0)
            improved = middle - residual / (1.0 + 0.25 * h * h * slope)
            if not lower <= improved <= upper:
                improved = 0.5 * (lower + upper)
            if abs(improved - middle) <= 1e-16 * (1.0 + abs(middle)):
                break
            middle = improved
        force = acceleration(b, middle)
        y, v = y + h * v + 0.5 * h * h * force, v + h * force


@kernel
def rk4(b, y, v, h, n, out):
    """Simulate by the classical Runge-Kutta method."""
    for i in range(n):
        write_row(out[i], y, v, hamiltonian(b, y, v))
        y1, v1 = v, acceleration(b, y)
        y2, v2 = v + 0.5 * h * v1, acceleration(b, y + 0.5 * h * y1)
        y3, v3 = v + 0.5 * h * v2, acceleration(b, y + 0.5 * h * y2)
        y4, v4 = v + h * v3, acceleration(b, y + h * y3)
        y += h / 6.0 * (y1 + 2.0 * y2 + 2.0 * y3 + y4)
        v += h / 6.0 * (v1 + 2.0 * v2 + 2.0 * v3 + v4)


@kernel
def sav(b, y, v, h, n, out):
    """Simulate by a quadratised energy (SAV): ψ = √(2V) is a variable of its own, and each step is explicit."""
    psi = math.sqrt(2.0 * wall_energy(b, y))
    for i in range(n):
        write_row(out[i], y, v, hamiltonian(b, y, v))
        middle = y + 0.5 * h * v
        root = math.sqrt(2.0 * wall_energy(b, middle) + 1e-30)
        slope = -(acceleration(b, middle) + b.stiffness * middle + b.gravity) / root
        mean = (2.0 * v / h - b.stiffness * y - b.gravity - slope * psi) / (
            2.0 / h + 0.5 * h * (b.stiffness + slope * slope)
        )
        psi += slope * h * mean
        y += h * mean
        v = 2.0 * mean - v


METHODS = {
    "Störmer-Verlet": verlet,
    "FDN (eq. 4)": fdn,
    "implicit midpoint": midpoint,
    "RK4": rk4,
    "SAV": sav,
}


def simulate(method: str, body: SingleBody, y: float, v: float, h: float, steps: int) -> np.ndarray:
    """Simulate a body from displacement y (m) and velocity v (m/s), in steps of h seconds.

    method: a key of METHODS
    Returns displacements (m), velocities (m/s) and energies (J per kg): [steps, 3].
    """
    out = np.full((steps, 3), np.nan)
    METHODS[method](body, y, v, h, steps, out)
    return out
