"""How long a work-precision study will take, as it says while it runs."""

import types

import pytest
from conftest import ROOT

import engine
from engine.analysis import study_progress
from engine.analysis.study_progress import StudyProgress
from engine.analysis.work_precision import measure_work_precision

LADDER = [1, 20, 16, 10, 5, 4, 2, 2, 1, 1]  # stages of a sample, in the order of a study
REFERENCES = [36, 36, 72, 72, 144, 144]


class Clock:
    """A clock that the test moves."""

    def __init__(self, monkeypatch):
        self.now = 100.0
        monkeypatch.setattr(study_progress, "time", types.SimpleNamespace(perf_counter=lambda: self.now))


@pytest.mark.parametrize(("fixed", "per_stage"), [(0.5, 0.02), (10.0, 1e-4), (0.0, 0.3)])
def test_the_estimate_holds_from_the_third_run_on_and_does_not_grow(monkeypatch, fixed, per_stage):
    """Whether building takes the time, or the steps do; kernels that are compiled meanwhile change nothing."""
    clock, reports = Clock(monkeypatch), []
    planned = [*LADDER, *REFERENCES]
    progress = StudyProgress(lambda *report: reports.append((clock.now, *report)), planned)
    compiled = 0.0
    for number, stages in enumerate(planned):
        with progress.run(f"{stages} stages", stages):
            if number in (3, 8):
                with progress.compiling():
                    clock.now += 30.0
                    compiled += 30.0
            clock.now += fixed + per_stage * stages
    end = 100.0 + compiled + sum(fixed + per_stage * stages for stages in planned)
    estimates = [(now, left) for now, _, _, left in reports if left is not None]
    assert len(estimates) >= len(planned) - 2
    compile_to_come = lambda now: compiled - sum(30.0 for n, _, phase, _ in reports if "compiling" in phase and n < now)
    for now, left in estimates:
        assert left == pytest.approx(end - now - compile_to_come(now), abs=0.02 * (end - 100.0))
    assert [left for _, left in estimates] == sorted((left for _, left in estimates), reverse=True)
    shares = [share for _, share, _, _ in reports]
    assert shares == sorted(shares) and shares[-1] > 0.6


def test_references_that_are_not_needed_shorten_it(monkeypatch):
    clock, reports = Clock(monkeypatch), []
    progress = StudyProgress(lambda *report: reports.append(report), [1, 2, 36, 144, 144])
    for stages in (1, 2, 36):
        with progress.run("", stages):
            clock.now += 1.0 + stages
    before = progress.seconds_left()
    progress.drop([144, 144])
    assert progress.seconds_left() < 0.2 * before


@pytest.mark.hard
def test_a_study_names_its_phases(monkeypatch):
    monkeypatch.setenv("FDH_KERNEL", "general")
    phases, shares = [], []

    def report(share, phase, left):
        shares.append(share)
        phases.append(phase)

    measure_work_precision(engine.load(ROOT / "patches" / "bouncing_ball.toml"), seconds=0.02, report=report)
    words = "order 2, 16 ×", "refining the reference: order 6, 4 ×", "timing order 4, 1 ×", "comparing with other"
    assert all(word in "\n".join(phases) for word in words)
    assert phases[0] == "building" and shares[0] == 0.0 and shares[-1] == pytest.approx(0.95)
