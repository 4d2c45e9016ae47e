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


def test_a_file_has_the_same_names(tmp_path):
    patch = next(path for path in PATCHES if path.stem == "bouncing_ball")
    words = ("-o", str(tmp_path / "a.wav"), "--seconds", "0.1", "--trace", str(tmp_path / "a.npz"))
    assert exit_code("render", str(patch), *words) == 0
    assert set(np.load(tmp_path / "a.npz").files) == ALWAYS
    assert exit_code("render", str(patch), *words, "--trace-shapes") == 0
    assert set(np.load(tmp_path / "a.npz").files) == ALWAYS | WITH_SHAPES


def test_every_name_is_explained():
    assert all(name in TraceArrays.__doc__ for name in ALWAYS | WITH_SHAPES | WITH_FRICTION)
