"""Points of a sweep rendered on this machine, by several processes.

Each has a pipe of its own, so that one that ends, or is ended, in the midst of an answer holds up no other.
"""

import multiprocessing
import os
import signal
import threading
from collections import deque
from contextlib import suppress
from multiprocessing.connection import Connection, wait

from engine.point import LOOK, Answers, Found, Task, rendered


def here(tasks: list[Task], cores: int) -> Answers:
    """Answers in any order, each once. A point whose process ends under it is tried once more, alone."""
    lost: list[Task] = []
    yield from _shared(tasks, cores, lost)
    for task in lost:
        again: list[Task] = []
        yield from _shared([task], 1, again)
        if again:
            yield task.number, Found(None, {}, "its process was killed; is there memory enough?")


def _shared(tasks: list[Task], cores: int, lost: list[Task]) -> Answers:
    """Answers of several processes; points whose process ended go to `lost`.

    The first point is rendered alone, until one is done: then what most need is compiled.
    """
    waiting, busy, room = deque(tasks), list[Worker](), 1
    try:
        while waiting or busy:
            while waiting and len(busy) < room:
                busy.append(Worker(waiting.popleft()))
            ready = wait([worker.pipe for worker in busy], LOOK)
            if not ready:
                yield None
            for worker in [worker for worker in busy if worker.pipe in ready]:
                task, found = worker.task, worker.answer()
                if found is None:
                    lost.append(task)
                if found is None or not waiting:
                    worker.end()
                    busy.remove(worker)
                else:
                    worker.give(waiting.popleft())
                if found is not None:
                    room = cores if found.audio is not None else room
                    yield task.number, found
    finally:
        for worker in busy:
            worker.end()


class Worker:
    """A process that renders points, one at a time."""

    def __init__(self, task: Task) -> None:
        spawn = multiprocessing.get_context("spawn")
        self.pipe, theirs = spawn.Pipe()
        self.process = spawn.Process(target=_work, args=(theirs,), daemon=True)
        self.process.start()
        theirs.close()
        self.give(task)

    def give(self, task: Task) -> None:
        """What to render next. If the process has ended, there is no answer."""
        self.task = task
        with suppress(OSError):
            self.pipe.send(task)

    def answer(self) -> Found | None:
        """What it found, once its pipe is ready; None if it has ended."""
        try:
            found: Found = self.pipe.recv()
        except (EOFError, OSError):  # before, or in the midst of it
            return None
        return found

    def end(self) -> None:
        """End it, whatever it is about."""
        self.process.terminate()
        self.process.join()
        self.pipe.close()


def _work(pipe: Connection) -> None:
    """In a process of its own: Ctrl-C is the parent's to answer, and without it there is nothing to do."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    parent = multiprocessing.parent_process()

    def follow() -> None:
        if parent is not None:
            parent.join()
            os._exit(1)

    threading.Thread(target=follow, daemon=True).start()
    with suppress(EOFError, OSError):  # the parent's end is closed
        while True:
            pipe.send(rendered(pipe.recv()))
