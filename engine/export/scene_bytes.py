"""A scene as bytes: its Model, its State and the output of a block, which a program without Python takes as they are.

Each pointer is an offset into the bytes. A program copies them to memory, and adds its address to each pointer.
"""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from engine.compiler.struct_handle import Layout, address_of

ALIGNMENT = 64  # bytes, of each array: that of a cache line
MARGIN = 64  # bytes after each array, which vector instructions may read


@dataclass(frozen=True)
class SceneBytes:
    """Values in the layout of compiled code, with all their arrays."""

    content: bytes
    pointers: list[int]  # places of addresses, which are offsets into the content
    values: dict[str, int]  # where each value begins
    arrays: dict[tuple[int, int], int]  # where each array begins, by its place in this process

    def place_of(self, array: np.ndarray) -> int:
        """Return where an array begins. Raises KeyError for one that is not of the values."""
        return self.arrays[_key(array)]


def lay_out(values: Mapping[str, Any], pointer_bytes: int) -> SceneBytes:
    """Lay out values for a machine whose pointers have so many bytes.

    values: records of arrays, by name
    Raises ValueError if an array is not in one piece.
    """
    content, arrays, begins = bytearray(), dict[tuple[int, int], int](), dict[str, int]()
    for array in _arrays_of(tuple(values.values())):
        if _key(array) not in arrays:
            content += bytes(-len(content) % ALIGNMENT)
            arrays[_key(array)] = len(content)
            content += array.tobytes() + bytes(MARGIN)
    layout = Layout(pointer_bytes, lambda array: arrays[_key(array)], keeps_pointers=True)
    for name, value in values.items():
        content += bytes(-len(content) % ALIGNMENT)
        begins[name] = len(content)
        layout.pack(value, content)
    return SceneBytes(bytes(content), layout.pointers or [], begins, arrays)


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
