"""The problems of the ruler as a package of their own, and the leader board."""

import csv
import hashlib
import re
import subprocess
import sys

import pytest
from conftest import ROOT

from bench.publish.ruler_package import SOURCES, main
from bench.ruler.contact_ruler import NAMES
from bench.ruler.contact_ruler.leader_board import COLUMNS, MEASURES
from bench.ruler.contact_ruler.library import FOLDER, VERSION

DIGEST = {
    "1.0": "fe16f1acc57f881d3c68b82fb234374e6485f2b6552c3722840d10dd4aa3d016",
    "1.1": "17f1ceb33af50788a910dc17528abb52fef2d9709d4fcce3d1fd60d73ee12970",
    "1.2": "6024688f623ac7810e6f78d109439434ada18dfc21b5febcc6fe56699ff759b3",
}  # of digests.json, by version: other numbers need another version
BOARD = SOURCES / "leader_board.csv"


def run(folder, *words: str) -> str:
    done = subprocess.run(
        [sys.executable, *words], cwd=folder, capture_output=True, text=True, timeout=120, check=False
    )
    assert done.returncode == 0, done.stderr
    return done.stdout


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    path = tmp_path_factory.mktemp("package")
    assert main([str(path)]) == 0
    return path


def test_the_package_needs_nothing_of_the_engine(folder):
    listed = run(folder, "-m", "contact_ruler")
    assert [line.split()[0] for line in listed.splitlines()] == list(NAMES)
    engine = '[name for name in sys.modules if name.partition(".")[0] == "engine"]'
    assert run(folder, "-c", f"import sys, contact_ruler, contact_ruler.leader_board; print({engine})") == "[]\n"
    assert f'version = "{VERSION}"' in (folder / "pyproject.toml").read_text("utf-8")
    assert f'version: "{VERSION}"' in (folder / "CITATION.cff").read_text("utf-8")


def test_the_example_of_the_page_runs_without_the_engine(folder):
    (example,) = re.findall(r"^```python\n(.*?)^```$", (ROOT / "docs" / "ruler.md").read_text("utf-8"), re.M | re.S)
    assert run(folder, "-c", example) == ""


@pytest.mark.hard
@pytest.mark.parametrize("name", ["barrier", "walls", "stretching_string"])
def test_the_example_gives_its_row_of_the_board(folder, name):
    (row,) = csv.reader(run(folder, "verlet.py", name).splitlines())
    (known,) = [
        row for row in csv.reader(BOARD.open(encoding="utf-8")) if row[1:4] == [name, "Störmer-Verlet", "1 step"]
    ]
    for measure in ("motion", "force", "bands_db", "pull"):
        place = len(COLUMNS) + MEASURES.index(measure)
        assert float(row[place]) == pytest.approx(float(known[place]), rel=0.01, abs=1e-12, nan_ok=True)


def test_rows_of_the_board_are_complete():
    header, *rows = csv.reader(BOARD.open(encoding="utf-8"))
    assert header == [*COLUMNS, *MEASURES] and rows
    for row in rows:
        values = dict(zip(header, row, strict=True))
        assert values["problem"] in NAMES and values["version"] in DIGEST and values["method"] and values["author"]
        assert values["failed"] or float(values["motion"]) >= 0.0


def test_other_numbers_need_another_version():
    assert hashlib.sha256((FOLDER / "digests.json").read_bytes()).hexdigest() == DIGEST[VERSION]
