"""A folder of the user's may hold an engine.py or an engine/ of another kind: the program does not take it for its
own."""

import csv
import os
import subprocess
import sys
import sysconfig
from pathlib import Path

import pytest
from conftest import ROOT

FDH = Path(sysconfig.get_path("scripts")) / ("fdh.exe" if sys.platform == "win32" else "fdh")
PROGRAMS = {"fdh": [str(FDH)], "render.py": [sys.executable, str(ROOT / "render.py")]}
WRONG = "raise SystemExit('the engine of the user was imported')\n"


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """A folder with a module and a package that have the name of ours."""
    (tmp_path / "engine").mkdir()
    for path in (tmp_path / "engine.py", tmp_path / "engine" / "__init__.py", tmp_path / "engine" / "__main__.py"):
        path.write_text(WRONG)
    return tmp_path


def run(program: str, folder: Path, *words: str, **more: str) -> str:
    """What the program writes on standard output, run in a folder."""
    if program == "fdh" and not FDH.exists():
        pytest.skip("fdh is not installed")
    environment = {name: value for name, value in os.environ.items() if name != "PYTHONPATH"}
    environment |= more
    command = [*PROGRAMS[program], *words]
    done = subprocess.run(command, cwd=folder, env=environment, capture_output=True, text=True, timeout=120)
    assert done.returncode == 0 and "engine of the user" not in done.stdout + done.stderr, done.stderr
    return done.stdout


@pytest.mark.hard
@pytest.mark.parametrize("program", PROGRAMS)
def test_a_patch_is_rendered_beside_an_engine_of_the_user(program, folder):
    run(program, folder, "bouncing_ball", "--seconds", "0.1", "-o", "a.wav")
    assert (folder / "a.wav").stat().st_size > 10_000


@pytest.mark.hard
@pytest.mark.parametrize("program", PROGRAMS)
def test_processes_of_a_sweep_beside_an_engine_of_the_user(program, folder):
    varied = ["--vary", "body.ball.mass=0.1,0.2,0.4"]
    run(program, folder, "sweep", "bouncing_ball", *varied, "--seconds", "0.1", "--cores", "2", "-o", "balls")
    with open(folder / "balls" / "index.csv", newline="", encoding="utf-8") as file:
        assert [row["status"] for row in csv.DictReader(file)] == ["done"] * 3
