"""Advances a Model: its partitions one after another or on several cores, with the same samples bit for bit."""

import time
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from itertools import pairwise
from typing import Any

import numpy as np

from engine.kernel.codes import Ledger
from engine.kernel.model import Model
from engine.kernel.state import BlockOutput, State, Trace
from engine.offline.energy_audit import EnergyAudit, EnergyStatistics

MIN_BUFFER_FRAMES = 1024  # that a block may have at first


class Simulation:
    """A Model at work on its State.

    cores:          how many to use; more than the scene has partitions are of no use
    measure_energy: of every sample
    """

    def __init__(self, model: Model, state: State, cores: int = 1, measure_energy: bool = True) -> None:
        from engine.compiler.struct_handle import StructHandle  # with Numba, which takes a second to import

        self.model, self.state, self.measure_energy = model, state, measure_energy
        self._make_handle = StructHandle
        self.partitions = model.islands.partition.size - 1
        self.cores = min(cores, self.partitions)
        self.audit = EnergyAudit()
        self._handles = StructHandle(model), StructHandle(state)
        self._addresses = tuple(handle.address for handle in self._handles)
        self._outputs: list[Any] = []  # StructHandle of the BlockOutput of each partition
        self._render: Callable[..., Any] | None = None
        self._output_kind: Any = None
        self._pool = ThreadPoolExecutor(self.cores - 1) if self.cores > 1 else None

    def render_block(self, audio: np.ndarray, trace: Trace | None = None) -> None:
        """Render len(audio) samples into audio [frames, channels]; a trace is filled by one core."""
        frames, outputs = len(audio), self.outputs(*audio.shape)
        if trace is not None:
            outputs = [self._make_handle(output.value._replace(trace=trace)) for output in outputs]
        render = self._compiled(outputs[0])
        model, state = self._addresses

        def run(first: int, last: int) -> None:
            for partition in range(first, last):
                render(model, state, outputs[partition].address, partition, frames)

        if self._pool is None or trace is not None:
            run(0, self.partitions)
        else:  # one job for each core: to hand over a job takes 50 µs, and partitions cost about the same
            cuts = [self.partitions * core // self.cores for core in range(self.cores + 1)]
            jobs = [self._pool.submit(run, first, last) for first, last in pairwise(cuts[1:])]
            run(0, cuts[1])
            for job in jobs:
                job.result()
        first, ledger, _ = outputs[0].value
        audio[:] = first[:frames]
        for output in outputs[1:]:  # in the same order however they ran
            audio += output.value.audio[:frames]
            if ledger is not None:
                ledger[:frames] += output.value.ledger[:frames]
        if ledger is not None:
            self.audit.add(ledger[:frames])

    def _compiled(self, output: Any) -> Callable[..., Any]:
        """The kernel for such an output, called by its address: without a look at the types, 3 µs of a call."""
        if self._render is None or self._output_kind is not output.kind:
            from engine.compiler.decorators import c_function
            from engine.kernel.render_block import render_block

            self._render = c_function(render_block, *self._handles, output, 0, 0)
            self._output_kind = output.kind
        return self._render

    def outputs(self, frames: int, channels: int) -> list[Any]:
        """Where the block of each partition goes."""
        existing = self._outputs[0].value.audio if self._outputs else np.empty((0, 0))
        if len(existing) < frames or existing.shape[1] != channels:
            size = max(frames, MIN_BUFFER_FRAMES)
            self._outputs = []
            for _ in range(self.partitions):
                ledger = np.empty((size, len(Ledger))) if self.measure_energy else None
                self._outputs.append(self._make_handle(BlockOutput(np.empty((size, channels)), ledger, None)))
        return self._outputs

    def energies(self) -> EnergyStatistics:
        """Energies up to now (engine.offline.energy_audit)."""
        return self.audit.summary(self.state.energy_totals)


def time_block(simulation: Simulation, audio: np.ndarray) -> float:
    """Seconds that a block takes, its memory being there."""
    for output in simulation.outputs(*audio.shape):
        output.value.audio[:] = 0.0  # memory is given when it is first written to
        if output.value.ledger is not None:
            output.value.ledger[:] = 0.0
    begin = time.perf_counter()
    simulation.render_block(audio)
    return time.perf_counter() - begin
