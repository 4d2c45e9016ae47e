"""A Model or a State stored once in the layout of compiled code, so that a kernel takes one address.

To unpack a scene of a hundred arrays at each call takes 60 µs, a quarter of a short block; and an audio driver, which
calls from outside Python, has nothing but addresses.
"""

import struct
from collections.abc import Callable
from typing import Any

import numpy as np

from engine.compiler.kinds import POINTER, Kind, kind_of
from engine.compiler.special_kernels import ALL


def address_of(array: np.ndarray) -> int:
    """Return where the numbers of an array lie. Raises ValueError if they are not in one piece."""
    interface = array.__array_interface__  # half the time of `ctypes` and `flags`
    if interface["strides"] is not None:
        raise ValueError("an array of compiled code lies in one piece")
    return int(interface["data"][0])


class Layout:
    """The layout of values in compiled code: numbers as in C; of an array its owners, of which it has none here, how
    many numbers, their size, their address, shape and strides; and of nothing an empty pointer.

    pointer_bytes: 4 or 8
    address_of:    where the numbers of an array lie
    pointers:      the places that hold these addresses
    """

    def __init__(
        self, pointer_bytes: int = 8, address_of: Callable[[np.ndarray], int] = address_of, keeps_pointers: bool = False
    ) -> None:
        pointer, gap = {4: ("I", 4), 8: ("Q", 0)}[pointer_bytes]
        self.pointer_bytes, self.address_of = pointer_bytes, address_of
        self.pointers: list[int] | None = [] if keeps_pointers else None
        self._arrays = [struct.Struct(f"<2{pointer}2q{pointer}{gap}x{2 * axes}q") for axes in range(4)]

    def pack(self, value: Any, content: bytearray) -> None:
        """Add a value to the content."""
        if isinstance(value, bool | np.bool_):
            content += struct.pack("<B", value)
            return
        alignment = self._alignment(value)
        content += bytes(-len(content) % alignment)
        if value is None:
            content += bytes(self.pointer_bytes)
        elif isinstance(value, np.ndarray):
            if self.pointers is not None:
                self.pointers.append(len(content) + 2 * self.pointer_bytes + 16)
            numbers = (0, 0, value.size, value.itemsize, self.address_of(value), *value.shape, *value.strides)
            content += self._arrays[value.ndim].pack(*numbers)
        elif isinstance(value, tuple):
            for item in value:
                self.pack(item, content)
            content += bytes(-len(content) % alignment)
        else:
            content += struct.pack("<d" if isinstance(value, float | np.floating) else "<q", value)

    def _alignment(self, value: Any) -> int:
        if self.pointer_bytes == 8 or not (value is None or isinstance(value, tuple)):
            return 8
        if value is None:
            return self.pointer_bytes
        return max((1 if isinstance(item, bool | np.bool_) else self._alignment(item) for item in value), default=1)


HERE = Layout()  # of this process


class StructHandle:
    """A tuple of arrays in the layout of compiled code. The arrays stay where they are, and are kept alive.

    kind: of a pointer to the value, if it is known
    """

    def __init__(self, value: Any, kind: Kind | None = None) -> None:
        self.value, self.kind = value, kind or pointer_kind(value)
        content = bytearray()
        HERE.pack(value, content)
        self._bytes = np.frombuffer(bytes(content) + bytes(-len(content) % 8 + 8), np.int64)
        self.address = self._bytes.ctypes.data


def pointer_kind(value: Any, effects: int = ALL) -> Kind:
    """The kind of a pointer to a value. effects: of the kernel that takes it, if it is a Model"""
    return POINTER, kind_of(value), effects
