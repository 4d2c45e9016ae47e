"""Traces as other programs read them, and contacts as columns of sweeps."""

import csv

import numpy as np
import pytest
from conftest import ROOT

import engine
from engine.cli import main

BALL = str(ROOT / "patches" / "bouncing_ball.toml")
FORCE = "force of contact.0 [N]"


@pytest.fixture(scope="module")
def traced():
    return engine.render(engine.load("bouncing_ball"), seconds=0.5, trace=True)


def read(path):
    """The largest force and the last energy of a file, by the program that it is for."""
    if path.suffix == ".nc":
        import xarray

        with xarray.open_dataset(path, engine="scipy") as found:
            assert found.force.attrs["units"] == "N" and found.attrs["fdh_version"]
            assert found.contact_name.values.tolist() == ["contact.0"]
            return float(found.force.max()), float(found.total[-1])
    if path.suffix == ".mat":
        from scipy.io import loadmat

        found = loadmat(path, squeeze_me=True)
        assert str(found["contacts"]) == "contact.0"
        return found["force"].max(), found["total"][-1]
    if path.suffix == ".csv":
        with path.open(newline="", encoding="utf-8") as file:
            rows = list(csv.DictReader(file))
        return max(float(row[FORCE]) for row in rows), float(rows[-1]["total [J]"])
    with np.load(path) as found:
        return found["force"].max(), found["total"][-1]


@pytest.mark.parametrize("name", ["a.npz", "a.nc", "a.mat", "a.csv"])
def test_a_trace_is_the_same_in_every_format(traced, tmp_path, name):
    traced.save(tmp_path / name)
    assert read(tmp_path / name) == (traced.trace["force"].max(), traced.trace["total"][-1])


@pytest.mark.parametrize("name", ["a.nc", "a.csv"])
def test_the_command_writes_them_too(traced, tmp_path, name):
    words = "--trace", str(tmp_path / name), "-o", str(tmp_path / "a.wav"), "--seconds", "0.5"
    assert main.main(["render", BALL, *words]) == 0
    assert read(tmp_path / name) == (traced.trace["force"].max(), traced.trace["total"][-1])


def test_a_trace_says_which_patch_it_is_of(traced, tmp_path):
    traced.save(tmp_path / "a.npz")
    with np.load(tmp_path / "a.npz") as found:
        (tmp_path / "again.toml").write_text(str(found["patch_text"]), "utf-8")
    again = engine.load(tmp_path / "again.toml")
    assert again.model_dump() == traced.scene.model_dump()


def test_a_data_set_of_friction_has_its_names():
    scene = engine.load("bowed_violin")
    found = engine.render(scene, seconds=0.02, trace=True).to_xarray()
    assert found.friction_name.values.tolist() == [f.name for f in scene.friction]
    assert found.slip.dims == ("time", "friction_name") and found.slip.attrs["units"] == "m/s"


def test_contacts_of_a_sweep_are_those_of_single_renderings(tmp_path):
    """First touch, duration, impulse, largest force and compression, touches: exact to the step, by the trace."""
    scene, path = engine.load("bouncing_ball"), "body.ball.mass"
    rows = engine.run_sweep_rows(scene, {path: [0.2, 2.0]}, tmp_path / "a", seconds=0.6, contacts=True)
    for row in rows:
        alone = engine.render(scene.replace(path, row[path]), seconds=0.6, trace=True).contacts["contact.0"].as_dict()
        found = {name: row[f"contact.0.{name}"] for name in alone}
        assert found == pytest.approx(alone, rel=1e-8) and found["touches"] >= 1
    assert "contact.0.impulse" not in engine.run_sweep_rows(scene, {path: [0.2]}, seconds=0.1)[0]
    dataset = engine.read_sweep(tmp_path / "a")
    assert dataset["contact.0.peak_force"].attrs == {"units": "N", "long_name": "peak force of contact.0"}


def test_a_contact_that_never_touches_has_no_first_touch(tmp_path):
    found = engine.run_sweep_rows(engine.load("bouncing_ball"), {"body.ball.mass": [1.0]}, seconds=0.01, contacts=True)
    assert found[0]["contact.0.first_touch"] is None and found[0]["contact.0.touches"] == 0


def test_random_rows_are_those_of_their_seed():
    scene, varied = engine.load("bouncing_ball"), {"body.ball.mass": "0.1..10:log"}
    drawn = [
        [row["body.ball.mass"] for row in engine.run_sweep_rows(scene, varied, seconds=0.01, random=n, seed=seed)]
        for n, seed in ((3, 1), (5, 1), (3, 2))
    ]
    assert drawn[0] == drawn[1][:3] and not set(drawn[0]) & set(drawn[2])
    assert all(0.1 <= mass <= 10.0 for mass in drawn[1])


def test_contacts_of_notes_are_refused(capsys):
    patch = str(ROOT / "patches" / "kalimba_keys.toml")
    assert main.main(["sweep", patch, "--notes", "A4", "--contacts"]) == 2
    assert "every key has contacts of its own" in capsys.readouterr().err
