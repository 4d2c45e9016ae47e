"""A semaphore of the system that compiled code waits on and posts, by addresses.

`wait(handle, WAIT_FOREVER)` and `post(handle, 1, 0)` are right on every system: the functions of POSIX and of macOS
ignore what they do not take. Only those of Linux are tested.
"""

import ctypes
import sys
from typing import Any, NamedTuple

WAIT_FOREVER = -1  # as an unsigned number, on macOS; INFINITE on Windows
SEMAPHORE_BYTES = 64  # a sem_t takes 32 at most


class Semaphore(NamedTuple):
    """Addresses of what compiled code calls, and of what it calls it with."""

    handle: int
    wait: int
    post: int
    memory: Any  # that lives as long


def make_semaphore() -> Semaphore:
    """A semaphore that nobody has posted. Raises OSError where there are none."""
    if sys.platform == "win32":
        library = ctypes.WinDLL("kernel32")
        library.CreateSemaphoreW.restype = ctypes.c_void_p
        memory, wait, post = library, library.WaitForSingleObject, library.ReleaseSemaphore
        handle = library.CreateSemaphoreW(None, 0, 0x7FFFFFFF, None)
    elif sys.platform == "darwin":
        library = ctypes.CDLL(None)
        library.dispatch_semaphore_create.restype = ctypes.c_void_p
        memory, wait, post = library, library.dispatch_semaphore_wait, library.dispatch_semaphore_signal
        handle = library.dispatch_semaphore_create(ctypes.c_long(0))
    else:
        library, memory = ctypes.CDLL(None), ctypes.create_string_buffer(SEMAPHORE_BYTES)
        wait, post = library.sem_wait, library.sem_post
        handle = ctypes.addressof(memory) if library.sem_init(memory, 0, 0) == 0 else None
    if not handle:
        raise OSError("the system has no semaphore to give")
    waits_at, posts_at = (ctypes.cast(function, ctypes.c_void_p).value or 0 for function in (wait, post))
    return Semaphore(handle, waits_at, posts_at, memory)
