"""Bodies that stretch, with quadratised energies: each has a ψ = √(2V), beside those of the contacts.

With g = dψ/dq [modes] at the middle of two steps, and M what a unit force moves a mode by in two steps:

    F = -g·(ψ⁺ + ψ⁻)/2          ψ⁺ - ψ⁻ = g·(q⁺ - q⁻)/2          q⁺ - q⁻ = D - M·(g·(ψ⁺ + ψ⁻)/2 + Φᵀf)

so that the mean of ψ is one division, and less by Φ·M·g·f/(4 + g·M·g) for a contact force f: the contacts are solved as
ever (quadratised_contacts), with what remains of their coupling.
"""

import math
from typing import Any, NamedTuple

import numba
import numpy as np

from bench.ruler.contact_ruler.problem import Problem
from bench.ruler.methods.quadratised_contacts import LARGEST_CHANGE, REGULATED, REGULATED_NON_ADHESIVE, SINGLE, STEEPEST

OPTIONS: dict[str, Any] = {"cache": True, "error_model": "numpy", "fastmath": {"reassoc"}}  # sums in any order


class Stretch(NamedTuple):
    """Bodies that stretch, in a step."""

    rows: np.ndarray  # √K·κ [bodies, modes]; no mode is of two bodies
    coupling: np.ndarray  # of the contacts, if nothing stretched [contacts, contacts], m/N
    psi: np.ndarray  # [bodies], √J
    direction: np.ndarray  # g [bodies, modes], √J/(√kg·m)
    mean: np.ndarray  # (ψ⁺ + ψ⁻)/2 [bodies], √J
    inertia: np.ndarray  # 4 + g·M·g [bodies]
    change: np.ndarray  # of the mean by contact forces [bodies], √J
    across: np.ndarray  # Φ·M·g [bodies, contacts]
    there: np.ndarray  # the state that ψ is of [modes]
    moved: np.ndarray  # D [modes]


def begin_stretch(problem: Problem, coupling: np.ndarray, q: np.ndarray) -> Stretch:
    """The bodies of a problem that stretch, at a state q [modes]. coupling: of the contacts, without them"""
    rows = np.zeros((0, q.size)) if problem.stretch is None else np.ascontiguousarray(problem.stretch)
    bodies, psi = len(rows), np.sqrt(0.5) * (rows @ q**2)
    direction, across = np.sqrt(2.0) * rows * q, np.empty((bodies, len(coupling)))
    room = (np.empty(bodies) for _ in range(2))
    return Stretch(rows, coupling, psi, direction, psi.copy(), *room, across, np.empty(q.size), np.empty(q.size))


@numba.njit(**OPTIONS)
def root_of_stretch(rows, b, q):
    """√(2V) of body b at a state q [modes], √J."""
    total = 0.0
    for m in range(q.size):
        total += rows[b, m] * q[m] * q[m]
    return math.sqrt(0.5) * total


@numba.njit(**OPTIONS)
def choose_direction(rule, gain, stretch, b, reach, here):
    """Set g of body b.

    here: state at the middle of two steps [modes]; stretch.there is half a step before
    """
    g, there = stretch.direction[b], stretch.there
    for m in range(here.size):
        g[m] = math.sqrt(2.0) * stretch.rows[b, m] * here[m]
    if gain > 0.0 and rule in (REGULATED, REGULATED_NON_ADHESIVE, SINGLE):
        square, response, steepness = 0.0, 0.0, 0.0
        for m in range(here.size):
            if stretch.rows[b, m] > 0.0:
                square += 4.0 * (here[m] - there[m]) ** 2
                response += 4.0 * reach[m] * (here[m] - there[m]) ** 2
                steepness += g[m] * g[m]
        error = gain * (stretch.psi[b] - root_of_stretch(stretch.rows, b, there))
        if STEEPEST * square**2 > error**2 * response:
            share = error / square
            if rule == REGULATED_NON_ADHESIVE:  # as of contacts, where the motion turns
                bound = LARGEST_CHANGE * math.sqrt(steepness / square)
                share = min(max(share, -bound), bound)
            for m in range(here.size):
                if stretch.rows[b, m] > 0.0:
                    g[m] -= share * 2.0 * (here[m] - there[m])


@numba.njit(**OPTIONS)
def find_means(rule, gain, stretch, reach, shapes, here, coupling):
    """Set the means of ψ without contact forces, and `coupling` to what that of the contacts becomes.

    reach: M [modes], s²; here: of choose_direction. stretch.there and stretch.moved are set before.
    """
    for k in range(shapes.shape[0]):
        for j in range(shapes.shape[0]):
            coupling[k, j] = stretch.coupling[k, j]
    for b in range(stretch.mean.size):
        choose_direction(rule, gain, stretch, b, reach, here)
        g, moved, along, response = stretch.direction[b], stretch.moved, 0.0, 0.0
        for m in range(here.size):
            along += g[m] * moved[m]
            response += reach[m] * g[m] * g[m]
        stretch.inertia[b] = 4.0 + response
        stretch.mean[b] = (4.0 * stretch.psi[b] + along) / stretch.inertia[b]
        for k in range(shapes.shape[0]):
            across = 0.0
            for m in range(here.size):
                across += shapes[k, m] * reach[m] * g[m]
            stretch.across[b, k] = across
        for k in range(shapes.shape[0]):
            for j in range(shapes.shape[0]):
                coupling[k, j] -= stretch.across[b, k] * stretch.across[b, j] / stretch.inertia[b]


@numba.njit(**OPTIONS)
def pull_back(stretch, means, reach, q):
    """q -= reach·Σ g·mean, of modes or of their momenta; means: [bodies]"""
    for b in range(means.size):
        for m in range(q.size):
            q[m] -= reach[m] * stretch.direction[b, m] * means[b]


@numba.njit(**OPTIONS)
def yield_to_contacts(stretch, forces):
    """Change the means of ψ by the contact forces, and set ψ to the end of the step."""
    for b in range(stretch.mean.size):
        pushed = 0.0
        for k in range(forces.size):
            pushed += stretch.across[b, k] * forces[k]
        stretch.change[b] = -pushed / stretch.inertia[b]
        stretch.mean[b] += stretch.change[b]
        stretch.psi[b] = 2.0 * stretch.mean[b] - stretch.psi[b]
