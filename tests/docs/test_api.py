"""docs/api.md and docs/cli.md: they are those of the docstrings and parsers as they are, and every example works."""

import doctest
import inspect

import pytest

import engine
from bench.publish import cli
from bench.publish.api import PAGE, compose_page, documented

DOCUMENTED = dict(documented())
WITH_EXAMPLES = [name for name, value in DOCUMENTED.items() if ">>>" in (inspect.getdoc(value) or "")]


def test_the_page_is_that_of_the_docstrings():
    assert PAGE.read_text("utf-8") == compose_page(), "a docstring has changed: uv run python -m bench api"


def test_the_page_of_commands_is_that_of_the_parsers():
    assert cli.PAGE.read_text("utf-8") == cli.compose_page(), "an option has changed: uv run python -m bench cli"


def test_every_public_name_is_on_the_page():
    assert {f"fdh.{name}" for name in engine.__all__} <= set(DOCUMENTED)
    assert all(inspect.getdoc(value) for value in DOCUMENTED.values())


@pytest.mark.hard_for("fdh.run_sweep", "Rendering.save", "fdh.read_sweep", "fdh.AudioInput", "Rendering.plot")
@pytest.mark.parametrize("name", WITH_EXAMPLES)
def test_every_example_works(name, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    text, flags = inspect.getdoc(DOCUMENTED[name]), doctest.ELLIPSIS | doctest.NORMALIZE_WHITESPACE
    example, said = doctest.DocTestParser().get_doctest(text, {}, name, None, 0), []
    result = doctest.DocTestRunner(optionflags=flags).run(example, out=said.append)
    assert result.attempted > 0 and result.failed == 0, "".join(said)
