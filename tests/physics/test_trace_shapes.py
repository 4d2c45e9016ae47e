"""Shapes of strings and sheets in a trace, against closed forms; and what the columns of a trace are."""

import json

import numpy as np
import pytest
from conftest import exit_code

import engine
from engine.offline import shape_snapshots

STRING = {"name": "string", "kind": "string", "length": 0.6, "mass": 3e-3, "frequency": 100.0, "modes": 20}
HEARD = {"body": "string", "at": 0.3, "quantity": "displacement"}


def traced(bodies, pickups, seconds, **more):
    scene = engine.load({"body": bodies, "pickup": pickups, "seconds": seconds} | more)
    return engine.render(scene, trace_shapes=True)


def test_a_string_in_its_first_mode_keeps_the_shape_of_a_sine():
    string = STRING | {"displacement": {"kind": "mode", "number": 1, "amplitude": 1e-3}}
    trace = traced([string], [HEARD], 0.02).trace
    x, t = trace["shape_positions.string"], trace["shape_time"]
    expected = 1e-3 * np.outer(np.cos(2 * np.pi * 100.0 * t), np.sin(np.pi * x))
    np.testing.assert_allclose(trace["shape.string"], expected, rtol=0, atol=1e-12)
    assert len(t) == len(trace["time"]) and x[0] == 0.0 and x[-1] == 1.0


def test_shapes_pass_through_what_is_traced_at_every_sample():
    """Also through contact, and where shapes are far apart; neither sound nor trace knows of them."""
    scene = engine.load("piano_c4")
    rendering, plain = engine.render(scene, 0.3, trace_shapes=True), engine.render(scene, 0.3, trace=True)
    assert (rendering.audio == plain.audio).all()
    for name in ("displacement", "velocity", "compression", "force", "iterations", "total"):
        np.testing.assert_array_equal(rendering.trace[name], plain.trace[name])
    trace = rendering.trace
    every = round(trace["shape_time"][1] * trace["samplerate"])
    assert every > 1 and len(trace["shape_time"]) <= shape_snapshots.MAX_SNAPSHOTS
    at = json.loads(trace["positions"][0])
    shape = [np.interp(at, trace["shape_positions.string"], row) for row in trace["shape.string"]]
    moved = trace["displacement"][::every, 0]
    np.testing.assert_allclose(shape, moved, rtol=0, atol=0.02 * np.abs(moved).max())


def test_a_round_membrane_has_no_corners_and_a_still_rim():
    head = {"name": "head", "kind": "membrane", "radius": 0.16, "density": 0.26, "tension": 3000.0, "modes": 40}
    force = {"kind": "pluck", "body": "head", "at": [0.5, 0.5], "amplitude": 1.0, "duration": 0.003}
    trace = traced([head], [{"body": "head", "at": [0.4, 0.5]}], 0.005, force=[force]).trace
    shape, positions = trace["shape.head"], trace["shape_positions.head"]
    radius = np.hypot(*np.moveaxis(2 * positions - 1, -1, 0))
    assert shape.shape[1:] == (17, 17) and np.isnan(shape[:, radius > 1]).all()
    assert np.isfinite(shape[:, radius <= 1]).all()
    largest = np.abs(shape[:, 8, 8]).max()
    assert largest > 0.0 and np.abs(shape[:, radius == 1]).max() < 1e-9 * largest
    np.testing.assert_allclose(shape, shape.transpose(0, 2, 1), rtol=0, atol=1e-9 * largest)  # struck in the middle


def test_shapes_stay_within_their_memory(monkeypatch):
    monkeypatch.setattr(shape_snapshots, "MAX_NUMBERS", 650)
    trace = traced([STRING], [HEARD], 0.02).trace
    assert trace["shape.string"].shape == (10, 65)


def test_columns_are_named_and_placed():
    trace = engine.render(engine.load("tanpura"), 0.01, trace=True).trace
    scene = engine.load("tanpura")
    assert trace["bodies"].tolist() == [body.name for body in scene.body]
    assert len(trace["contacts"]) == trace["force"].shape[1] == len({*trace["contacts"].tolist()})
    first = json.loads(trace["contact_positions"][0])
    assert len(first) == 2 and 0.0 <= first[0] <= 1.0
    units = dict(trace["units"].tolist())
    assert (units["force"], units["velocity"], units["total"], trace["samplerate"]) == ("N", "m/s", "J", 44_100)


def test_oversampled_traces_say_their_own_rate():
    trace = engine.render(engine.load("bouncing_ball"), 0.01, trace=True, oversample=4).trace
    assert trace["samplerate"] == 4 * 44_100 == pytest.approx(1 / trace["time"][1])


def test_the_command_writes_shapes_beside_the_trace(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    assert exit_code("piano_c4", "--seconds", "0.01", "--trace", "a.npz", "--trace-shapes") == 0
    assert np.load("a.npz")["shape.string"].shape == (441, 65)
    assert exit_code("piano_c4", "--trace-shapes") == 2
    assert "--trace-shapes: requires --trace; give that too" in capsys.readouterr().err
