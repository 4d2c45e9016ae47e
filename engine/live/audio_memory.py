"""Memory of the audio thread, and the compiled kernels that it calls."""

import math

import numpy as np

from engine.assembly.absent_parts import fill_stages
from engine.assembly.array_memory import align_to_cache_lines
from engine.assembly.build import BuildResult
from engine.assembly.refinement import build_refinement
from engine.compiler.struct_handle import StructHandle
from engine.kernel.data.effects import EVENTS
from engine.kernel.data.enums import Energies
from engine.kernel.data.model import Model
from engine.live.shared_memory import Gauge, SharedMemory, Slot
from engine.patch.accuracy import Accuracy
from engine.patch.frames import frame_count, nearest_frame
from engine.runtime.event_slots import VALUES_PER_EVENT, EventSlot
from engine.runtime.exchange import INSERT_EVENT, INSERT_USE
from engine.runtime.job_memory import JobMemory
from engine.runtime.kernel_choice import prepare

FADE_SECONDS = 0.005
RENDERED_AT_ONCE = 1024  # computed at once
QUEUE_SIZE = 16_384  # events: more than are told between two blocks, and than wait for their frames
QUALITY_CHANGES_KEPT = 1024  # until Python reads them
LOAD_COUNT = 8192  # blocks whose loads are kept
RECORD_SECONDS = 20.0  # of what was played, until it is fetched
LOAD_HIGH, LOAD_LOW = 0.8, 0.76  # of its deadline: a block above lowers the quality; a higher one is to stay below
LIMITER_RELEASE = 0.1  # s, in which the limiter lets go
MAX_FRAMES = 1 << 40  # that are played if a scene goes on and on


class AudioMemory:
    """All that the audio thread reads and writes, for a built scene, and the kernels that it calls.

    seconds: until it fades out; `math.inf`: until it is stopped
    gain:    factor on SI units
    kernel:  which is to run (engine.runtime.kernel_choice); `kernel` says which does
    queue_size: events that the queue holds, and as many can wait for their frames
    models:  what is played, and coarser ones
    kinds:   of pointers to a model and to the state
    shared:  what compiled code finds at `address`
    """

    def __init__(
        self,
        built: BuildResult,
        accuracy: Accuracy,
        channels: int,
        seconds: float,
        gain: float,
        kernel: str | None = None,
        queue_size: int = QUEUE_SIZE,
    ) -> None:
        model, samplerate = built.model, round(built.model.samplerate)
        self.models = [model, *coarser_models(built, accuracy)]
        prepared = prepare(self.models, built.state, kernel)
        self.kernel, self.kinds = prepared.name, prepared.kinds
        self.model_handles, self.state_handle = prepared.handles()
        self.job_memory = JobMemory(
            self.model_handles[0], self.state_handle, (RENDERED_AT_ONCE, channels), Energies.AT_CHECKS
        )
        self.shared = SharedMemory(
            counters=np.zeros(len(Slot), np.int64),
            gauges=np.zeros(len(Gauge)),
            events=np.zeros((queue_size, len(EventSlot)), np.int64),
            values=np.zeros((queue_size, VALUES_PER_EVENT)),
            waiting=np.zeros((queue_size, len(EventSlot)), np.int64),
            waiting_values=np.zeros((queue_size, VALUES_PER_EVENT)),
            order=np.arange(queue_size),
            dropped=np.zeros(queue_size, np.int64),
            single_event=np.zeros(len(EventSlot), np.int64),
            models=np.array([handle.address for handle in self.model_handles], np.int64),
            quality_log=np.zeros((QUALITY_CHANGES_KEPT, 2), np.int64),
            loads=np.zeros(LOAD_COUNT),
            record=np.zeros((nearest_frame(RECORD_SECONDS, samplerate), channels), np.float32),
            spare=np.zeros((RENDERED_AT_ONCE, channels), np.float32),
            audio=self.job_memory.audio,
            job=self.job_memory.address,
            state=self.state_handle.address,
            insert_event=INSERT_EVENT.address(self.model_handles[0].kind, self.state_handle.kind, *INSERT_USE.others),
            samplerate=samplerate,
            release=math.exp(-1.0 / (LIMITER_RELEASE * samplerate)),
        )
        counters, gauges, fade = self.shared.counters, self.shared.gauges, frame_count(FADE_SECONDS, samplerate)
        counters[[Slot.FADE_IN_FRAMES, Slot.FADE_OUT_FRAMES]] = fade
        counters[Slot.END] = MAX_FRAMES if math.isinf(seconds) else frame_count(seconds, samplerate)
        gauges[[Gauge.GAIN, Gauge.LOAD_HIGH, Gauge.LOAD_LOW]] = gain, LOAD_HIGH, LOAD_LOW
        self._handle = StructHandle(self.shared)
        self.address = self._handle.address

    @property
    def is_held(self) -> bool:
        """True if what is played is in memory."""
        return bool(self.models)

    def let_go(self, keeps_record: bool) -> None:
        """Free all but what the audio thread reads of a scene that is over: its counters, and of the first its
        recording."""
        kept = {"counters", *(("record", "spare", "audio") if keeps_record else ())}
        arrays = {k: v for k, v in self.shared._asdict().items() if isinstance(v, np.ndarray) and k not in kept}
        self.shared = SharedMemory(**(self.shared._asdict() | {k: v[:0].copy() for k, v in arrays.items()}))
        self.models, self._handle.value = [], self.shared
        del self.job_memory, self.model_handles, self.state_handle


def coarser_models(built: BuildResult, accuracy: Accuracy) -> list[Model]:
    """Coarser models of the same kind, to step down to where blocks come near their deadline."""
    model, layout = built.model, built.layout
    if model.refinement is None:
        return []
    has_events, rate = bool(model.effects & EVENTS), model.samplerate
    tables = [build_refinement(layout, coarse, rate, has_events, accuracy) for coarse in accuracy.coarser()[1:]]
    return [model._replace(refinement=align_to_cache_lines(fill_stages(model, table))) for table in tables if table]
