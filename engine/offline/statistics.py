"""Statistics of a render beside its sound: iterations, energy, effects and activity."""

from dataclasses import dataclass
from typing import Any

import numpy as np

from engine.assembly.layout import Layout
from engine.kernel.data.enums import Sleep, SolveStatus
from engine.kernel.data.model import Model
from engine.kernel.data.state import State
from engine.offline.brief_contacts import BriefContact
from engine.offline.effects import EffectStatistics, effects_of
from engine.offline.energy_statistics import EnergyStatistics
from engine.offline.simulation import Simulation
from engine.offline.statistics_base import Statistics

UNCONVERGED = (SolveStatus.CAPPED, SolveStatus.REVERSED, SolveStatus.LOOSE_TENSION)


@dataclass(frozen=True)
class SolveOutcomes(Statistics):
    """Outcomes of the contact solves: numbers of samples, over all islands with contacts."""

    free: int  # no contact was in reach
    separation: int  # none closed
    closed_form: int
    newton: int
    capped: int  # the forces are those of an unfinished solve; they create no energy
    failed: int  # the motion was turned back instead

    @property
    def solved(self) -> int:
        """Samples that had a contact to solve."""
        return self.separation + self.closed_form + self.newton + self.capped + self.failed


@dataclass(frozen=True)
class NewtonStatistics(Statistics):
    """Evaluations of the contact law per iterative solve."""

    solves: int
    mean: float
    p99: int
    max: int
    unconverged: int  # contact solves that did not converge: capped ones, and those of the next two
    reversed_steps: int  # the motion was turned back instead
    loose_tensions: int  # the tension of a stretching body was taken with more than rounding left
    histogram: list[int]  # solves by their evaluations
    solve_outcomes: SolveOutcomes

    @property
    def regimes(self) -> SolveOutcomes:
        """The earlier name of solve_outcomes."""
        return self.solve_outcomes

    def as_dict(self) -> dict[str, Any]:
        """All values by their names, and by the earlier one."""
        return super().as_dict() | {"regimes": self.solve_outcomes.as_dict()}


@dataclass(frozen=True)
class Activity(Statistics):
    """Shares of the samples, mean over islands: they sum to 1."""

    free: float
    contact: float
    asleep: float


@dataclass(frozen=True)
class LargestIsland(Statistics):
    """The island with the most work."""

    bodies: list[str]
    modes: int
    contacts: int


@dataclass(frozen=True)
class IslandStatistics(Statistics):
    """Parts of a scene that no contact joins."""

    count: int
    largest: LargestIsland


@dataclass(frozen=True)
class SimulationStatistics(Statistics):
    """Statistics of a simulation up to the present sample."""

    newton: NewtonStatistics
    energy: EnergyStatistics
    effects: EffectStatistics
    activity: Activity


@dataclass(frozen=True)
class RenderStatistics(SimulationStatistics):
    """Statistics of a rendering: the names of `fdh render --json` (docs/design.md, sec. 6)."""

    seconds: float
    samplerate: int  # Hz
    channels: int
    peak: float  # largest absolute sample, in the units of the pickups
    real_time_factor: float
    ns_per_sample: float
    build_seconds: float
    cores: int
    kernel: str  # special or general (engine.runtime.kernel_choice)
    table_digest: str  # of the tables that it began with (engine.assembly.table_digest)
    islands: IslandStatistics
    accuracy: dict[str, Any]  # the settings that were used
    trusted: bool
    reasons: list[str]  # why not
    warnings: list[str]
    brief_contacts: list[BriefContact]  # that last only a few steps
    patch: str | None = None  # the path of the patch, and of the sound; the command knows them
    output: str | None = None


def simulation_statistics(simulation: Simulation, totals: np.ndarray | None = None) -> SimulationStatistics:
    """Newton iterations, energy, effects and activity of a scene up to now. totals: as of Simulation.energies"""
    model, state = simulation.model, simulation.state
    frames = max(1, int(state.frame[0]))
    contact = float(np.mean(state.contact_samples / frames))
    asleep = float(np.mean(state.sleep[:, Sleep.SAMPLES_SLEPT] / frames))
    return SimulationStatistics(
        newton=newton_statistics(model, state),
        energy=simulation.energies(totals),
        effects=effects_of(model),
        activity=Activity(1 - contact - asleep, contact, asleep),
    )


def capped_samples(state: State) -> int:
    """Count the samples that would have needed more steps than allowed, where they are chosen by error."""
    return 0 if state.refinement is None else int(state.refinement.capped_samples.sum())


def island_statistics(layout: Layout) -> IslandStatistics:
    """Count the islands, and describe the largest."""
    modes = layout.islands.mode_counts
    largest = int(np.argmax(modes * (1 + np.diff(layout.islands.contact_begins))))
    names = [layout.scene.body[b].name for b in layout.islands.bodies[largest]]
    contacts = int(np.diff(layout.islands.contact_begins)[largest])
    return IslandStatistics(modes.size, LargestIsland(names, int(modes[largest]), contacts))


def newton_statistics(model: Model, state: State) -> NewtonStatistics:
    """Evaluations of the contact law, and how each sample of each island with contacts was solved."""
    histogram, outcomes = state.iteration_histogram.sum(axis=0), state.solve_outcomes.sum(axis=0)
    with_contacts = np.diff(model.islands.contact) > 0
    free = state.frame[0] - state.contact_samples - state.sleep[:, Sleep.SAMPLES_SLEPT]
    solves = int(histogram.sum())
    reached = np.cumsum(histogram)
    return NewtonStatistics(
        solves=solves,
        mean=float(histogram @ np.arange(histogram.size) / solves) if solves else 0.0,
        p99=int(np.searchsorted(reached, 0.99 * solves)) if solves else 0,
        max=int(np.flatnonzero(histogram)[-1]) if solves else 0,
        unconverged=int(sum(outcomes[status] for status in UNCONVERGED)),
        reversed_steps=int(outcomes[SolveStatus.REVERSED]),
        loose_tensions=int(outcomes[SolveStatus.LOOSE_TENSION]),
        histogram=np.trim_zeros(histogram, "b").tolist(),
        solve_outcomes=SolveOutcomes(
            free=int(np.sum(free[with_contacts])),
            separation=int(outcomes[SolveStatus.SEPARATION]),
            closed_form=int(outcomes[SolveStatus.CLOSED_FORM]),
            newton=int(outcomes[SolveStatus.NEWTON]),
            capped=int(outcomes[SolveStatus.CAPPED]),
            failed=int(outcomes[SolveStatus.FAILED]),
        ),
    )
