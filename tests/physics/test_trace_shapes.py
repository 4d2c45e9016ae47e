"""Shapes of strings and sheets in a trace, against closed forms; and what the columns of a trace are."""

import json

import numpy as np
import pytest
from conftest import exit_code

import engine
from engine.assembly.build import build
from engine.assembly.scored_changes import scored_tables
from engine.bodies import BODIES
from engine.kernel.data.effects import STRETCHING
from engine.offline import shape_snapshots
from engine.offline.large_motion import LargeMotion, MotionRecord
from engine.offline.shape_snapshots import ShapeSnapshots
from engine.offline.simulation import Simulation
from engine.offline.stretching_record import StretchingRecord
from engine.offline.trace import allocate_trace, trace_rows

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


@pytest.mark.hard
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
    head = {"name": "head", "kind": "membrane", "radius": 0.16, "area_density": 0.26, "tension": 3000.0, "modes": 40}
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


# --- every recorder of every body


BEND, SHALLOW = {"kind": "triangle", "at": 0.3, "amplitude": 3e-3}, {"kind": "mode", "number": 1, "amplitude": 4e-4}
PLAIN = {"kind": "string", "length": 0.6, "mass": 3e-3, "frequency": 100.0, "modes": 8, "displacement": BEND}
SLACK = {"kind": "string", "length": 0.65, "linear_density": 4e-4, "tension": 72.0, "modes": 8, "displacement": BEND}
SLACK |= {"axial_stiffness": 1e4}
HEAD = {"kind": "membrane", "radius": 0.16, "area_density": 0.26, "tension": 3000.0, "modes": 12}
PANEL = {"kind": "plate", "size": [0.3, 0.2], "thickness": 1e-3, "young": 2e11, "area_density": 7.8, "modes": 12}
SHELL = {"kind": "shell", "radius": 0.16, "length": 0.13, "thickness": 1e-3, "density": 7850.0, "young": 2e11}
BODIES_OF_KIND = {  # and those that stretch
    "mass": {"kind": "mass", "mass": 0.02},
    "oscillator": {"kind": "oscillator", "mass": 0.02, "frequency": 300.0, "displacement": 1e-4},
    "string": PLAIN,
    "string in two directions": PLAIN | {"polarisations": 2, "polarisation_detuning": 2.0},
    "string that stretches": SLACK,
    "string in two directions that stretches": SLACK | {"polarisations": 2},
    "bar": {"kind": "bar", "length": 0.3, "mass": 0.1, "frequency": 300.0, "modes": 5},
    "membrane": HEAD,
    "membrane that stretches": HEAD | {"stretching_stiffness": 1.4e6, "displacement": SHALLOW},
    "plate": PANEL,
    "plate that stretches": PANEL | {"stretching": True, "displacement": SHALLOW},
    "soundboard": {"kind": "soundboard", "size": [0.5, 0.4], "thickness": 3e-3, "modes": 12},
    "shell": SHELL | {"modes": 12},
    "air": {"kind": "air", "size": [0.3, 0.2, 0.1], "hole": {"radius": 0.03}},
    "tube": {"kind": "tube", "length": 0.6, "radius": 0.01, "modes": 8},
    "modes": {"kind": "modes", "frequency": [200.0, 310.0], "sigma": [5.0, 9.0], "points": {"tip": [4.0, -3.0]}},
}
PLACES = {"string": 0.4, "bar": 0.4, "modes": "tip", "air": "hole", "tube": 1.0, "mass": None, "oscillator": None}
FRAMES, BLOCKS = 400, (64, 1, 150, 185)
RECORDERS = [
    {name for n, name in enumerate(("trace", "shapes", "energies", "stretching", "motion")) if number >> n & 1}
    for number in range(1, 32)
]


def scene_of(*names, **more):
    """The bodies of these names: each is struck by a hammer, pushed by a force, and holds a mass on a spring. Air is
    moved by a plate."""
    tables = {"body": [], "contact": [], "connection": [], "force": [], "pickup": []}
    for n, name in enumerate(names):
        body, struck = BODIES_OF_KIND[name] | {"name": f"body_{n}"}, f"body_{n}"
        place = PLACES.get(body["kind"], [0.4, 0.45])
        tables["body"].append(body)
        is_heard_as_a_whole = body["kind"] in ("mass", "oscillator", "tube")
        tables["pickup"].append({"body": struck} | ({} if is_heard_as_a_whole else {"at": place}))
        if body["kind"] == "air":
            struck, place = f"plate_{n}", [0.4, 0.45]
            tables["body"].append(PANEL | {"name": struck})
            tables["connection"].append({"kind": "air", "body": struck, "on": f"body_{n}"})
        at, on_at = ({}, {}) if place is None else ({"at": place}, {"on_at": place})
        hammer = {"name": f"hammer_{n}", "kind": "mass", "mass": 5e-3, "velocity": 2.0, "displacement": -5e-3}
        tables["body"] += [hammer, {"name": f"mass_{n}", "kind": "mass", "mass": 0.01}]
        tables["contact"].append({"body": f"hammer_{n}", "on": struck, "stiffness": 1e6, "exponent": 2.0} | on_at)
        tables["connection"].append({"body": f"mass_{n}", "on": struck, "stiffness": 1e3} | on_at)
        tables["force"].append({"body": struck, "kind": "pulse", "amplitude": 1.0, "duration": 2e-3} | at)
    return engine.Scene.model_validate(tables | more)


def record(scene, recorders, **accuracy):
    """Render a scene with these recorders around its simulation, in blocks of several lengths; the audio."""
    used = scene.accuracy.replace(**accuracy)
    model, state, layout = built = build(scene, 44_100, used)
    tables = scored_tables(scene, built, accuracy=used)
    renderer = simulation = Simulation(model, state, measure_energy="energies" in recorders, tables=tables)
    trace = allocate_trace(model, FRAMES) if recorders & {"trace", "shapes"} else None
    if "shapes" in recorders:
        renderer = ShapeSnapshots(simulation, layout, FRAMES)
        assert renderer.every > 1 or not renderer.shapes
    if "motion" in recorders:
        renderer = MotionRecord(renderer, LargeMotion(model, state, layout))
    if "stretching" in recorders and model.effects & STRETCHING:
        renderer = StretchingRecord(renderer, state, layout, 256)
    audio, begin = np.zeros((FRAMES, scene.channels)), 0
    for count in (0, *BLOCKS):
        rows = None if trace is None else trace_rows(trace, begin, begin + count)
        renderer.render_block(audio[begin : begin + count], rows)
        begin += count
    assert np.isfinite(audio).all() and np.abs(audio).max(axis=0).all()
    return audio


def assert_alike(scene, monkeypatch, recorders=RECORDERS, **accuracy):
    """Combinations of recorders leave the samples as they are."""
    monkeypatch.setattr(shape_snapshots, "MAX_SNAPSHOTS", 150)  # between them, blocks of the bodies alone
    plain = record(scene, set(), **accuracy)
    assert [names for names in recorders if not np.array_equal(record(scene, names, **accuracy), plain)] == []


@pytest.mark.slow_but_each(3)
@pytest.mark.hard_but("mass", "modes")
@pytest.mark.parametrize("name", BODIES_OF_KIND)
def test_recorders_leave_the_samples_of_every_kind_of_body_as_they_are(name, monkeypatch):
    assert_alike(scene_of(name), monkeypatch)


def test_every_kind_of_body_is_recorded():
    assert {body["kind"] for body in BODIES_OF_KIND.values()} == set(BODIES)


FINER = [{"substeps": 3}, {"order": 4}, {"max_error": 1e-2}, {"least_detuning": 0.0}, {"silence": -40.0}]


@pytest.mark.slow_but_each(4)
@pytest.mark.hard
@pytest.mark.parametrize("accuracy", [{}, *FINER])
def test_recorders_leave_the_samples_of_bodies_of_all_kinds_together_as_they_are(accuracy, monkeypatch):
    one_or_all = [names for names in RECORDERS if len(names) in (1, len(RECORDERS[-1]))]
    assert_alike(scene_of(*BODIES_OF_KIND), monkeypatch, one_or_all, **accuracy)


@pytest.mark.hard_for(
    "air",
    "membrane that stretches",
    "plate that stretches",
    "soundboard",
    "string",
    "string in two directions",
    "string that stretches",
    "string in two directions that stretches",
    "membrane",
    "plate",
    "shell",
    "bar",
)
@pytest.mark.parametrize("name", BODIES_OF_KIND)
def test_renderings_with_a_trace_have_the_same_samples(name):
    """With all that belongs to a rendering: warnings, statistics, the filter of an oversampled one."""
    scene = scene_of(name)
    for more in ({}, {"oversample": 2}):
        plain = engine.render(scene, 0.02, **more)
        for kind in ("trace", "trace_shapes"):
            with_trace = engine.render(scene, 0.02, **{kind: True}, **more)
            assert np.array_equal(with_trace.audio, plain.audio)
            assert with_trace.stats.warnings == plain.stats.warnings


CHANGES = [(SLACK, "tension", 90.0), (SLACK, "linear_density", 6e-4), (SLACK, "axial_stiffness", 1e3)]


@pytest.mark.hard
@pytest.mark.parametrize(
    ("string", "parameter", "value"), [*CHANGES, (PLAIN, "frequency", 130.0), (PLAIN, "mass", 2e-3)]
)
@pytest.mark.parametrize("duration", [0.0, 0.01])
def test_shapes_follow_what_the_score_changes(string, parameter, value, duration, monkeypatch):
    """So do the samples: tables are exchanged under snapshots as without them. The density scales the mode shapes."""
    event = {"kind": "change", "parameter": f"body.string.{parameter}", "time": 0.004, "value": value}
    tables = {"body": [string | {"name": "string"}], "event": [event | {"duration": duration}]}
    scene = engine.load(tables | {"pickup": [{"body": "string", "at": 0.25}]})
    assert_alike(scene, monkeypatch)
    monkeypatch.undo()
    for oversample in (1, 2):
        plain = engine.render(scene, 0.02, trace=True, oversample=oversample)
        rendering = engine.render(scene, 0.02, trace_shapes=True, oversample=oversample)
        assert np.array_equal(rendering.audio, plain.audio)
        trace = rendering.trace
        np.testing.assert_allclose(trace["shape.string"][:, 16], trace["displacement"][:, 0], rtol=0, atol=1e-15)
    without = engine.render(scene.model_copy(update={"event": []}), 0.02)
    assert not np.array_equal(without.audio, plain.audio)
