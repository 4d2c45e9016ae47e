"""Advances a Model: its partitions one after another or on several cores, with the same samples bit for bit."""

import time
from typing import Any

import numpy as np

from engine.assembly.layout import Layout
from engine.assembly.table_changes import TableChanges
from engine.compiler.struct_handle import StructHandle
from engine.kernel.data.enums import BALANCE_SIZE, Energies
from engine.kernel.data.model import Model
from engine.kernel.data.state import State, Trace
from engine.offline.energy_statistics import EnergyStatistics, energy_statistics, find_energy_totals
from engine.offline.trace import trace_rows
from engine.runtime.exchange import INSERT_USE, exchange_tables
from engine.runtime.helpers import start_helpers
from engine.runtime.job_memory import RENDER_USE, JobMemory, TracedJob
from engine.runtime.kernel_choice import prepare

MIN_BUFFER_FRAMES = 4096  # that a block may have at first: so many need no second memory


class Simulation:
    """A Model at work on its State.

    cores:          how many to use; more than the scene has partitions are of no use
    measure_energy: of every sample
    tables:         that a score changes
    kernel:         which is to run (engine.runtime.kernel_choice); `kernel` says which does
    """

    def __init__(
        self,
        model: Model,
        state: State,
        cores: int = 1,
        measure_energy: bool = True,
        kernel: str | None = None,
        tables: TableChanges | None = None,
    ) -> None:
        self._tables, self._frame = tables, 0
        self.model, self.state, self.measure_energy = model, state, measure_energy
        self._energies = Energies.AT_EACH_SAMPLE if measure_energy else Energies.NEVER
        self.partitions = model.islands.partition.size - 1
        self.cores = min(cores, self.partitions)
        self._balance = np.zeros(BALANCE_SIZE)
        uses = [RENDER_USE, *([INSERT_USE] if tables else [])]
        prepared = prepare([model], state, kernel)
        self.is_compiled = prepared.is_ready(uses)  # or the first block waits for it
        self.kernel, self.kinds = prepared.name, prepared.kinds
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

    def render_sample(self, job: TracedJob) -> None:
        """Render the next sample by a job of memory_of. Tables are exchanged before (exchange_due_tables)."""
        job.render(1)
        self._frame += 1

    def exchange_due_tables(self) -> None:
        """Do the exchanges of tables that are due before the next sample."""
        self._frames_until_exchange(1)

    @property
    def layout_of_tables(self) -> Layout | None:
        """The layout that the tables in use follow from; None if no score changes them."""
        return None if self._tables is None else self._tables.layout

    def _frames_until_exchange(self, frames: int) -> int:
        """Do the exchanges that are due now. Returns for how many frames there are no more, or `frames`."""
        if self._tables is None or frames == 0:
            return frames
        for exchange in self._tables.due(self._frame):
            exchange_tables(*self._handles, exchange, self._frame)
        self._tables.forget_before(self._frame + 1)
        following = self._tables.next_frame
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

    def memory_of(self, model: Model, state: State, channels: int) -> JobMemory:
        """Make the memory for single samples, with the same balance; on one core.

        model, state: like those at work, which differ in what is traced
        """
        model_handle, state_handle = (
            StructHandle(value, handle.kind) for value, handle in zip((model, state), self._handles, strict=True)
        )
        return JobMemory(model_handle, state_handle, (1, channels), self._energies, self._balance)

    def energy_totals(self) -> np.ndarray:
        """Return State.energy_totals up to now: before the next step."""
        return find_energy_totals(self.model, self.state, self._frame)

    def energies(self, totals: np.ndarray | None = None) -> EnergyStatistics:
        """Energies up to now. totals: energy_totals of the sample whose energies are the last ones; of now if None"""
        return energy_statistics(self._balance, self.energy_totals() if totals is None else totals)


# time of this thread, so that a busy machine costs nothing, where the system measures it finely (Windows in 16 ms)
THREAD_CLOCK = time.thread_time if time.get_clock_info("thread_time").resolution < 1e-5 else time.perf_counter


def time_block(simulation: Simulation, audio: np.ndarray) -> float:
    """Seconds that a block takes on one core, its memory being there."""
    simulation.memory(*audio.shape)
    begin = THREAD_CLOCK()
    simulation.render_block(audio)
    return THREAD_CLOCK() - begin
