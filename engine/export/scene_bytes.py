"""A scene as bytes: records and arrays, which a program without Python takes as they are.

Each address in it counts from a base: that of the bytes in the memory of the program, if it is known, or else 0. Then
the program adds the address of the bytes to each.
"""

from collections.abc import Iterator
from typing import Any

import numpy as np

from engine.compiler.struct_handle import Layout, address_of

ALIGNMENT = 64  # bytes, of each array: that of a cache line
NUMBER_BYTES = 8
MARGIN = 64  # bytes after each array, which vector instructions may read


class SceneBytes:
    """Values in the layout of compiled code, with all their arrays.

    pointer_bytes: of an address in a record, 4 or 8; in arrays of numbers an address has 8
    base:          address of the first byte
    content:       the bytes
    values:        where each value begins, by its name
    unused:        addresses of arrays in this process of which some numbers are not read, and which
    pointers:      places of addresses, in records and where `set_address` wrote them
    """

    def __init__(self, pointer_bytes: int, base: int = 0) -> None:
        self.base, self.content, self.values = base, bytearray(), dict[str, int]()
        self._arrays = dict[tuple[int, int], int]()  # where each array begins, by its place in this process
        self._kept = dict[str, Any]()  # so that no later array takes the place of one of theirs
        self.unused = list[tuple[int, np.ndarray]]()
        self._layout = Layout(pointer_bytes, lambda array: base + self.place_of(array), keeps_pointers=True)

    def add(self, name: str, value: Any) -> None:
        """Add a record with its arrays, or an array. Arrays that are there already are shared. Raises ValueError if an
        array is not in one piece."""
        self._kept[name] = value
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
        """Places of addresses."""
        assert self._layout.pointers is not None  # it was asked to keep them
        return self._layout.pointers

    def place_of(self, array: np.ndarray) -> int:
        """Return where an array begins. Raises KeyError for one that was not added."""
        return self._arrays[_key(array)]

    def kept_values(self) -> list[tuple[str, Any]]:
        """Return the values that were added, by their names."""
        return list(self._kept.items())

    def places_of_arrays(self, value: Any, but: Any = ()) -> Iterator[tuple[int, int]]:
        """Yield place and size of each array of a value that was added, but for those of a record in it."""
        left_out = set(map(_key, _arrays_of(but)))
        for array in _arrays_of(value):
            if array.size and _key(array) not in left_out:
                yield self.place_of(array), array.nbytes

    def address(self, what: str | np.ndarray) -> int:
        """Return the address of a value, by its name, or of an array. Raises KeyError for one that was not added."""
        return self.base + (self.values[what] if isinstance(what, str) else self.place_of(what))

    def stand_for(self, original: Any, value: Any, used: Any) -> None:
        """Let the arrays of a value that was added stand for those of another. used: 0 for the numbers of those arrays
        that nobody reads; all have the same shapes"""
        for array, ours, mask in zip(*map(_arrays_of, (original, value, used)), strict=True):
            if _key(array) not in self._arrays:
                self._arrays[_key(array)] = self.place_of(ours)
                self.unused.append((address_of(array), mask.reshape(-1) == 0.0))
        self._kept[f"original {len(self._kept)}"] = original

    def place_of_word(self, address: int) -> int | None:
        """Return the place of a number of an array that was added, by its address in this process; None for others."""
        for (begin, size), place in self._arrays.items():
            if begin <= address < begin + size:
                return place + address - begin
        return None

    def place_in(self, name: str, field: str) -> int:
        """Return where an integer of a record lies that was added by this name."""
        record, content = self._kept[name], bytearray()
        Layout(self._layout.pointer_bytes, lambda array: 0).pack(
            tuple(record[: record._fields.index(field) + 1]), content
        )
        return self.values[name] + len(content) - NUMBER_BYTES

    def set_number(self, place: int, value: int) -> None:
        """Set a 64-bit integer at a place."""
        self.content[place : place + NUMBER_BYTES] = value.to_bytes(NUMBER_BYTES, "little", signed=True)

    def set_address(self, place: int, what: str | np.ndarray) -> None:
        """Set a 64-bit integer at a place to the address of what was added."""
        self.set_place(place, self.address(what) - self.base)

    def set_place(self, place: int, target: int) -> None:
        """Set a 64-bit integer at a place to the address of another place."""
        self.set_number(place, self.base + target)
        self.pointers.append(place)

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
