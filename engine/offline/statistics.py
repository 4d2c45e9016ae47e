"""What a render has to tell beside its sound: iterations, energy, effects and activity."""

from typing import Any

import numpy as np

from engine.build.layout import Layout
from engine.kernel.codes import Sleep, SolveStatus
from engine.kernel.model import Model
from engine.kernel.state import State
from engine.offline.effects import effects_of
from engine.offline.simulation import Simulation


def statistics(simulation: Simulation) -> dict[str, Any]:
    """Newton iterations, energy, effects and activity of a scene up to now."""
    model, state = simulation.model, simulation.state
    frames = max(1, int(state.frame[0]))
    contact = float(np.mean(state.contact_samples / frames))
    asleep = float(np.mean(state.sleep[:, Sleep.SAMPLES_SLEPT] / frames))
    return {
        "newton": newton_statistics(model, state),
        "energy": simulation.energies(),
        "effects": effects_of(model),
        "activity": {"free": 1 - contact - asleep, "contact": contact, "asleep": asleep},
    }


def island_statistics(layout: Layout) -> dict[str, Any]:
    """How many islands there are, and the largest."""
    modes = np.diff(layout.islands.mode)
    largest = int(np.argmax(modes * (1 + np.diff(layout.islands.contact))))
    names = [b.name for b in layout.scene.body if layout.island_of_body[layout.body_index[b.name]] == largest]
    contacts = int(np.diff(layout.islands.contact)[largest])
    return {"count": modes.size, "largest": {"bodies": names, "modes": int(modes[largest]), "contacts": contacts}}


def newton_statistics(model: Model, state: State) -> dict[str, Any]:
    """Evaluations of the contact law per iterative solve, and how each sample of each island with
    contacts was solved; "capped" are the samples that made do with unfinished forces, "failed" those
    where the motion was turned back instead."""
    histogram, regimes = state.iteration_histogram.sum(axis=0), state.solve_outcomes.sum(axis=0)
    with_contacts = np.diff(model.islands.contact) > 0
    free = state.frame[0] - state.contact_samples - state.sleep[:, Sleep.SAMPLES_SLEPT]
    solves = int(histogram.sum())
    reached = np.cumsum(histogram)
    return {
        "solves": solves,
        "mean": float(histogram @ np.arange(histogram.size) / solves) if solves else 0.0,
        "p99": int(np.searchsorted(reached, 0.99 * solves)) if solves else 0,
        "max": int(np.flatnonzero(histogram)[-1]) if solves else 0,
        "unconverged": int(regimes[SolveStatus.FAILED]),
        "histogram": np.trim_zeros(histogram, "b").tolist(),
        "regimes": {
            "free": int(np.sum(free[with_contacts])),
            "separation": int(regimes[SolveStatus.SEPARATION]),
            "closed_form": int(regimes[SolveStatus.CLOSED_FORM]),
            "newton": int(regimes[SolveStatus.NEWTON]),
            "capped": int(regimes[SolveStatus.CAPPED]),
            "failed": int(regimes[SolveStatus.FAILED]),
        },
    }
