"""What a person is told while something takes long."""

import signal
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

PROGRESS_DELAY = 1.5  # s, after which the user is told what takes so long


@contextmanager
def progress_feedback(quiet: bool) -> Iterator[Callable[[float], None]]:
    """Tell the user what takes so long: compiling, before the first samples; then a progress bar,
    on a terminal, once a render has lasted a while. Yields the function to call with the share done."""
    begin = time.perf_counter()
    say = "compiling the kernel (once per machine) …"
    compiling = threading.Timer(PROGRESS_DELAY, lambda: print(say, file=sys.stderr))
    compiling.daemon = True
    compiling.start()
    shown: list[Any] = []
    interrupted: list[int] = []

    def interrupt(number: int, frame: Any) -> None:
        interrupted.append(number)
        raise KeyboardInterrupt

    before = None
    if threading.current_thread() is threading.main_thread():
        before = signal.signal(signal.SIGINT, interrupt)

    def progress(share: float) -> None:
        compiling.cancel()
        if interrupted:  # while compiling, and lost in a callback of the compiler's
            raise KeyboardInterrupt
        late = time.perf_counter() - begin > PROGRESS_DELAY and share < 0.9
        if not shown and late and sys.stderr.isatty() and not quiet:
            from rich.console import Console
            from rich.progress import Progress

            shown.append(Progress(console=Console(stderr=True), transient=True))
            shown[0].start()
            shown[0].add_task("rendering", total=1.0)
        if shown:
            shown[0].update(shown[0].task_ids[0], completed=share)

    try:
        yield progress
    except Exception:
        if interrupted:  # the compiler stumbled over it
            raise KeyboardInterrupt from None
        raise
    finally:
        compiling.cancel()
        if before is not None:
            signal.signal(signal.SIGINT, before)
        if shown:
            shown[0].stop()
