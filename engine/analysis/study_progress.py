"""The progress of a work-precision study, and the time that is left, estimated from the runs that have ended.

A run of a setting that has run before takes as long as then. Others take one time to be built and another for each
stage of a sample, both fitted to the runs up to now, of which the dearest on the ladder comes early; so the references,
which have many times the stages, are foreseen. A kernel that is not there is compiled once, by the first run that needs
it. How long that takes depends on the machine, and may be most of a study, so those runs come first.
"""

import time
from collections.abc import Callable, Hashable, Iterable, Iterator
from contextlib import contextmanager
from typing import NamedTuple

import numpy as np

from engine.patch.accuracy import STAGES, Accuracy

Report = Callable[[float, str, float | None], None]  # the share done, what is done now, and the seconds left
RUNS_SHARE = 0.95  # of a study; the rest is for the comparison with other methods
CHOSEN_STEPS = 16  # tries included
COMPILE_SECONDS = 15.0  # of a kernel, until one was compiled


class StudyRun(NamedTuple):
    """A run of a study, as it is planned.

    setting: runs of one setting take about the same time
    stages:  of a sample; a guess where steps are chosen by error
    kernel:  that has to be compiled before, unless an earlier run has needed it; None if it is there
    """

    setting: Hashable
    stages: int
    is_guess: bool = False
    kernel: Hashable = None

    @property
    def urgency(self) -> tuple[bool, int]:
        """The key to sort runs by, so that the first show the times to come: kernels to compile, then the dearest."""
        return self.kernel is None, -self.stages


def study_run(accuracy: Accuracy, kernel: Hashable = None) -> StudyRun:
    """The run of a setting, which may sleep or not."""
    setting = accuracy.replace(silence=-np.inf)
    return StudyRun(setting, stages_of(accuracy), accuracy.max_error is not None, kernel)


def stages_of(accuracy: Accuracy) -> int:
    """Count the stages of one output sample where contact is possible; guess, where they are chosen by error."""
    steps = accuracy.substeps if accuracy.max_error is None else CHOSEN_STEPS * accuracy.substeps
    return len(STAGES[accuracy.order]) * steps * accuracy.oversample


class StudyProgress:
    """The runs of a study: those over, the present one, and those to come."""

    def __init__(self, report: Report | None) -> None:
        self._report = report
        self._planned: list[StudyRun] = []
        self._over: list[tuple[StudyRun, float]] = []  # with the seconds of each run, without those of compiling
        self._compile_seconds: list[float] = []  # of each kernel that was compiled
        self._phase, self._run = "", StudyRun("", 0)
        self._needs_kernel = False  # the present run, still
        self._spent, self._since = 0.0, 0.0  # s, on the present run up to a time, without compiling

    def plan(self, runs: Iterable[StudyRun]) -> None:
        """Add runs to come."""
        self._planned += runs

    @contextmanager
    def run(self, phase: str, run: StudyRun) -> Iterator[None]:
        """Measure a run, which has been planned."""
        run = self._take(run)
        self._phase, self._run, self._spent = phase, run, 0.0
        self._needs_kernel = run.kernel is not None
        self._since = time.perf_counter()
        self._tell(phase)
        yield
        self._over.append((run, self._spent + time.perf_counter() - self._since))
        self._forget_kernel()

    @contextmanager
    def compiling(self) -> Iterator[None]:
        """Name what the present run waits for, which does not count as its own time."""
        begin = time.perf_counter()
        self._spent += begin - self._since
        self._needs_kernel = True
        self._tell("compiling the kernel, once per machine")
        yield
        self._since = time.perf_counter()
        self._compile_seconds.append(self._since - begin)
        self._forget_kernel()
        self._tell(self._phase)

    def drop(self, runs: Iterable[StudyRun]) -> None:
        """Remove planned runs that are not necessary."""
        for run in runs:
            self._take(run)

    def _take(self, run: StudyRun) -> StudyRun:
        """Remove a run of the same setting from those that are planned, and return it."""
        planned = next(one for one in self._planned if one.setting == run.setting)
        self._planned.remove(planned)
        return planned

    def finish(self, phase: str) -> None:
        """Name what is done after the last run, of which no share is known."""
        self._tell(phase, is_over=True)

    def seconds_left(self) -> float | None:
        """Estimate the time of the present run and of those to come, s; None until the finished runs suffice for an
        estimate."""
        expected = self._expected_seconds()
        if expected is None:
            return None
        kernels = {run.kernel for run in self._planned} - {None, self._run.kernel}
        compiles = (len(kernels) + self._needs_kernel) * self._seconds_of_kernel()
        return compiles + sum(map(expected, self._planned)) + max(0.0, expected(self._run) - self._spent)

    def _seconds_of_kernel(self) -> float:
        """The time that compiling a kernel takes, s: the mean of those up to now."""
        return float(np.mean(self._compile_seconds or [COMPILE_SECONDS]))

    def _expected_seconds(self) -> Callable[[StudyRun], float] | None:
        """The time that a run takes; None until it is known of any."""
        measured = [(run.stages, seconds) for run, seconds in self._over if not run.is_guess]
        stages, seconds = np.array(measured).reshape(-1, 2).T
        if np.unique(stages).size < 2:
            return None
        per_stage, fixed = np.polyfit(stages, seconds, 1, w=1.0 / np.maximum(seconds, 1e-6))
        per_stage, fixed = max(float(per_stage), 0.0), max(float(fixed), 0.0)
        known = {run.setting: seconds for run, seconds in self._over}  # of each setting, the last
        return lambda run: known.get(run.setting, fixed + per_stage * run.stages)

    def _forget_kernel(self) -> None:
        """Take note that the kernel of the present run is there."""
        kernel, self._needs_kernel = self._run.kernel, False
        if kernel is not None:
            self._planned = [run._replace(kernel=None) if run.kernel == kernel else run for run in self._planned]

    def _tell(self, phase: str, is_over: bool = False) -> None:
        if self._report is None:
            return
        left = None if is_over else self.seconds_left()
        spent = self._spent + sum(seconds for _, seconds in self._over) + sum(self._compile_seconds)
        share = 1.0 if is_over else 0.0 if left is None else spent / max(spent + left, 1e-9)
        self._report(RUNS_SHARE * share, phase, left)
