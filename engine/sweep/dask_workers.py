"""Points of a sweep rendered by the workers of a Dask scheduler.

Workers need the same version of the engine, which is checked; they need no shared disk: a task holds all that it
takes, and the files are written here. What a killed worker was rendering is given to another.
"""

import logging
import sys
import time
from collections import deque
from concurrent.futures import CancelledError
from typing import Any

from engine.provenance import source_digest
from engine.sweep.task import POLL_INTERVAL, RenderResult, RenderTask, Results, render_task

SCHEDULER_TIMEOUT = 8  # s
TASKS_PER_THREAD = 2  # that are sent to the workers, so that none waits for the next one


def run_dask(tasks: list[RenderTask], address: str) -> Results:
    """Results of the workers, in any order, each once. Raises RuntimeError if no scheduler or no worker answers."""
    if tasks:
        yield None
        with _connect(address) as client:
            try:
                yield from _run_tasks(client, tasks)
            except (OSError, CancelledError):
                message = f"the scheduler at {address} is gone; when it is back, run the same command to continue"
                raise RuntimeError(message) from None


class MatchingWorkers:
    """The workers of a scheduler that have the sources of this engine. Others are reported, once each."""

    def __init__(self, client: Any) -> None:
        self.client, self.digest = client, source_digest()
        self.digests: dict[str, str] = {}  # by address, of all workers that have answered
        self.unreported: list[str] = []  # addresses of workers with other sources

    def poll(self) -> dict[str, int]:
        """Threads, by address, of the workers that are there now and may be given points."""
        threads: dict[str, int] = self.client.nthreads()
        new = [address for address in threads if address not in self.digests]
        self.digests |= self._ask_digests(new) if new else {}
        self.unreported += [address for address in new if self.digests[address] != self.digest]
        matching = {address: n for address, n in threads.items() if self.digests[address] == self.digest}
        if self.unreported and matching:
            text = f"{self._describe_others(self.unreported)}; start them with the sources of this one"
            print(text, file=sys.stderr)
            self.unreported = []
        return matching

    def describe_refusal(self) -> str:
        """A message that no worker has these sources."""
        return f"no worker can take points; {self._describe_others(list(self.digests))}"

    def _describe_others(self, addresses: list[str]) -> str:
        names = ", ".join(f"{address} ({self.digests[address] or 'none'})" for address in sorted(addresses))
        return (
            f"these workers are left out, because they have another version of the engine than {self.digest}: {names}"
        )

    def _ask_digests(self, addresses: list[str]) -> dict[str, str]:
        """The digests of the workers' sources; "" for a worker that has none, or cannot tell."""
        answers = self.client.run(source_digest, workers=addresses, on_error="return")
        return {a: answers[a] if isinstance(answers.get(a), str) else "" for a in addresses}


def _run_tasks(client: Any, tasks: list[RenderTask]) -> Results:
    """Results of the workers of a scheduler. Raises RuntimeError if none may be given points."""
    from distributed import wait

    waiting, workers = deque(tasks), MatchingWorkers(client)
    under_way: dict[Any, tuple[RenderTask, set[str]]] = {}  # by future, with the workers that may render it
    is_deserted = False
    if not workers.poll():
        raise RuntimeError(workers.describe_refusal())
    while True:
        threads = workers.poll()
        for future in [f for f, (_, given) in under_way.items() if threads and not given & set(threads)]:
            waiting.appendleft(under_way.pop(future)[0])  # all its workers are gone, and others came
            future.cancel()
        slots = TASKS_PER_THREAD * max(1, sum(threads.values())) - len(under_way)
        for _ in range(min(slots, len(waiting)) if threads else 0):
            task = waiting.popleft()
            try:
                future = client.submit(render_task, task.complete(), pure=False, workers=list(threads))
                under_way[future] = task, set(threads)
            except FileNotFoundError as error:  # the file was removed after the sweep began
                yield task.number, RenderResult(None, {}, str(error))
        if not under_way and not waiting:
            return
        is_deserted = _report_desertion(threads, is_deserted)
        try:
            finished = wait(list(under_way), POLL_INTERVAL, "FIRST_COMPLETED").done if under_way else _wait_idle()
        except TimeoutError:
            yield None
            continue
        for future in finished:
            yield under_way.pop(future)[0].number, _result_of(future)


def _wait_idle() -> set[Any]:
    """Wait as if for a task, when there is none. Raises TimeoutError."""
    time.sleep(POLL_INTERVAL)
    raise TimeoutError


def _report_desertion(threads: dict[str, int], was_deserted: bool) -> bool:
    """Return True if all workers are gone. A line is printed once when they go."""
    is_deserted = not threads
    if is_deserted and not was_deserted:
        print(
            "all workers are gone; waiting for others (Ctrl-C ends the sweep, and the same command continues it)",
            file=sys.stderr,
        )
    return is_deserted


def _connect(address: str) -> Any:
    """Connect to a scheduler that has workers. Raises RuntimeError."""
    from distributed import Client

    logging.getLogger("distributed").setLevel(logging.CRITICAL + 1)  # its errors are reported here
    logging.getLogger("distributed.client").setLevel(logging.CRITICAL + 1)
    try:
        client = Client(address, timeout=SCHEDULER_TIMEOUT)
    except (OSError, ValueError, TypeError) as error:
        reason = str(error).splitlines()[0] if str(error) else type(error).__name__
        raise RuntimeError(f"no scheduler answers at {address} ({reason}); start one with: dask scheduler") from None
    try:
        client.wait_for_workers(1, timeout=SCHEDULER_TIMEOUT)
    except TimeoutError:
        client.close()
        remedy = f"start some with: dask worker {address} --nthreads 1 --nworkers 2"
        raise RuntimeError(f"the scheduler at {address} has no workers; {remedy}") from None
    return client


def _result_of(future: Any) -> RenderResult:
    """The result of a finished future; an error outside the rendering is the failure of its point. Raises
    CancelledError if the scheduler is gone."""
    try:
        result: RenderResult = future.result()
        return result
    except CancelledError:
        raise
    except Exception as error:  # no engine there, or a point that kills one worker after another
        return RenderResult(None, {}, " ".join(f"{type(error).__name__}: {error}".split()))
