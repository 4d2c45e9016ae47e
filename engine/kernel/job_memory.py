"""The memory that blocks of a scene are rendered in, and the Job that says where it is."""

from typing import Any

import numpy as np

from engine.compiler.decorators import c_address, c_function
from engine.compiler.struct_handle import StructHandle
from engine.kernel.codes import Ledger
from engine.kernel.helpers import Helpers
from engine.kernel.partitions import Job, render_job
from engine.kernel.render_block import render_block
from engine.kernel.state import BlockOutput, Trace


class JobMemory:
    """Blocks of a scene, of up to so many frames.

    model, state: handles of a Model and of a State
    audio:        [frames, channels], the sum of all partitions
    ledger:       [frames, columns (Ledger)], J; None if energies are not measured
    job:          see Job
    """

    def __init__(
        self, model: StructHandle, state: StructHandle, frames: int, channels: int, measure_energy: bool = True
    ) -> None:
        partitions = model.value.islands.partition.size - 1
        self.model, self.state = model, state
        self.audio = np.zeros((frames, channels))
        self.ledger = np.zeros((frames, len(Ledger))) if measure_energy else None
        self._outputs = [
            StructHandle(BlockOutput(np.zeros_like(self.audio), ledger, None))
            for ledger in (
                [None] * partitions if self.ledger is None else [*np.zeros((partitions, *self.ledger.shape))]
            )
        ]
        self._outputs_at = _addresses([output.address for output in self._outputs])
        self._audios = _addresses([output.value.audio.ctypes.data for output in self._outputs])
        self._ledgers = _addresses(
            [0 if output.value.ledger is None else output.value.ledger.ctypes.data for output in self._outputs]
        )
        self.job = np.zeros(len(Job), np.int64)
        self.job[Job.RENDER_BLOCK] = c_address(render_block, model, state, self._outputs[0], 0, 0)
        self.job[[Job.MODEL, Job.STATE]] = model.address, state.address
        self.job[[Job.PARTITIONS, Job.CHANNELS]] = partitions, channels
        self.job[[Job.OUTPUTS, Job.AUDIOS]] = self._outputs_at.ctypes.data, self._audios.ctypes.data
        self.job[Job.AUDIO] = self.audio.ctypes.data
        if self.ledger is not None:
            self.job[[Job.LEDGERS, Job.LEDGER]] = self._ledgers.ctypes.data, self.ledger.ctypes.data
        self.address = int(self.job.ctypes.data)
        self._render = c_function(render_job, self.address, 0)
        self._traced: tuple[Any, int] = (None, 0)  # the kind of output that was traced last, and its kernel

    def use_helpers(self, helpers: Helpers) -> None:
        """Let threads take part, as long as they live."""
        self.job[Job.CREW] = helpers.address

    def render(self, frames: int) -> None:
        """Render the next frames into `audio` and `ledger`."""
        self._render(self.address, frames)

    def render_traced(self, frames: int, trace: Trace) -> None:
        """The same on one core, with a trace of all partitions."""
        outputs = [StructHandle(output.value._replace(trace=trace)) for output in self._outputs]
        if self._traced[0] != outputs[0].kind:
            self._traced = outputs[0].kind, c_address(render_block, self.model, self.state, outputs[0], 0, 0)
        job, addresses = self.job.copy(), _addresses([output.address for output in outputs])
        job[[Job.RENDER_BLOCK, Job.OUTPUTS, Job.CREW]] = self._traced[1], addresses.ctypes.data, 0
        self._render(int(job.ctypes.data), frames)


def _addresses(numbers: list[int]) -> np.ndarray:
    return np.array(numbers, np.int64)
