"""The runs of a work-precision study: of a scene with probes, for errors, and as it is, for costs."""

from typing import Any, NamedTuple

import numpy as np

from engine.analysis.finer_scene import FinerScene
from engine.analysis.study_progress import StudyProgress, StudyRun, study_run
from engine.assembly.build import build
from engine.assembly.scored_changes import scored_tables
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

REFERENCE_RATE = 4  # times the sample rate, where that refines anything
TIMED_RUNS = 3  # of a setting, at most, of which the fastest counts
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
        self.finer = FinerScene.of(
            self.probed, seconds, samplerate, scene.accuracy.replace(oversample=1), REFERENCE_RATE
        )
        self._kernels: dict[Any, Any] = {}  # that have to be compiled, by what they differ in

    def planned(self, accuracy: Accuracy) -> StudyRun:
        """The run of a setting. The first of each kernel is built, to see whether that is there."""
        is_composed = accuracy.order > 2 or accuracy.substeps > 1
        effects = accuracy.order > 2, is_composed, accuracy.max_error is None
        if effects not in self._kernels:
            simulation, _ = self._build(accuracy)
            self._kernels[effects] = None if simulation.is_compiled else simulation.kinds
        return study_run(accuracy, self._kernels[effects])

    def _build(
        self, accuracy: Accuracy, perturbation: float = 0.0, is_reference: bool = False
    ) -> tuple[Simulation, np.ndarray]:
        """The simulation of the scene with probes at a setting, and no frames of its output."""
        scene, factor = (self.finer.scene, self.finer.factor) if is_reference else (self.probed, accuracy.oversample)
        model, state, _ = built = build(scene, self.samplerate * factor, accuracy, self.seconds)
        if perturbation:
            _perturb(model, state, perturbation)
        tables = scored_tables(scene, built, accuracy=accuracy, seconds=self.seconds)
        return Simulation(model, state, tables=tables), np.zeros((0, self.probed.channels))

    def run(self, phase: str, accuracy: Accuracy, perturbation: float = 0.0, is_reference: bool = False) -> Run:
        """Run the scene with probes; perturbation: relative, of all that it begins with; is_reference: at a higher rate
        where that refines anything"""
        with self.progress.run(phase, study_run(accuracy)):
            simulation, nothing = self._build(accuracy, perturbation, is_reference)
            self._compile(simulation, nothing)
            fine = self.frames * (self.finer.factor if is_reference else accuracy.oversample)
            out = np.zeros((fine + decimation_tail(accuracy.oversample), self.probed.channels))
            simulation.render_block(out[:fine])
            stats = simulation_statistics(simulation)
            if accuracy.oversample > 1:
                simulation.render_block(out[fine:])
        if accuracy.oversample > 1:  # the first time, which loads SciPy, says nothing of other runs
            out = decimate(out, accuracy.oversample, self.frames)
        elif is_reference:
            out = self.finer.thin_out(out)
        forces, velocities = self.columns
        return Run(out[:, :forces], out[:, forces:velocities], out[:, velocities:], stats)

    def measure_cost(self, phase: str, accuracy: Accuracy) -> float:
        """Time per sample of the output, ns, of the fastest of TIMED_RUNS runs without probes; that of an empty call
        does not count."""
        out = np.zeros((self.frames * accuracy.oversample, self.scene.channels))
        best = np.inf
        for _ in range(TIMED_RUNS):
            with self.progress.run(phase, study_run(accuracy)):
                rate = self.samplerate * accuracy.oversample
                model, state, _ = built = build(self.scene, rate, accuracy, self.seconds)
                tables = scored_tables(self.scene, built, accuracy=accuracy, seconds=self.seconds)
                simulation = Simulation(model, state, tables=tables)
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
    model.force.table[:] *= 1 + by
    model.force.tail[:] *= 1 + by
    model.events.value2[model.events.kind == EventKind.STRIKE] *= 1 + by
    model.events.value[model.events.kind == EventKind.PLUCK] *= 1 + by
