"""The README: short, and true."""

import csv
import re
import tomllib

from conftest import ROOT

import engine

TEXT = (ROOT / "README.md").read_text("utf-8")
MAX_LINES, MAX_CHARACTERS, MAX_WORDS = 110, 120, 900
CODE = dict(re.findall(r"^```(toml|python)\n(.*?)^```$", TEXT, re.MULTILINE | re.DOTALL))


def test_it_is_short():
    lines = TEXT.splitlines()
    assert len(lines) <= MAX_LINES and max(map(len, lines)) <= MAX_CHARACTERS and len(TEXT.split()) <= MAX_WORDS


def test_its_patch_sounds(tmp_path):
    rendering = engine.render(engine.load(tomllib.loads(CODE["toml"])), seconds=0.1)
    assert rendering.stats.trusted and rendering.stats.newton.solves > 0 and rendering.audio.any()


def test_its_python_runs(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    exec(compile(CODE["python"], "README.md", "exec"), {})
    duration, error = map(float, capsys.readouterr().out.split())
    assert 1e-4 < duration < 1e-2 and error < 1e-12
    assert (tmp_path / "soft.wav").exists()


def test_its_numbers_are_those_of_the_benchmark():
    """Errors and times of the piano string, at order 2 and at order 4, one step per sample."""
    with open(ROOT / "bench" / "results" / "first.csv", newline="", encoding="utf-8") as file:
        _, head, *rows = csv.reader(file)
    found = {row[0]: dict(zip(head, row, strict=True)) for row in rows}
    for order in ("order 2, 1 ×", "order 4, 1 ×"):
        error, time = (found[order][f"piano, C4: {what}"] for what in ("error", "ns"))
        assert re.search(rf"\b{error} at\s+{time} ns", TEXT), f"{order}: {error} at {time} ns"
