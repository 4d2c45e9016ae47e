"""Advances a Model: its partitions one after another or on several cores, with the same samples bit for bit."""

import time
from collections.abc import Callable
from typing import Any

import numpy as np

from engine.assembly.table_changes import ScoredExchanges
from engine.compiler.background import compile_beside
from engine.compiler.struct_handle import StructHandle
from engine.kernel.data.enums import BALANCE_SIZE, Energies
from engine.kernel.data.model import Model
from engine.kernel.data.state import State, Trace
from engine.offline.energy_statistics import EnergyStatistics, energy_statistics
from engine.offline.trace import trace_rows
from engine.runtime.exchange import INSERT_USE, exchange_tables
from engine.runtime.helpers import start_helpers
from engine.runtime.job_memory import RENDER_USE, JobMemory
from engine.runtime.kernel_choice import is_ready, prepare

MIN_BUFFER_FRAMES = 4096  # that a block may have at first: so many need no second memory


class Simulation:
    """A Model at work on its State.

    cores:          how many to use; more than the scene has partitions are of no use
    measure_energy: of every sample
    exchanges:      of tables, as a score asks for them
    kernel:         which is to run (engine.runtime.kernel_choice); `kernel` says which does
    """

    def __init__(
        self,
        model: Model,
        state: State,
        cores: int = 1,
        measure_energy: bool = True,
        kernel: str | None = None,
        exchanges: ScoredExchanges | None = None,
    ) -> None:
        self._exchanges, self._frame = exchanges, 0
        self.model, self.state, self.measure_energy = model, state, measure_energy
        self._energies = Energies.AT_EACH_SAMPLE if measure_energy else Energies.NEVER
        self.partitions = model.islands.partition.size - 1
        self.cores = min(cores, self.partitions)
        self._balance = np.zeros(BALANCE_SIZE)
        uses = [RENDER_USE, *([INSERT_USE] if exchanges else [])]
        prepared = prepare([model], state, uses, kernel)
        self.is_compiled = is_ready(prepared, uses)  # or the first block waits for it
        compile_beside(prepared.missing)
        self.kernel = prepared.name
        (model_handle,), state_handle = prepared.handles()
        self._handles = model_handle, state_handle
        self._memory: JobMemory | None = None
        self._helpers: Any = None

    def render_block(self, audio: np.ndarray, trace: Trace | None = None) -> None:
        """Render len(audio) samples into audio [frames, channels]; a trace is filled by one core."""
        begin, frames = 0, len(audio)
        while True:
            end = min(frames, begin + self._frames_until_exchange(frames - begin))
            self._render(audio[begin:end], None if trace is None else trace_rows(trace, begin, end))
            begin, self._frame = end, self._frame + end - begin
            if begin == frames:
                return

    def _frames_until_exchange(self, frames: int) -> int:
        """Do the exchanges that are due now. Returns for how many frames there are no more, or `frames`."""
        if self._exchanges is None or frames == 0:
            return frames
        for exchange in self._exchanges.due(self._frame):
            exchange_tables(*self._handles, exchange, self._frame)
        following = self._exchanges.next_frame
        return frames if following is None else following - self._frame

    def _render(self, audio: np.ndarray, trace: Trace | None) -> None:
        frames, memory = len(audio), self.memory(*audio.shape)
        if trace is None:
            memory.render(frames)
        else:
            memory.render_traced(frames, trace)
        audio[:] = memory.audio[:frames]

    def memory(self, frames: int, channels: int) -> JobMemory:
        """Return the memory for blocks of up to so many frames."""
        if self._memory is None or self._memory.audio.shape[0] < frames or self._memory.audio.shape[1] != channels:
            size = max(frames, MIN_BUFFER_FRAMES)
            self._memory = JobMemory(*self._handles, (size, channels), self._energies, self._balance)
            if self._helpers is None:
                self._helpers = start_helpers(self.cores, self.partitions)
            self._memory.use_helpers(self._helpers)
        return self._memory

    def memory_of(self, change: Callable[[Model], Model], channels: int) -> JobMemory:
        """Make the memory for single samples of a changed model, with the same state and balance; on one core.

        change: gives a model of the same kind, which differs in what is traced
        """
        model, state = self._handles
        return JobMemory(StructHandle(change(model.value)), state, (1, channels), self._energies, self._balance)

    def energies(self) -> EnergyStatistics:
        """Energies up to now."""
        return energy_statistics(self._balance, self.state.energy_totals)


def time_block(simulation: Simulation, audio: np.ndarray) -> float:
    """Seconds that a block takes, its memory being there."""
    simulation.memory(*audio.shape)
    begin = time.perf_counter()
    simulation.render_block(audio)
    return time.perf_counter() - begin
