"""Variations of a patch: axes, points, and what cannot be asked for."""

from collections import Counter
from itertools import islice
from pathlib import Path

import numpy as np
import pytest
import soundfile
from conftest import ROOT, exit_code
from sweeps import MARBLE, axis, plan

import engine
from engine.cli import main
from engine.sweep import plan as plan_module

# --- axes


@pytest.mark.parametrize(
    ("text", "values"),
    [
        ("seconds=1..2:5", [1.0, 1.25, 1.5, 1.75, 2.0]),
        ("seconds=2..1:2", [2.0, 1.0]),
        ("contact.glass.stiffness=1e8..1e10:log:3", [1e8, 1e9, 1e10]),
        ("contact.0.loss=0,0.5", [0, 0.5]),
        ("pickup.bell.quantity=force, velocity", ["force", "velocity"]),
        ("accuracy.substeps=1..8:3", [1, 4, 8]),
        ("accuracy.order=2..4:3", [2, 3, 4]),
        ("pickup.0.gain=0.1..0.5:5", [0.1, 0.2, 0.3, 0.4, 0.5]),
        ("body.1.mass=7", [7]),
    ],
)
def test_axes(text, values):
    found = axis(text).grid_values()
    assert found == values
    assert [type(value) for value in found] == [type(value) for value in values]


def test_paths_lead_to_where_the_value_stands(tmp_path):
    assert axis("contact.glass.loss=1").key_path == ("contact", 0, "loss")
    assert axis("pickup.bell.gain=1").key_path == ("pickup", 0, "gain")
    assert axis("accuracy.silence=-inf").key_path == ("accuracy", "silence")
    marimba = str(ROOT / "patches" / "marimba.toml")
    path = next(f"body.{b.name}.ratios.1" for b in engine.load(marimba).body if getattr(b, "ratios", None))
    made = plan(f"{path}=3,5", patch=marimba)
    scene = made.scene(made.points[1])
    assert 5 in [b.ratios[1] for b in scene.body if getattr(b, "ratios", None)]
    assert scene.model_dump() != engine.load(marimba).model_dump()


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("foo", '"foo" is not a variation; give PATH=A..B:N'),
        ("seconds=", "is not a variation"),
        ("seconds=a..b", "neither a range nor a list"),
        ("seconds=1,,2", "neither a range nor a list"),
        ("seconds=1..2:x", "neither a range nor a list"),
        ("seconds=1..2:3:4", "is not a range"),
        ("seconds=1..inf:3", "is not a range"),
        ("seconds=1..1:3", "is not a range"),
        ("seconds=1..2:1", "1 values"),
        ("seconds=1..2", "does not say how many; give 1..2:16"),
        ("seconds=0..2:log:3", "no logarithm"),
        ("contact.glas.loss=1,2", 'did you mean "contact.glass.loss"?'),
        ("contact.glass.los=1,2", 'did you mean "contact.glass.loss"?'),
        ("contakt.glass.loss=1,2", 'did you mean "contact.glass.loss"?'),
        ("body.gong.mass=1,2", "the known ones are marble, bell"),
        ("pickup.4.gain=1,2", 'there is no "pickup.4"; pickup.0'),
        ("force.0.start=1,2", "the patch has no force"),
        ("body.bell=1,2", "a table; give one of its keys: body.bell.name, "),
        ("body=1,2", "a table"),
        ("body.bell.mass.0=1,2", "body.bell.mass has no parts"),
        ("contact.glass.bridge.at=1,2", "contact.glass.bridge is not in the patch"),
    ],
)
def test_a_wrong_axis_is_said_in_one_line(text, says):
    with pytest.raises(ValueError) as caught:
        axis(text)
    assert says in str(caught.value)
    assert "\n" not in str(caught.value)


def test_a_body_of_two_pickups_does_not_name_one(tmp_path):
    text = Path(MARBLE).read_text("utf-8")
    (tmp_path / "p.toml").write_text(text + '\n[[pickup]]\nbody = "bell"\nchannel = 2\n', "utf-8")
    with pytest.raises(ValueError, match=r"2 of pickup are on \"bell\"; pickup\.0 or pickup\.1"):
        axis("pickup.bell.gain=1,2", str(tmp_path / "p.toml"))


# --- points


def test_the_last_axis_of_a_grid_varies_fastest():
    found = plan("seconds=1,2", "pickup.0.quantity=force,velocity", "body.bell.mass=1..3:3")
    assert found.points[:4] == [(1, "force", 1.0), (1, "force", 2.0), (1, "force", 3.0), (1, "velocity", 1.0)]
    assert len(set(found.points)) == 12
    scene = found.scene((2, "velocity", 3.0))
    assert (scene.seconds, scene.pickup[0].quantity, scene.body[1].mass) == (2, "velocity", 3.0)


def test_random_points_are_those_of_their_seed():
    texts = ["contact.glass.stiffness=1e6..1e10:log", "body.bell.mass=1..3", "accuracy.order=2,4", "seconds=1..2:3"]
    texts += ["accuracy.substeps=1..4"]
    drawn = [axis(text, sampling=True) for text in texts]
    found = list(islice(plan_module.draw_points(drawn, 7), 2000))
    assert found == list(islice(plan_module.draw_points(drawn, 7), 2000))
    assert found != list(islice(plan_module.draw_points(drawn, 8), 2000))
    stiffness, mass, order, _, substeps = (np.array(column) for column in zip(*found, strict=True))
    for share in (np.log10(stiffness) / 4 - 1.5, (mass - 1) / 2):  # uniform from 0 to 1
        assert 0 <= share.min() < 0.01 and 0.99 < share.max() <= 1
        assert share.mean() == pytest.approx(0.5, abs=0.03)
    assert Counter(order.tolist())[2] == pytest.approx(1000, abs=100)
    assert [Counter(substeps.tolist())[n] for n in range(6)] == pytest.approx([0, 500, 500, 500, 500, 0], abs=80)


def test_ends_that_cannot_be_are_refused_before_anything_is_rendered(tmp_path, capsys):
    words = ["--vary", "contact.glass.stiffness=-1..1:3", "--vary", "pickup.0.quantity=force,loudness"]
    words += ["--vary", "contact.glass.barrier=0,1"]
    assert main.main(["sweep", MARBLE, "-o", str(tmp_path / "out"), *words]) == 2
    said = capsys.readouterr().err.splitlines()
    assert len(said) == 3
    assert said[0].startswith("fdh --vary: contact.glass.stiffness: -1.0 is out of range; stiffness kc")
    assert 'pickup.0.quantity: "loudness" is not known' in "".join(said)
    assert "contact.glass.barrier: on and barrier are both given" in "".join(said)
    assert not list(tmp_path.iterdir())


@pytest.mark.hard
def test_a_shorter_sound_leaves_out_the_events_that_come_later(tmp_path, capsys):
    """As --seconds does: the same samples, and one line, for a patch, and for notes and dampers of an instrument."""
    for patch, texts in (("kalimba", "0.1,0.3"), ("kalimba_keys", "0.2..0.4:2")):
        scene = engine.load(patch)
        assert any(event.time > 0.4 for event in scene.event)
        folder = tmp_path / patch
        words = ["--vary", f"seconds={texts}", "--subtype", "DOUBLE", "--gain", "0"]
        assert main.main(["sweep", patch, "-o", str(folder), *words, "--cores", "1"]) == 0
        said = [line for line in capsys.readouterr().err.splitlines() if "later than" in line]
        assert len(said) == 1 and said[0].startswith("note: seconds: ")
        sounds = sorted(folder.glob("*.wav"))
        for path, seconds in zip(sounds, (0.1, 0.3) if "," in texts else (0.2, 0.4), strict=True):
            whole = engine.render(scene, seconds=seconds)
            np.testing.assert_array_equal(soundfile.read(path, always_2d=True)[0], whole.audio)
    rows = engine.run_sweep_rows(engine.load("kalimba"), {"seconds": [0.05, 2.5]})
    assert [row["status"] for row in rows] == ["done", "done"]


@pytest.mark.parametrize("value", ["0", "-1", "long", "4000"])
def test_seconds_that_cannot_be_are_refused(tmp_path, capsys, value):
    assert main.main(["sweep", "kalimba", "-o", str(tmp_path / "out"), "--vary", f"seconds={value},1"]) == 2
    assert "fdh --vary: seconds: " in capsys.readouterr().err


# --- what is asked for


@pytest.mark.parametrize(
    ("words", "says"),
    [
        (["--vary", "seconds=1,2", "--live"], "--live is now a command: fdh play PATCH"),
        (["--vary", "seconds=1,2", "--midi", "a.mid"], "--midi a.mid; --midi belongs to fdh render, fdh play"),
        (["--vary", "seconds=1,2", "--price", "--explain"], "--price is now a command: fdh accuracy PATCH"),
        (["--vary", "seconds=1,2", "--plot"], "--plot; --plot belongs to fdh render, fdh accuracy"),
        (["--vary", "seconds=1,2", "--trace", "a.npz"], "--trace a.npz; --trace belongs to fdh render"),
        (["--vary", "seconds=1,2", "--target-error", "1e-3"], "--target-error belongs to fdh render"),
        (["--vary", "seconds=1,2", "--record", "a.wav"], "--record belongs to fdh play"),
        (["--vary", "seconds=1,2", "--sample", "3"], "fdh sweep: --sample is now called --random"),
        (["--vary", "seconds=1,2", "--seconds", "1"], "seconds: --seconds is given too"),
        (["--vary", "accuracy.order=2,4", "--order", "4"], "accuracy.order: --order is given too"),
        (["--vary", "seconds=1,2", "--vary", "seconds=1,2"], "it varies twice"),
        (
            ["--vary", "seconds=1..2:1000", "--vary", "body.bell.mass=1..2:1000"],
            "the grid has 1000000 points; the limit is 100000",
        ),
        (["--vary", "seconds=1,2", "--random", "many"], '--random: "many" is not a whole number'),
        (["--vary", "seconds=1,2", "--seed", "3"], "--seed: requires --random"),
        (["--random", "3"], "nothing varies; give --vary PATH=RANGE, or --notes"),
        (["--cluster", "here"], "nothing varies; give --vary PATH=RANGE, or --notes"),
        (["--vary", "seconds=1,2", "-o", MARBLE], "is a file"),
        (["--vary", "seconds=1,2", "-o", "no/where"], "no such folder"),
        (["--vary", "seconds=1,2", "--subtype", "MP7"], "unknown sample format"),
        (["--vary", "seconds=1,2", "--cluster", "x", "--cores", "2"], "--cores: cannot be combined with --cluster"),
    ],
)
def test_what_does_not_go_together_is_refused(tmp_path, monkeypatch, capsys, words, says):
    monkeypatch.chdir(tmp_path)
    assert exit_code("sweep", MARBLE, *words) == 2
    said = capsys.readouterr().err
    assert says in said and "Traceback" not in said
    assert not list(tmp_path.iterdir())


def test_an_index_of_something_else_is_not_touched(tmp_path, capsys):
    (tmp_path / "index.csv").write_text("number,name\n1,x\n")
    assert main.main(["sweep", MARBLE, "-o", str(tmp_path), "--vary", "seconds=1,2"]) == 2
    assert "is an index of something else; give another folder, or remove it" in capsys.readouterr().err
    assert (tmp_path / "index.csv").read_text() == "number,name\n1,x\n"


def test_without_distributed_the_command_to_run_is_named(tmp_path, monkeypatch, capsys):
    monkeypatch.setattr(plan_module, "find_spec", lambda name: None)
    assert main.main(["sweep", MARBLE, "-o", str(tmp_path / "a"), "--vary", "seconds=1,2", "--cluster", "x"]) == 2
    assert (
        "--cluster: needs distributed; run uv sync --extra cluster, or pip install distributed"
        in capsys.readouterr().err
    )
