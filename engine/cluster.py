"""Points of a sweep rendered by the workers of a Dask scheduler.

Workers need the same version of the engine, and no shared disk: a task holds all that it takes, and the files are
written here. What a worker was about when it is killed is given to another.
"""

import itertools
from typing import Any

from engine.point import Found, Task, rendered
from engine.sweep import LOOK, Answers

PATIENCE = 8  # s, to reach a scheduler
AHEAD = 2  # points per thread of the workers that wait there, so that none waits for us


def there(tasks: list[Task], address: str) -> Answers:
    """Answers of the workers, in any order, each once. Raises RuntimeError if no scheduler or no worker answers."""
    from distributed import wait

    waiting = iter(tasks)
    if not tasks:
        return
    yield None
    with _client(address) as client:
        under_way: dict[Any, int] = {}
        while True:
            room = AHEAD * max(1, sum(client.nthreads().values()))
            for task in itertools.islice(waiting, max(0, room - len(under_way))):
                under_way[client.submit(rendered, task.complete(), pure=False)] = task.number
            if not under_way:
                return
            try:
                finished = wait(list(under_way), LOOK, "FIRST_COMPLETED").done
            except TimeoutError:
                yield None
                continue
            for future in finished:
                yield under_way.pop(future), _answer(future, address)


def _client(address: str) -> Any:
    """A connection to a scheduler that has workers. Raises RuntimeError."""
    from distributed import Client

    try:
        client = Client(address, timeout=PATIENCE, set_as_default=False)
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


def _answer(future: Any, address: str) -> Found:
    """What a worker found; what goes wrong around it is the point's failure. Raises RuntimeError if the scheduler
    is gone."""
    from concurrent.futures import CancelledError

    try:
        found: Found = future.result()
        return found
    except CancelledError:
        raise RuntimeError(f"the scheduler at {address} is gone; run the same command to go on") from None
    except Exception as error:  # no engine there, or a point that kills one worker after another
        return Found(None, {}, " ".join(f"{type(error).__name__}: {error}".split()))
