"""A patch may be given by the name of a shipped one, from any folder; and the ways in which the program is started."""

import os
import subprocess
import sys
from pathlib import Path

import pytest
import soundfile
from conftest import PATCHES, ROOT, exit_code

import engine
from engine import files
from engine.patch.reader import PatchError
from engine.wording import program_name

MASS = '[[body]]\nname = "b"\nkind = "mass"\nmass = 1.0\nvelocity = 1.0\n[[pickup]]\nbody = "b"\n'


@pytest.mark.hard
def test_all_shipped_patches_are_loaded_by_name(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert files.shipped_names() == [path.stem for path in PATCHES]
    assert all(engine.load(path.stem) == engine.load(path) for path in PATCHES)
    with pytest.raises(PatchError, match=r"tanpora: no such file or shipped patch; did you mean tanpura\?"):
        engine.load("tanpora")


def test_a_file_wins_over_a_shipped_name_and_a_folder_does_not(tmp_path, monkeypatch):
    """A sweep of a shipped patch writes a folder of its name, and goes on when it is started again."""
    monkeypatch.chdir(tmp_path)
    Path("bouncing_ball").mkdir()
    assert files.find_patch("bouncing_ball") == ROOT / "patches" / "bouncing_ball.toml"
    Path("tanpura").write_text(MASS, "utf-8")
    assert files.find_patch("tanpura") == Path("tanpura")
    assert engine.load("tanpura").body[0].name == "b"
    for name in ("./marimba", "marimba.toml", "../marimba", "patch.schema", "", "templates/ball", "a\0b"):
        assert files.find_patch(name) == Path(name)


@pytest.mark.parametrize("command", [["render"], []])
def test_a_shipped_patch_is_rendered_by_name(tmp_path, monkeypatch, capsys, command):
    monkeypatch.chdir(tmp_path)
    assert exit_code(*command, "bouncing_ball", "--seconds", "0.1") == 0
    assert soundfile.info("bouncing_ball.wav").frames == 4410
    assert capsys.readouterr().out.endswith("bouncing_ball.wav\n")


@pytest.mark.parametrize("words", [["check"], ["params"], ["inspect", "--seconds", "0.01"]])
def test_other_commands_take_the_name_too(tmp_path, monkeypatch, words):
    monkeypatch.chdir(tmp_path)
    assert exit_code(words[0], "bouncing_ball", *words[1:]) == 0
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize(
    ("started", "name"),
    [
        ("render.py", "render.py"),
        ("/somewhere/render.py", "render.py"),
        ("/usr/bin/fdh", "fdh"),
        ("C:/Scripts/fdh.exe", "fdh"),
        ("/lib/engine/__main__.py", "python -m engine"),
        ("/lib/fdh/__main__.py", "python -m fdh"),
        ("/lib/pytest/__main__.py", "fdh"),
        ("", "fdh"),
    ],
)
def test_messages_name_the_program_that_was_started(monkeypatch, capsys, started, name):
    monkeypatch.setattr(sys, "argv", [started])
    assert program_name() == name
    assert exit_code("play", "tanpura", "--trace", "a.npz") == 2
    said = capsys.readouterr().err
    assert said == f"{name} play: unrecognized arguments: --trace a.npz; --trace belongs to {name} render\n"


def test_the_engine_is_a_program(tmp_path):
    """As a module, from any folder; of an engine that is not installed, the version says so."""
    run = lambda *words: (
        subprocess.run(
            [sys.executable, *words],
            cwd=tmp_path,
            env=os.environ | {"PYTHONPATH": str(ROOT)},
            capture_output=True,
            text=True,
            check=True,
        ).stdout
    )
    assert run("-m", "engine", "--help").startswith("usage: python -m engine [-h] [--version] COMMAND ...")
    assert run("-m", "engine", "--version") == f"fdh {engine.__version__}\n"
    assert run(str(ROOT / "render.py"), "--version") == f"fdh {engine.__version__}\n"
    assert run("-S", "-c", "import engine; print(engine.__version__)") == "0+source\n"


def test_public_names_come_when_they_are_used():
    code = "import sys, engine; engine.__version__; print({'numba', 'numpy', 'pydantic'} & set(sys.modules))"
    done = subprocess.run([sys.executable, "-c", code], cwd=ROOT, capture_output=True, text=True, check=True)
    assert done.stdout == "set()\n"
    assert engine.Player.__module__ == "engine.api.player"
    assert (ROOT / "engine" / "py.typed").exists()
