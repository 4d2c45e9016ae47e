"""The memory that blocks of a scene are rendered in, and the Job that says where it is."""

import numpy as np

from engine.compiler.kernels import Kernel
from engine.compiler.kinds import INT
from engine.compiler.struct_handle import StructHandle, pointer_kind
from engine.kernel.data.enums import BALANCE_SIZE, Energies, Ledger, Wanted
from engine.kernel.data.state import BlockOutput, Trace
from engine.runtime.helpers import Helpers
from engine.runtime.jobs import Job
from engine.runtime.kernel_choice import Use

RENDER_BLOCK = Kernel("engine.kernel.run.render_block", "render_block")
RENDER_JOB = Kernel("engine.runtime.partitions", "render_job")
RENDER_JOB_KINDS = INT, INT


def no_trace() -> Trace:
    """A trace of no frames."""
    table, row = np.zeros((0, 0)), np.zeros(0)
    return Trace(table, table, table, table, np.zeros(0, np.int64), row, row, row, row, row)


def block_output(audio: np.ndarray, ledger: np.ndarray, energies: Energies, trace: Trace | None = None) -> BlockOutput:
    """Return the output arrays of a block of one partition; motion is traced if there is a trace."""
    wanted = np.zeros(len(Wanted), np.int64)
    wanted[[Wanted.ENERGIES, Wanted.MOTION]] = energies, trace is not None
    return BlockOutput(audio, ledger, trace or no_trace(), wanted)


RENDER_USE = Use(
    RENDER_BLOCK, (pointer_kind(block_output(np.zeros((0, 0)), np.zeros((0, 0)), Energies.NEVER)), INT, INT)
)


class JobMemory:
    """Blocks of a scene, of up to so many frames and of so many channels.

    model, state: handles of a Model and of a State
    audio:        [frames, channels], the sum of all partitions
    balance:      see Balance; all zeros if energies are not measured
    ledger:       [rows, frames], the sum of all partitions
    job:          see Job
    addresses:    of the outputs, the audio and the ledgers of all partitions, by the slot of the job that names them
    """

    def __init__(
        self,
        model: StructHandle,
        state: StructHandle,
        size: tuple[int, int],
        energies: Energies = Energies.AT_EACH_SAMPLE,
        balance: np.ndarray | None = None,
    ) -> None:
        frames, channels = size
        partitions = model.value.islands.partition.size - 1
        self.model, self.state, self.energies = model, state, energies
        ledgers = np.zeros((partitions, len(Ledger), frames if energies else 0))
        outputs = [block_output(np.zeros((frames, channels)), ledger, energies) for ledger in ledgers]
        self.outputs = [StructHandle(output) for output in outputs]
        several = partitions > 1  # or their sum is that of the only one
        self.audio = np.zeros((frames, channels)) if several else self.outputs[0].value.audio
        self.ledger = np.zeros((len(Ledger), frames)) if several else ledgers[0]
        self.balance = np.zeros(BALANCE_SIZE) if balance is None else balance
        self.addresses = {
            Job.OUTPUTS: _addresses([output.address for output in self.outputs]),
            Job.AUDIOS: _addresses([output.value.audio.ctypes.data for output in self.outputs]),
            Job.LEDGERS: _addresses([ledger.ctypes.data for ledger in ledgers]),
        }
        self.job = np.zeros(len(Job), np.int64)
        self.job[Job.RENDER_BLOCK] = RENDER_BLOCK.address(model.kind, state.kind, *RENDER_USE.others)
        self.job[[Job.MODEL, Job.STATE]] = model.address, state.address
        self.job[[Job.PARTITIONS, Job.CHANNELS, Job.CAPACITY]] = partitions, channels, frames
        self.job[[Job.OUTPUTS, Job.AUDIOS]] = [self.addresses[s].ctypes.data for s in (Job.OUTPUTS, Job.AUDIOS)]
        self.job[[Job.AUDIO, Job.BALANCE]] = self.audio.ctypes.data, self.balance.ctypes.data
        if energies:
            self.job[[Job.LEDGERS, Job.LEDGER]] = self.addresses[Job.LEDGERS].ctypes.data, self.ledger.ctypes.data
        self.address = int(self.job.ctypes.data)
        self._render = RENDER_JOB.callable(*RENDER_JOB_KINDS)

    def use_helpers(self, helpers: Helpers | None) -> None:
        """Let threads take part, as long as they live."""
        self.job[Job.CREW] = 0 if helpers is None else helpers.address

    def render(self, frames: int) -> None:
        """Render the next frames into `audio`."""
        self._render(self.address, frames)

    def render_traced(self, frames: int, trace: Trace) -> None:
        """The same on one core, with a trace of all partitions."""
        TracedJob(self, trace).render(frames)


class TracedJob:
    """Blocks of a scene on one core that fill the same trace of all partitions again and again: it is zeroed by who
    reads it."""

    def __init__(self, memory: JobMemory, trace: Trace) -> None:
        self.memory = memory
        outputs = [handle.value for handle in memory.outputs]
        traced = [block_output(o.audio, o.ledger, memory.energies, trace) for o in outputs]
        self._handles = [StructHandle(output) for output in traced]
        self._addresses = _addresses([handle.address for handle in self._handles])
        self._job = memory.job.copy()
        self._job[[Job.OUTPUTS, Job.CREW]] = self._addresses.ctypes.data, 0
        self._render = RENDER_JOB.callable(*RENDER_JOB_KINDS)

    def render(self, frames: int) -> None:
        """Render the next frames into the memory's `audio`, and add to the trace."""
        self._render(int(self._job.ctypes.data), frames)


def _addresses(numbers: list[int]) -> np.ndarray:
    return np.array(numbers, np.int64)
