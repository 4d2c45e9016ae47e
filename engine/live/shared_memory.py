"""Memory that Python and the audio thread share: integers and addresses, gauges, and a queue of events.

The audio thread finds everything by addresses in one array of integers: the kernel of the scene, its Model, State and
outputs, a queue of events (engine.runtime.event_slots), and a ring of the frames that were played.
"""

from enum import IntEnum


class Slot(IntEnum):
    """Integers and addresses in the shared memory."""

    # set once
    JOB = 0  # address of the Job of a block (engine.runtime.partitions)
    INSERT_EVENT = 1  # address of the kernel that takes an event
    MODEL = 2  # address of the Model that is played
    STATE = 3
    CHANNELS = 4
    CHUNK_FRAMES = 5  # frames computed at once, at most
    EVENTS = 6  # queue of events
    VALUES = 7  # queue of the values of events
    QUEUE_SIZE = 8
    RECORD = 9  # ring of the frames that were played
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
    SPARE = 22  # memory for the successor's output while one sound fades into another
    TUNINGS = 23  # exchanges of tables that wait for their frame
    # changed by Python
    WRITE_INDEX = 24  # events put in so far
    STOP_REQUESTED = 25
    SUCCESSOR = 26  # address of the shared memory that takes over
    FADE_OUT_FRAMES = 27
    # changed by the audio thread
    END = 28  # frame at which playing ends
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
    """Floating-point numbers in the shared memory."""

    GAIN = 0
    ENVELOPE = 1  # of the limiter
    PEAK = 2
    MAX_LOAD = 3
    SECONDS_USED = 4
    LOAD_HIGH = 5  # a block with a higher load lowers the quality
    LOAD_LOW = 6  # after a second of lower loads, the quality rises
