"""The wheel holds all that the command needs: built, installed into an environment of its own, and used elsewhere."""

import os
import shutil
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest
import soundfile
from conftest import PATCHES, ROOT

pytestmark = [
    pytest.mark.hard,
    pytest.mark.skipif(shutil.which("uv") is None, reason="no uv to build and install with"),
]
VERSION = tomllib.loads((ROOT / "pyproject.toml").read_text("utf-8"))["project"]["version"]


def uv(*words: str | Path) -> None:
    """Run uv; what it says is shown if it fails."""
    done = subprocess.run(["uv", *map(str, words)], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr


@pytest.fixture(scope="module")
def installed(tmp_path_factory) -> Path:
    """The folder of programs of an environment that has the wheel and nothing else of this project."""
    folder = tmp_path_factory.mktemp("wheel")
    uv("build", "--wheel", "--out-dir", folder, ROOT)
    (wheel,) = folder.glob("*.whl")
    uv("venv", "--python", sys.executable, folder / "venv")
    programs = folder / "venv" / ("Scripts" if sys.platform == "win32" else "bin")
    uv("pip", "install", "--python", programs / "python", wheel)
    return programs


@pytest.fixture
def elsewhere(tmp_path) -> Path:
    """A folder with the files of another project, some of which are called as ours are."""
    for name in ("render.py", "cli.py", "wording.py", "conftest.py"):
        (tmp_path / name).write_text("raise SystemExit('another project')\n")
    (tmp_path / "pyproject.toml").write_text('[project]\nname = "other"\nversion = "9"\n')
    for name in ("patches", "tests", "bench"):
        (tmp_path / name).mkdir()
    (tmp_path / "patches" / "other.toml").write_text("nonsense")
    return tmp_path


def run(installed: Path, folder: Path, program: str, *words: str) -> str:
    """What a program of the environment prints, in a folder; it ends well."""
    environment = {name: value for name, value in os.environ.items() if name not in ("PYTHONPATH", "VIRTUAL_ENV")}
    command = [str(installed / program), *words]
    done = subprocess.run(command, cwd=folder, env=environment, capture_output=True, text=True, check=False)
    assert done.returncode == 0, (words, done.stderr)
    return done.stdout


def test_the_command_works_from_any_folder(installed, elsewhere):
    run_here = lambda *words: run(installed, elsewhere, "fdh", *words)
    assert run_here("--version").startswith("fdh ")
    assert all(path.stem in run_here("--help") for path in PATCHES[:3])
    assert run_here("tanpura", "--seconds", "0.1").endswith("tanpura.wav\n")
    assert run_here("render", "tanpura", "--seconds", "0.1", "-o", "again.wav").endswith("again.wav\n")
    first, again = (soundfile.read(elsewhere / name)[0] for name in ("tanpura.wav", "again.wav"))
    assert len(first) == 4410 and (first == again).all()
    assert run_here("new", "mine").endswith("  fdh check mine.toml\n  fdh render mine.toml\n")
    assert "mine.toml: valid; " in run_here("check", "mine.toml")
    schema = (elsewhere / (elsewhere / "mine.toml").read_text("utf-8").split()[1]).resolve()
    assert (
        run_here("schema") == schema.read_text("utf-8") == (ROOT / "patches" / "patch.schema.json").read_text("utf-8")
    )
    vary = ["--vary", "contact.0.exponent=1.3,1.5", "--cores", "2", "--seconds", "0.02"]
    assert "2 of 2 done" in run_here("sweep", "tanpura", *vary, "-o", "set")


def test_the_package_works_from_any_folder(installed, elsewhere):
    python = lambda *words: run(installed, elsewhere, "python", *words)
    assert python("-m", "engine", "--help").startswith("usage: python -m engine ")
    told = python("-c", "import fdh; print(fdh.load('tanpura').title, fdh.__version__, fdh.__file__)")
    assert "tanpura" in told.lower() and str(ROOT) not in told
    assert python("-c", "import engine, fdh; print(fdh.Scene is engine.Scene)") == "True\n"
    assert python("-m", "fdh", "--version") == f"fdh {VERSION}\n"
    names = python("-c", "import engine.files as f; print(*f.shipped_names())")
    assert names.split() == [path.stem for path in PATCHES]
    marked = "import {0}, pathlib; print((pathlib.Path({0}.__file__).parent / 'py.typed').exists())"
    assert all(python("-c", marked.format(name)) == "True\n" for name in ("engine", "fdh"))


def test_nothing_but_the_package_is_installed(installed):
    (folder,) = {path.parent for path in installed.parent.rglob("fdh_engine-*.dist-info")}
    assert not [name for name in ("patches", "tests", "bench", "render.py") if (folder / name).exists()]
    for name in ("engine", "fdh"):
        beside = [path for path in (folder / name).iterdir() if not path.is_dir()]
        assert {path.name for path in beside} == {p.name for p in (ROOT / name).iterdir() if not p.is_dir()}


def test_the_citation_has_the_version():
    assert f"\nversion: {VERSION}\n" in (ROOT / "CITATION.cff").read_text("utf-8")
