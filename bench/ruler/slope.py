"""The slope through a contact: a ball is thrown at a wall, and where it ends must fall by as much as where it began
rises. What differentiates through a simulation gets this slope, and it is wrong where schemes feel when in a step the
contact began."""

from collections.abc import Callable
from functools import partial

import numpy as np

import engine
from bench.publish.report import publish
from bench.ruler.contact_ruler import Problem, Trajectory
from bench.ruler.methods import FAMILIES
from engine.assembly.build import build
from engine.offline.simulation import Simulation
from engine.patch.accuracy import Accuracy

RATE = 1000.0  # Hz
SPEED = 5.0  # m/s
STARTS = np.linspace(-0.12, -0.10, 401)  # m: the wall is met after 20 to 24 steps
FRAMES = 60
STIFFNESS = (1e5, 1e6, 1e7, 1e8, 1e9)  # N/m, of a ball of 1 kg: contact lasts π·√(m/k), 10 ms to 0.1 ms
OWN = ((2, 1), (4, 1), (6, 1), (2, 8), (4, 8))  # order, substeps


def engine_ends(order: int, substeps: int, stiffness: float) -> np.ndarray:
    """Where balls end, m [starts], by the engine."""
    names = [f"ball{i}" for i in range(STARTS.size)]
    bodies = [
        {"name": name, "kind": "mass", "mass": 1.0, "displacement": start, "velocity": SPEED}
        for name, start in zip(names, STARTS.tolist(), strict=True)
    ]
    law = {"barrier": 0.0, "stiffness": stiffness, "exponent": 1.0}
    parts = {"body": bodies, "contact": [{"body": name} | law for name in names], "pickup": [{"body": names[0]}]}
    accuracy = Accuracy(order=order, substeps=substeps, silence=-np.inf)
    model, state, layout = build(engine.Scene.model_validate(parts), RATE, accuracy)
    Simulation(model, state).render_block(np.zeros((FRAMES, 1)))
    return state.q[np.argsort(layout.islands.body_order)]  # of 1 kg each


def ends_of(simulate: Callable[[Problem, int], Trajectory], stiffness: float) -> np.ndarray:
    """Where balls end, m [starts], by a method."""
    with np.errstate(all="ignore"):
        return np.array([simulate(ball(start, stiffness), 1).displacement[-1] for start in STARTS])


def ball(start: float, stiffness: float) -> Problem:
    """A ball of 1 kg that flies at a wall at 0."""
    one, none = np.ones(1), np.zeros(1)
    body = {"omega": none, "sigma": none, "weight": none, "q": start * one, "p": SPEED * one, "pickup": one}
    wall = {"barrier": none, "stiffness": stiffness * one, "exponent": one, "loss": none, "shapes": np.ones((1, 1))}
    return Problem(title="a ball thrown at a wall", samplerate=RATE, frames=FRAMES, **body, **wall)


def largest_error(ends: np.ndarray) -> float:
    """How far the slopes between neighbours are from -1, at most; infinite where they are not numbers."""
    with np.errstate(all="ignore"):
        error = float(np.abs(np.diff(ends) / np.diff(STARTS) + 1).max())
    return error if np.isfinite(error) else np.inf


def describe_slopes(ends: np.ndarray) -> str:
    """The slopes between neighbours: how far they are from -1, or from where to where they go, and their mean."""
    error = largest_error(ends)
    if error > 1e3:
        return "blows up"
    slopes = np.diff(ends) / np.diff(STARTS)
    if error <= 1e-2:
        return f"±{max(error, 1e-12):.0e}"
    return f"{slopes.min():.2f} to {slopes.max():.2f}, mean {slopes.mean():.4f}"


def methods() -> dict[str, list[Callable[[float], np.ndarray]]]:
    """From a stiffness to where balls end, by the names of methods; of a family, by each variant."""
    ours = {f"this engine, order {order}, {n} ×": [partial(engine_ends, order, n)] for order, n in OWN}
    others = {name: variants for name, variants in FAMILIES.items() if "DOP853" not in name}
    return ours | {name: [partial(ends_of, v.simulate) for v in variants] for name, variants in others.items()}


def run() -> None:
    """Measure and publish."""
    rows = []
    for name, variants in methods().items():
        best = (min((ends(k) for ends in variants), key=largest_error) for k in STIFFNESS)
        rows.append([name, *(describe_slopes(ends) for ends in best)])
    steps = [f"{np.pi / np.sqrt(k) * RATE:.2g}" for k in STIFFNESS]
    header = [f"{k:.0e} N/m: {n} steps" for k, n in zip(STIFFNESS, steps, strict=True)]
    publish("slope", ["slope of end over start (exact: -1)", *header], rows)
