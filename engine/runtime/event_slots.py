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
    NOTE = 6  # the note that it belongs to, with whose end it is cancelled if it has not begun; 0: none
    IS_RELEASE = 7  # 1: it ends a note, and is never dropped
    TABLE = 8  # address of the copies of an exchange of tables …
    TICKET = 9  # … and of the number that says whether it was made or withdrawn; 0: it cannot be withdrawn
    TAKEN_AT = 10  # frame at which the audio thread took it, or one of the answers below
    INDEX = 11  # in the queue: how many were put in before


VALUES_PER_EVENT = 3
DROPPED = -1  # instead of the frame at which an event was taken: there was no room for it
DISPLACING = -2  # … there was room only in the place of an older one, which ended
