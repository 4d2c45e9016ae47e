"""Tables exchanged in a scene that is being rendered: what that does to the energy counts as supplied."""

import ctypes

import numpy as np

from engine.assembly.table_changes import Exchange
from engine.compiler.kernels import Kernel
from engine.compiler.kinds import INT
from engine.compiler.struct_handle import StructHandle
from engine.kernel.data.enums import EventKind
from engine.runtime.event_slots import VALUES_PER_EVENT, EventSlot
from engine.runtime.kernel_choice import Use

INSERT_EVENT = Kernel("engine.runtime.event_insertion", "insert_event_at")
INSERT_USE = Use(INSERT_EVENT, (INT, INT, INT))
WORD_BYTES = 8


def exchange_tables(model: StructHandle, state: StructHandle, exchange: Exchange, frame: int) -> None:
    """Do an exchange before the step of a frame, as the audio thread does (engine.live.audio_thread)."""
    insert = INSERT_EVENT.callable(model.kind, state.kind, *INSERT_USE.others)
    event, value = np.zeros(len(EventSlot), np.int64), np.zeros(VALUES_PER_EVENT)

    def book_energy(sign: int) -> None:
        for n in range(exchange.island, exchange.island + exchange.islands):
            event[[EventSlot.KIND, EventSlot.ISLAND, EventSlot.TARGET_BEGIN]] = EventKind.BOOK_ENERGY, n, sign
            insert(model.address, state.address, event.ctypes.data, value.ctypes.data, frame)

    book_energy(-1)
    for target, source, words in exchange.copies.table.tolist():
        ctypes.memmove(target, source, WORD_BYTES * words)
    book_energy(1)
