"""Points of a sweep rendered by the workers of a Dask scheduler.

Workers need the same version of the engine, and are asked for it; they need no shared disk: a task holds all that it
takes, and the files are written here. What a worker was about when it is killed is given to another.
"""

import logging
import sys
import time
from collections import deque
from concurrent.futures import CancelledError
from typing import Any

from engine.machine import sources
from engine.point import LOOK, Answers, Found, Task, rendered

PATIENCE = 8  # s, to reach a scheduler
AHEAD = 2  # points per thread of the workers that wait there, so that none waits for us


def there(tasks: list[Task], address: str) -> Answers:
    """Answers of the workers, in any order, each once. Raises RuntimeError if no scheduler or no worker answers."""
    if tasks:
        yield None
        with _client(address) as client:
            try:
                yield from _answers(client, tasks)
            except (OSError, CancelledError):
                gone = f"the scheduler at {address} is gone; when it is back, run the same command to go on"
                raise RuntimeError(gone) from None


class Workers:
    """Those workers of a scheduler that have this very engine; of the others it is said, once, that they have not."""

    def __init__(self, client: Any) -> None:
        self.client, self.sources = client, sources()
        self.engines: dict[str, str] = {}  # by address, of all that were asked
        self.unsaid: list[str] = []  # of another engine

    def look(self) -> dict[str, int]:
        """Threads by address, of the workers that are there now and may be given points."""
        threads: dict[str, int] = self.client.nthreads()
        new = [address for address in threads if address not in self.engines]
        self.engines |= self._asked(new) if new else {}
        self.unsaid += [address for address in new if self.engines[address] != self.sources]
        good = {address: n for address, n in threads.items() if self.engines[address] == self.sources}
        if self.unsaid and good:
            print(f"{self._named(self.unsaid)}; start them with the sources of this one", file=sys.stderr)
            self.unsaid = []
        return good

    def refusal(self) -> str:
        """That none has this engine."""
        return f"no worker can be given points; {self._named(list(self.engines))}"

    def _named(self, addresses: list[str]) -> str:
        names = ", ".join(f"{address} ({self.engines[address] or 'none'})" for address in sorted(addresses))
        return f"left out, for they have another engine than this one ({self.sources}): {names}"

    def _asked(self, addresses: list[str]) -> dict[str, str]:
        """The engines of workers; nothing for one that has none, or none that can say."""
        answers = self.client.run(sources, workers=addresses, on_error="return")
        return {a: answers[a] if isinstance(answers.get(a), str) else "" for a in addresses}


def _answers(client: Any, tasks: list[Task]) -> Answers:
    from distributed import wait

    waiting, workers = deque(tasks), Workers(client)
    under_way: dict[Any, tuple[Task, set[str]]] = {}  # who may render it
    without = False
    if not workers.look():
        raise RuntimeError(workers.refusal())
    while True:
        threads = workers.look()
        for future in [f for f, (_, given) in under_way.items() if threads and not given & set(threads)]:
            waiting.appendleft(under_way.pop(future)[0])  # all that it was given to are gone, and others came
            future.cancel()
        room = AHEAD * max(1, sum(threads.values())) - len(under_way)
        for _ in range(min(room, len(waiting)) if threads else 0):
            task = waiting.popleft()
            try:
                told = client.submit(rendered, task.complete(), pure=False, workers=list(threads))
                under_way[told] = task, set(threads)
            except FileNotFoundError as error:  # that was there when all began
                yield task.number, Found(None, {}, str(error))
        if not under_way and not waiting:
            return
        without = _deserted(threads, without)
        try:
            finished = wait(list(under_way), LOOK, "FIRST_COMPLETED").done if under_way else _none()
        except TimeoutError:
            yield None
            continue
        for future in finished:
            yield under_way.pop(future)[0].number, _answer(future)


def _none() -> set[Any]:
    """Nothing, after a while."""
    time.sleep(LOOK)
    raise TimeoutError


def _deserted(threads: dict[str, int], before: bool) -> bool:
    """Whether all workers are gone; that they are is said once."""
    without = not threads
    if without and not before:
        print("all workers are gone; waiting for others (Ctrl-C ends it, the same command goes on)", file=sys.stderr)
    return without


def _client(address: str) -> Any:
    """A connection to a scheduler that has workers. Raises RuntimeError."""
    from distributed import Client

    logging.getLogger("distributed").setLevel(logging.CRITICAL + 1)  # what goes wrong, we say
    logging.getLogger("distributed.client").setLevel(logging.CRITICAL + 1)
    try:
        client = Client(address, timeout=PATIENCE)
    except (OSError, ValueError, TypeError) as error:
        why = str(error).splitlines()[0] if str(error) else type(error).__name__
        raise RuntimeError(f"no scheduler answers at {address} ({why}); start one by: dask scheduler") from None
    try:
        client.wait_for_workers(1, timeout=PATIENCE)
    except TimeoutError:
        client.close()
        right = f"start some by: dask worker {address} --nthreads 1 --nworkers 2"
        raise RuntimeError(f"the scheduler at {address} has no workers; {right}") from None
    return client


def _answer(future: Any) -> Found:
    """What a worker found; what goes wrong around it is the point's failure. Raises CancelledError if the
    scheduler is gone."""
    try:
        found: Found = future.result()
        return found
    except CancelledError:
        raise
    except Exception as error:  # no engine there, or a point that kills one worker after another
        return Found(None, {}, " ".join(f"{type(error).__name__}: {error}".split()))
