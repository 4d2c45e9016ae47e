"""The progress of a work-precision study, and the time that is left, estimated from the runs that have ended.

A run takes one time to be built and another for each stage of a sample. Both are fitted to the runs up to now, of which
the dearest on the ladder comes early; so the references, which have many times the stages, are foreseen. What compiling
takes does not count.
"""

import time
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager

import numpy as np

from engine.patch.accuracy import STAGES, Accuracy

Report = Callable[[float, str, float | None], None]  # the share done, what is done now, and the seconds left
RUNS_SHARE = 0.95  # of a study; the rest is for the comparison with other methods
CHOSEN_STEPS = 16  # tries included


def stages_of(accuracy: Accuracy) -> int:
    """Count the stages of one output sample where contact is possible; guess, where they are chosen by error."""
    steps = accuracy.substeps if accuracy.max_error is None else CHOSEN_STEPS * accuracy.substeps
    return len(STAGES[accuracy.order]) * steps * accuracy.oversample


class StudyProgress:
    """The runs of a study: those over, the present one, and those to come."""

    def __init__(self, report: Report | None, planned: Iterable[int]) -> None:
        """planned: the stages of a sample, of each run to come"""
        self._report, self._planned = report, list(planned)
        self._over: list[tuple[int, float]] = []  # stages and seconds of each run
        self._phase, self._stages = "", 0
        self._spent, self._since = 0.0, 0.0  # s, on the present run up to a time

    @contextmanager
    def run(self, phase: str, stages: int) -> Iterator[None]:
        """Measure a run, which has been planned."""
        self._phase, self._stages, self._spent = phase, stages, 0.0
        self._planned.remove(stages)
        self._since = time.perf_counter()
        self._tell(phase)
        yield
        self._over.append((stages, self._spent + time.perf_counter() - self._since))

    @contextmanager
    def compiling(self) -> Iterator[None]:
        """Name what the present run waits for, and do not count it."""
        self._spent += time.perf_counter() - self._since
        self._tell("compiling the kernel, once per machine")
        yield
        self._since = time.perf_counter()
        self._tell(self._phase)

    def drop(self, stages: Iterable[int]) -> None:
        """Remove planned runs that are not necessary."""
        for number in stages:
            self._planned.remove(number)

    def finish(self, phase: str) -> None:
        """Name what is done after the last run, of which no share is known."""
        self._tell(phase, is_over=True)

    def seconds_left(self) -> float | None:
        """Estimate the time of the present run and of those to come, s; None until the finished runs suffice for an
        estimate."""
        stages, seconds = np.array(self._over).reshape(-1, 2).T
        if np.unique(stages).size < 2:
            return None
        per_stage, fixed = np.polyfit(stages, seconds, 1, w=1.0 / np.maximum(seconds, 1e-6))
        per_stage, fixed = max(per_stage, 0.0), max(fixed, 0.0)
        to_come = fixed * len(self._planned) + per_stage * sum(self._planned)
        return float(to_come + max(0.0, fixed + per_stage * self._stages - self._spent))

    def _tell(self, phase: str, is_over: bool = False) -> None:
        if self._report is None:
            return
        left = None if is_over else self.seconds_left()
        spent = self._spent + sum(seconds for _, seconds in self._over)
        share = 1.0 if is_over else 0.0 if left is None else spent / max(spent + left, 1e-9)
        self._report(RUNS_SHARE * share, phase, left)
