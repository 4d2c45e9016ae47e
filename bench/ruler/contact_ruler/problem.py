"""A problem of collision, as arrays: what any method needs to know, and nothing of this engine.

Mass-normalised modes q (√kg·m), p = dq/dt; contacts k at rows Φ_k of mode shapes (1/√kg):

    dp/dt = -ω²·q - 2σ·p + weight - Σ Φ_k·f_k
    s_k   = Φ_k·q - barrier_k                           compression, m
    f_k   = stiffness_k·[s_k]₊^α_k · max(0, 1 + loss_k·ds_k/dt)

Bodies b that stretch (Kirchhoff 1883, Carrier 1945) add -∂V/∂q to dp/dt, of the energy V = ¼·Σ r_b² with
r_b = Σ stretch_b·q². It is ¼·K·(Σ κ·q²)² of docs/design.md, with stretch = √K·κ.

Points of friction j at rows Φ_j of `rubbed` add -Σ Φ_j·F_j to dp/dt. A bristle of stiffness k is bent by z, and slips
where it would push harder than the normal force N allows (Coulomb's law, with the coefficient of docs/design.md):

    F = k·z,  |F| ≤ N·μ(θ),  μ = dynamic + (static - dynamic)·speed/(speed + θ)
    w = Φ_j·p - velocity                                slip of the surfaces, m/s
    stuck: dz/dt = w; it slides when |F| would exceed N·μ
    sliding: |F| = N·μ; it sticks when its slip (w - dz/dt) would change its sign
    memory·dθ/dt = |w - dz/dt| - θ                      θ follows the slip of the bristle

with z = θ = 0 at time 0. With memory > N·(static - dynamic)/(k·speed) it has one solution; without any memory it is no
differential equation.

The results to compute are the displacement `pickup`·q at n/samplerate, n = 0 … frames, and the mean force of each
contact, and then of each point of friction, in each of the `frames` samples.
"""

from pathlib import Path
from typing import NamedTuple

import numpy as np


class Problem(NamedTuple):
    """A problem of collision; SI units."""

    title: str
    samplerate: float  # Hz
    frames: int
    omega: np.ndarray  # [modes], 1/s, ω of the mode without its loss
    sigma: np.ndarray  # [modes], 1/s, decay rate
    weight: np.ndarray  # [modes], √kg·m/s²
    q: np.ndarray  # [modes], √kg·m, at time 0
    p: np.ndarray  # [modes], √kg·m/s, at time 0
    shapes: np.ndarray  # Φ [contacts, modes], 1/√kg
    barrier: np.ndarray  # [contacts], m
    stiffness: np.ndarray  # [contacts], N/m^α
    exponent: np.ndarray  # α [contacts]
    loss: np.ndarray  # μ [contacts], s/m
    pickup: np.ndarray  # [modes], 1/√kg
    stretch: np.ndarray | None = None  # [bodies that stretch, modes], √(N/m)/(kg·m); None if none does
    rubbed: np.ndarray | None = None  # Φ [points of friction, modes], 1/√kg; None if there are none
    friction: np.ndarray | None = None  # the numbers of each, as Friction has them [7, points]; None if there are none

    @property
    def force_count(self) -> int:
        """Number of contacts and points of friction."""
        return self.barrier.size + (0 if self.rubbed is None else len(self.rubbed))


class Friction(NamedTuple):
    """The rows of Problem.friction; [points] each."""

    velocity: np.ndarray  # m/s, of the surface that rubs, such as a bow
    force: np.ndarray  # N, by which the surfaces are pressed together
    static: np.ndarray  # coefficient at rest
    dynamic: np.ndarray  # coefficient in fast slip
    speed: np.ndarray  # m/s, slip at which the coefficient is half-way
    memory: np.ndarray  # τ, s
    bristle: np.ndarray  # k, N/m


class Reference(NamedTuple):
    """The solution of a problem."""

    displacement: np.ndarray  # [frames + 1], m, at the pickup
    force: np.ndarray  # [frames], N: of all contacts and friction together, the mean over each sample
    energy: np.ndarray  # [frames + 1], J, with that of bristles
    horizon: int  # frames up to which the motion is known
    agreement: float  # largest difference of two solutions of one method before the horizon, share of the peak
    other_agreement: float  # the same, from the solution of another method


def energy_of(problem: Problem, q: np.ndarray, p: np.ndarray) -> np.ndarray:
    """Energy of states, J: Σ ½p² + ½ω²q² - weight·q + stiffness·[s]₊^(α+1)/(α+1) + ¼r², without that of bristles.

    q, p: [..., modes]
    """
    squeezed = np.maximum(q @ problem.shapes.T - problem.barrier, 0.0)
    stored = problem.stiffness / (problem.exponent + 1) * squeezed ** (problem.exponent + 1)
    modal = 0.5 * p**2 + 0.5 * problem.omega**2 * q**2 - problem.weight * q
    energy = np.sum(modal, axis=-1) + np.sum(stored, axis=-1)
    if problem.stretch is not None:
        energy = energy + 0.25 * np.sum((q**2 @ problem.stretch.T) ** 2, axis=-1)
    return np.asarray(energy)


def stretching_force(problem: Problem, q: np.ndarray) -> np.ndarray:
    """Return the force of bodies that stretch on each mode, -Σ r·stretch·q [..., modes], √kg·m/s². q: [..., modes]"""
    if problem.stretch is None:
        return np.zeros_like(q)
    return np.asarray(-(q**2 @ problem.stretch.T @ problem.stretch) * q)


def save_problem(path: Path, problem: Problem, reference: Reference) -> None:
    """Write a problem and its reference to an .npz file."""
    arrays = {name: value for name, value in problem._asdict().items() if value is not None}
    np.savez_compressed(path, **arrays, **{f"reference_{k}": v for k, v in reference._asdict().items()})


def read_problem(path: Path) -> tuple[Problem, Reference]:
    """A problem and its reference from an .npz file."""
    with np.load(path) as data:
        values = {name: data[name] if data[name].ndim else data[name].item() for name in data.files}
    known = {name: values[f"reference_{name}"] for name in Reference._fields}
    return Problem(**{name: values[name] for name in Problem._fields if name in values}), Reference(**known)
