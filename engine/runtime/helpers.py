"""Threads that help to render blocks (engine.runtime.partitions) by compiled code, and never wait for Python."""

import ctypes
import os
import threading
import weakref
from typing import Any

import numpy as np

from engine.compiler.clock import clock_address
from engine.compiler.kernels import Kernel
from engine.compiler.kinds import INT
from engine.compiler.semaphore import Semaphore, make_semaphore
from engine.runtime.jobs import Crew

HELP_CREW = Kernel("engine.runtime.partitions", "help_crew")
HELP_CREW_KINDS = (INT,)
TIME_CRITICAL = 15  # THREAD_PRIORITY_TIME_CRITICAL of Windows
USER_INTERACTIVE = 0x21  # QOS_CLASS_USER_INTERACTIVE of macOS


class Helpers:
    """Threads that take part in every job whose Job.CREW is `address`, until they are stopped, or this is forgotten.

    count:       how many
    in_realtime: run before all ordinary threads, where that is allowed
    Raises OSError where the system has no semaphores.
    """

    def __init__(self, count: int, in_realtime: bool = False) -> None:
        semaphore = make_semaphore()
        crew = np.zeros(len(Crew), np.int64)
        crew[[Crew.SEMAPHORE, Crew.WAIT, Crew.POST]] = semaphore.handle, semaphore.wait, semaphore.post
        crew[Crew.CLOCK] = clock_address()
        help_on = HELP_CREW.callable(*HELP_CREW_KINDS)

        def run() -> None:
            if in_realtime:
                raise_priority()
            help_on(crew.ctypes.data)

        threads = [threading.Thread(target=run, name=f"fdh helper {n}", daemon=True) for n in range(count)]
        for thread in threads:
            thread.start()
        self.crew, self.address = crew, int(crew.ctypes.data)
        self.stop = weakref.finalize(self, _stop, crew, semaphore, threads)


def start_helpers(cores: int, partitions: int, in_realtime: bool = False) -> Helpers | None:
    """Helpers for the other cores, as many as partitions keep busy; None if one core does all, as it does where the
    system has no semaphores."""
    count = min(cores, partitions) - 1
    try:
        return Helpers(count, in_realtime) if count > 0 else None
    except OSError:
        return None


def raise_priority() -> bool:
    """Let this thread run before all ordinary ones. Returns whether that is allowed."""
    windows: Any = getattr(ctypes, "windll", None)
    try:
        if windows is not None:
            thread = ctypes.c_void_p(windows.kernel32.GetCurrentThread())
            return bool(windows.kernel32.SetThreadPriority(thread, TIME_CRITICAL))
        if hasattr(os, "sched_setscheduler"):
            os.sched_setscheduler(0, os.SCHED_RR, os.sched_param(os.sched_get_priority_min(os.SCHED_RR)))
            return True
        return bool(ctypes.CDLL(None).pthread_set_qos_class_self_np(USER_INTERACTIVE, 0) == 0)
    except (AttributeError, OSError):
        return False


def _stop(crew: np.ndarray, semaphore: Semaphore, threads: list[threading.Thread]) -> None:
    crew[Crew.STOP] = 1
    post = ctypes.CFUNCTYPE(None, ctypes.c_void_p, ctypes.c_ssize_t, ctypes.c_ssize_t)(semaphore.post)
    for _ in threads:
        post(semaphore.handle, 1, 0)
    for thread in threads:
        thread.join()
