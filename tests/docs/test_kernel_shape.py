"""The shape of the engine: ceilings that fall with each change, and what is counted."""

import ast
import re

import pytest
from kernel_shape import (
    NAMED_EFFECTS,
    ROOT,
    Counts,
    files_that_know,
    find_writing_predicates,
    identifiers_of,
    main,
    measure_engine,
    table_of,
)

ENGINE = ROOT / "engine"

SOURCE = """
def press(point, force):
    point[3] = force

def is_pressed(friction, forces, state):
    for k in range(4):
        point = state.friction[k]
        press(point, forces[k])
    return True

def is_far(near, k):
    found = near.is_far[k]
    return found

def are_all_far(near, state):
    count = 0
    for row in state.rows:
        count += row
    return count == 0

def leaves_out(near):
    '''True if contacts are left out.'''
    near.until += 1
    return True

def keep(near):
    near.until = 1
"""


@pytest.fixture(scope="module")
def counts() -> Counts:
    return measure_engine()


def test_predicates_that_write_are_found_also_through_what_they_call():
    trees = {"kernel/run/made_up": ast.parse(SOURCE)}
    assert find_writing_predicates(trees) == ["kernel/run/made_up.is_pressed", "kernel/run/made_up.leaves_out"]


def test_a_file_knows_an_effect_by_its_identifiers_and_the_names_that_it_quotes():
    sources = {
        "patch/rules": "def check(table):\n    return table.friction",
        "live/reload": "from engine.patch import bristles",
        "assembly/friction": "friction = 1",
        "export/page": "# friction\nlength = 'friction of a bow'",
        "assembly/ends": "extension = 2",
        "report/plot": "draw(tension=2)",
        "live/voices": "sections = ('friction', 'contact')",
    }
    trees = {name: ast.parse(text) for name, text in sources.items()}
    assert files_that_know("friction", trees) == ["patch/rules", "live/reload", "live/voices"]
    assert files_that_know("stretching", trees) == ["report/plot"]
    assert NAMED_EFFECTS.keys() == {"friction", "stretching", "connections"}


def test_the_shape_is_no_worse_than_it_was(counts):
    """`python -m tests.docs.kernel_shape` prints what there is, and with --places where."""
    assert counts.kernel_lines > 0 and counts.none_tests  # or nothing was counted
    ceilings = {
        "lines of the kernel": 9_118,
        "lines of the engine": 55_400,  # 1700 of them for files, 1100 for rigs and tunings, 1100 for plug-ins, 800 for
        # films, labels, bends of notes, restitution and MIDI ports of JACK
        "functions of more than 6 arguments": 8,
        "predicates of the kernel that write": 0,
        "files that know friction": 32,
        "files that know stretching": 42,
        "files that know connections": 60,
        "branches on an effect or an ability": 33,
        "tests of the constant of effects": 67,
        "functions of the kernel that test for None": 19,
    }
    table = dict(table_of(counts))
    assert table.keys() == ceilings.keys()
    assert {name: number for name, number in table.items() if number > ceilings[name]} == {}


FELT = re.compile(r"felt_|_felt|FeltNumber|relaxes|relaxation", re.IGNORECASE)  # identifiers of felt with memory


def test_a_law_is_known_to_the_files_that_the_guide_lists_and_no_others():
    """Of felt with memory: at most six files of the engine that were there before."""
    listed = (ROOT / "docs" / "extending.md").read_text("utf-8")
    listed = listed[listed.index("<!-- files:felt -->") : listed.index("<!-- /files:felt -->")]
    files = re.findall(r"`engine/([\w/]+)\.py`( \(new\))?", listed)
    sources = {path.relative_to(ROOT / "engine").with_suffix("").as_posix(): path for path in ENGINE.rglob("*.py")}
    knowing = {name for name, path in sources.items() if FELT.search(" ".join(identifiers_of(path)))}
    assert knowing == {name for name, _ in files}
    assert sum(not is_new for _, is_new in files) <= 6


def test_the_table_has_every_count(capsys):
    main([])
    printed = capsys.readouterr().out
    for name in ("lines of the kernel", "files that know friction", "functions of the kernel that test for None"):
        assert name in printed
