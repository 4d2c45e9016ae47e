"""A problem of collision, as arrays: what any method needs to know, and nothing of this engine.

Mass-normalised modes q (√kg·m), p = dq/dt; contacts k at rows Φ_k of mode shapes (1/√kg):

    dp/dt = -ω²·q - 2σ·p + weight - Σ Φ_k·f_k
    s_k   = Φ_k·q - barrier_k                           compression, m
    f_k   = stiffness_k·[s_k]₊^α_k · max(0, 1 + loss_k·ds_k/dt)

Bodies b that stretch (Kirchhoff 1883, Carrier 1945) add -∂V/∂q to dp/dt, of the energy V = ¼·Σ r_b² with
r_b = Σ stretch_b·q². It is ¼·K·(Σ κ·q²)² of docs/design.md, with stretch = √K·κ.

The results to compute are the displacement `pickup`·q at n/samplerate, n = 0 … frames, and the mean force of each
contact in each of the `frames` samples.
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


class Reference(NamedTuple):
    """The solution of a problem."""

    displacement: np.ndarray  # [frames + 1], m, at the pickup
    force: np.ndarray  # [frames], N: of all contacts together, the mean over each sample
    energy: np.ndarray  # [frames + 1], J
    horizon: int  # frames up to which the motion is known
    agreement: float  # largest difference of two solutions of one method before the horizon, share of the peak
    other_agreement: float  # the same, from the solution of another method


def energy_of(problem: Problem, q: np.ndarray, p: np.ndarray) -> np.ndarray:
    """Energy of states, J: Σ ½p² + ½ω²q² - weight·q + stiffness·[s]₊^(α+1)/(α+1) + ¼r². q, p: [..., modes]"""
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
