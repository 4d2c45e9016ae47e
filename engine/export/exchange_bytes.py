"""Exchanges of tables as bytes: the kernel makes them, between two samples, as in live sound.

The tables are computed at export, and their copies name places in the bytes of the player.
"""

import numpy as np

from engine.assembly.event_table import EventRow
from engine.assembly.table_changes import Exchange
from engine.assembly.table_exchange import WORD_BYTES, Copies
from engine.export.scene_bytes import SceneBytes
from engine.kernel.data.enums import EventKind
from engine.live.shared_memory import SharedMemory
from engine.runtime.event_slots import EventSlot

COPY_NUMBERS = 3  # of a row of copies: where to, where from, and how many words
COPIES, VALUES = "copies ", "values "  # beginnings of the names of what is added to a scene


def add_copies(laid_out: SceneBytes, copies: Copies, values: int | None = None) -> tuple[int, int]:
    """Add copies to the bytes of a player, whose models are there. Return the place of their table, and how many they
    are: numbers that only other kernels use are left out.

    values: place of the numbers to read, if others added them before
    """
    values, read_from = add_values(laid_out, copies) if values is None else values, copies.values.ctypes.data
    rows = [
        (target, values + source - read_from, words)
        for address, source, words in copies.table.tolist()
        if (target := laid_out.place_of_word(address)) is not None
    ]
    table = np.zeros((len(rows), COPY_NUMBERS), np.int64)
    laid_out.add(f"{COPIES}{len(laid_out.values)}", table)
    begin = laid_out.place_of(table)
    for n, (target, source, words) in enumerate(rows):
        at = begin + WORD_BYTES * COPY_NUMBERS * n
        laid_out.set_place(at, target)
        laid_out.set_place(at + WORD_BYTES, source)
        laid_out.set_number(at + 2 * WORD_BYTES, words)
    return begin, len(rows)


def add_values(laid_out: SceneBytes, copies: Copies) -> int:
    """Add the numbers that copies read to the bytes of a player. Return their place."""
    numbers, read_from = copies.values.copy(), copies.values.ctypes.data
    for address, source, words in copies.table.tolist():
        _empty_unused(laid_out, address, numbers[(source - read_from) // WORD_BYTES :][:words])
    laid_out.add(f"{VALUES}{len(laid_out.values)}", numbers)
    return laid_out.place_of(numbers)


def _empty_unused(laid_out: SceneBytes, address: int, numbers: np.ndarray) -> None:
    """Set those of the numbers that go to an address to zero that nobody reads: they need no room in a packed page."""
    for begin, is_unused in laid_out.unused:
        first = (address - begin) // WORD_BYTES
        if 0 <= first < is_unused.size:
            numbers[is_unused[first : first + numbers.size]] = 0


def add_queued_exchanges(laid_out: SceneBytes, shared: SharedMemory, exchanges: list[Exchange]) -> None:
    """Add the tables of exchanges that wait in the queue of a player, and let its events name them."""
    by_address = {exchange.copies.table.ctypes.data: exchange for exchange in exchanges}
    queue = laid_out.place_of(shared.events)
    for n, event in enumerate(shared.events.tolist()):
        if event[EventSlot.KIND] == EventKind.EXCHANGE_TABLES:
            place, count = add_copies(laid_out, by_address[event[EventSlot.TABLE]].copies)
            at = queue + WORD_BYTES * len(EventSlot) * n
            laid_out.set_number(at + WORD_BYTES * EventSlot.LENGTH, count)
            laid_out.set_place(at + WORD_BYTES * EventSlot.TABLE, place)
            laid_out.set_number(at + WORD_BYTES * EventSlot.TICKET, 0)


def row_of_exchange(laid_out: SceneBytes, exchange: Exchange) -> list[float]:
    """Add the tables of an exchange. Return its row: the numbers of EventRow, with the copies as its length, and their
    address."""
    islands = exchange.island, exchange.island + exchange.islands
    return row_of_copies(laid_out, islands, add_copies(laid_out, exchange.copies))


def row_of_copies(laid_out: SceneBytes, islands: tuple[int, int], added: tuple[int, int]) -> list[float]:
    """Return the row of an exchange of tables of islands from and to. added: place and number of its copies"""
    place, count = added
    return [*EventRow(EventKind.EXCHANGE_TABLES, 0, *islands, 0, count), laid_out.base + place]


def writes_alike(one: Copies, other: Copies) -> bool:
    """True if two exchanges write to a number that is the same."""
    spans = [[(to, to + WORD_BYTES * words) for to, _, words in copies.table.tolist()] for copies in (one, other)]
    return any(a < d and c < b for a, b in spans[0] for c, d in spans[1])
