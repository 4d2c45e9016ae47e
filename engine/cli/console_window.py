"""Closing of the console window on Windows, which ends a program at once, without a signal."""

import ctypes
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from threading import Event
from typing import Any

CLOSED, LOGGED_OFF, SHUT_DOWN = 2, 5, 6  # control events of Windows after which the program is ended
PATIENCE = 4.5  # seconds; after 5, Windows ends the program all the same


@contextmanager
def delayed_closing(note_closing: Callable[[], None]) -> Iterator[None]:
    """Within it, the end of the program waits for the end of the block once the console window is closed.

    note_closing: called, by another thread, when the window is closed. On other systems, it is never called.
    """
    windows: Any = getattr(ctypes, "windll", None)
    if windows is None:
        yield
        return
    over, handler_type = Event(), getattr(ctypes, "WINFUNCTYPE")(ctypes.c_int, ctypes.c_ulong)  # noqa: B009

    def handle(event: int) -> int:
        if event not in (CLOSED, LOGGED_OFF, SHUT_DOWN):
            return 0  # for the next handler
        note_closing()
        over.wait(PATIENCE)
        return 1

    handler = handler_type(handle)
    windows.kernel32.SetConsoleCtrlHandler(handler, 1)
    try:
        yield
    finally:
        over.set()
        windows.kernel32.SetConsoleCtrlHandler(handler, 0)
