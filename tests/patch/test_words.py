"""Words that a patch may be written with: those of other programs, which are answered with a line and a page."""

import itertools
import re
import tomllib

import pytest
from conftest import PATCHES, ROOT

import engine
from engine.cli import main
from engine.patch.keyword_hints import PAGES
from engine.patch.limits_of_model import ANSWERS, PAGE
from engine.patch.scene import scene_of_document

PATCH = """[[body]]
name = "b"
kind = "mass"
mass = 1.0
{body}

[[pickup]]
body = "b"
{pickup}
"""


def said(tmp_path, capsys, text: str) -> str:
    """What is said of a patch that is refused."""
    patch = tmp_path / "words.toml"
    patch.write_text(text, "utf-8")
    assert main.main(["check", str(patch)]) == 2
    return capsys.readouterr().err


def sections(page: str) -> set[str]:
    """The anchors of the headings of a page."""
    headings = re.findall(r"^#+ (.*)$", (ROOT / page).read_text("utf-8"), re.MULTILINE)
    return {re.sub(r"[^\w -]", "", heading).lower().replace(" ", "-") for heading in headings}


@pytest.mark.parametrize("word", ["bow", "friction", "noise", "reverb", "reed", "sine", "mic", "torsion", "hysteresis"])
@pytest.mark.parametrize("section", ["body", "event"])
def test_kinds_that_are_not_there_are_answered(word, section, tmp_path, capsys):
    table = f'[[{section}]]\nname = "c"\nbody = "b"\nkind = "{word}"\ntime = 0.0\n'
    error = said(tmp_path, capsys, table + PATCH.format(body="", pickup=""))
    assert f'.kind: unknown kind "{word}"; {ANSWERS[word]}' in error


@pytest.mark.parametrize("word", ["pan", "scrape", "volume", "lfo", "Reverb", "fade-in"])
def test_keys_and_tables_that_are_not_there_are_answered(word, tmp_path, capsys):
    answer = ANSWERS[word.lower().replace("-", "_")]
    error = said(tmp_path, capsys, PATCH.format(body=f"{word} = 0.3", pickup=""))
    assert f"words.toml:5 body[0].{word}: unknown key; {answer}" in error
    error = said(tmp_path, capsys, PATCH.format(body="", pickup="") + f"[{word}]\nmix = 0.5\n")
    assert f"{word}: unknown key; {answer}" in error


KINDS = re.compile(r'kind = "(\w+)"')
SOME = [p for p in PATCHES if p.stem in ("guitar", "marble_on_a_bell", "bowed_vibraphone", "buzzing_reed", "piano_c2")]
WRONG = ["glass", "bowl", "bell", "plank", "shel", "bor", "strin", "boddy", "pulses", "springy"]


@pytest.mark.hard_for("guitar", "bowed_vibraphone")
@pytest.mark.parametrize("path", SOME, ids=lambda p: p.stem)
def test_an_unknown_kind_is_said_alone(path):
    """Of bodies, losses, connections, forces, events and controls: nothing of keys that one kind or the other has not,
    nor of tables that refer to it."""
    text = path.read_text("utf-8")
    kinds = list(KINDS.finditer(text))
    assert kinds
    for match, wrong in itertools.product(kinds, WRONG):
        with pytest.raises(engine.PatchError) as refused:
            scene_of_document(
                tomllib.loads(text[: match.start(1)] + wrong + text[match.end(1) :]), path.parent, "p.toml"
            )
        (fault,) = refused.value.faults
        assert fault.path.endswith(".kind") and fault.message.startswith(f'unknown kind "{wrong}"; ')
        assert "docs/" in fault.message


def test_an_unknown_kind_names_the_nearest_and_the_page(tmp_path, capsys):
    table = '[[body]]\nname = "c"\nkind = "{}"\nlength = 1.0\n'
    for wrong, says in {
        "plank": 'unknown kind "plank"; did you mean "plate"? (docs/patches.md#bodies-body)',
        "pipes": 'unknown kind "pipes"; the known ones are mass, oscillator,',
        "glass": f'unknown kind "glass"; {ANSWERS["glass"]}',
        "tine": 'unknown kind "tine"; kind = "bar"',
    }.items():
        error = said(tmp_path, capsys, table.format(wrong) + PATCH.format(body="", pickup=""))
        assert says in error and len(error.splitlines()) == 1


def test_the_pages_of_kinds_are_there():
    for page in PAGES.values():
        file, _, anchor = page.partition("#")
        assert anchor in sections(file)


def test_a_misspelt_kind_still_shows_what_else_is_wrong(tmp_path, capsys):
    error = said(tmp_path, capsys, PATCH.format(body="", pickup="").replace('"mass"\nmass = 1', '"mas"\nmass = -1'))
    assert 'did you mean "mass"?' in error and "body[0].mass: -1.0 is out of range" in error


def test_each_answer_names_a_section_of_the_page():
    named = {answer.rpartition(f"{PAGE}#")[2].rstrip(")") for answer in ANSWERS.values()}
    assert named and named <= sections(PAGE)


def test_a_word_that_the_engine_has_is_no_foreign_word(tmp_path, capsys):
    """The nearest known key is still named."""
    error = said(tmp_path, capsys, PATCH.format(body="", pickup="gian = 2.0"))
    assert 'did you mean "gain"?' in error
