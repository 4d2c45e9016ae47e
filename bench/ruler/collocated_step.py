"""A problem of collision in one precision, its forces, and a step of it by collocation (bench.ruler.reference)."""

from typing import NamedTuple

import numpy as np

from bench.ruler.collocation import Nodes
from bench.ruler.contact_ruler.problem import Problem
from bench.ruler.rubbing import Bristles, Rubbing, as_rubbing, friction_forces, rates, reach

MAX_ROUNDS = 80  # of a fixed-point iteration


class System(NamedTuple):
    """A problem in one precision."""

    squared: np.ndarray  # ω² [modes]
    decay: np.ndarray  # 2σ [modes]
    weight: np.ndarray  # [modes]
    shapes: np.ndarray  # [contacts, modes]
    barrier: np.ndarray  # [contacts]
    stiffness: np.ndarray  # [contacts]
    exponent: np.ndarray  # [contacts]
    loss: np.ndarray  # [contacts]
    length: np.ndarray  # √(Φ·Φ) [contacts]
    is_whole: np.ndarray  # [contacts], whether α is an integer
    stretch: np.ndarray  # [bodies that stretch, modes]
    rubbing: Rubbing


def as_system(problem: Problem, kind: type) -> System:
    """A problem in one precision."""
    shapes, exponent = problem.shapes.astype(kind), problem.exponent.astype(kind)
    return System(
        squared=problem.omega.astype(kind) ** 2,
        decay=2 * problem.sigma.astype(kind),
        weight=problem.weight.astype(kind),
        shapes=shapes,
        barrier=problem.barrier.astype(kind),
        stiffness=problem.stiffness.astype(kind),
        exponent=exponent,
        loss=problem.loss.astype(kind),
        length=np.sqrt(np.sum(shapes**2, axis=1)),
        is_whole=exponent == np.round(exponent),
        stretch=(np.zeros((0, problem.omega.size)) if problem.stretch is None else problem.stretch).astype(kind),
        rubbing=as_rubbing(problem, kind),
    )


def select_contacts(system: System, which: np.ndarray) -> System:
    """The same modes with some of the contacts."""
    return system._replace(
        **{
            name: getattr(system, name)[which]
            for name in ("shapes", "barrier", "stiffness", "exponent", "loss", "length", "is_whole")
        }
    )


def power(system: System, s: np.ndarray) -> np.ndarray:
    """s^α of contacts [..., contacts]; analytic through 0 if α is an integer, 0 below it if not."""
    if system.is_whole.size and system.is_whole.all():
        if (system.exponent == system.exponent[0]).all():
            return np.asarray(s ** int(system.exponent[0]))
        return np.stack([s[..., k] ** int(a) for k, a in enumerate(system.exponent)], axis=-1)
    return np.where(system.is_whole, s, np.maximum(s, 0)) ** system.exponent


def forces(system: System, s: np.ndarray, speed: np.ndarray) -> np.ndarray:
    """Forces of pressing contacts, N. s, speed: [..., contacts]"""
    f = system.stiffness * power(system, s)
    return f * (1 + system.loss * speed) if system.loss.any() else f


def stretching(system: System, q: np.ndarray) -> np.ndarray:
    """Return the force of bodies that stretch on each mode [..., modes]. q: [..., modes]"""
    return np.asarray(-((q**2 @ system.stretch.T) @ system.stretch) * q)


def iterate(
    system: System, nodes: Nodes, h: np.floating, q: np.ndarray, p: np.ndarray, bristles: Bristles, guess: tuple
) -> tuple | None:
    """Solve a step with all contacts of a system pressing, from a guess, by fixed-point iteration.

    Returns q and p at the nodes [nodes, modes], dp/dt there, forces [nodes, contacts + points of friction], and the
    bristles there with their rates; None if it fails.
    """
    stretches = len(system.stretch) > 0
    qs, ps = guess
    epsilon = np.finfo(q.dtype).eps
    ahead = (h * nodes.integral).astype(q.dtype)
    s0 = system.shapes @ q - system.barrier
    (rows, law), rubs = system.rubbing, len(system.rubbing.shapes) > 0
    bent, bristle_rates = Bristles(*(np.repeat(x[None], nodes.place.size, axis=0) for x in bristles)), None
    before = np.inf
    for _ in range(MAX_ROUNDS):
        speed = ps @ system.shapes.T
        f = forces(system, s0 + ahead @ speed, speed)
        slope = system.weight - system.squared * qs - system.decay * ps - f @ system.shapes
        if stretches:
            slope = slope + stretching(system, qs)
        if rubs:
            bristle_rates = rates(law, bent, ps @ rows.T - law.velocity)
            bend, remembered = (x + ahead @ rate for x, rate in zip(bristles, bristle_rates, strict=False))
            moved = np.abs(remembered - bent.remembered) / (law.speed + np.abs(remembered))
            moved = np.maximum(moved, np.abs(bend - bent.bend) / reach(law, remembered)).max()
            bent = bent._replace(bend=bend, remembered=remembered)
            friction = friction_forces(law, bent)
            slope, f = slope - friction @ rows, np.concatenate([f, friction], axis=1)
        next_ps = p + ahead @ slope
        change, size = np.abs(next_ps - ps).max(), np.abs(next_ps).max()
        if rubs:
            change = max(change, moved * size)
        ps = next_ps
        qs = q + ahead @ ps
        if not change < 1e3 * size + 1e3:
            return None
        if change <= 2 * epsilon * size or (change <= 200 * epsilon * size and change > 0.3 * before):
            return qs, ps, slope, f, bent, bristle_rates
        before = change
    return None
