"""Points of a sweep rendered on this machine, by several processes.

Each has a pipe of its own, so that one that ends, or is ended, while it sends a result holds up no other.
"""

import multiprocessing
import os
import signal
import threading
from collections import deque
from contextlib import suppress
from multiprocessing.connection import Connection, wait

from engine.sweep.task import POLL_INTERVAL, RenderResult, RenderTask, Results, render_task

UNGUARDED = 93  # exit code of a process that was about to start the sweep again
NO_GUARD = (
    "a script that renders with several processes is imported by each of them, and must not start the sweep again: "
    'put what starts it under if __name__ == "__main__":'
)


def leave_if_imported() -> None:
    """End this process if it is a worker that is only importing the script that starts the sweep; `run_local` tells
    the script's own process."""
    if getattr(multiprocessing.current_process(), "_inheriting", False):  # as multiprocessing itself asks
        os._exit(UNGUARDED)


def run_local(tasks: list[RenderTask], cores: int) -> Results:
    """Results in any order, each once. A point whose process ends under it is tried once more, alone. Raises
    RuntimeError in a script without a main guard."""
    lost: list[RenderTask] = []
    yield from _run_pool(tasks, cores, lost)
    for task in lost:
        lost_twice: list[RenderTask] = []
        yield from _run_pool([task], 1, lost_twice)
        if lost_twice:
            yield (
                task.number,
                RenderResult(None, {}, "its process was killed; there may be too little memory for so many processes"),
            )


def _run_pool(tasks: list[RenderTask], cores: int, lost: list[RenderTask]) -> Results:
    """Results of several processes; points whose process ended are added to `lost`.

    Points are rendered one at a time until the first is done: then what most need is compiled.
    """
    waiting, busy, slots = deque(tasks), list[Worker](), 1
    try:
        while waiting or busy:
            while waiting and len(busy) < slots:
                busy.append(Worker(waiting.popleft()))
            ready = wait([worker.pipe for worker in busy], POLL_INTERVAL)
            if not ready:
                yield None
            for worker in [worker for worker in busy if worker.pipe in ready]:
                task, result = worker.task, worker.receive()
                if result is None:
                    lost.append(task)
                if result is None or not waiting:
                    worker.terminate()
                    busy.remove(worker)
                    if worker.process.exitcode == UNGUARDED:
                        raise RuntimeError(NO_GUARD)
                else:
                    worker.send(waiting.popleft())
                if result is not None:
                    slots = cores if result.audio is not None else slots
                    yield task.number, result
    finally:
        for worker in busy:
            worker.terminate()


class Worker:
    """A process that renders points, one at a time."""

    def __init__(self, task: RenderTask) -> None:
        spawn = multiprocessing.get_context("spawn")
        self.pipe, remote_end = spawn.Pipe()
        self.process = spawn.Process(target=_run_worker, args=(remote_end,), daemon=True)
        self.process.start()
        remote_end.close()
        self.send(task)

    def send(self, task: RenderTask) -> None:
        """Send what to render next. If the process has ended, `receive` tells."""
        self.task = task
        with suppress(OSError):
            self.pipe.send(task)

    def receive(self) -> RenderResult | None:
        """The result, once the pipe is ready; None if the process has ended."""
        try:
            result: RenderResult = self.pipe.recv()
        except (EOFError, OSError):  # it ended before or while it sent
            return None
        return result

    def terminate(self) -> None:
        """End the process, whatever it is doing."""
        self.process.terminate()
        self.process.join()
        self.pipe.close()


def _run_worker(pipe: Connection) -> None:
    """Render what comes through a pipe. Ctrl-C is for the parent to handle; when that ends, so does this process."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    parent = multiprocessing.parent_process()

    def end_with_parent() -> None:
        if parent is not None:
            parent.join()
            os._exit(1)

    threading.Thread(target=end_with_parent, daemon=True).start()
    with suppress(EOFError, OSError):  # the parent has closed its end
        while True:
            pipe.send(render_task(pipe.recv()))
