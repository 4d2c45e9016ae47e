"""What Python and the audio thread share: whole numbers and addresses, gauges, and events in a queue.

Everything that the audio thread needs is found by addresses in one array of whole numbers: the kernel of the scene, its
Model, State and outputs, a queue of events (engine.parallel.event_slots), a ring of what was played.
"""

from enum import IntEnum


class Slot(IntEnum):
    """Whole numbers and addresses. Set once …"""

    JOB = 0  # address of the Job of a block (engine.parallel.partitions)
    INSERT_EVENT = 1  # address of the kernel that takes an event
    MODEL = 2  # address of the Model that is played
    STATE = 3
    CHANNELS = 4
    CHUNK_FRAMES = 5  # frames computed at once, at most
    EVENTS = 6  # queue of events
    VALUES = 7  # and of their values
    QUEUE_SIZE = 8
    RECORD = 9  # ring of what was played
    RECORD_FRAMES = 10
    GAUGES = 11
    FADE_IN_FRAMES = 12
    SAMPLERATE = 13
    LOADS = 14  # ring of the loads of the last blocks
    LOAD_COUNT = 15
    MODELS = 16  # addresses of Models, each coarser than the one before
    MODEL_COUNT = 17
    LOWEST_QUALITY = 18
    ORDER = 19  # an event that the audio thread itself inserts
    QUALITY_LOG = 20  # ring of frames and levels of quality
    QUALITY_LOG_SIZE = 21
    SPARE = 22  # where the successor plays while one sound fades into another
    TUNINGS = 23  # tunings that wait for their frame
    # … what Python changes …
    WRITE_INDEX = 24  # events put in so far
    STOP_REQUESTED = 25
    SUCCESSOR = 26  # address of the shared memory that takes over
    FADE_OUT_FRAMES = 27
    # … and what the audio thread does
    END = 28  # frame at which all is over
    READ_INDEX = 29  # events taken so far
    FRAME = 30
    FINISHED = 31
    LIMITED_SAMPLES = 32
    UNDERRUNS = 33
    CALLS = 34
    QUALITY = 35  # level that is played, 0 is the best
    QUALITY_CHANGES = 36
    FRAMES_AT_EASE = 37
    RECORDED = 38
    NONFINITE_SAMPLES = 39
    WAITING_TUNINGS = 40


class Gauge(IntEnum):
    """Numbers."""

    GAIN = 0
    ENVELOPE = 1  # of the limiter
    PEAK = 2
    MAX_LOAD = 3
    SECONDS_USED = 4
    LOAD_HIGH = 5  # a block with a higher load lowers the quality
    LOAD_LOW = 6  # one with a lower load is at ease
