"""Points of a sweep rendered by the workers of a Dask scheduler.

Workers need the same version of the engine, and no shared disk: a task holds all that it takes, and the files are
written here. What a worker was about when it is killed is given to another.
"""

import itertools
import logging
import sys
from concurrent.futures import CancelledError
from typing import Any

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


def _answers(client: Any, tasks: list[Task]) -> Answers:
    from distributed import wait

    waiting = iter(tasks)
    under_way: dict[Any, int] = {}
    without = False
    while True:
        room = AHEAD * max(1, sum(client.nthreads().values()))
        for task in itertools.islice(waiting, max(0, room - len(under_way))):
            try:
                under_way[client.submit(rendered, task.complete(), pure=False)] = task.number
            except FileNotFoundError as error:  # that was there when all began
                yield task.number, Found(None, {}, str(error))
        if not under_way:
            return
        try:
            finished = wait(list(under_way), LOOK, "FIRST_COMPLETED").done
        except TimeoutError:
            without = _deserted(client, without)
            yield None
            continue
        for future in finished:
            yield under_way.pop(future), _answer(future)


def _deserted(client: Any, before: bool) -> bool:
    """Whether all workers are gone; that they are is said once."""
    without = not client.nthreads()
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
