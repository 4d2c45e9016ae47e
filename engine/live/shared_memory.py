"""Memory that Python and the audio thread share: a record of arrays and numbers, which the thread reads at its address
(engine.compiler.struct_handle)."""

from enum import IntEnum
from typing import NamedTuple

import numpy as np


class Slot(IntEnum):
    """Integers in the shared memory that change."""

    # set by Python
    WRITE_INDEX = 0  # events put in so far
    STOP_REQUESTED = 1
    SUCCESSOR = 2  # address of the shared memory that takes over
    FADE_IN_FRAMES = 3
    FADE_OUT_FRAMES = 4
    # set by the audio thread
    END = 5  # frame at which playing ends
    READ_INDEX = 6  # events taken so far
    FRAME = 7
    FINISHED = 8
    LIMITED_SAMPLES = 9
    UNDERRUNS = 10
    CALLS = 11
    QUALITY = 12  # level that is played, 0 is the best
    QUALITY_CHANGES = 13
    FRAMES_AT_EASE = 14
    RECORDED = 15
    NONFINITE_SAMPLES = 16
    EXCHANGES_WAITING = 17  # exchanges of tables whose frame has not come


class Gauge(IntEnum):
    """Floating-point numbers in the shared memory."""

    GAIN = 0
    ENVELOPE = 1  # of the limiter
    PEAK = 2
    MAX_LOAD = 3
    SECONDS_USED = 4
    LOAD_HIGH = 5  # a block with a higher load lowers the quality
    LOAD_LOW = 6  # after a second of lower loads, the quality rises
    TREMOLO_DEPTH = 7
    TREMOLO_TURNS = 8  # a sample
    TREMOLO_SPREAD = 9  # turns from one channel to the next


class SharedMemory(NamedTuple):
    """All that the audio thread reads and writes for one scene. Only what the arrays hold changes."""

    counters: np.ndarray  # int64 [Slot]
    gauges: np.ndarray  # [Gauge]
    events: np.ndarray  # int64 [queue size, EventSlot], a ring: the queue of events …
    values: np.ndarray  # [queue size, VALUES_PER_EVENT] … and of their values
    exchanges: np.ndarray  # int64 [queue size, EventSlot]: exchanges of tables that wait for their frame
    order: np.ndarray  # int64 [EventSlot]: an event that the audio thread itself inserts
    models: np.ndarray  # int64 [models]: addresses of Models, each coarser than the one before
    quality_log: np.ndarray  # int64 [queue size, 2], a ring: frame, level of quality
    loads: np.ndarray  # [blocks], a ring: of the last blocks, as shares of their deadlines
    record: np.ndarray  # float32 [frames, channels], a ring: what was played
    spare: np.ndarray  # float32 [frames, channels]: output of the successor while one sound fades into another
    audio: np.ndarray  # [frames, channels]: output of the job, of as many frames as are computed at once
    job: int  # address of the Job of a block (engine.runtime.jobs)
    state: int  # address of the State
    insert_event: int  # address of the kernel that takes an event
    samplerate: int
    lowest_quality: int
    release: float  # share of the limiter's envelope that is left after a sample


def _empty(dtype: type, dimensions: int) -> np.ndarray:
    return np.zeros((0,) * dimensions, dtype)


EMPTY = SharedMemory(  # says what compiled code gets
    counters=_empty(np.int64, 1),
    gauges=_empty(np.float64, 1),
    events=_empty(np.int64, 2),
    values=_empty(np.float64, 2),
    exchanges=_empty(np.int64, 2),
    order=_empty(np.int64, 1),
    models=_empty(np.int64, 1),
    quality_log=_empty(np.int64, 2),
    loads=_empty(np.float64, 1),
    record=_empty(np.float32, 2),
    spare=_empty(np.float32, 2),
    audio=_empty(np.float64, 2),
    job=0,
    state=0,
    insert_event=0,
    samplerate=0,
    lowest_quality=0,
    release=0.0,
)
