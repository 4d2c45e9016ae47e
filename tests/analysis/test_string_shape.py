"""The shape of a string over time: what a picture of it shows."""

import numpy as np
import pytest
from conftest import ROOT

import engine
from engine.analysis.string_shape import PERIODS, string_shape


@pytest.mark.hard_for("tanpura")
@pytest.mark.parametrize("patch", ["piano_c4", "tanpura", "marimba"])
def test_a_shape_is_what_a_pickup_hears(patch):
    """In contact and in free flight, at the places of the string where pickups are put."""
    scene = engine.load(ROOT / "patches" / f"{patch}.toml")
    rendering = engine.render(scene, seconds=0.15, trace=True)
    shape = string_shape(scene, rendering)
    assert shape is not None
    assert shape.displacement.shape == (len(shape.time), len(shape.places))
    places = [20, 75, 130]
    pickups = [
        {"body": shape.body, "at": float(shape.places[n]), "quantity": "displacement", "channel": 1 + i}
        for i, n in enumerate(places)
    ]
    document = scene.model_dump(exclude_none=True) | {"pickup": pickups}
    heard = engine.render(engine.Scene.model_validate(document), seconds=0.15).audio
    frames = np.round(shape.time * 44_100).astype(int)
    np.testing.assert_allclose(shape.displacement[:, places], heard[frames], atol=1e-9 * np.abs(heard).max())


def test_it_has_two_periods_of_the_lowest_mode():
    scene = engine.load(ROOT / "patches" / "piano_c4.toml")
    shape = string_shape(scene, engine.render(scene, seconds=0.15, trace=True))
    length = shape.time[-1] - shape.time[0] + shape.time[1] - shape.time[0]
    assert length == pytest.approx(PERIODS / scene.body[0].modal_body(20e3).omega[0] * 2 * np.pi, rel=0.02)


def test_a_scene_without_a_string_has_none():
    scene = engine.load(ROOT / "patches" / "bouncing_ball.toml")
    assert string_shape(scene, engine.render(scene, seconds=0.3, trace=True)) is None
