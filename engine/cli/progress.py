"""What a person is told while something takes long: a bar on a terminal, and elsewhere a line every ten seconds."""

import signal
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from typing import Any

PROGRESS_DELAY = 1.5  # s, after which the user is told what takes so long
LINE_INTERVAL = 10.0  # s, between two lines where there is no terminal
BAR_INTERVAL = 0.1  # s, between two looks at what a bar shows
NEARLY_DONE = 0.9  # share after which no bar is begun


@contextmanager
def progress_feedback(task: str) -> Iterator[Callable[[float], None]]:
    """Tell the user on standard error what takes so long. Yields the function to call with the share done, which also
    raises KeyboardInterrupt where a callback of the compiler's has lost one.

    task: what is done, such as "rendering"
    """
    display = ProgressDisplay(task)
    interrupted: list[int] = []

    def interrupt(number: int, frame: Any) -> None:
        interrupted.append(number)
        raise KeyboardInterrupt

    before = None
    if threading.current_thread() is threading.main_thread():
        before = signal.signal(signal.SIGINT, interrupt)

    def progress(share: float) -> None:
        if interrupted:  # while compiling, and lost in a callback of the compiler's
            raise KeyboardInterrupt
        display.update(share)

    display.thread.start()
    try:
        yield progress
    except Exception:
        if interrupted:  # the compiler stumbled over it
            raise KeyboardInterrupt from None
        raise
    finally:
        if before is not None:
            signal.signal(signal.SIGINT, before)
        display.end()


class ProgressDisplay:
    """A thread that shows how far a task is, from PROGRESS_DELAY on, whatever the main thread is busy with."""

    def __init__(self, task: str) -> None:
        self.task, self.begin = task, time.perf_counter()
        self.share: float | None = None  # of the task that is done; None before anything is known of it
        self.first: tuple[float, float] | None = None  # time and share at the first update
        self.over = threading.Event()
        self.has_terminal = threading.current_thread() is threading.main_thread()  # of another, a meter may be there
        self.thread = threading.Thread(target=self._show, daemon=True)

    def update(self, share: float) -> None:
        """Take note of the share that is done."""
        if self.first is None:
            self.first = time.perf_counter(), share
        self.share = share

    def end(self) -> None:
        """Remove what is shown."""
        self.over.set()
        self.thread.join(2.0)  # it waits for nothing but a standard error that nobody reads

    def describe(self) -> str:
        """The task, how far it is, and how long it will take, as one line."""
        if self.share is None:
            return f"{self.stage()}: {time.perf_counter() - self.begin:.0f} s so far"
        left = self.seconds_left()
        return f"{self.task}: {self.share:.0%} done" + ("" if left is None else f", about {left:.0f} s left")

    def stage(self) -> str:
        """What is done at present. Numba is imported only to compile, which comes before the first share."""
        is_compiling = self.share is None and "numba" in sys.modules
        return "compiling the kernel (once per machine)" if is_compiling else self.task

    def seconds_left(self) -> float | None:
        """The time that the rest will take at the mean speed up to now, s; None as long as that is not known."""
        if self.first is None or self.share is None or self.share <= self.first[1]:
            return None
        begin, share = self.first
        return (time.perf_counter() - begin) * (1.0 - self.share) / (self.share - share)

    def _show(self) -> None:
        """Show the progress until the task is over."""
        if self.over.wait(PROGRESS_DELAY) or sys.stderr is None:
            return
        with suppress(OSError, ValueError):  # standard error may be closed meanwhile
            if self.has_terminal and sys.stderr.isatty():
                self._show_bar()
            else:
                self._print_lines()

    def _print_lines(self) -> None:
        """Print a line every ten seconds; and one at once if the kernel is compiled, which takes that long."""
        if self.stage() != self.task:
            print(f"{self.stage()} …", file=sys.stderr, flush=True)
        while not self.over.wait(LINE_INTERVAL):
            print(self.describe(), file=sys.stderr, flush=True)

    def _show_bar(self) -> None:
        """Show a bar, unless the task is nearly done."""
        from rich.console import Console
        from rich.progress import Progress

        if self.share is not None and self.share > NEARLY_DONE:
            return
        with Progress(console=Console(stderr=True), transient=True) as bar:
            number = bar.add_task(self.stage(), total=None)
            while not self.over.wait(BAR_INTERVAL):
                total = None if self.share is None else 1.0
                bar.update(number, description=self.stage(), total=total, completed=self.share or 0.0)
