"""Words that a patch may be written with: those of other programs, which are answered with a line and a page."""

import re

import pytest
from conftest import ROOT

from engine.cli import main
from engine.patch.limits_of_model import ANSWERS, PAGE

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


def test_each_answer_names_a_section_of_the_page():
    named = {answer.rpartition(f"{PAGE}#")[2].rstrip(")") for answer in ANSWERS.values()}
    assert named and named <= sections(PAGE)


def test_a_word_that_the_engine_has_is_no_foreign_word(tmp_path, capsys):
    """The nearest known key is still named."""
    error = said(tmp_path, capsys, PATCH.format(body="", pickup="gian = 2.0"))
    assert 'did you mean "gain"?' in error
