"""The command line, as a user meets it."""

import json
import subprocess
import sys
import time

import numpy as np
import pytest
import soundfile
from conftest import PATCHES, ROOT, exit_code

import engine
from engine import output_files
from engine.assembly.table_digest import digest_scene
from engine.cli import main
from engine.offline.simulation import Simulation
from engine.report import console

BALL = str(ROOT / "patches" / "bouncing_ball.toml")
KEYS = {
    "patch", "output", "seconds", "samplerate", "channels", "peak", "real_time_factor", "ns_per_sample",
    "newton", "energy", "effects", "activity",
}  # fmt: skip


def run(*words: str, cwd=None) -> subprocess.CompletedProcess:
    command = [sys.executable, str(ROOT / "render.py"), *words]
    return subprocess.run(command, cwd=cwd, capture_output=True, text=True, timeout=120, check=False)


def test_a_patch_becomes_a_wav(tmp_path):
    done = run(BALL, "--seconds", "0.5", cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    info = soundfile.info(str(tmp_path / "bouncing_ball.wav"))
    assert (info.frames, info.samplerate, info.channels, info.subtype) == (22_050, 44_100, 1, "FLOAT")
    length, level, speed, file = done.stdout.splitlines()
    assert "0.5 s at 44100 Hz, mono" in length and "× real time" in speed
    assert "-1.0 dBFS" in level and "gain" in level
    assert file == "bouncing_ball.wav"
    assert [p.name for p in tmp_path.iterdir()] == ["bouncing_ball.wav"]


def test_verbose_tells_what_the_simulation_did(tmp_path, capsys):
    assert main.main([BALL, "-o", str(tmp_path / "a.wav"), "--seconds", "0.5"]) == 0
    brief = capsys.readouterr().out.splitlines()
    assert main.main([BALL, "-o", str(tmp_path / "a.wav"), "--seconds", "0.5", "--verbose"]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert [line.split()[0] for line in lines[:3]] == [line.split()[0] for line in brief[:3]]
    for word in ("ns per sample", "Newton", "energy error", "enabled", "disabled"):
        assert any(word in line for line in lines) and not any(word in line for line in brief)
    assert lines[-1] == brief[-1] == str(tmp_path / "a.wav")


@pytest.mark.parametrize("verbose", [False, True])
def test_what_is_wrong_is_said_without_verbose(capsys, verbose):
    stats = engine.render(engine.load(BALL), seconds=0.1).stats.as_dict() | {
        "output": "a.wav",
        "gain_db": 0.0,
        "peak_file": 0.9,
    }
    console.print_summary(stats, [], verbose)
    said = capsys.readouterr().out
    assert not any(alarm in said for alarm in ("NOT TO BE TRUSTED", "slow", "clip", "silent"))
    wrong = {"trusted": False, "reasons": ["the energy is off"], "real_time_factor": 0.5, "peak_file": 2.0}
    console.print_summary(stats | wrong, [], verbose)
    said = capsys.readouterr().out
    assert all(alarm in said for alarm in ("NOT TO BE TRUSTED  the energy is off", "players will clip it"))
    console.print_summary(stats | {"peak_file": 0.0, "silent": "nothing moves"}, [], verbose)
    assert "silent: nothing moves" in capsys.readouterr().out


def test_the_file_holds_the_take(tmp_path, capsys):
    """Normalised to -1 dBFS by default; SI units times a fixed gain if asked for."""
    out = tmp_path / "a.wav"
    assert main.main([BALL, "-o", str(out), "--subtype", "DOUBLE", "--gain", "0"]) == 0
    rendering = engine.render(engine.load(BALL))
    np.testing.assert_array_equal(soundfile.read(out)[0], rendering.audio[:, 0])
    assert main.main([BALL, "-o", str(out), "--subtype", "DOUBLE"]) == 0
    audio = soundfile.read(out)[0]
    assert np.abs(audio).max() == pytest.approx(10 ** (-1 / 20), rel=1e-12)
    heard = slice(0, -221)  # the sound goes on, and fades out for 5 ms
    wanted = rendering.audio[heard, 0] / rendering.audio[9999, 0]
    np.testing.assert_allclose(audio[heard] / audio[9999], wanted, rtol=1e-12)
    assert audio[-1] == 0.0
    assert "gain +0.0 dB" in capsys.readouterr().out


@pytest.mark.hard
def test_a_plot_lies_beside_the_sound(tmp_path, capsys):
    from matplotlib.image import imread

    assert main.main([BALL, "-o", str(tmp_path / "ball.wav"), "--seconds", "0.5", "--plot"]) == 0
    assert sorted(p.name for p in tmp_path.iterdir()) == ["ball.png", "ball.wav"]
    assert "ball.png" in capsys.readouterr().out
    image = imread(tmp_path / "ball.png")[:, :, :3]
    assert image.shape[0] > 800 and image.shape[1] > 800
    panels = [part for part in np.array_split(image, 4) if np.unique(part.reshape(-1, 3), axis=0).shape[0] > 20]
    assert len(panels) == 4  # something is drawn in each
    shade = np.array([255, 223, 194]) / 255  # contact, on white
    assert (np.abs(image - shade).max(axis=2) < 0.02).sum() > 50
    assert exit_code("inspect", BALL, "--plot") == 2
    assert "--plot belongs to fdh render, fdh accuracy" in capsys.readouterr().err


@pytest.mark.parametrize("subtype", output_files.SUBTYPES)
def test_sample_formats_and_rates(tmp_path, subtype):
    out = tmp_path / "a.wav"
    assert main.main([BALL, "-o", str(out), "--subtype", subtype, "--samplerate", "96000", "--seconds", "0.1"]) == 0
    info = soundfile.info(str(out))
    assert (info.subtype, info.samplerate, info.frames) == (subtype, 96_000, 9_600)


def test_json_is_one_object_with_the_documented_names(tmp_path, capsys):
    out = tmp_path / "a.wav"
    assert main.main([BALL, "-o", str(out), "--json", "--scheme", "fdh"]) == 0
    stats = json.loads(capsys.readouterr().out)
    assert set(stats) >= KEYS
    assert set(stats["newton"]) >= {"solves", "mean", "p99", "max", "unconverged"}
    assert set(stats["energy"]) == {"initial", "final", "supplied", "dissipated", "error_max", "error_per_step_max"}
    assert stats["effects"]["compiled"] == ["gravity", "contact"]
    assert "loss" in stats["effects"]["left_out"]
    assert sum(stats["activity"].values()) == pytest.approx(1.0)
    assert (stats["patch"], stats["output"], stats["channels"]) == (BALL, str(out), 1)
    assert stats["table_digest"] == digest_scene(engine.load(BALL))  # a free fall is the same by both schemes
    assert stats["energy"]["initial"] == pytest.approx(9.81 * 0.2)
    assert stats["peak_file"] == pytest.approx(np.abs(soundfile.read(out)[0]).max(), rel=1e-6)
    assert stats["peak"] == pytest.approx(stats["peak_file"] / 10 ** (stats["gain_db"] / 20), rel=1e-6)


def test_trace_holds_every_sample(tmp_path):
    out = tmp_path / "t.npz"
    assert main.main([BALL, "-o", str(tmp_path / "a.wav"), "--trace", str(out), "--seconds", "0.3"]) == 0
    trace = np.load(out)
    n = 13_230
    shapes = {"displacement": (n, 1), "velocity": (n, 1), "compression": (n, 1), "force": (n, 1)}
    for name in ("time", "iterations", "kinetic", "potential", "contact", "dissipated", "supplied", "total"):
        shapes[name] = (n,)
    labels = {"bodies", "contacts", "positions", "contact_positions", "samplerate", "units"}
    facts = {"patch", "patch_text", "kernel", "accuracy", "fdh_version"}
    assert {name: trace[name].shape for name in trace.files if name not in labels | facts} == shapes
    assert str(trace["patch_text"]) == (ROOT / "patches" / "bouncing_ball.toml").read_text("utf-8") and str(
        trace["fdh_version"]
    )
    assert labels <= {*trace.files} and {*shapes} <= {*dict(trace["units"])}
    assert trace["displacement"][0, 0] == 0.2
    assert trace["total"][0] == pytest.approx(9.81 * 0.2)
    touching = trace["compression"][:, 0] > 0
    np.testing.assert_allclose(trace["compression"][:, 0], -trace["displacement"][:, 0], atol=1e-13)
    assert touching.any()
    assert np.all(trace["force"][~touching & ~np.roll(touching, 1), 0] == 0)


@pytest.mark.hard
@pytest.mark.parametrize("patches", [PATCHES[::8], pytest.param(PATCHES, marks=pytest.mark.hard)], ids=["some", "all"])
def test_check_validates_without_rendering(patches, tmp_path):
    bad = tmp_path / "bad.toml"
    bad.write_text("seconds = -1\n[[body]]\nname = 1\n")
    good = run("check", *map(str, patches), cwd=tmp_path)
    assert good.returncode == 0
    assert good.stdout.count(": valid;") == len(patches)
    done = run("check", BALL, str(bad), cwd=tmp_path)
    assert done.returncode == 2
    assert done.stdout.count("valid") == 1
    assert len(done.stderr.splitlines()) == 3
    assert [p.name for p in tmp_path.iterdir()] == ["bad.toml"]


def test_all_that_is_wrong_is_said_and_nothing_is_written(tmp_path):
    bad = tmp_path / "bad.toml"
    bad.write_text('[[body]]\nname = "b"\nkind = "mass"\nmass = -1\n[[pickup]]\nbody = "c"\n')
    words = ["--seconds", "-3", "--samplerate", "12", "--scheme", "euler", "--gain", "loud", "-o", "no/where.wav"]
    done = run(str(bad), *words, "--subtype", "PCM_8", cwd=tmp_path)
    assert done.returncode == 2
    assert "Traceback" not in done.stderr
    lines = done.stderr.splitlines()
    for part in (
        f"{bad}:4 body[0].mass: -1 is out of range",
        f'{bad}:6 pickup[0].body: no body is named "c"; the bodies are "b"',
        "render.py --seconds: -3 is out of range; give more than 0",
        "render.py --samplerate: 12 is out of range",
        'render.py --gain: "loud" is not a number',
        'render.py --scheme: "euler" is not known; expected',
        "render.py --output: no such folder: no",
        'render.py --subtype: unknown sample format "PCM_8"',
    ):
        assert any(line.startswith(part) for line in lines), (part, lines)
    assert len(lines) == 8
    assert [p.name for p in tmp_path.iterdir()] == ["bad.toml"]


@pytest.mark.parametrize(
    ("words", "says"),
    [
        (["nowhere.toml"], "no such file"),
        ([BALL, "-o", "a.mp7"], "is not the name of a known audio format"),
        ([BALL, "--seconds", "nan"], "out of range"),
        ([BALL, "--samplerate", "44100.5"], "not a whole number"),
        ([BALL, "-o", "a.flac", "--subtype", "FLOAT"], "FLAC files cannot hold FLOAT"),
        ([BALL, "--trace", "no/t.npz"], "no such folder"),
    ],
)
def test_other_faults(tmp_path, words, says, capsys, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert main.main(words) == 2
    assert says in capsys.readouterr().err
    assert not list(tmp_path.iterdir())


def test_an_impossible_rate_names_the_patch(tmp_path, capsys):
    text = (ROOT / "patches" / "repelled_oscillator.toml").read_text()
    (tmp_path / "p.toml").write_text(text.replace("frequency = 440.0", "frequency = 44000.0"))
    assert main.main([str(tmp_path / "p.toml"), "-o", str(tmp_path / "a.wav")]) == 2
    assert "p.toml:8 body[0]: vibrates at 44000 Hz" in capsys.readouterr().err


@pytest.mark.hard
def test_help_answers_at_once():
    """Without Numba, NumPy or pydantic, all of which take longer to import."""
    helped, bare = [], []
    for _ in range(7):  # in turns, for the machine may be busy at times
        begin = time.perf_counter()
        done = run("--help")
        between = time.perf_counter()
        subprocess.run([sys.executable, "-c", "import argparse"], capture_output=True, check=True)
        helped, bare = [*helped, between - begin], [*bare, time.perf_counter() - between]
        assert done.returncode == 0
        assert "render a patch" in done.stdout and "tanpura" in done.stdout
    assert min(helped) < 4 * min(bare) + 0.1
    code = """import sys
from engine.cli import main
for words in ([], *([name] for name in main.build_parser()[1])):
    try:
        main.main([*words, "--help"])
    except SystemExit:
        pass
print({'numba', 'numpy', 'pydantic', 'scipy', 'rich'} & set(sys.modules))"""
    done = subprocess.run([sys.executable, "-c", code], cwd=ROOT, capture_output=True, text=True, check=True)
    assert done.stdout.splitlines()[-1] == "set()" and "--samplerate" in done.stdout


def test_without_dependencies_the_command_to_run_is_named(tmp_path):
    """A Python without packages: -S hides them, -E the environment."""
    done = subprocess.run(
        [sys.executable, "-S", "-E", str(ROOT / "render.py"), BALL],
        cwd=tmp_path,
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 1
    program = f"--project {ROOT} {ROOT / 'render.py'}"
    assert f"python3 -m pip install uv && uv run {program} {BALL}" in done.stderr
    assert "Traceback" not in done.stderr


@pytest.mark.system
def test_a_scene_that_takes_minutes_is_rendered_in_short_blocks(monkeypatch):
    """Between two of them, Ctrl-C is heard: where a sample takes 10 ms, within a second."""
    sizes, block = [], Simulation.render_block

    def slow(self, out, trace=None):
        sizes.append(len(out))
        time.sleep(0.01 * len(out))
        block(self, out, trace)

    monkeypatch.setattr(Simulation, "render_block", slow)
    engine.render(engine.load(BALL), seconds=0.005)
    assert sum(sizes) == 221 and max(sizes) <= 64 and sizes[-2] <= 8


def test_a_failed_write_keeps_the_old_file(tmp_path, monkeypatch, capsys):
    """The target is replaced only by a whole file."""
    out = tmp_path / "a.wav"
    out.write_bytes(b"precious")

    def fail(*_):
        raise OSError("disk full")

    monkeypatch.setattr(soundfile.SoundFile, "write", fail)
    assert main.main([BALL, "-o", str(out), "--seconds", "0.1"]) == 1
    assert "cannot write" in capsys.readouterr().err
    assert out.read_bytes() == b"precious"
    assert [p.name for p in tmp_path.iterdir()] == ["a.wav"]


def test_a_silent_patch_says_so(tmp_path, capsys):
    (tmp_path / "p.toml").write_text('[[body]]\nname = "b"\nkind = "mass"\nmass = 1\n[[pickup]]\nbody = "b"\n')
    assert main.main([str(tmp_path / "p.toml"), "-o", str(tmp_path / "a.wav"), "--seconds", "0.1"]) == 0
    assert "silent" in capsys.readouterr().out


def test_a_rendering_slower_than_real_time_is_no_alarm(capsys):
    """A file need not be rendered in real time; what would make the patch playable is in the details."""
    rendering = engine.render(engine.load(ROOT / "patches" / "tanpura.toml"), seconds=0.1)
    slow = {"patch": "tanpura.toml", "output": "tanpura.wav", "gain_db": 0.0, "peak_file": 0.9, "real_time_factor": 0.4}
    console.print_summary(rendering.stats.as_dict() | slow, [])
    brief = capsys.readouterr().out
    assert "speed              slower than real time: 0.4 ×\n" in brief and "TOO SLOW" not in brief
    assert "subsystem" not in brief
    console.print_summary(rendering.stats.as_dict() | slow, [], verbose=True)
    text = "the coupled subsystem of string has 80 modes and 16 contact points; about 25 modes would be fast enough"
    assert f"to play it live    {text}" in capsys.readouterr().out
    console.print_summary(rendering.stats.as_dict() | slow | {"real_time_factor": 7.0}, [], verbose=True)
    says = capsys.readouterr().out
    assert "7 × real time" in says and "to play it live" not in says


def test_explain_tells_what_is_built_and_what_is_not(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    path = str(ROOT / "patches" / "felt_arpeggio.toml")
    assert main.main(["inspect", path, "--seconds", "0.5", "--json"]) == 0
    found = json.loads(capsys.readouterr().out)["explain"]
    assert len(found["islands"]) == 6
    for island in found["islands"]:
        assert (island["modes"], island["contacts"], island["solver"]) == (2, 1, "scalar")
        assert sum(island["activity"].values()) == pytest.approx(1.0)
        assert 0 < island["ns_mean"] <= island["ns_busiest"]
    assert found["effects"]["loss"] == "compiled in"
    assert found["effects"]["gravity"].startswith("left out: ")
    assert main.main(["inspect", path, "--seconds", "0.5"]) == 0
    told = capsys.readouterr().out
    assert found["kernel"] in told and "bar_c, hammer_c" in told
    assert not list(tmp_path.iterdir())


def test_the_worst_case_is_that_of_a_short_block(capsys):
    """A hammer touches for 2 ms, after which the string is cheap."""
    assert main.main(["inspect", "piano_c4", "--seconds", "0.5", "--json"]) == 0
    island = json.loads(capsys.readouterr().out)["explain"]["islands"][0]
    assert island["ns_busiest"] > 3 * island["ns_mean"]
    assert main.main(["inspect", "piano_c4", "--seconds", "0.1"]) == 0
    table = capsys.readouterr().out
    assert "worst case" in table and "estimated" not in table


def test_explain_names_what_cannot_close_and_what_is_too_high(tmp_path, capsys):
    patch = tmp_path / "quiet.toml"
    patch.write_text(
        """
        [[body]]
        name = "a"
        kind = "modes"
        frequency = [100.0, 30000.0]
        sigma = [1.0, 1.0]
        points = { top = [1.0, 1.0] }
        [[contact]]
        name = "stop"
        body = "a"
        at = "top"
        barrier = 1.0
        stiffness = 1e6
        exponent = 1.5
        [[pickup]]
        body = "a"
        at = "top"
        """,
        "utf-8",
    )
    assert main.main(["inspect", str(patch), "--seconds", "0.1", "--json"]) == 0
    found = json.loads(capsys.readouterr().out)["explain"]
    assert found["contacts_left_out"] == ["stop: too little energy to close it"]
    assert found["islands"][0]["modes_dropped"] == 1
