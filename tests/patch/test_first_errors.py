"""What a newcomer may do wrong first, each as a program of its own: one line or two say what is wrong, and what would
be right."""

import ast
import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest
import soundfile
from conftest import ROOT, exit_code

from engine.cli import main

BALL = str(ROOT / "patches" / "bouncing_ball.toml")
WHY_DOUBLE = (
    "everything is rendered in double precision, because single precision was slower at 40, 400 and 4000 modes; "
    "leave it out"
)
GOOD = """[[body]]
name = "ball"
kind = "mass"
mass = 1.0
velocity = 1.0

[[pickup]]
body = "ball"
"""


def run(*words: str, cwd: Path | None = None, hide: tuple[str, ...] = ()) -> subprocess.CompletedProcess:
    """render.py as a program of its own, as if some modules were not installed."""
    code = f"import runpy, sys; sys.modules.update(dict.fromkeys({hide!r})); sys.argv = sys.argv[1:];"
    code += "sys.path.insert(0, sys.argv[0].rpartition('/')[0]); runpy.run_path(sys.argv[0], run_name='__main__')"
    start = [sys.executable, "-c", code] if hide else [sys.executable]
    command = [*start, str(ROOT / "render.py"), *words]
    told = {"capture_output": True, "text": True, "timeout": 120, "stdin": subprocess.DEVNULL}
    return subprocess.run(command, cwd=cwd, check=False, **told)


def refused(done: subprocess.CompletedProcess, *says: str, code: int = 2, lines: int = 1) -> None:
    """It ended with a code and in a few lines, which say these things."""
    assert done.returncode == code, done.stderr
    assert "Traceback" not in done.stderr and done.stdout == ""
    assert len(done.stderr.splitlines()) <= lines, done.stderr
    for part in says:
        assert part in done.stderr


# --- the file


@pytest.mark.hard
def test_the_patch_is_elsewhere(tmp_path):
    """The shipped one is named, wherever one is; and one here comes first."""
    refused(run("piano_c4.toml", cwd=tmp_path), "piano_c4.toml: no such file; did you mean piano_c4?")
    refused(run("render", "tanpora", cwd=tmp_path), "tanpora: no such file or shipped patch; did you mean tanpura?")
    refused(run("patches/piano_c4", cwd=ROOT), "did you mean patches/piano_c4.toml?")
    (tmp_path / "piano_c4.toml").write_text(GOOD)
    done = run("check", "pianoc4", "marimbo.toml", "qqq.toml", cwd=tmp_path)
    refused(done, "did you mean piano_c4.toml?", "did you mean marimba?", lines=3)
    assert "qqq.toml: no such file; give a patch, such as " in done.stderr


@pytest.mark.hard
def test_a_folder(tmp_path):
    refused(run("patches", cwd=ROOT), "patches: is a folder; give one of its patches, such as patches/ball_on_drum")


def test_no_patch():
    refused(run(), "give a PATCH, such as tanpura, or start one with render.py new NAME")


NO_PATCHES = {
    b"\xff\xfea\0": ": not a text file; a patch is TOML in UTF-8",
    b"RIFF\0\0\0\0WAVE": ": not a text file; a patch is TOML in UTF-8",
    b"# nothing yet\n": ": empty; render.py new NAME writes a first patch",
    None: ": is a folder; give a patch, a .toml file",
}
SLIPS = {
    ("mass = 1.0", "mas = 1.0"): ':4 body[0].mas: unknown key; did you mean "mass"?',
    ('"mass"', '"mas"'): ':3 body[0].kind: unknown kind "mas"; did you mean "mass"?',
    ('body = "ball"', 'body = "bal"'): ':8 pickup[0].body: no body is named "bal"; the bodies are "ball"',
    ("mass = 1.0", 'mass = "1.0"'): ':4 body[0].mass: "1.0" is not a number; mass, kg',
    ("mass = 1.0\n", ""): ":1 body[0].mass: this key is missing; give it: mass, kg",
    ("[[pickup]]", "[[pickups]]"): ':7 pickups: unknown key; did you mean "pickup"?',
    ("[[pickup]]", "[pickup]"): ":7 pickup: {'body': 'ball'} is not a table; write [[pickup]]",
    ("mass = 1.0", "mass = 1,0"): ":4: not valid TOML at column 9",
}


@pytest.mark.hard
def test_what_is_no_patch_and_slips_in_one(tmp_path):
    """One line for each, in the order of the files."""
    said = []
    for number, (content, says) in enumerate(NO_PATCHES.items()):
        path = tmp_path / f"no{number}"
        path.mkdir() if content is None else path.write_bytes(content)
        said.append(f"{path.name}{says}")
    for number, ((old, new), says) in enumerate(SLIPS.items()):
        assert old in GOOD
        (tmp_path / f"slip{number}").write_text(GOOD.replace(old, new))
        said.append(f"slip{number}{says}")
    names = [line.partition(":")[0] for line in said]
    done = run("check", *names, cwd=tmp_path)
    refused(done, lines=len(said))
    for line, wanted in zip(done.stderr.splitlines(), said, strict=True):
        assert line.startswith(wanted)


# --- the command


@pytest.mark.hard
def test_a_slip_in_a_command_or_an_option(tmp_path):
    refused(run("chekc", "x"), 'no command, file or shipped patch is called "chekc"; did you mean "check"')
    refused(run("parms"), 'did you mean "params"?')
    refused(run(BALL, "--gian", "3", cwd=tmp_path), "unrecognized arguments: --gian 3; did you mean --gain?")
    refused(run("params", BALL, "--jsn"), "did you mean --json?")
    refused(run(BALL, "--xyz"), "render.py render --help lists all options")
    (tmp_path / "chekc").write_text(GOOD)  # a patch may have any name
    (tmp_path / "mine.toml").write_text(GOOD)
    refused(run("mime", cwd=tmp_path), 'is called "mime"; did you mean "mine.toml"')
    names = '"tanpura", "tanpura_body" or "tanpura_drone"'
    refused(run("tanpora", cwd=tmp_path), f'is called "tanpora"; did you mean {names}?')
    refused(run("qqq", cwd=tmp_path), "render.py --help lists commands and shipped patches")
    assert run("check", "chekc", cwd=tmp_path).returncode == 0


@pytest.mark.hard
def test_help_names_the_commands():
    told = run("--help").stdout
    assert {line.split()[0] for line in told.splitlines() if line.startswith("    ")} >= set(main.build_parser()[1])
    assert all(run(name, "--help").returncode == 0 for name in main.build_parser()[1])


# --- what is written


@pytest.mark.hard
@pytest.mark.skipif(not Path("/proc/self").exists(), reason="no folder that refuses even root")
def test_folders_that_take_no_file(tmp_path):
    refused(run(BALL, "-o", "/proc/a.wav"), "--output: /proc cannot be written to; write elsewhere")
    refused(run(BALL, cwd=Path("/proc")), "the folder you are in cannot be written to", "--output FOLDER/bouncing_ball")
    refused(run(BALL, "--trace", "/proc/a.npz", cwd=tmp_path), "--trace: /proc cannot be written to")
    assert not list(tmp_path.iterdir())


@pytest.mark.hard
def test_the_output_is_a_folder(tmp_path):
    (tmp_path / "a.wav").mkdir()
    refused(
        run(BALL, "-o", "a.wav", cwd=tmp_path), "a.wav is a folder; give the name of a file, such as a.wav/sound.wav"
    )


@pytest.mark.parametrize(
    ("error", "says"),
    [
        (OSError(28, "No space left on device", ".a.wav.1.part"), "a.wav (no space left on device)"),
        (soundfile.LibsndfileError(2, "Error opening '.a.wav.1.part': "), "a.wav (System error.)"),
    ],
)
def test_a_full_disk(tmp_path, monkeypatch, capsys, error, says):
    def fail(*_, **__):
        raise error

    monkeypatch.setattr(soundfile.SoundFile, "write", fail)
    monkeypatch.chdir(tmp_path)
    assert main.main([BALL, "-o", "a.wav", "--seconds", "0.1"]) == 1
    assert capsys.readouterr().err.splitlines()[-1] == f"fdh: cannot write {says}"
    assert not list(tmp_path.iterdir())


def test_the_file_that_failed_is_named(tmp_path, monkeypatch, capsys):
    def fail(*_, **__):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(np, "savez", fail)
    monkeypatch.chdir(tmp_path)
    assert main.main([BALL, "-o", "a.wav", "--trace", "t.npz", "--seconds", "0.1"]) == 1
    assert "cannot write t.npz (no space left on device)" in capsys.readouterr().err
    assert [p.name for p in tmp_path.iterdir()] == ["a.wav"]


@pytest.mark.parametrize(("name", "subtype"), [("a.wav", "PCM_16"), ("a.wav", "PCM_24"), ("a.flac", None)])
def test_clipped_samples_are_counted(tmp_path, capsys, name, subtype):
    """And the gain that is said to fit fits, and no more than a tenth of a dB less than needed."""
    words = [BALL, "-o", str(tmp_path / name), "--seconds", "0.3", *(["--subtype", subtype] if subtype else [])]
    assert main.main([*words, "--gain", "0", "--json"]) == 0
    out, err = capsys.readouterr()
    stats = json.loads(out)
    assert np.abs(soundfile.read(tmp_path / name)[0]).max() <= 1.0 < stats["peak_file"]
    assert 0 < stats["clipped"] < 13_230
    said = err.splitlines()[-1]
    assert f"{stats['clipped']} of 13230 samples are beyond ±1 and clipped; --gain " in said
    gain = said.split("--gain ")[1].split()[0]
    assert main.main([*words, "--gain", gain, "--json"]) == 0
    out, err = capsys.readouterr()
    assert json.loads(out)["clipped"] == 0 and "and clipped" not in err
    assert 0.98 < json.loads(out)["peak_file"] <= 1.0


def test_float_holds_all_and_players_clip(tmp_path, capsys):
    assert main.main([BALL, "-o", str(tmp_path / "a.wav"), "--seconds", "0.3", "--gain", "0"]) == 0
    out, err = capsys.readouterr()
    assert "players will clip it; --gain -" in out and "clipped" not in err
    assert np.abs(soundfile.read(tmp_path / "a.wav")[0]).max() > 1.5


# --- what is installed


def test_render_py_is_read_by_old_pythons():
    source = (ROOT / "render.py").read_text("utf-8")
    ast.parse(source, feature_version=(3, 6))
    for version, said in (((3, 8, 10), "3.8"), ((3, 10, 0), "3.10")):
        code = f"import sys; sys.version_info = {version}; sys.argv = ['render.py', 'a.toml']; exec({source!r})"
        done = subprocess.run([sys.executable, "-S", "-c", code], capture_output=True, text=True, check=False)
        refused(done, f"needs Python 3.11 or newer, and this is {said}", "uv run render.py a.toml", code=1, lines=2)


@pytest.mark.hard_for("matplotlib-words2---plot: needs matplotlib; run uv sync --extra plot-2")
@pytest.mark.parametrize(
    ("hidden", "words", "says", "code"),
    [
        ("numpy", [BALL], "numpy is not installed. This sets up everything", 1),
        ("pydantic", ["check", BALL], "pydantic is not installed. This sets up everything", 1),
        ("matplotlib", [BALL, "--plot"], "--plot: needs matplotlib; run uv sync --extra plot", 2),
    ],
)
def test_what_is_not_installed_is_named(tmp_path, hidden, words, says, code):
    refused(run(*words, cwd=tmp_path, hide=(hidden,)), says, code=code, lines=2)
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize(
    ("words", "says"),
    [
        ([BALL, "--midi", "no.mid"], "no.mid cannot be read as MIDI (no such file or directory)"),
        ([BALL, "--midi", "a.wav"], "a.wav cannot be read as MIDI"),
        (["replay", "a.wav"], "a.wav: cannot be read as a log (not a text file); give one that play --event-log wrote"),
        (["replay", "no.json"], "no.json: cannot be read as a log (no such file or directory)"),
    ],
)
def test_files_that_are_no_notes_and_no_log(tmp_path, monkeypatch, capsys, words, says):
    monkeypatch.chdir(tmp_path)
    soundfile.write("a.wav", np.zeros(9), 44_100)
    assert main.main([*words, "-o", "b.wav"]) == 2
    assert says in capsys.readouterr().err
    assert not Path("b.wav").exists()


@pytest.mark.hard
@pytest.mark.skipif(not Path("/proc/self").exists(), reason="no folder that refuses even root")
def test_a_cache_that_cannot_be_written(tmp_path):
    """Compiled code goes to a temporary folder, of this user's own."""
    environment = {**os.environ, "TMPDIR": str(tmp_path), "PYTHONPATH": str(ROOT)}
    for name, value in (("XDG_CACHE_HOME", "/proc/none"), ("NUMBA_CACHE_DIR", "/proc/none")):
        words = [sys.executable, "-c", "from engine.compiler.cache import kernel_folder; print(kernel_folder())"]
        done = subprocess.run(words, env=environment | {name: value}, capture_output=True, text=True, check=True)
        assert Path(done.stdout.strip()).parent.parent == tmp_path


@pytest.mark.hard
@pytest.mark.skipif(not Path("/proc/self").exists(), reason="no folder that refuses even root")
def test_a_render_without_a_cache_folder(tmp_path):
    """It compiles once, and works."""
    words = [sys.executable, str(ROOT / "render.py"), BALL, "-o", str(tmp_path / "a.wav"), "--seconds", "0.1"]
    environment = {**os.environ, "TMPDIR": str(tmp_path), "NUMBA_CACHE_DIR": "/proc/none"}
    subprocess.run(words, env=environment, capture_output=True, check=True)
    assert soundfile.info(tmp_path / "a.wav").frames == 4410


# --- files that are given by mistake


@pytest.mark.hard_for(
    'words0-"mine.toml" is not the name of a picture; end it in .png',
    'words1-"mine.toml" is not the name of a trace; end it in .npz',
    'words2-"mine.toml" is not the name of a log; end it in .json',
    "words3-. has other files in it; give an empty folder",
    "words6---output: is empty; give the name of a file",
)
@pytest.mark.parametrize(
    ("words", "what"),
    [
        (["--plot", "mine.toml", BALL], '"mine.toml" is not the name of a picture; end it in .png'),
        ([BALL, "--trace", "mine.toml"], '"mine.toml" is not the name of a trace; end it in .npz'),
        (["play", BALL, "--event-log", "mine.toml"], '"mine.toml" is not the name of a log; end it in .json'),
        (["sweep", BALL, "--vary", "body.ball.mass=1,2", "-o", "."], ". has other files in it; give an empty folder"),
        (["new", "."], '"." is not the name of a file; give a word, such as mine'),
        (["new", ""], '"" is not the name of a file; give a word, such as mine'),
        ([BALL, "-o", ""], "--output: is empty; give the name of a file"),
    ],
)
def test_a_file_is_not_written_over_by_a_slip(words, what, tmp_path):
    (tmp_path / "mine.toml").write_text(GOOD, "utf-8")
    refused(run(*words, cwd=tmp_path), what, lines=2)
    assert (tmp_path / "mine.toml").read_text("utf-8") == GOOD and len(list(tmp_path.iterdir())) == 1


def test_a_mark_of_windows_is_no_fault(tmp_path):
    path = tmp_path / "mine.toml"
    path.write_bytes(b"\xef\xbb\xbf" + GOOD.replace("\n", "\r\n").encode())
    assert main.main(["check", str(path)]) == 0


def test_ctrl_c_that_the_compiler_stumbles_over(capsys):
    """The compiler loses it in a callback, and fails of it later."""
    from engine.cli.progress import progress_feedback

    with pytest.raises(KeyboardInterrupt), progress_feedback(True):
        try:
            os.kill(os.getpid(), signal.SIGINT)
            time.sleep(0.1)
        except KeyboardInterrupt:
            pass
        raise RuntimeError("no compiled object yet")


@pytest.mark.parametrize(
    ("text", "what"),
    [
        (GOOD + 'body = "ball"\n', "a key is given twice"),
        (GOOD.replace("[[body]]", "[body]") + GOOD, "write [[body]]"),
        (GOOD.replace("mass = 1.0", "mass = 1,0"), "6.0, not 6,0; write units in a comment"),
        (GOOD.replace("mass = 1.0", "mass = 1 kg"), "write units in a comment, after #"),
    ],
)
def test_what_is_no_toml_says_what_would_be(text, what, tmp_path, capsys):
    path = tmp_path / "mine.toml"
    path.write_text(text, "utf-8")
    assert main.main(["check", str(path)]) == 2
    assert what in capsys.readouterr().err


@pytest.mark.parametrize(
    ("words", "what"),
    [
        (["inspect", "--price"], "fdh inspect: --price is now a command: fdh accuracy PATCH"),
        (["inspect", "-o", "x.wav"], "fdh inspect: unrecognized arguments: -o x.wav"),
        (["inspect", "--trace", "x.npz"], "--trace belongs to fdh render"),
        (["inspect", "--target-error", "1e-3"], "--target-error belongs to fdh render"),
        (["accuracy", "--target-error", "1e-3"], "--target-error belongs to fdh render"),
        (["accuracy", "--order", "4"], "--order belongs to fdh render, fdh play, fdh sweep, fdh inspect"),
        (["accuracy", "-o", "x.wav"], "fdh --output: requires --report; give that too"),
        (["accuracy", "--trace", "x.npz"], "--trace belongs to fdh render"),
        (["render", "--midi", "a.mid", "--trace", "x.npz"], "--trace: cannot be combined with --midi"),
        (["render", "--midi", "a.mid", "--cores", "2"], "--cores: cannot be combined with --midi"),
        (["render", "--seed", "3"], "--seed belongs to fdh sweep"),
        (["render", "--cluster", "here"], "--cluster belongs to fdh sweep"),
        (["play", "--plot"], "--plot belongs to fdh render, fdh accuracy"),
        (["play", "--trace", "x.npz"], "--trace belongs to fdh render"),
        (["play", "--vary", "seconds=1,2"], "--vary is now a command: fdh sweep PATCH --vary PATH=RANGE"),
        (["check", "--json"], "fdh check: unrecognized arguments: --json"),
        (["schema", "--seconds", "1"], "--seconds belongs to fdh render"),
    ],
)
def test_what_would_be_ignored_is_refused(words, what, capsys):
    """By the parser of the command, which names the command that an option belongs to."""
    patch = [] if words[0] == "schema" else [BALL]
    assert exit_code(words[0], *patch, *words[1:]) == 2
    assert what in capsys.readouterr().err


@pytest.mark.parametrize("option", ["--seconds", "--gain", "--block-size", "--device", "--vary", "--plot", "--midi"])
def test_a_log_says_all_that_a_replay_needs(option, capsys):
    assert exit_code("replay", "log.json", option, "1") == 2
    assert "fdh replay: " in capsys.readouterr().err


# --- the command line of before


@pytest.mark.parametrize(
    ("words", "what"),
    [
        ([BALL, "--live"], "fdh render: --live is now a command: fdh play PATCH"),
        ([BALL, "--price"], "fdh render: --price is now a command: fdh accuracy PATCH"),
        ([BALL, "--explain", "--json"], "fdh render: --explain is now a command: fdh inspect PATCH"),
        ([BALL, "--vary", "a=1,2"], "fdh render: --vary is now a command: fdh sweep PATCH --vary PATH=RANGE"),
        ([BALL, "--vary=a=1,2"], "fdh render: --vary is now a command: fdh sweep PATCH --vary PATH=RANGE"),
        (["--replay", "log.json"], "fdh render: --replay is now a command: fdh replay LOG.json"),
        (["--list-devices"], "fdh render: --list-devices is now a command: fdh devices"),
        ([BALL, "--error", "1e-3"], "fdh render: --error is now called --target-error"),
        ([BALL, "--log", "a.json"], "fdh render: --log is now called --event-log, and belongs to fdh play"),
        (["play", BALL, "--block", "64"], "fdh play: --block is now called --block-size"),
        (["play", BALL, "--log", "a.json"], "fdh play: --log is now called --event-log"),
        (["play", BALL, "--force"], "fdh play: --force is now called --ignore-speed"),
        (["sweep", BALL, "--sample", "9"], "fdh sweep: --sample is now called --random"),
        ([BALL, "--precision", "float32"], f"fdh render: --precision is gone: {WHY_DOUBLE}"),
        (["play", BALL, "--precision=float64"], f"fdh play: --precision is gone: {WHY_DOUBLE}"),
        (["inspect", BALL, "--precision=float32", "--json"], f"fdh inspect: --precision is gone: {WHY_DOUBLE}"),
    ],
)
def test_old_options_are_answered_with_the_new_ones(words, what, capsys):
    assert exit_code(*words) == 2
    assert capsys.readouterr().err == f"{what}\n"


def test_options_are_not_abbreviated(capsys):
    assert exit_code("sweep", BALL, "--vary", "seconds=1,2", "--samplera", "8000") == 2
    assert "unrecognized arguments: --samplera 8000; did you mean --samplerate?" in capsys.readouterr().err
