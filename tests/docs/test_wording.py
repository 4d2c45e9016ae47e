"""Words of docstrings, guides and messages: standard ones, in whole sentences."""

import ast
import re
from collections.abc import Iterator
from pathlib import Path

import pytest
from conftest import ROOT
from source_trees import tree_of

SOURCES = sorted((ROOT / "engine").rglob("*.py"))
GUIDES = [ROOT / "README.md", ROOT / "CONTRIBUTING.md", *sorted((ROOT / "docs").glob("*.md"))]
INDIRECT = re.compile(r"(What|How|Whether|As|Which|Where)\b")
RIDDLES = re.compile(
    r"\b(is heard|are heard|is told|are told|to be desired|plain step|errs|asked for|learnt|(?:nothing|cannot)"
    r"(?: can)? be told)\b",
    re.IGNORECASE,
)
QUOTED = re.compile(r"^Sources: .*$", re.MULTILINE)  # in the gallery: comments of patches


def docstring_nodes(tree: ast.Module) -> Iterator[ast.Expr]:
    """Yield the docstrings of a file, as nodes."""
    for node in ast.walk(tree):
        if isinstance(node, ast.Module | ast.ClassDef | ast.FunctionDef | ast.AsyncFunctionDef):
            if ast.get_docstring(node) is not None:
                assert isinstance(node.body[0], ast.Expr)
                yield node.body[0]


def docstrings(tree: ast.Module) -> list[str]:
    """Return the texts of all docstrings of a file."""
    return [ast.literal_eval(node.value) for node in docstring_nodes(tree)]


def messages(tree: ast.Module) -> list[str]:
    """Return the texts of a file that are not docstrings; of formatted ones, the fixed pieces."""
    known = {id(node.value) for node in docstring_nodes(tree)}
    constants = [node for node in ast.walk(tree) if isinstance(node, ast.Constant) and id(node) not in known]
    return [node.value for node in constants if isinstance(node.value, str)]


def place(path: Path) -> str:
    """Return the path of a file in the repository."""
    return path.relative_to(ROOT).as_posix()


@pytest.mark.parametrize("folder", sorted({path.parent for path in SOURCES}), ids=place)
def test_docstrings_begin_with_a_verb_or_a_noun_and_messages_are_no_riddles(folder):
    """In each file of a folder."""
    trees = {place(path): tree_of(path) for path in SOURCES if path.parent == folder}
    texts = [(path, text) for path, tree in trees.items() for text in docstrings(tree)]
    said = [(path, text) for path, tree in trees.items() for text in messages(tree)]
    assert texts
    assert [(path, text) for path, text in texts if INDIRECT.match(text)] == []
    assert [(path, text) for path, text in [*texts, *said] if RIDDLES.search(text)] == []


@pytest.mark.parametrize("path", GUIDES, ids=place)
def test_guides_are_no_riddles(path):
    assert not RIDDLES.findall(QUOTED.sub("", path.read_text("utf-8")))


def test_indirect_docstrings_and_riddles_are_found():
    tree = ast.parse('def f():\n    """What is heard."""\n    raise ValueError(f"{f} errs")\n')
    assert INDIRECT.match(docstrings(tree)[0]) and [text for text in messages(tree) if RIDDLES.search(text)] == [
        " errs"
    ]
    assert not INDIRECT.match("Assemble a scene.") and not RIDDLES.search("errors are learned")
