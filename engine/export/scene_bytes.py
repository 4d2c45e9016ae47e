"""A scene as bytes: its Model, its State and the output of a block, which a program without Python takes as they are.

Each address in it counts from a base: that of the bytes in the memory of the program, if it is known, or else 0. Then
the program adds the address of the bytes to each.
"""

from collections.abc import Iterator
from typing import Any

import numpy as np

from engine.compiler.struct_handle import Layout, address_of

ALIGNMENT = 64  # bytes, of each array: that of a cache line
MARGIN = 64  # bytes after each array, which vector instructions may read


class SceneBytes:
    """Values in the layout of compiled code, with all their arrays.

    pointer_bytes: of an address in a record, 4 or 8; in arrays of numbers an address has 8
    base:          address of the first byte
    content:       the bytes
    values:        where each value begins, by its name
    pointers:      places of addresses in records
    """

    def __init__(self, pointer_bytes: int, base: int = 0) -> None:
        self.base, self.content, self.values = base, bytearray(), dict[str, int]()
        self._arrays = dict[tuple[int, int], int]()  # where each array begins, by its place in this process
        self._kept = list[Any]()  # values, so that no later array takes the place of one of theirs
        self._layout = Layout(pointer_bytes, lambda array: base + self.place_of(array), keeps_pointers=True)

    def add(self, name: str, value: Any) -> None:
        """Add a record with its arrays, or an array. Arrays that are there already are shared. Raises ValueError if an
        array is not in one piece."""
        self._kept.append(value)
        for array in _arrays_of(value):
            if _key(array) not in self._arrays:
                self._align()
                self._arrays[_key(array)] = len(self.content)
                self.content += array.tobytes() + bytes(MARGIN)
        self._align()
        self.values[name] = len(self.content)
        if isinstance(value, np.ndarray):
            self.values[name] = self.place_of(value)
        else:
            self._layout.pack(value, self.content)

    @property
    def pointers(self) -> list[int]:
        """Places of addresses in records."""
        return self._layout.pointers or []

    def place_of(self, array: np.ndarray) -> int:
        """Return where an array begins. Raises KeyError for one that was not added."""
        return self._arrays[_key(array)]

    def address(self, what: str | np.ndarray) -> int:
        """Return the address of a value, by its name, or of an array. Raises KeyError for one that was not added."""
        return self.base + (self.values[what] if isinstance(what, str) else self.place_of(what))

    def set_number(self, array: np.ndarray, number: int, value: int) -> None:
        """Set number `number` of an array of 64-bit integers that was added."""
        place = self.place_of(array) + 8 * number
        self.content[place : place + 8] = value.to_bytes(8, "little", signed=True)

    def _align(self) -> None:
        self.content += bytes(-len(self.content) % ALIGNMENT)


def _key(array: np.ndarray) -> tuple[int, int]:
    """Return what tells arrays apart: an empty one may lie where another begins."""
    return address_of(array), array.nbytes


def _arrays_of(value: Any) -> Iterator[np.ndarray]:
    """Yield all arrays of a record, and of the records in it."""
    if isinstance(value, np.ndarray):
        yield value
    elif isinstance(value, tuple):
        for item in value:
            yield from _arrays_of(item)
