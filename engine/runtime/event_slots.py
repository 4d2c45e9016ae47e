"""An event as integers and values, the form in which a scene that is being rendered takes it."""

from enum import IntEnum


class EventSlot(IntEnum):
    """Integers of an event: those of engine.assembly.event_table.EventRow, and what only live sound needs."""

    KIND = 0  # engine.kernel.data.enums.EventKind
    ISLAND = 1
    TARGET_BEGIN = 2
    TARGET_END = 3
    START = 4  # frame at which it begins, at the earliest
    LENGTH = 5  # frames; of an exchange of tables, copies
    TABLE = 6  # address of the copies of an exchange of tables
    TAKEN_AT = 7  # frame at which the audio thread took it


VALUES_PER_EVENT = 2
DROPPED = -1  # instead of the frame at which an event was taken
