"""How long a work-precision study will take, as it says while it runs."""

import types

import pytest
from conftest import ROOT

import engine
from engine.analysis import study_progress
from engine.analysis.study_progress import StudyProgress, StudyRun
from engine.analysis.work_precision import measure_work_precision

LADDER = [1, 20, 16, 10, 5, 4, 2, 2, 1, 1]  # stages of a sample, in the order of a study
REFERENCES = [36, 36, 72, 72, 144, 144]


class Clock:
    """A clock that the test moves."""

    def __init__(self, monkeypatch):
        self.now = 100.0
        monkeypatch.setattr(study_progress, "time", types.SimpleNamespace(perf_counter=lambda: self.now))


def runs(stages, kernel=None):
    """Planned runs of so many stages, each of a setting of its own; their kernel has to be compiled."""
    return [StudyRun((n, count), count, kernel=kernel) for n, count in enumerate(stages)]


@pytest.mark.parametrize(("fixed", "per_stage"), [(0.5, 0.02), (10.0, 1e-4), (0.0, 0.3)])
def test_the_estimate_holds_from_the_third_run_on_and_does_not_grow(monkeypatch, fixed, per_stage):
    """Whether building takes the time, or the steps do."""
    clock, reports = Clock(monkeypatch), []
    planned = runs([*LADDER, *REFERENCES])
    progress = StudyProgress(lambda *report: reports.append((clock.now, *report)))
    progress.plan(planned)
    for run in planned:
        with progress.run(f"{run.stages} stages", run):
            clock.now += fixed + per_stage * run.stages
    end = clock.now
    estimates = [(now, left) for now, _, _, left in reports if left is not None]
    assert len(estimates) >= len(planned) - 2
    for now, left in estimates:
        assert left == pytest.approx(end - now, abs=0.02 * (end - 100.0))
    assert [left for _, left in estimates] == sorted((left for _, left in estimates), reverse=True)
    shares = [share for _, share, _, _ in reports]
    assert shares == sorted(shares) and shares[-1] > 0.6


@pytest.mark.parametrize("seconds", [8.0, 15.0, 29.0])
def test_kernels_that_have_to_be_compiled_count_from_the_beginning(monkeypatch, seconds):
    """Each once, also those of runs that are to come long after the fast ones; of a kernel that is there, nothing."""
    clock, reports = Clock(monkeypatch), []
    planned = [*runs([1, 20, 16, 10]), *runs([9, 1], kernel="refined"), *runs([4, 4, 8, 8]), *runs([2], "refined")]
    planned = [run._replace(setting=n) for n, run in enumerate(planned)] + runs([3, 6], "another")
    progress = StudyProgress(lambda *report: reports.append((clock.now, *report)))
    progress.plan(planned)
    compiled = {None}
    for run in planned:
        with progress.run("", run):
            if run.kernel not in compiled:
                compiled.add(run.kernel)
                with progress.compiling():
                    clock.now += seconds
            clock.now += 0.01 + 1e-3 * run.stages
    estimates = [(clock.now - now, left) for now, _, _, left in reports if left is not None]
    assert len(estimates) > len(planned)
    for rest, left in estimates[:-1]:
        assert 0.5 < (left + 0.01) / (rest + 0.01) < 2.0


def test_a_setting_that_ran_before_takes_as_long_again(monkeypatch):
    """Whatever its stages were taken for: those of steps that are chosen by error are a guess."""
    clock = Clock(monkeypatch)
    progress = StudyProgress(None)
    progress.plan([*runs([1, 20]), *4 * [StudyRun("chosen", 16, True)], *runs([2])])
    for run, seconds in zip(runs([1, 20]), (1.1, 3.0), strict=True):
        with progress.run("", run):
            clock.now += seconds
    with progress.run("", StudyRun("chosen", 16, True)):
        clock.now += 40.0
    with progress.run("", StudyRun("chosen", 16, True)):
        assert progress.seconds_left() == pytest.approx(3 * 40.0 + 1.2)


def test_references_that_are_not_needed_shorten_it(monkeypatch):
    clock, reports = Clock(monkeypatch), []
    progress = StudyProgress(lambda *report: reports.append(report))
    planned = runs([1, 2, 36, 144, 144])
    progress.plan(planned)
    for run in planned[:3]:
        with progress.run("", run):
            clock.now += 1.0 + run.stages
    before = progress.seconds_left()
    progress.drop(planned[3:])
    assert progress.seconds_left() < 0.2 * before


@pytest.mark.hard
def test_a_study_names_its_phases(monkeypatch):
    phases, shares = [], []

    def report(share, phase, left):
        shares.append(share)
        phases.append(phase)

    measure_work_precision(engine.load(ROOT / "patches" / "bouncing_ball.toml"), seconds=0.02, report=report)
    words = "order 2, 16 ×", "refining the reference: order 6, 4 ×", "timing order 4, 1 ×", "comparing errors"
    assert all(word in "\n".join(phases) for word in words)
    assert phases[0] == "building" and shares[0] == 0.0 and shares[-1] == pytest.approx(0.95)
