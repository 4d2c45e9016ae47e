"""What guides and docstrings name exists: modules and their contents, files, and what links lead to."""

import ast
import importlib
import re
from collections.abc import Iterator
from pathlib import Path

import pytest
from conftest import ROOT
from source_trees import tree_of

GUIDES = [ROOT / "README.md", *sorted((ROOT / "docs").glob("*.md"))]  # the changelog has names of before, too
SOURCES = [path for room in ("engine", "bench", "tests") for path in sorted((ROOT / room).rglob("*.py"))]
PACKAGES = sorted(path.parent.name for path in (ROOT / "engine").glob("*/__init__.py"))
DOTTED = re.compile(r"(?<![\w./-])(?:engine|fdh)(?:\.[A-Za-z_]\w*)+")
IN_PACKAGE = re.compile(rf"`((?:{'|'.join(PACKAGES)})\.[a-z_]\w*)`")  # as docs/architecture.md has them
FILE = re.compile(r"(?<![\w/.$:{}<>*-])((?:[\w-]+/)+[\w.-]+\.(?:py|md|toml|csv|png|json|npz|zip|ipynb|svg))\b")
FOLDERS = ROOT, ROOT / "docs", ROOT / "engine"
CODE = re.compile(r"^```.*?^```$", re.MULTILINE | re.DOTALL)
LINK = re.compile(r"\]\(([^)#\s]+)[^)]*\)")
DIFF = re.compile(r"^```diff\n.*?^```$", re.MULTILINE | re.DOTALL)  # names files as git does
FILES = {"engine.py", "fdh.h", "fdh.c", "fdh.exe"}
OF_THE_READER = {"hardness/index.csv"}  # files that the reader of a guide makes


def docstrings(path: Path) -> Iterator[str]:
    """The docstrings of a file, each with the name of what it is of."""
    for node in ast.walk(tree_of(path)):
        if isinstance(node, ast.Module | ast.ClassDef | ast.FunctionDef | ast.AsyncFunctionDef):
            yield ast.get_docstring(node) or ""


def texts(path: Path) -> list[str]:
    """What a file tells its readers."""
    if path.suffix == ".py":
        return list(docstrings(path))
    return [DIFF.sub("", path.read_text("utf-8"))]


def exists(name: str) -> bool:
    """Whether there is something of a dotted name: a module, or what a module or a class has."""
    parts = name.split(".")
    for length in range(len(parts), 0, -1):
        try:
            value = importlib.import_module(".".join(parts[:length]))
        except ModuleNotFoundError:
            continue
        for part in parts[length:]:
            fields = getattr(value, "model_fields", {}) | getattr(value, "__annotations__", {})
            if not hasattr(value, part):
                return part in fields
            value = getattr(value, part)
        return True
    return False


def place(path: Path) -> str:
    return path.relative_to(ROOT).as_posix()


@pytest.mark.parametrize("folder", sorted({path.parent for path in [*GUIDES, *SOURCES]}), ids=place)
def test_names_and_files_that_are_named_exist(folder):
    """In each file of a folder."""
    read = [path for path in [*GUIDES, *SOURCES] if path.parent == folder]
    assert read
    assert [(place(path), wrong) for path in read if (wrong := names_of_nothing(path))] == []


def names_of_nothing(path: Path) -> list[str]:
    """Names of modules, of what they have, and of files, that a file speaks of and that do not exist."""
    text = "\n".join(texts(path))
    names = {name for name in DOTTED.findall(text) if name not in FILES}
    if path in GUIDES:
        names |= {f"engine.{name}" for name in IN_PACKAGE.findall(text)}
    files = set(FILE.findall(text)) - OF_THE_READER
    return [
        *(name for name in names if not exists(name)),
        *(file for file in files if not any((folder / file).exists() for folder in FOLDERS)),
    ]


@pytest.mark.parametrize("path", GUIDES, ids=place)
def test_links_of_guides_lead_somewhere(path):
    links = LINK.findall(CODE.sub("", path.read_text("utf-8")))
    assert not [link for link in links if "://" not in link and not (path.parent / link).exists()]


def test_a_name_that_does_not_exist_is_found():
    assert (
        exists("engine.kernel.interactions.one_way_drive.clear_drive")
        and exists("engine.Rendering.plot")
        and exists("fdh.load")
        and exists("fdh.offline.trace.TraceArrays.positions")
    )
    assert exists("engine.offline.render.RenderedArrays.audio") and exists("engine.patch.scene.Scene.body")
    assert (
        not exists("engine.assembly.island_order")
        and not exists("engine.Take")
        and not exists("engine.api.rendering.x")
    )
    assert FILE.findall(
        "see kernel/interactions/one_way_drive.py and (docs/bench.md), not a/*.py, FOLDER or {path}/x.py"
    ) == [
        "kernel/interactions/one_way_drive.py",
        "docs/bench.md",
    ]
