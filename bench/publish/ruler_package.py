"""`uv run python -m bench ruler_package FOLDER`: write the problems, their references and the scorer as a package of
their own, contact_ruler, which needs NumPy alone."""

import re
import shutil
import sys
from pathlib import Path

from bench.publish.report import ROOT
from engine.problems.library import FOLDER, VERSION

SOURCES = ROOT / "bench" / "ruler" / "package"
MODULES = {  # of the engine, and what they are called in the package
    **{f"engine.problems.{name}": name for name in ("library", "problem", "trajectory", "score", "leader_board")},
    "engine.analysis.metrics": "metrics",
    "engine.offline.statistics_base": "statistics_base",
    "engine.problems": "__init__",
}
PROJECT = f"""\
[project]
name = "contact-ruler"
version = "{VERSION}"
description = "Problems of collision with reference solutions, and the score of a method"
readme = "README.md"
requires-python = ">=3.10"
dependencies = ["numpy"]
license = "MIT"

[build-system]
requires = ["hatchling"]
build-backend = "hatchling.build"
"""


def main(words: list[str]) -> int:
    """Write the package; return the exit code. words: the folder"""
    if len(words) != 1:
        print(__doc__, file=sys.stderr)
        return 2
    write_package(Path(words[0]))
    print(Path(words[0]))
    return 0


def write_package(folder: Path) -> None:
    """Write the package to a folder, which may exist."""
    package = folder / "contact_ruler"
    package.mkdir(parents=True, exist_ok=True)
    for module, name in MODULES.items():
        path = ROOT.joinpath(*module.split(".")).with_suffix(".py")
        path = path if path.exists() else path.with_suffix("") / "__init__.py"
        (package / f"{name}.py").write_text(rename_imports(path.read_text("utf-8")), "utf-8")
    shutil.copytree(FOLDER, package / "references", dirs_exist_ok=True)
    shutil.copy(SOURCES / "__main__.py", package)
    for name in ("README.md", "CITATION.cff", "leader_board.csv", "verlet.py"):
        shutil.copy(SOURCES / name, folder)
    shutil.copy(ROOT / "LICENSE", folder)
    (folder / "pyproject.toml").write_text(PROJECT, "utf-8")


def rename_imports(source: str) -> str:
    """Return the source of a module with the names that modules have in the package."""
    for module, name in MODULES.items():
        renamed = "contact_ruler" if name == "__init__" else f"contact_ruler.{name}"
        source = re.sub(rf"\b{re.escape(module)}\b(?!\.)", renamed, source)
    return source
