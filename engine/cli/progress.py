"""Progress of long tasks: the time that a task will take, as soon as it is known; then a bar on a terminal, or
elsewhere a line every ten seconds."""

import signal
import sys
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from typing import Any

PROGRESS_DELAY = 1.5  # s, after which progress is shown
LINE_INTERVAL = 10.0  # s, between two lines where there is no terminal
BAR_INTERVAL = 0.1  # s, between two looks at how far a task is
NEARLY_DONE = 0.9  # share after which no bar is begun
LONG = 10.0  # s that a task will take, from which on that is printed first …
MEASURED = 0.5  # s, … as soon as its speed was measured for so long


@contextmanager
def progress_feedback(task: str, size: str = "") -> Iterator["Progress"]:
    """Tell the user on standard error what takes so long. Yields what is to be called with the share done.

    task: what is done, such as "rendering"
    size: what makes it long, if anything does, and has to be built first, such as "226 strings and 2 plates"
    """
    progress, before = Progress(task, size), None
    if threading.current_thread() is threading.main_thread():
        before = signal.signal(signal.SIGINT, progress.interrupt)
    progress.thread.start()
    try:
        yield progress
    except Exception:
        if progress.is_interrupted:  # the compiler stumbled over it
            raise KeyboardInterrupt from None
        raise
    finally:
        if before is not None:
            signal.signal(signal.SIGINT, before)
        progress.end()


class Progress:
    """Progress of a task. A thread shows it, from PROGRESS_DELAY on, whatever the main thread is busy with."""

    def __init__(self, task: str, size: str = "") -> None:
        self.task, self.size, self.begin = task, size, time.perf_counter()
        self.share: float | None = None  # of the task that is done; None before anything is known of it
        self.phase = ""
        self.first: tuple[float, float] | None = None  # time and share at the first call
        self.end_expected: float | None = None  # time, if the last call said
        self.says_rest = False  # some call said, so that the mean speed tells nothing
        self.is_announced = False  # how long it will take
        self.is_interrupted = False  # by Ctrl-C
        self.over = threading.Event()
        self.has_terminal = threading.current_thread() is threading.main_thread()  # of another, a meter may be there
        self.thread = threading.Thread(target=self._show, daemon=True)

    def __call__(self, share: float, phase: str = "", left: float | None = None) -> None:
        """Take note of the share that is done, of what is done now, and of the seconds that the rest will take, where
        they are not to be found from the share. Raises KeyboardInterrupt where a callback of the compiler's has lost
        one."""
        if self.is_interrupted:
            raise KeyboardInterrupt
        now = time.perf_counter()
        if self.first is None:
            self.first = now, share
        self.share, self.phase = share, phase
        self.end_expected = None if left is None else now + left
        self.says_rest |= left is not None

    def interrupt(self, number: int, frame: Any) -> None:
        """Handle Ctrl-C."""
        self.is_interrupted = True
        raise KeyboardInterrupt

    def end(self) -> None:
        """Remove what is shown."""
        self.over.set()
        self.thread.join(2.0)  # it waits for nothing but a standard error that nobody reads

    def describe(self) -> str:
        """The task, how far it is, and how long it will take, as one line."""
        if self.share is None:
            return f"{self.stage()}: {time.perf_counter() - self.begin:.0f} s so far"
        phase = f" ({self.phase})" if self.phase else ""
        return f"{self.task}: {self.share:.0%} done{phase}{self.describe_rest()}"

    def describe_rest(self) -> str:
        """Return the time left, after a comma; "" until it is known."""
        left = self.seconds_left()
        return "" if left is None else f", {format_duration(left)} left"

    def stage(self) -> str:
        """Name the present stage of the task. Numba is imported only to compile, which comes before the first share."""
        if self.share is not None:
            return f"{self.task}: {self.phase}" if self.phase else self.task
        from engine.compiler.special_kernels import is_compiling

        if is_compiling():
            return "compiling a special kernel (once per machine)"
        if "numba" in sys.modules:
            return "compiling the kernel (once per machine)"
        return f"building {self.size}" if self.size else self.task

    def seconds_left(self) -> float | None:
        """The time that the rest will take, s: as the last update said, or at the mean speed up to now. None as long as
        that is not known, or if it is over."""
        now = time.perf_counter()
        if self.end_expected is not None:
            return self.end_expected - now if self.end_expected > now else None
        if self.says_rest or self.first is None or self.share is None or self.share <= self.first[1]:
            return None
        begin, share = self.first
        return (now - begin) * (1.0 - self.share) / (self.share - share)

    def announcement(self) -> str | None:
        """Return the time that a long task will take, once it is known; None before, if the task is short, or if this
        was returned already."""
        if self.is_announced or self.first is None or time.perf_counter() - self.first[0] < MEASURED:
            return None
        left = self.seconds_left()
        if left is None or left < LONG:
            return None
        self.is_announced = True
        return f"{self.size or self.task}: {format_duration(left)}"

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
        """Print a line every ten seconds; and one at once if something large is built or the kernel is compiled, which
        takes that long, and one as soon as it is known how long the task will take."""
        if self.share is None and self.stage() != self.task:
            print(f"{self.stage()} …", file=sys.stderr, flush=True)
        due = time.perf_counter() + LINE_INTERVAL
        while not self.over.wait(min(BAR_INTERVAL, LINE_INTERVAL)):
            line = self.announcement()
            if line is None and time.perf_counter() >= due:
                line = self.describe()
            if line is not None:
                print(line, file=sys.stderr, flush=True)
                due = time.perf_counter() + LINE_INTERVAL

    def _show_bar(self) -> None:
        """Show a bar, unless the task is nearly done."""
        from rich.console import Console
        from rich.progress import BarColumn, TaskProgressColumn, TextColumn
        from rich.progress import Progress as ProgressBar

        if self.share is not None and self.share > NEARLY_DONE:
            return
        rest = TextColumn("{task.fields[rest]}")
        columns = TextColumn("{task.description}"), BarColumn(), TaskProgressColumn(), rest
        with ProgressBar(*columns, console=Console(stderr=True), transient=True) as bar:
            number = bar.add_task(self.stage(), total=None, rest="")
            while not self.over.wait(BAR_INTERVAL):
                if line := self.announcement():
                    bar.console.print(line, highlight=False)
                total = None if self.share is None else 1.0
                rest_now = self.describe_rest().lstrip(", ")
                bar.update(number, description=self.stage(), total=total, completed=self.share or 0.0, rest=rest_now)


def format_duration(seconds: float) -> str:
    """A time as one says it, such as about 40 s, about 3 min or about 2 h."""
    if seconds < 55.0:
        return f"about {seconds:.0f} s"
    return f"about {seconds / 60:.0f} min" if seconds < 5400.0 else f"about {seconds / 3600:.0f} h"
