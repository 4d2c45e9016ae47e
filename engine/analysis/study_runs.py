"""The runs of a work-precision study: of a scene with probes, for errors, and as it is, for costs."""

from typing import NamedTuple

import numpy as np

from engine.analysis.other_methods import TIMED_RUNS
from engine.analysis.study_progress import StudyProgress, stages_of
from engine.assembly.build import build
from engine.assembly.table_changes import scored_exchanges
from engine.bodies import Mass, Oscillator
from engine.kernel.data.enums import EventKind
from engine.kernel.data.model import Model
from engine.kernel.data.state import State
from engine.offline.decimation import decimate, decimation_tail
from engine.offline.simulation import Simulation, time_block
from engine.offline.statistics import SimulationStatistics, simulation_statistics
from engine.patch.accuracy import Accuracy
from engine.patch.frames import frame_count
from engine.patch.scene import Scene
from engine.patch.tables import MAX_CHANNELS

TIMED_EMPTY_CALLS = 10  # of which the fastest is what a call costs


class Run(NamedTuple):
    """The result of a run of a scene with probes (`add_probes`)."""

    audio: np.ndarray  # [frames, channels]
    forces: np.ndarray  # [frames, bodies that touch], N
    velocities: np.ndarray  # [frames, the first of these, which are masses or oscillators], m/s
    stats: SimulationStatistics


class StudyRuns:
    """Runs a scene at settings of its accuracy, for some seconds at a sample rate, and reports its progress."""

    def __init__(self, scene: Scene, seconds: float, samplerate: int, progress: StudyProgress) -> None:
        self.scene, self.seconds, self.samplerate, self.progress = scene, seconds, samplerate, progress
        self.probed, self.columns = add_probes(scene)
        self.frames = frame_count(seconds, samplerate)

    def run(self, phase: str, accuracy: Accuracy, perturbation: float = 0.0) -> Run:
        """Run the scene with probes; perturbation: relative, of all that it begins with."""
        with self.progress.run(phase, stages_of(accuracy)):
            model, state, _ = built = build(self.probed, self.samplerate * accuracy.oversample, accuracy, self.seconds)
            if perturbation:
                _perturb(model, state, perturbation)
            exchanges = scored_exchanges(self.probed, built, accuracy=accuracy, seconds=self.seconds)
            simulation = Simulation(model, state, exchanges=exchanges)
            fine = self.frames * accuracy.oversample
            out = np.zeros((fine + decimation_tail(accuracy.oversample), self.probed.channels))
            self._compile(simulation, out[:0])
            simulation.render_block(out[:fine])
            stats = simulation_statistics(simulation)
            if accuracy.oversample > 1:
                simulation.render_block(out[fine:])
                out = decimate(out, accuracy.oversample, self.frames)
        forces, velocities = self.columns
        return Run(out[:, :forces], out[:, forces:velocities], out[:, velocities:], stats)

    def measure_cost(self, phase: str, accuracy: Accuracy) -> float:
        """Time per sample of the output, ns, of the fastest of TIMED_RUNS runs without probes; that of an empty call
        does not count."""
        out = np.zeros((self.frames * accuracy.oversample, self.scene.channels))
        best = np.inf
        for _ in range(TIMED_RUNS):
            with self.progress.run(phase, stages_of(accuracy)):
                model, state, _ = build(self.scene, self.samplerate * accuracy.oversample, accuracy, self.seconds)
                simulation = Simulation(model, state)
                self._compile(simulation, out[:0])
                call = min(time_block(simulation, out[:0]) for _ in range(TIMED_EMPTY_CALLS))
                best = min(best, time_block(simulation, out) - call)
        return best / self.frames * 1e9

    def _compile(self, simulation: Simulation, nothing: np.ndarray) -> None:
        """Compile the kernel of a simulation, if it has to be. nothing: no frames of its output"""
        if not simulation.is_compiled:
            with self.progress.compiling():
                simulation.render_block(nothing)


def add_probes(scene: Scene) -> tuple[Scene, tuple[int, int]]:
    """The scene with channels for contact forces and velocities, and the columns at which the two begin.

    After the channels of the scene come the contact forces on the bodies that touch, masses and oscillators first, then
    the velocities of these, as many as there are channels for.
    """
    channels = scene.channels
    lumped = [b.name for b in scene.body if isinstance(b, Mass | Oscillator)]
    touching = list(dict.fromkeys(name for c in scene.contact for name in (c.body, c.on) if name))
    touching.sort(key=lambda name: name not in lumped)
    moving = [name for name in touching if name in lumped][: (MAX_CHANNELS - channels) // 2]
    touching = touching[: MAX_CHANNELS - channels - len(moving)]
    probes = [(name, "force") for name in touching] + [(name, "velocity") for name in moving]
    pickups = [p.model_dump(exclude_none=True) for p in scene.pickup]
    pickups += [
        {"body": name, "quantity": quantity, "channel": channels + 1 + i} for i, (name, quantity) in enumerate(probes)
    ]
    probed = Scene.model_validate(scene.model_dump(exclude_none=True) | {"pickup": pickups})
    return probed, (channels, channels + len(touching))


def _perturb(model: Model, state: State, by: float) -> None:
    """Scale all that the scene begins with, and is driven by, by a relative amount."""
    state.q[:] *= 1 + by
    state.p[:] *= 1 + by
    state.compression[:] = (1 + by) * (state.compression + state.barrier) - state.barrier
    if model.force is not None:
        model.force.table[:] *= 1 + by
        model.force.tail[:] *= 1 + by
    if model.events is not None:
        model.events.value2[model.events.kind == EventKind.STRIKE] *= 1 + by
