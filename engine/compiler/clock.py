"""The clock of the system, as compiled code reads it: by the address of its function, so that kernels need nothing from
outside. The one for Windows is not tested."""

import ctypes
import sys
from functools import lru_cache
from typing import NamedTuple

import numpy as np

CLOCK_MONOTONIC = {"darwin": 6}  # on other systems it is 1
PLACE = -1  # an argument: the address of the result, which is two words


class Clock(NamedTuple):
    """A function of two arguments that writes a time into two words, and their units."""

    function: int  # its address
    first: int  # its first argument; the second is PLACE
    units: tuple[float, float]  # s, of the words


def system_clock() -> Clock:
    """Return the clock that never goes back."""
    if sys.platform == "win32":
        library, ticks = ctypes.WinDLL("kernel32"), ctypes.c_int64()
        library.QueryPerformanceFrequency(ctypes.byref(ticks))
        return Clock(_address(library.QueryPerformanceCounter), PLACE, (1.0 / ticks.value, 0.0))
    return Clock(_address(ctypes.CDLL(None).clock_gettime), CLOCK_MONOTONIC.get(sys.platform, 1), (1.0, 1e-9))


@lru_cache
def _words() -> np.ndarray:
    clock = system_clock()
    return np.array([clock.function, clock.first, *np.array(clock.units).view(np.int64)], np.int64)


def clock_address() -> int:
    """Return the address of the clock, as compiled code takes it."""
    return int(_words().ctypes.data)


def _address(function: object) -> int:
    return ctypes.cast(function, ctypes.c_void_p).value or 0  # type: ignore[arg-type]
