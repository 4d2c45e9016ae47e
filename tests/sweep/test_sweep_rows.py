"""A sweep as a list of dicts: what a data set holds, as plain numbers, and without xarray."""

import csv
import sys

import numpy as np
import pytest
from sweeps import GRID, MARBLE, MASS, SECONDS, STIFFNESS, swept

import engine
from bench.scenes.families import tanpuras

SCENE = engine.load(MARBLE)


@pytest.fixture(scope="module")
def found(tmp_path_factory):
    folder = tmp_path_factory.mktemp("sweep")
    return engine.run_sweep_rows(SCENE, GRID, folder, seconds=SECONDS), folder


@pytest.mark.hard
def test_rows_have_the_numbers_of_the_data_set(found):
    pytest.importorskip("xarray", reason="needs xarray")
    rows, folder = found
    dataset = engine.read_sweep(folder, SCENE)
    assert len(rows) == 6 and [row["number"] for row in rows] == [1, 2, 3, 4, 5, 6]
    for row in rows:
        point = dataset.sel({STIFFNESS: row[STIFFNESS], MASS: row[MASS]})
        assert (row["file"], row["status"]) == (point.file.item(), "done")
        for name in ("peak", "rms", "centroid_hz", "t60_s", "newton_max", "contact"):
            value = np.nan if row[name] is None else row[name]
            np.testing.assert_equal(value, point[name].item())


def test_cells_are_plain_numbers_words_and_none(found):
    rows, folder = found
    assert {type(row[STIFFNESS]) for row in rows} == {float} and {type(row["peak"]) for row in rows} == {float}
    assert {type(row[name]) for row in rows for name in ("number", "newton_max", "unconverged", "silent")} == {int}
    assert all((folder / row["file"]).is_file() for row in rows)
    assert all(row["t60_s"] is None for row in rows), "in 20 ms no decay can be measured"


def test_rows_are_written_by_the_csv_module(found, tmp_path):
    rows = found[0]
    with open(tmp_path / "a.csv", "w", newline="", encoding="utf-8") as file:
        writer = csv.DictWriter(file, rows[0])
        writer.writeheader()
        writer.writerows(rows)
    with open(tmp_path / "a.csv", newline="", encoding="utf-8") as file:
        assert [float(row["peak"]) for row in csv.DictReader(file)] == [row["peak"] for row in rows]


def test_rows_need_no_xarray(found, monkeypatch):
    monkeypatch.setitem(sys.modules, "xarray", None)
    assert engine.read_sweep_rows(found[1]) == found[0]
    assert engine.run_sweep_rows(SCENE, {MASS: [0.002]}, seconds=SECONDS)[0]["file"] is None
    for refused in (lambda: engine.read_sweep(found[1]), lambda: engine.run_sweep(SCENE, {MASS: [0.002]})):
        with pytest.raises(ImportError, match="run_sweep_rows and read_sweep_rows give rows without it"):
            refused()


def test_a_point_that_fails_has_none_and_says_why():
    path = "body.oscillator.frequency"
    rows = engine.run_sweep_rows(engine.load("repelled_oscillator"), {path: [440.0, 30_000.0]}, seconds=SECONDS)
    assert rows[0]["status"] == "done" and rows[0]["peak"] > 0.0
    assert "30000" in rows[1]["status"] and rows[1]["peak"] is rows[1]["newton_max"] is None


def test_words_and_whole_numbers_that_varied_stay_what_they_are():
    ball = engine.load("bouncing_ball").replace("body.ball.displacement", 1e-3)
    varied = {"contact.0.side": ["above", "below"], "pickup.0.channel": [1, 2]}
    rows = engine.run_sweep_rows(ball, varied, seconds=SECONDS)
    assert [tuple(row[path] for path in varied) for row in rows] == [
        ("above", 1),
        ("above", 2),
        ("below", 1),
        ("below", 2),
    ]


def test_a_sweep_that_was_stopped_has_the_rows_that_are_done(tmp_path):
    swept(tmp_path, f"{STIFFNESS}=1e8,1e9", f"{MASS}=0.002,0.004", most=3)
    assert [row["status"] for row in engine.read_sweep_rows(tmp_path)] == ["done"] * 3


def test_what_is_no_sweep_is_refused_with_the_remedy(tmp_path):
    with pytest.raises(ValueError, match="holds no sweep; give a folder"):
        engine.read_sweep_rows(tmp_path)
    with pytest.raises(TypeError, match="3 is not a path; give the folder of a sweep"):
        engine.read_sweep_rows(3)


@pytest.mark.hard
def test_a_row_says_that_its_forces_are_not_to_be_trusted_and_why():
    scene = tanpuras(1, 100, 1.5, 1e9)
    bad, good = engine.run_sweep_rows(scene, {"accuracy.iterations": [2, 6]}, seconds=0.1)
    stats = engine.render(scene, seconds=0.1, iterations=2).stats
    assert (bad["trusted"], good["trusted"]) == (0, 1) and good["reasons"] == ""
    assert bad["reasons"] == "; ".join(stats.reasons) and "reached the iteration limit" in bad["reasons"]
    assert bad["unconverged"] == bad["capped"] == stats.newton.solve_outcomes.capped > 100
    assert stats.newton.unconverged == stats.as_dict()["newton"]["unconverged"] == bad["capped"]


def test_the_folder_of_a_sweep_of_an_earlier_version_can_be_read(found, tmp_path):
    rows, folder = found
    later = ("capped", "trusted", "reasons")
    with open(folder / "index.csv", newline="", encoding="utf-8") as file:
        cells = [{name: cell for name, cell in row.items() if name not in later} for row in csv.DictReader(file)]
    with open(tmp_path / "index.csv", "w", newline="", encoding="utf-8") as file:
        writer = csv.DictWriter(file, cells[0], lineterminator="\n")
        writer.writeheader()
        writer.writerows(cells)
    before = engine.read_sweep_rows(tmp_path)
    assert [row["peak"] for row in before] == [row["peak"] for row in rows]
    assert {row["trusted"] for row in before} == {row["capped"] for row in before} == {None}
