"""What Python and the audio thread share: whole numbers and addresses, gauges, and events in a queue.

Everything that the audio thread needs is found by addresses in one array of whole numbers: the kernel of the scene, its
Model, State and outputs, a queue of events, a ring of what was played.
"""

from enum import IntEnum


class Slot(IntEnum):
    """Whole numbers and addresses. Set once …"""

    RENDER_BLOCK = 0  # address of the kernel
    INSERT_EVENT = 1  # address of the kernel that takes an event
    MODEL = 2  # address of the Model that is played
    STATE = 3
    PARTITIONS = 4
    CHANNELS = 5
    CHUNK_FRAMES = 6  # frames computed at once, at most
    OUTPUTS = 7  # address of addresses: of the BlockOutput of each partition
    AUDIOS = 8  # of its audio
    LEDGERS = 9  # of its ledger
    MIX = 10  # sum of all partitions
    EVENTS = 11  # queue of events
    VALUES = 12  # and of their values
    QUEUE_SIZE = 13
    RECORD = 14  # ring of what was played
    RECORD_FRAMES = 15
    GAUGES = 16
    FADE_IN_FRAMES = 17
    SAMPLERATE = 18
    LOADS = 19  # ring of the loads of the last blocks
    LOAD_COUNT = 20
    MODELS = 21  # addresses of Models, each coarser than the one before
    MODEL_COUNT = 22
    LOWEST_QUALITY = 23
    ORDER = 24  # an event that the audio thread itself inserts
    QUALITY_LOG = 25  # ring of frames and levels of quality
    QUALITY_LOG_SIZE = 26
    SPARE = 27  # where the successor plays while one sound fades into another
    TUNINGS = 28  # tunings that wait for their frame
    # … what Python changes …
    WRITE_INDEX = 29  # events put in so far
    STOP_REQUESTED = 30
    SUCCESSOR = 31  # address of the shared memory that takes over
    FADE_OUT_FRAMES = 32
    # … and what the audio thread does
    END = 33  # frame at which all is over
    READ_INDEX = 34  # events taken so far
    FRAME = 35
    FINISHED = 36
    LIMITED_SAMPLES = 37
    UNDERRUNS = 38
    CALLS = 39
    QUALITY = 40  # level that is played, 0 is the best
    QUALITY_CHANGES = 41
    FRAMES_AT_EASE = 42
    RECORDED = 43
    NONFINITE_SAMPLES = 44
    WAITING_TUNINGS = 45


class Gauge(IntEnum):
    """Numbers."""

    GAIN = 0
    ENVELOPE = 1  # of the limiter
    PEAK = 2
    MAX_LOAD = 3
    SECONDS_USED = 4
    INITIAL_BALANCE = 5  # J
    MAX_ENERGY = 6
    MAX_ENERGY_ERROR = 7
    LOAD_HIGH = 8  # a block with a higher load lowers the quality
    LOAD_LOW = 9  # one with a lower load is at ease


class EventSlot(IntEnum):
    """Whole numbers of an event."""

    KIND = 0  # engine.kernel.codes.EventKind
    ISLAND = 1
    TARGET_BEGIN = 2
    TARGET_END = 3
    START = 4  # frame at which it begins, at the earliest
    LENGTH = 5  # frames
    TAKEN_AT = 6  # frame at which the audio thread took it


VALUES_PER_EVENT = 2
DROPPED = -1  # instead of the frame at which an event was taken
