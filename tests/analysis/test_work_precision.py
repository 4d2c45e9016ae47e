"""What accuracy costs: the table, the choice, and the measures behind them."""

import json
import time
from types import SimpleNamespace

import numpy as np
import pytest
from conftest import ROOT

import engine
from engine.analysis import metrics
from engine.analysis.work_precision import measure_work_precision
from engine.cli import main
from engine.offline.simulation import THREAD_CLOCK, time_block

PATCH = ROOT / "patches" / "repelled_oscillator.toml"


@pytest.fixture(scope="module")
def found():
    return measure_work_precision(engine.load(PATCH), seconds=0.05)


@pytest.mark.hard
def test_finer_settings_err_less_and_cost_more(found):
    rows = {row["setting"]: row for row in found["rows"]}
    names = [
        "order 2, 1 ×",
        "order 2, 2 ×",
        "order 2, 4 ×",
        "order 2, 16 ×",
        "order 4, 1 ×",
        "order 4, 2 ×",
        "order 4, 4 ×",
    ]
    errors = [rows[name]["error"] for name in names]
    assert errors == sorted(errors, reverse=True)
    assert errors[0] > 1e-2 and errors[-1] < 1e-6
    assert rows["order 2, 16 ×"]["ns_per_sample"] > 1.5 * rows["order 2, 1 ×"]["ns_per_sample"]
    assert all(row["newton"]["unconverged"] == 0 for row in rows.values())
    assert all(row["energy_error"] <= 1e-12 for row in rows.values())
    assert rows["order 4, 4 ×"]["front"]


@pytest.mark.hard
def test_the_reference_agrees_with_itself(found):
    assert found["horizon"] == pytest.approx(0.05)  # one oscillator, one barrier: nothing chaotic
    assert found["disagreement"] <= 0.1 * min(row["error"] for row in found["rows"])


@pytest.mark.hard
def test_an_error_of_the_table_is_that_of_a_render(found):
    told = engine.load(PATCH)
    row = next(row for row in found["rows"] if row["setting"] == "order 4, 1 ×")
    fine = engine.render(told, seconds=0.05, order=6, substeps=12).audio
    error = metrics.relative_rms_error(engine.render(told, seconds=0.05, **row["changes"]).audio, fine, len(fine))
    assert error == pytest.approx(row["error"], rel=0.01)


def test_the_cost_of_a_setting_is_the_time_of_its_thread():
    """Or a machine that does other work besides would cost up to twenty times as much at one setting as at the next."""
    waiting = SimpleNamespace(memory=lambda *shape: None, render_block=lambda audio: time.sleep(0.1))
    assert THREAD_CLOCK is not time.thread_time or time_block(waiting, np.zeros((1, 1))) < 0.03


def test_measures():
    rng = np.random.default_rng(1)
    sound = rng.normal(size=(22_050, 2))
    assert metrics.relative_rms_error(1.01 * sound, sound, 22_050) == pytest.approx(0.01)
    assert metrics.band_error(10 ** (1 / 20) * sound, sound, 44_100) == pytest.approx(1.0, abs=1e-9)
    assert metrics.impulse_error(1.1 * np.abs(sound), np.abs(sound)) == pytest.approx(0.1)
    assert metrics.decay_error(10 ** (1 / 20) * sound, sound, 44_100) == pytest.approx(1.0, abs=1e-9)
    time = np.arange(44_100)[:, None] / 44_100
    tones = [np.sin(2 * np.pi * f * time) for f in (440.0, 440.0 * 2 ** (3 / 1200))]
    assert metrics.detuning_cents(tones[1], tones[0]) == pytest.approx(3.0, abs=0.1)
    pushes = np.zeros((1000, 2))
    pushes[100:144, 1] = pushes[300:900, 0] = 1.0
    assert metrics.first_contact_ms(pushes, 44_100) == pytest.approx(44 / 44.1)
    assert metrics.contact_intervals(pushes, 1000.0) == [(0.1, 0.144), (0.3, 0.9)]
    assert metrics.contact_intervals(pushes, 1000.0, 0.2) == [(0.1, 0.9)]
    speeds = np.arange(1000.0)[:, None] * [1.0, 10.0]
    assert metrics.rebound_velocity(pushes, speeds) == 1440.0
    assert np.isnan(metrics.rebound_velocity(np.ones((10, 1)), np.ones((10, 1))))
    away = sound.copy()
    away[10_000:] += 0.1
    assert 10_000 - 221 <= metrics.horizon(sound, away, 44_100) <= 10_000
    assert metrics.horizon(sound, sound, 44_100) == 22_050
    assert metrics.relative_rms_error(sound, sound, 0) == np.inf


@pytest.mark.hard
def test_the_first_rebound_is_told(found):
    """Fig. 6's oscillator leaves the barrier as fast as it came: ½v² = ½ω²(y0² - y1²)."""
    speed = 2 * np.pi * 440 * np.sqrt(2e-3**2 - 0.93e-3**2)
    late = (2 * np.pi * 440) ** 2 * 0.93e-3 / 44_100  # what the spring takes of it within a sample
    assert -speed <= found["rebound"] <= -speed + 1.2 * late
    best = min(found["rows"], key=lambda row: row["error"])
    assert best["rebound"] == pytest.approx(found["rebound"], rel=1e-6)


@pytest.mark.hard
def test_chaos_ends_the_horizon():
    """A ball in a box of unequal, moving walls forgets how it began; what is said of its error ends there."""
    bodies = [
        {"name": "ball", "kind": "mass", "mass": 0.001, "velocity": 3.0},
        {"name": "left", "kind": "oscillator", "mass": 0.003, "frequency": 333.0, "displacement": -1e-3},
        {"name": "right", "kind": "oscillator", "mass": 0.002, "frequency": 217.0, "displacement": 1e-3},
    ]
    law = {"stiffness": 1e8, "exponent": 1.5}
    contacts = [
        {"body": "ball", "on": "left", "side": "below", "gap": 1e-3} | law,
        {"body": "ball", "on": "right", "gap": 1e-3} | law,
    ]
    told = engine.Scene.model_validate({"body": bodies, "contact": contacts, "pickup": [{"body": "ball"}]})
    found = measure_work_precision(told, seconds=0.5)
    assert 0.0 < found["horizon"] < 0.5
    assert "chaotic" in found["verdict"]


@pytest.mark.hard
def test_price_and_error_on_the_command_line(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    words = ["accuracy", str(PATCH), "--seconds", "0.02", "--plot", "price.png"]
    assert main.main(words) == 0
    told = capsys.readouterr().out
    assert "order 4, 4 ×" in told and "times smaller than that of one step per sample" in told
    assert (tmp_path / "price.png").read_bytes().startswith(b"\x89PNG")
    assert [p.name for p in tmp_path.iterdir()] == ["price.png"]


def test_a_rendering_says_about_how_much_it_errs(tmp_path, monkeypatch, capsys):
    """Where that costs little, from its first twentieth."""
    monkeypatch.chdir(tmp_path)
    patch, told = str(ROOT / "patches/piano_c4.toml"), engine.load("piano_c4")
    fine = engine.render(told, seconds=0.1, order=4, substeps=16).audio
    for options in ([], ["--order", "4"], ["--max-error", "1e-4"]):
        assert main.main([patch, "--seconds", "2", "-o", "out.wav", "--json", *options]) == 0
        stats = json.loads(capsys.readouterr().out)
        rendered = engine.render(told, seconds=0.1, **stats["accuracy"]).audio
        error = metrics.relative_rms_error(rendered, fine, len(fine))
        assert stats["error_estimate"]["seconds"] == pytest.approx(0.1)
        assert stats["error_estimate"]["motion"] == pytest.approx(error, rel=0.5)
    assert main.main([patch, "--seconds", "2", "-o", "out.wav"]) == 0
    assert "estimated error    0.02 of the sound up to 0.1 s; --error-estimate compares all" in capsys.readouterr().out


@pytest.mark.hard
@pytest.mark.parametrize(("target", "order"), [("1e-2", 2), ("1e-5", 4)])
def test_a_target_error_is_met_where_errors_add_up(tmp_path, capsys, target, order):
    """A mass at a barrier, for half a second: each sample errs a little, always to the same side."""
    fine = engine.render(engine.load(PATCH), seconds=0.5, order=6, substeps=8).audio
    words = [str(PATCH), "--seconds", "0.5", "--target-error", target, "-o", str(tmp_path / "out.wav"), "--json"]
    assert main.main(words) == 0
    stats = json.loads(capsys.readouterr().out)
    assert stats["error_estimate"]["motion"] <= stats["target_error"] == float(target)
    assert stats["accuracy"]["order"] == order
    error = metrics.relative_rms_error(
        engine.render(engine.load(PATCH), seconds=0.5, **stats["accuracy"]).audio, fine, len(fine)
    )
    assert error == pytest.approx(stats["error_estimate"]["motion"], rel=0.5)


def test_a_target_error_is_read_as_a_ratio_or_in_decibels(capsys):
    assert main.main([str(PATCH), "--target-error", "loud", "-o", "out.wav"]) == 2
    assert '"loud" is not an error; give a ratio such as 1e-4, or decibels such as 0.1dB' in capsys.readouterr().err
    assert main.main([str(PATCH), "--target-error", "3dB", "-o", "out.wav"]) == 2
    assert "--target-error: 0.41" in capsys.readouterr().err
    assert main.main([str(PATCH), "--target-error", "1e-3", "--max-error", "1e-3"]) == 2
    assert "--target-error: sets --max-error; give only one of the two" in capsys.readouterr().err


STILL = {"name": "m", "kind": "oscillator", "mass": 1.0, "frequency": 440.0}
WALL = {"body": "m", "barrier": 0.01, "stiffness": 1e8, "exponent": 2.0}
LATE = {"kind": "constant", "body": "m", "amplitude": 1.0, "start": 5.0}
SILENT = {
    "at rest": ({"body": [STILL]}, "nothing moves at the start"),
    "at rest near a wall": ({"body": [STILL], "contact": [WALL]}, "nothing moves at the start"),
    "pushed too late": ({"body": [STILL], "force": [LATE]}, "nothing happens before 5 s"),
    "without gain": ({"body": [STILL | {"velocity": 1.0}], "pickup": [{"body": "m", "gain": 0.0}]}, "gain = 0"),
    "hardly anything": ({"body": [STILL | {"velocity": 1e-200}], "contact": [WALL]}, ""),
}


@pytest.mark.parametrize("name", SILENT)
def test_of_silence_nothing_is_measured(name):
    parts, says = SILENT[name]
    told = engine.Scene.model_validate({"seconds": 0.05, "pickup": [{"body": "m"}]} | parts)
    found = measure_work_precision(told)
    assert found["verdict"].startswith("nothing can be measured: silent; ")
    assert says in found["verdict"] and found["rows"] == []


@pytest.mark.hard_for("5e-05", "0.0001")
@pytest.mark.parametrize("seconds", [1e-6, 2.3e-5, 5e-5, 1e-4])
def test_the_price_of_a_few_samples(seconds):
    found = measure_work_precision(engine.load(PATCH), seconds=seconds)
    assert found["verdict"].startswith(("nothing can be measured", "no setting is better"))
    if seconds < 3e-5:
        assert found["verdict"] == "nothing can be measured: it has one sample; give more seconds"


@pytest.mark.hard
def test_motion_that_is_lost_at_once_has_a_price():
    """Heavy damping leaves order 2 alone; and where no setting errs, none pays."""
    body = {"name": "m", "kind": "oscillator", "mass": 1.0, "frequency": 440.0, "velocity": 1.0, "damping_rate": 1e6}
    told = engine.Scene.model_validate({"seconds": 0.01, "body": [body], "contact": [WALL], "pickup": [{"body": "m"}]})
    found = measure_work_precision(told)
    assert all(row["changes"].get("order", 2) == 2 for row in found["rows"])
    assert found["verdict"]
    free = engine.Scene.model_validate({"body": [STILL | {"velocity": 1.0}], "pickup": [{"body": "m"}]})
    assert measure_work_precision(free, seconds=0.01)["verdict"].startswith("no setting is better")


@pytest.mark.hard
def test_silence_on_the_command_line(tmp_path, monkeypatch, capsys):
    """The comparison says why there is no table."""
    monkeypatch.chdir(tmp_path)
    body = '[[body]]\nname = "m"\nkind = "oscillator"\nmass = 1.0\nfrequency = 440.0\n'
    (tmp_path / "p.toml").write_text(f'seconds = 0.05\n{body}[[pickup]]\nbody = "m"\n', "utf-8")
    assert main.main(["accuracy", "p.toml", "--plot", "p.png"]) == 0
    assert capsys.readouterr().out.startswith("nothing can be measured: silent; nothing moves at the start")
    assert (tmp_path / "p.png").exists()
    assert main.main(["accuracy", "p.toml", "--json"]) == 0
    told = json.loads(capsys.readouterr().out)["price"]
    assert told["unmeasured"].startswith("silent; ") and told["rows"] == [] and told["horizon"] is None
    assert main.main(["accuracy", "p.toml", "--report", "p.html"]) == 0
    assert "Nothing can be measured" in (tmp_path / "p.html").read_text("utf-8")


STRING = {"name": "s", "kind": "string", "length": 0.65, "linear_density": 1e-3, "tension": 80.0, "modes": 12}


@pytest.mark.hard
def test_errors_of_noise_are_those_against_a_higher_sample_rate():
    """More steps do not refine what is known once a sample."""
    force = {"kind": "noise", "body": "s", "at": 0.2, "amplitude": 1.0, "duration": 1.0, "band": [100.0, 3000.0]}
    told = engine.load({"body": [STRING], "force": [force], "pickup": [{"body": "s", "at": 0.1}]})
    study = measure_work_precision(told, seconds=0.02)
    fine = engine.render(told, 0.02, 16 * 44_100, cores=1).audio[::16]
    for row in study.rows:
        if row.setting in ("order 2, 1 ×", "order 4, 4 ×"):
            audio = engine.render(told, 0.02, cores=1, **row.changes).audio
            assert row.error == pytest.approx(metrics.relative_rms_error(audio, fine, len(fine)), rel=0.2)
            assert row.error > 1e-3
    assert sum(row.front for row in study.rows) < len(study.rows), "of equal errors the fastest is the best"


@pytest.mark.hard
def test_a_patch_whose_pitch_glides_has_errors_and_costs():
    """The steps of the glide are an error of every setting, and take time."""
    shape = {"kind": "triangle", "at": 0.2, "amplitude": 1e-3}
    change = {"kind": "change", "time": 0.002, "parameter": "body.s.tension", "value": 88.0, "duration": 0.02}
    patch = {"body": [STRING | {"displacement": shape}], "event": [change], "pickup": [{"body": "s", "at": 0.1}]}
    measured = lambda doc: {row.setting: row for row in measure_work_precision(engine.load(doc), seconds=0.02).rows}
    still = measured(patch | {"event": []})
    gliding = measured(patch)
    assert gliding["order 4, 4 ×"].error > 1e-3
    assert gliding["order 2, 1 ×"].ns_per_sample > 2 * still["order 2, 1 ×"].ns_per_sample
