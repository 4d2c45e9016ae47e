"""The type of a trace names the arrays that are there: in Python, in a file, and with shapes."""

import typing

import numpy as np
import pytest
from conftest import PATCHES, exit_code

import engine
from engine.offline.trace import TraceArrays

ALWAYS, WITH_SHAPES = TraceArrays.__required_keys__, {"shape_time"}
WITH_FRICTION = TraceArrays.__optional_keys__ - WITH_SHAPES


def test_a_rendering_has_a_trace_of_that_type():
    assert typing.get_type_hints(engine.Rendering)["trace"] == TraceArrays | None


@pytest.mark.parametrize("name", ["piano_c4", "guitar_frets", "buzzing_reed"])
def test_a_trace_has_the_names_of_its_type(name):
    rendering = engine.render(engine.load(name), seconds=0.005, trace=True)
    assert set(rendering.trace) == ALWAYS
    assert {name for name, _ in rendering.trace["units"]} == ALWAYS - {"units", "bodies", "contacts"}


def test_with_friction_there_is_that_of_each_point_too():
    rendering = engine.render(engine.load("bowed_violin"), seconds=0.005, trace=True)
    assert set(rendering.trace) == ALWAYS | WITH_FRICTION
    assert {"slip", "friction", "sticks"} <= {name for name, _ in rendering.trace["units"]}


@pytest.mark.parametrize(("name", "bodies"), [("piano_c4", ["string"]), ("barrier_linear", [])])
def test_with_shapes_there_are_those_of_bodies_too(name, bodies):
    rendering = engine.render(engine.load(name), seconds=0.005, trace_shapes=True)
    of_bodies = {f"{kind}.{body}" for kind in ("shape", "shape_positions") for body in bodies}
    assert set(rendering.trace) == ALWAYS | WITH_SHAPES | of_bodies


FACTS = {"patch", "patch_text", "kernel", "accuracy", "fdh_version"}  # beside the trace


def test_a_file_has_the_same_names(tmp_path):
    patch = next(path for path in PATCHES if path.stem == "bouncing_ball")
    words = ("-o", str(tmp_path / "a.wav"), "--seconds", "0.1", "--trace", str(tmp_path / "a.npz"))
    assert exit_code("render", str(patch), *words) == 0
    assert set(np.load(tmp_path / "a.npz").files) == ALWAYS | FACTS
    assert exit_code("render", str(patch), *words, "--trace-shapes") == 0
    assert set(np.load(tmp_path / "a.npz").files) == ALWAYS | WITH_SHAPES | FACTS


def test_every_name_is_explained():
    assert all(name in TraceArrays.__doc__ for name in ALWAYS | WITH_SHAPES | WITH_FRICTION)


MASSES = [{"name": "a", "kind": "mass", "mass": 0.1, "velocity": 1.0}, {"name": "b", "kind": "mass", "mass": 1.0}]
SPRING = {"body": "a", "on": "b", "stiffness": 1e3}


@pytest.mark.parametrize("shapes", [{}, {"trace_shapes": True}])
@pytest.mark.parametrize("kind", ["mass", "oscillator"])
def test_masses_and_oscillators_are_traced_though_nothing_but_a_spring_joins_them(kind, shapes):
    """The momentum of masses stays; what is heard makes no difference."""
    second = MASSES[1] | ({"kind": "oscillator", "frequency": 3.0} if kind == "oscillator" else {})
    tables = {"body": [MASSES[0], second], "connection": [SPRING]}
    heard = [{"body": "a"}], [{"body": "a"}, {"body": "b", "channel": 2}]
    one, both = (
        engine.render(engine.load(tables | {"pickup": pickups}), 0.2, trace=True, **shapes).trace for pickups in heard
    )
    assert one["positions"].tolist() == ["null", "null"]
    for name in ("displacement", "velocity"):
        np.testing.assert_array_equal(one[name], both[name])
    assert np.abs(one["velocity"][:, 1]).max() > 0.0
    if kind == "mass":
        np.testing.assert_allclose(one["velocity"] @ [0.1, 1.0], 0.1, rtol=1e-12)


@pytest.mark.parametrize("shapes", [{}, {"trace_shapes": True}])
def test_a_body_that_is_not_traced_is_not_a_number(shapes):
    """A string that only a spring joins could be traced anywhere."""
    string = {"name": "string", "kind": "string", "length": 0.6, "mass": 3e-3, "frequency": 100.0, "modes": 5}
    spring = {"body": "a", "on": "string", "on_at": 0.3, "stiffness": 1e3}
    bodies = [string, string | {"name": "heard"}, MASSES[0]]
    scene = engine.load({"body": bodies, "connection": [spring], "pickup": [{"body": "heard", "at": 0.5}]})
    trace = engine.render(scene, 0.02, trace=True, **shapes).trace
    assert trace["positions"].tolist() == ["", "0.5", "null"]
    for name in ("displacement", "velocity"):
        assert np.isnan(trace[name]).all(axis=0).tolist() == [True, False, False]
        assert np.isfinite(trace[name][:, 1:]).all() and trace[name][-1, 2] != 0.0


def test_the_shape_of_a_string_is_drawn_beside_strings_that_are_not_traced():
    from engine.analysis.string_shape import string_shape

    string = {"name": "a", "kind": "string", "length": 0.6, "mass": 3e-3, "frequency": 100.0, "modes": 5}
    bent = string | {"name": "heard", "displacement": {"kind": "triangle", "at": 0.3, "amplitude": 1e-3}}
    scene = engine.load({"body": [string, bent], "pickup": [{"body": "heard", "at": 0.5}]})
    shape = string_shape(scene, engine.render(scene, 0.1, trace=True))
    assert shape is not None and shape.body == "heard"
