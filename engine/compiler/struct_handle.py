"""A Model or a State stored once in the layout of compiled code, so that a kernel takes one address.

To unpack a scene of a hundred arrays at each call takes 60 µs, a quarter of a short block; and an audio driver, which
calls from outside Python, has nothing but addresses.
"""

import struct
from typing import Any

import numpy as np

from engine.compiler.kinds import POINTER, Kind, kind_of

ARRAY_LAYOUTS = [struct.Struct(f"<{5 + 2 * axes}q") for axes in range(4)]  # of arrays with so many axes


class StructHandle:
    """A tuple of arrays in the layout of compiled code. The arrays stay where they are, and are kept alive.

    kind: of a pointer to the value, if it is known
    """

    def __init__(self, value: Any, kind: Kind | None = None) -> None:
        self.value, self.kind = value, kind or pointer_kind(value)
        content = bytearray()
        pack(value, content)
        self._bytes = np.frombuffer(bytes(content) + bytes(-len(content) % 8 + 8), np.int64)
        self.address = self._bytes.ctypes.data


def pointer_kind(value: Any) -> Kind:
    """The kind of a pointer to a value."""
    return POINTER, kind_of(value)


def pack(value: Any, content: bytearray) -> None:
    """Add a value as Numba lays it out: numbers as C does; of an array its owners, which it has none of here, how many
    numbers, their size, their address, shape and strides; and of nothing an empty pointer."""
    if isinstance(value, bool | np.bool_):
        content += struct.pack("<B", value)
        return
    content += bytes(-len(content) % 8)
    if value is None:
        content += bytes(8)
    elif isinstance(value, np.ndarray):
        interface = value.__array_interface__  # half the time of `ctypes` and `flags`
        if interface["strides"] is not None:
            raise ValueError("an array of compiled code lies in one piece")
        numbers = (0, 0, value.size, value.itemsize, interface["data"][0], *value.shape, *value.strides)
        content += ARRAY_LAYOUTS[value.ndim].pack(*numbers)
    elif isinstance(value, tuple):
        for item in value:
            pack(item, content)
        content += bytes(-len(content) % 8)
    else:
        content += struct.pack("<d" if isinstance(value, float | np.floating) else "<q", value)
