"""The guides in docs: their commands run, one after the other, as a reader would type them; so does their Python."""

import csv
import functools
import os
import re
import shlex
import shutil
import subprocess
import sys
from pathlib import Path

import pytest
import soundfile
from conftest import PATCHES, ROOT, needs_alsa, needs_portaudio

import engine

GUIDES = ["first_patch", "bodies", "joining", "friction", "scheme", "accuracy", "files"]
BLOCK = re.compile(r"^```(\w+)\n(.*?)^```$", re.MULTILINE | re.DOTALL)


def follow(guide: str, folder: Path, environment: dict[str, str], root: Path = ROOT) -> str:
    """Do what a guide says, in a folder that has the patches and the guides; returns all that was printed."""
    for name in ("patches", "docs"):
        (folder / name).symlink_to(ROOT / name)
    told = {"cwd": folder, "env": os.environ | {"PYTHONPATH": str(root)} | environment}
    told |= {"capture_output": True, "text": True, "timeout": 900.0, "stdin": subprocess.DEVNULL}
    said = []
    for kind, text in BLOCK.findall((ROOT / "docs" / f"{guide}.md").read_text("utf-8")):
        commands: list[list[str]] = []
        if kind == "sh":
            lines = [line for line in text.splitlines() if line.startswith("uv run fdh ")]
            words = [shlex.split(line, comments=True)[3:] for line in lines]
            commands = [[sys.executable, "-m", "engine", *rest] for rest in words]
        elif kind == "python":
            commands = [[sys.executable, "-c", text]]
        elif kind == "toml":  # to be added to the patch that the guide has made
            with open(folder / "mine.toml", "a", encoding="utf-8") as file:
                file.write("\n" + text)
        elif kind == "diff":
            (root / "change.diff").write_text(text, "utf-8")
            commands = [["git", "apply", f"--directory={root.name}", str(root / "change.diff")]]
        for command in commands:
            done = subprocess.run(command, **told)
            assert done.returncode == 0, f"{guide}: {' '.join(command)}\n{done.stderr}"
            said.append(done.stdout)
    assert said, "the guide has nothing to do"
    return "".join(said)


@pytest.mark.hard
@pytest.mark.parametrize("guide", GUIDES)
@needs_portaudio
@needs_alsa
def test_what_a_guide_says_works(guide, tmp_path, file_device):
    assert "nan" not in follow(guide, tmp_path, file_device[0]).lower().split()


PAGES = [*sorted((ROOT / "docs").glob("*.md")), ROOT / "README.md", ROOT / "CONTRIBUTING.md"]
NOT_WORDS = "…", "&&", ">"  # of a command: what follows is another's, or left to the reader


def commands_of(page: Path, program: str) -> list[list[str]]:
    """Return the words after a program's name, of each command of a page: in its blocks and in its text."""
    text = page.read_text("utf-8")
    said = [line for kind, block in BLOCK.findall(text) if kind == "sh" for line in block.splitlines()]
    said += [inline.replace("\n", " ") for inline in re.findall(r"`([^`]+)`", BLOCK.sub("", text))]
    found = []
    for command in said:
        for after in re.findall(rf"(?:^|uv run |docs |&& |general ){program} (.*)", command):
            words = shlex.split(after, comments=True)
            found.append(words[: min((words.index(w) for w in NOT_WORDS if w in words), default=len(words))])
    return [words for words in found if words and words[0] != "COMMAND"]


@functools.cache
def names_of_bench() -> set[str]:
    """The measurements that `python -m bench` lists."""
    command = [sys.executable, "-m", "bench"]
    listed = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=True).stdout
    return {line.split()[0] for line in listed.partition("\n\n")[2].splitlines()} | {"all", "NAME"}


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.stem)
def test_every_command_of_a_page_is_one_with_such_options(page):
    """Those that no test runs too: `fdh` knows the command and the patch, and `bench` the name."""
    from engine.cli.main import DEFAULT, build_parser
    from engine.files import shipped_names

    _, parsers = build_parser()
    for words in commands_of(page, "fdh"):
        if words[0].startswith("--"):
            continue
        is_command = words[0] in parsers
        assert is_command or words[0] in (*shipped_names(), "PATCH") or words[0].endswith(".toml"), words
        options = parsers[words[0] if is_command else DEFAULT]._option_string_actions
        assert all(word.partition("=")[0] in options for word in words if re.match("--?[a-z]", word)), words
    sweeps = [words for words in commands_of(page, "fdh") if words[0] == "sweep" and "-o" in words]
    folders = {words[words.index("-o") + 1]: words for words in sweeps}
    assert all(folders[words[words.index("-o") + 1]] == words for words in sweeps), "each sweep needs its own folder"
    names = names_of_bench()
    assert "gallery" in names
    assert "render" in parsers
    for words in commands_of(page, "python -m bench"):
        assert set(words[:1]) <= names, words


@pytest.mark.hard
@needs_portaudio
@needs_alsa
def test_playing_live(tmp_path, file_device):
    """What was played is what its log says."""
    mido = pytest.importorskip("mido", reason="needs mido")
    track = mido.MidiTrack([mido.Message("note_on", note=60, velocity=80), mido.Message("note_off", note=60, time=480)])
    mido.MidiFile(tracks=[track]).save(tmp_path / "tune.mid")
    follow("live", tmp_path, file_device[0])
    rendering, again = (soundfile.read(tmp_path / f"{name}.wav", dtype="float32")[0] for name in ("take", "again"))
    assert rendering.any() and (rendering == again[: len(rendering)]).all()


def test_the_worked_examples_are_changes_of_the_engine_as_it_is(tmp_path):
    changes = [
        text for kind, text in BLOCK.findall((ROOT / "docs" / "extending.md").read_text("utf-8")) if kind == "diff"
    ]
    assert changes
    for n, text in enumerate(changes):
        (tmp_path / f"{n}.diff").write_text(text, "utf-8")
        done = subprocess.run(
            ["git", "apply", "--check", tmp_path / f"{n}.diff"], cwd=ROOT, capture_output=True, text=True
        )
        assert done.returncode == 0, done.stderr


@pytest.mark.hard
def test_the_worked_examples_of_a_law_and_of_an_effect(tmp_path):
    """The changes that the guide shows, made to a copy of the engine, whose kernel takes minutes to compile."""
    copy = tmp_path / "copy"
    copy.mkdir()
    for name in ("engine", "fdh"):
        shutil.copytree(ROOT / name, copy / name, ignore=shutil.ignore_patterns("__pycache__"))
    environment = {"NUMBA_CACHE_DIR": str(tmp_path / "cache")}
    assert "terminal velocity" in follow("extending", tmp_path, environment, copy)


CLAIMS_OF_THE_NOTEBOOK = """
assert felt.touches == 1 and 1.5e-3 < felt.duration < 2.5e-3 and round(felt.peak_force) == 12
assert rendering.stats.energy.error_max < 1e-12
assert duration.shape == centroid.shape == (3, 6)
assert (np.diff(duration, axis=1) < 0.0).all() and (np.diff(centroid, axis=1) > 0.0).all()  # with velocity
assert (np.diff(duration, axis=0) < 0.0).all() and (np.diff(centroid, axis=0) > 0.0).all()  # with stiffness
"""


@pytest.mark.hard
def test_the_notebook_runs(tmp_path):
    """From top to bottom, in a kernel of its own; it shows sounds and pictures, and what it says of them is true."""
    nbformat, nbclient = (pytest.importorskip(name, reason=f"needs {name}") for name in ("nbformat", "nbclient"))
    notebook = nbformat.read(ROOT / "docs" / "first_sound.ipynb", as_version=4)
    assert not any(cell.get("outputs") for cell in notebook.cells), "it is kept without what it shows"
    notebook.cells.append(nbformat.v4.new_code_cell(CLAIMS_OF_THE_NOTEBOOK))
    nbclient.NotebookClient(notebook, timeout=200, resources={"metadata": {"path": ROOT / "docs"}}).execute()
    shown = [kind for cell in notebook.cells for out in cell.get("outputs", []) for kind in out.get("data", {})]
    assert shown.count("text/html") == 2 and shown.count("image/png") == 2


@pytest.mark.parametrize("page", sorted((ROOT / "docs").glob("*.md")), ids=lambda path: path.stem)
def test_the_rows_of_a_table_are_as_long_as_its_head(page):
    """A row of another table stands out, as long as they have other columns."""
    text = re.sub(r"^```.*?^```$", "", page.read_text("utf-8"), flags=re.MULTILINE | re.DOTALL)
    tables = re.findall(r"(?:^\|.*\|$\n)+", text, re.MULTILINE)
    assert bool(tables) == ("| --- |" in text)
    for table in tables:
        rows = [re.sub(r"\\\||`[^`]*`", "", row).count("|") for row in table.splitlines()]
        assert set(rows) == {rows[0]}, table.splitlines()[next(i for i, n in enumerate(rows) if n != rows[0])]


@pytest.mark.hard
def test_the_gallery_is_that_of_the_patches():
    """Made of the patches as they are, with a sound and a picture of each, and the pieces; sounds fit in 9 MB. Each
    family has a page, and templates of things stand among them."""
    from bench.publish import mixed
    from bench.publish.gallery import PAGE, PICTURES, changed, mark, path_of, read_words
    from bench.publish.pieces import PIECES
    from bench.publish.sounds import LIMIT, SOUNDS

    (families, words), index = read_words(), PAGE.read_text("utf-8")
    assert {p.stem for p in PATCHES} < set(words) and len(words) >= 12
    assert {"bowl", "coin", "keys", "door", "chain", "bottle", "shake", "scrape"} <= set(words)
    for family in families:
        page = family.page.read_text("utf-8")
        assert f"[{family.title}]({family.page.name})" in index and family.about in page
        for name in family.patches:
            path = path_of(name)
            assert f"[{name}]({family.page.name}#{name})" in index and f"## {name}\n" in page
            assert mark(path) in index, f"{name} has changed: uv run python -m bench exhibit {name}"
            assert words[name]["listen"] in page and len(words[name]["try"]) == 2
            for trial in words[name]["try"]:
                assert trial["what"] in page and changed(path, trial["set"]) != engine.load(path)
            heard = soundfile.info(SOUNDS / f"{name}.ogg")
            assert heard.frames / heard.samplerate == pytest.approx(engine.load(path).seconds, abs=0.01)
            assert (PICTURES / f"{name}.png").read_bytes().startswith(b"\x89PNG")
            if "piece" in words[name]:
                assert f"audio/{name}_piece.ogg" in page and PIECES[words[name]["piece"]].about in page
    assert sum(p.stat().st_size for p in SOUNDS.iterdir()) < LIMIT
    pieces = {f"{name}_piece" for name in words if "piece" in words[name]}
    assert {p.stem for p in SOUNDS.iterdir()} == set(words) | pieces | {mixed.SOUND.stem}
    assert {p.stem for p in PICTURES.iterdir()} == set(words)
    assert mixed.insert(index) == index


def test_a_dozen_patches_sound_different():
    """By more than a tenth in pitch, decay or brightness, each from each."""
    with open(ROOT / "bench" / "results" / "gallery.csv", newline="", encoding="utf-8") as file:
        rows = [row[2:5] for row in list(csv.reader(file))[2:]]

    def apart(a: str, b: str) -> bool:
        if "none" in (a, b):
            return a != b
        return abs(float(a) - float(b)) > 0.1 * min(float(a), float(b))

    different: list[list[str]] = []
    for row in rows:
        if all(any(map(apart, row, other)) for other in different):
            different.append(row)
    assert len(different) >= 12
