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
    CLOCK = 23  # address of a Clock, for the callback of PortAudio
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
    FRAMES_AT_EASE = 14  # in which a higher quality would have fitted
    RECORDED = 15
    NONFINITE_SAMPLES = 16
    WAITING = 17  # events whose frame has not come
    FIRST_WAITING = 18  # place of the first of them in `order`
    DROPPED = 19  # events that were dropped after they were taken
    DISPLACED = 20  # events that ended early, for a release that found no room
    FRAMES_AT_LEVEL = 21  # since the quality changed last
    LEVEL_BEFORE = 22  # which it had before that


class Gauge(IntEnum):
    """Floating-point numbers in the shared memory."""

    GAIN = 0
    ENVELOPE = 1  # of the limiter
    PEAK = 2
    MAX_LOAD = 3
    SECONDS_USED = 4
    LOAD_HIGH = 5  # a block with a higher load lowers the quality
    LOAD_LOW = 6  # the quality rises after a second in which a higher one would have had lower loads
    TREMOLO_DEPTH = 7
    TREMOLO_TURNS = 8  # a sample
    TREMOLO_SPREAD = 9  # turns from one channel to the next
    MEAN_LOAD = 10  # of the blocks since the quality changed last …
    LOAD_BEFORE = 11  # … and of those before


class SharedMemory(NamedTuple):
    """All that the audio thread reads and writes for one scene. Only what the arrays hold changes."""

    counters: np.ndarray  # int64 [Slot]
    gauges: np.ndarray  # [Gauge]
    events: np.ndarray  # int64 [queue size, EventSlot], a ring: the queue of events …
    values: np.ndarray  # [queue size, VALUES_PER_EVENT] … and of their values
    waiting: np.ndarray  # int64 [queue size, EventSlot]: events that wait for their frame …
    waiting_values: np.ndarray  # [queue size, VALUES_PER_EVENT] … their values …
    order: np.ndarray  # int64 [queue size], a ring: … and their rows, sorted by frame, before the unused ones
    dropped: np.ndarray  # int64 [queue size], a ring: indices of events that were dropped after they were taken
    single_event: np.ndarray  # int64 [EventSlot]: the one that the audio thread inserts at present
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
    release: float  # share of the limiter's envelope that is left after a sample


def _empty(dtype: type, dimensions: int) -> np.ndarray:
    return np.zeros((0,) * dimensions, dtype)


EMPTY = SharedMemory(  # says what compiled code gets
    counters=_empty(np.int64, 1),
    gauges=_empty(np.float64, 1),
    events=_empty(np.int64, 2),
    values=_empty(np.float64, 2),
    waiting=_empty(np.int64, 2),
    waiting_values=_empty(np.float64, 2),
    order=_empty(np.int64, 1),
    dropped=_empty(np.int64, 1),
    single_event=_empty(np.int64, 1),
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
    release=0.0,
)
