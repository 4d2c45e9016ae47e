"""Compiles kernels in another process, for the next time: at low priority, one process per machine, and with nothing
that the starting process waits for, or that holds its pipes open.
"""

import json
import os
import subprocess
import sys
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from multiprocessing import parent_process
from pathlib import Path
from typing import Any

from engine.compiler import cache_files

VARIABLE = "FDH_BACKGROUND"  # of the environment: "off" lets nothing be compiled beside
LOCK, COMPILING, PLAYING = "background.lock", "compiling", "playing"
FORBIDDING = "CI", "PYTEST_CURRENT_TEST"  # variables of the environment
LOCKED_BYTE = 1 << 20  # far behind the text, on Windows
PRIORITY = 19  # the lowest, on POSIX
_forbidden: list[bool] = []
Request = tuple[str, str, tuple[Any, ...]]  # module, function, kinds


@contextmanager
def forbidden() -> Iterator[None]:
    """Let nothing be compiled beside meanwhile."""
    _forbidden.append(True)
    try:
        yield
    finally:
        _forbidden.pop()


def is_allowed() -> bool:
    """True if kernels may be compiled in the background: not in tests, in CI, by a worker, or if the user forbids
    it."""
    unwanted = bool(_forbidden) or os.environ.get(VARIABLE, "").lower() in ("off", "0", "no")
    return not unwanted and parent_process() is None and not any(map(os.environ.get, FORBIDDING))


def compile_beside(requests: Sequence[Request]) -> None:
    """Start to compile kernels for the next time, if that is allowed and nothing is being compiled yet."""
    if not requests or not is_allowed() or _holder() is not None:
        return
    settings: dict[str, Any] = {"start_new_session": True}
    if sys.platform == "win32":
        settings = {"creationflags": subprocess.DETACHED_PROCESS | subprocess.IDLE_PRIORITY_CLASS}
    with suppress(OSError):
        subprocess.Popen(
            [sys.executable, "-m", "engine.compiler.background", json.dumps(requests)],
            stdin=subprocess.DEVNULL,
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
            close_fds=True,
            cwd=Path(__file__).parents[2],
            env=os.environ | {VARIABLE: "off"},
            **settings,
        )


def is_compiling() -> bool:
    """True if a process compiles kernels in the background."""
    return _holder() == COMPILING


@contextmanager
def postponed() -> Iterator[None]:
    """Let no process of this user begin to compile for the next time meanwhile."""
    lock = None
    with suppress(OSError):
        lock = _take_lock(PLAYING)
    try:
        yield
    finally:
        if lock is not None:
            os.close(lock)


def _holder() -> str | None:
    """Return the task of the process that has the lock; None if none has it."""
    try:
        path = cache_files.folder() / LOCK
        if not path.exists():
            return None
        lock = _take_lock()
        if lock is None:
            return path.read_text("utf-8")
    except OSError:
        return None
    os.close(lock)
    return None


def compile_requests(requests: Sequence[Request]) -> None:
    """Compile kernels that are not kept yet, if no other process does."""
    from engine.compiler.kernels import Kernel

    lock = _take_lock(COMPILING)
    if lock is None:
        return
    if hasattr(os, "nice"):
        os.nice(PRIORITY)
    for module, function, kinds in requests:
        Kernel(module, function).compile_for_host(*kinds)
    os.close(lock)


def _take_lock(purpose: str = "") -> int | None:
    """The lock, which ends with the process; None if another has it. Raises OSError without a folder.

    purpose: text for other processes
    """
    lock = os.open(cache_files.folder() / LOCK, os.O_RDWR | os.O_CREAT, 0o600)
    try:
        if sys.platform == "win32":
            import msvcrt

            os.lseek(lock, LOCKED_BYTE, os.SEEK_SET)  # no other process can read what is locked
            msvcrt.locking(lock, msvcrt.LK_NBLCK, 1)
            os.lseek(lock, 0, os.SEEK_SET)
        else:
            import fcntl

            fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except OSError:
        os.close(lock)
        return None
    os.ftruncate(lock, 0)
    os.write(lock, purpose.encode())
    return lock


if __name__ == "__main__":
    from engine.compiler.kinds import as_kind

    compile_requests([(module, function, as_kind(kinds)) for module, function, kinds in json.loads(sys.argv[1])])
