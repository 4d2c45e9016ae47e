"""Sweeps as labelled data sets: what they hold is what single renders give, at the values they are labelled with."""

from importlib.util import find_spec

import numpy as np
import pytest
from sweeps import GRID, MARBLE, MASS, SECONDS, STIFFNESS, swept

import engine
from engine.analysis.features import features

pytestmark = pytest.mark.skipif(find_spec("xarray") is None, reason="needs xarray")  # which takes a second to import
SCENE = engine.load(MARBLE)


@pytest.fixture(scope="module")
def found(tmp_path_factory):
    folder = tmp_path_factory.mktemp("sweep")
    return engine.run_sweep(SCENE, GRID, folder, sounds=True, seconds=SECONDS), folder


@pytest.mark.hard
def test_each_point_is_the_render_at_its_values(found):
    point = found[0].sel({STIFFNESS: 1e9, MASS: 0.004})
    rendering = engine.render(SCENE.replace({STIFFNESS: 1e9, MASS: 0.004}), SECONDS)
    expected = features(rendering.audio, rendering.samplerate)
    for name in ("peak", "rms", "centroid_hz"):
        assert float(point[name]) == pytest.approx(expected[name], rel=1e-6)
    np.testing.assert_allclose(point.audio, rendering.audio, rtol=0, atol=1e-6 * rendering.stats.peak)
    assert float(point.energy_error) == pytest.approx(rendering.stats.energy.error_max, rel=1e-6)


def test_values_and_measures_have_units(found):
    dataset = found[0]
    assert dict(dataset.sizes) == {STIFFNESS: 3, MASS: 2, "frame": round(SECONDS * 44_100), "channel": SCENE.channels}
    assert dataset[MASS].attrs["units"] == "kg" and dataset[STIFFNESS].values.tolist() == [1e8, 1e9, 1e10]
    assert (dataset.t60_s.attrs["units"], dataset.energy_error.attrs["units"]) == ("s", "1")
    assert dataset.time.values[-1] == pytest.approx(SECONDS - 1 / 44_100)


@pytest.mark.hard
def test_a_folder_is_read_again_and_what_is_there_is_not_rendered_again(found, monkeypatch):
    dataset, folder = found
    assert engine.read_sweep(folder, SCENE, sounds=True).identical(dataset)
    monkeypatch.setattr("engine.api.sweeping.render_task", lambda task: pytest.fail("it was rendered again"))
    assert engine.run_sweep(SCENE, GRID, folder, seconds=SECONDS).identical(dataset.drop_vars(["audio", "time"]))


def test_a_sweep_that_was_stopped_has_nan_where_nothing_was_rendered(tmp_path):
    swept(tmp_path, f"{STIFFNESS}=1e8,1e9", f"{MASS}=0.002,0.004", most=3)
    dataset = engine.read_sweep(tmp_path)
    assert dict(dataset.sizes) == {STIFFNESS: 2, MASS: 2}
    assert np.isnan(dataset.peak).sum() == 1 and (dataset.status == "done").sum() == 3


def test_points_at_random_lie_along_one_dimension(found, tmp_path):
    rows = (found[1] / "index.csv").read_text("utf-8").splitlines()
    few = [rows[0], *(row for n, row in enumerate(rows[1:]) if n in (0, 3))]  # two of the six: no grid
    (tmp_path / "index.csv").write_text("\n".join(few) + "\n", "utf-8")
    dataset = engine.read_sweep(tmp_path)
    assert dict(dataset.sizes) == {"point": 2} and dataset[MASS].dims == ("point",)
    assert dataset[STIFFNESS].values.tolist() == [1e8, 1e9]


def test_a_point_that_fails_is_nan_and_says_why():
    path = "body.oscillator.frequency"
    dataset = engine.run_sweep(engine.load("repelled_oscillator"), {path: [440.0, 30_000.0]}, seconds=SECONDS)
    assert dataset.status.values[0] == "done" and "30000" in dataset.status.values[1]
    assert np.isfinite(dataset.peak.values[0]) and np.isnan(dataset.peak.values[1])
    assert "file" not in dataset, "its sounds are kept nowhere"


@pytest.mark.parametrize(
    ("vary", "settings", "kind", "says"),
    [
        ({"contact.glas.loss": [0.1]}, {}, engine.PatchError, 'did you mean "contact.glass.loss"?'),
        ({MASS: [-1.0, 1.0]}, {}, engine.PatchError, "out of range"),
        ({MASS: "1..2"}, {}, engine.PatchError, "does not say how many"),
        ({MASS: []}, {}, engine.PatchError, "no values; give at least one"),
        ({MASS: 3}, {}, TypeError, "3 is not a list of values"),
        ([MASS], {}, TypeError, "not a dict of values by their paths"),
        ({MASS: [0.1]}, {"ordr": 4}, TypeError, 'did you mean "order"?'),
        ({MASS: [0.1]}, {"cores": "all"}, TypeError, "cores = 'all' is not a whole number"),
    ],
)
def test_what_cannot_be_swept_is_refused_with_the_remedy(vary, settings, kind, says):
    with pytest.raises(kind) as refused:
        engine.run_sweep(SCENE, vary, **settings)
    assert says in str(refused.value)


def test_what_cannot_be_read_is_refused_with_the_remedy(found, tmp_path, monkeypatch):
    with pytest.raises(ValueError, match="holds no sweep; give a folder"):
        engine.read_sweep(tmp_path)
    with pytest.raises(TypeError, match="3 is not a path; give the folder of a sweep"):
        engine.read_sweep(3)
    monkeypatch.setattr("engine.sweep.dataset.MAX_SOUND_NUMBERS", 1000)
    with pytest.raises(ValueError, match="read them one by one"):
        engine.read_sweep(found[1], sounds=True)
