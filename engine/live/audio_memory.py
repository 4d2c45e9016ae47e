"""Memory of the audio thread, and the compiled kernels that it calls."""

import math
from typing import NamedTuple

import numpy as np

from engine.assembly.array_memory import align_to_cache_lines
from engine.assembly.build import BuildResult
from engine.assembly.refinement import build_refinement
from engine.compiler.struct_handle import StructHandle
from engine.kernel.data.model import Model
from engine.live.shared_memory import Gauge, Slot
from engine.patch.accuracy import Accuracy
from engine.patch.frames import frame_count, nearest_frame
from engine.runtime.event_slots import VALUES_PER_EVENT, EventSlot
from engine.runtime.exchange import INSERT_EVENT, INSERT_USE
from engine.runtime.job_memory import RENDER_USE, JobMemory
from engine.runtime.kernel_choice import prepare

FADE_SECONDS = 0.005
RENDERED_AT_ONCE = 1024  # computed at once
QUEUE_SIZE = 1024  # events
LOAD_COUNT = 8192  # blocks whose loads are kept
RECORD_SECONDS = 20.0  # of what was played, until it is fetched
LOAD_HIGH, LOAD_LOW = 0.8, 0.4  # of its deadline: a block above lowers the quality, one below is at ease
MAX_FRAMES = 1 << 40  # that are played if a scene goes on and on


class AudioMemory:
    """All that the audio thread reads and writes, for a built scene.

    seconds: until it fades out; `math.inf`: until it is stopped
    gain:    factor on SI units
    kernel:  which is to run (engine.runtime.kernel_choice); `kernel` says which does
    models:  what is played, and coarser ones
    """

    def __init__(
        self,
        built: BuildResult,
        accuracy: Accuracy,
        channels: int,
        seconds: float,
        gain: float,
        kernel: str | None = None,
    ) -> None:
        model, samplerate = built.model, round(built.model.samplerate)
        self.channels = channels
        self.shared = np.zeros(len(Slot), np.int64)
        self.gauges = np.zeros(len(Gauge))
        self.events = np.zeros((QUEUE_SIZE, len(EventSlot)), np.int64)
        self.quality_log = np.zeros((QUEUE_SIZE, 2), np.int64)  # frame, level
        self.record = np.zeros((nearest_frame(RECORD_SECONDS, samplerate), channels), np.float32)
        self.loads = np.zeros(LOAD_COUNT)  # of the last blocks, as shares of their deadlines
        self._buffers = _allocate_buffers(channels)
        self.models, uses = [model, *coarser_models(built, accuracy)], [RENDER_USE, INSERT_USE]
        prepared = prepare(self.models, built.state, uses, kernel)
        self.kernel, self.missing_kernels = prepared.name, prepared.missing
        self._models, self._state = [*map(StructHandle, prepared.models)], StructHandle(prepared.state)
        self.job_memory = JobMemory(self._models[0], self._state, (RENDERED_AT_ONCE, channels))
        self._fill_slots(model, samplerate, seconds)
        self.gauges[[Gauge.GAIN, Gauge.LOAD_HIGH, Gauge.LOAD_LOW]] = gain, LOAD_HIGH, LOAD_LOW

    def _fill_slots(self, model: Model, samplerate: int, seconds: float) -> None:
        """Say where everything is."""
        handles, buffers, fade = (self._models[0], self._state), self._buffers, frame_count(FADE_SECONDS, samplerate)
        self._addresses = np.array([handle.address for handle in self._models], np.int64)
        values = {
            Slot.JOB: self.job_memory.address,
            Slot.INSERT_EVENT: INSERT_EVENT.address(*(handle.kind for handle in handles), *INSERT_USE.others),
            Slot.MODEL: handles[0].address,
            Slot.STATE: handles[1].address,
            Slot.CHANNELS: self.channels,
            Slot.CHUNK_FRAMES: RENDERED_AT_ONCE,
            Slot.EVENTS: self.events.ctypes.data,
            Slot.VALUES: buffers.values.ctypes.data,
            Slot.QUEUE_SIZE: QUEUE_SIZE,
            Slot.TUNINGS: buffers.tunings.ctypes.data,
            Slot.RECORD: self.record.ctypes.data,
            Slot.RECORD_FRAMES: len(self.record),
            Slot.SPARE: buffers.spare.ctypes.data,
            Slot.MODELS: self._addresses.ctypes.data,
            Slot.MODEL_COUNT: len(self._models),
            Slot.LOWEST_QUALITY: len(self._models) - 1 + model.islands.mode.size - 2,
            Slot.ORDER: buffers.order.ctypes.data,
            Slot.QUALITY_LOG: self.quality_log.ctypes.data,
            Slot.QUALITY_LOG_SIZE: QUEUE_SIZE,
            Slot.LOADS: self.loads.ctypes.data,
            Slot.LOAD_COUNT: LOAD_COUNT,
            Slot.GAUGES: self.gauges.ctypes.data,
            Slot.FADE_IN_FRAMES: fade,
            Slot.FADE_OUT_FRAMES: fade,
            Slot.SAMPLERATE: samplerate,
            Slot.END: MAX_FRAMES if math.isinf(seconds) else frame_count(seconds, samplerate),
        }
        for slot, value in values.items():
            self.shared[slot] = value


class _Buffers(NamedTuple):
    """Arrays that only the audio thread uses."""

    spare: np.ndarray
    values: np.ndarray
    tunings: np.ndarray  # that wait for their frame
    order: np.ndarray


def _allocate_buffers(channels: int) -> _Buffers:
    return _Buffers(
        spare=np.zeros((RENDERED_AT_ONCE, channels), np.float32),
        values=np.zeros((QUEUE_SIZE, VALUES_PER_EVENT)),
        tunings=np.zeros((QUEUE_SIZE, len(EventSlot)), np.int64),
        order=np.zeros(len(EventSlot), np.int64),
    )


def coarser_models(built: BuildResult, accuracy: Accuracy) -> list[Model]:
    """Coarser models of the same kind, to step down to where blocks come near their deadline."""
    model, layout = built.model, built.layout
    if model.refinement is None or accuracy.precision == "float32":
        return []
    kick, rate = model.step.kick, model.samplerate
    tables = [build_refinement(layout, kick, coarse, rate, accuracy) for coarse in accuracy.coarser()[1:]]
    return [model._replace(refinement=align_to_cache_lines(table)) for table in tables]
