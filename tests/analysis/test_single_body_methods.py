"""The methods of others on one body at walls, as the tables of docs/accuracy.md have them."""

import itertools
from types import SimpleNamespace

import numpy as np
import pytest

import engine
from bench.rivals import single_body_errors
from bench.rivals.single_body_errors import as_single_body, compare_methods, dop853_with_events, methods_beside
from engine.analysis.work_precision import WorkPrecisionStudy


def between_walls(mass: float, exponent: float, **wall: float) -> engine.Scene:
    """A mass at 2 m/s between two walls, 1 mm away."""
    law = {"body": "b", "exponent": exponent} | wall
    return engine.load(
        {
            "body": [{"name": "b", "kind": "mass", "mass": mass, "velocity": 2.0}],
            "contact": [law | {"side": side, "barrier": at} for side, at in (("above", 1e-3), ("below", -1e-3))],
            "pickup": [{"body": "b", "quantity": "displacement"}],
        }
    )


def study(seconds: float, horizon: float) -> WorkPrecisionStudy:
    """A study without rows, whose reference is of order 6."""
    return WorkPrecisionStudy(seconds, 44_100, [], None, "", horizon, horizon, "order 6, 16 ×")


@pytest.mark.hard
def test_the_error_of_each_method_falls_with_its_step():
    rows = {row.setting: row for row in methods_beside(study(0.05, 0.05), engine.load("repelled_oscillator"))}
    for name, falls in (("Störmer-Verlet", 14), ("implicit midpoint", 14), ("SAV", 1.5)):
        coarse, fine = (rows[f"{name}, {n} ×"].error for n in (16, 64))
        assert coarse / fine > falls
    assert rows["RK4, 64 ×"].error < 1e-6 and rows["DOP853, 1e-10"].error < 1e-5
    assert not any(name.startswith("FDN") for name in rows)  # it has no α = 2
    assert all(row.failed == "" and row.ns_per_sample > 0.0 for row in rows.values())


@pytest.mark.hard
def test_a_method_that_blows_up_stays_in_the_list():
    scene = between_walls(1.0, 1.0, stiffness=1e13)
    fine = engine.render(scene, seconds=0.02, order=6, substeps=16).audio[:, 0]
    failed = {row.setting: row.failed for row in compare_methods(scene, fine, 44_100, 882)}
    assert failed["RK4, 1 ×"] == failed["Störmer-Verlet, 1 ×"] == "blows up"


def test_there_are_no_other_methods_for_more_than_one_body():
    assert methods_beside(study(0.5, 0.5), engine.load("piano_c4")) == []


def test_another_method_ends_when_its_time_is_up(monkeypatch):
    """At whichever evaluation the time is up."""
    case = as_single_body(between_walls(1.0, 1.5, stiffness=1e6))
    assert case is not None, "one lossless mass between two walls is what the other methods can do"
    for calls in range(2, 60):
        clock = itertools.count()
        monkeypatch.setattr(single_body_errors, "SCIPY_TIME_LIMIT", float(calls))
        fake = SimpleNamespace(perf_counter=lambda clock=clock: float(next(clock)))
        monkeypatch.setattr(single_body_errors, "time", fake)
        result = dop853_with_events(case, np.zeros(100), 44_100, 1e-7)
        assert "stopped" in result.failed
