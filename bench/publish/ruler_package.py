"""`uv run python -m bench ruler_package FOLDER`: write the problems, their references and the scorer as a package of
their own, contact_ruler, which needs NumPy alone."""

import re
import shutil
import sys
from pathlib import Path

from bench.publish.report import ROOT
from bench.ruler.contact_ruler.library import VERSION

SOURCES = ROOT / "bench" / "ruler" / "package"  # what is beside the modules
MODULES = ROOT / "bench" / "ruler" / "contact_ruler"
OF_THE_ENGINE = {  # modules that the scorer shares with the engine, and what they are called in the package
    "engine.analysis.metrics": "metrics",
    "engine.offline.statistics_base": "statistics_base",
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
    modules = {path.stem: path for path in MODULES.glob("*.py")}
    modules |= {name: ROOT.joinpath(*module.split(".")).with_suffix(".py") for module, name in OF_THE_ENGINE.items()}
    for name, path in modules.items():
        (package / f"{name}.py").write_text(rename_imports(path.read_text("utf-8")), "utf-8")
    shutil.copytree(MODULES / "references", package / "references", dirs_exist_ok=True)
    for name in ("README.md", "CITATION.cff", "leader_board.csv", "verlet.py"):
        shutil.copy(SOURCES / name, folder)
    shutil.copy(ROOT / "LICENSE", folder)
    (folder / "pyproject.toml").write_text(PROJECT, "utf-8")


def rename_imports(source: str) -> str:
    """Return the source of a module with the names that modules have in the package."""
    for module, name in OF_THE_ENGINE.items():
        source = re.sub(rf"\b{re.escape(module)}\b(?!\.)", f"contact_ruler.{name}", source)
    return source.replace("bench.ruler.contact_ruler", "contact_ruler")
