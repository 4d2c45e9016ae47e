"""The shape of the kernel in numbers: `uv run python tests/docs/kernel_shape.py`. test_structure.py holds them."""

import ast
import re
from pathlib import Path
from typing import NamedTuple

KERNEL = Path(__file__).parents[2] / "engine" / "kernel"
DATA = "model", "state", "axes", "enums", "island_view"  # files that list what there is
# identifiers that show that a function knows an effect, and the files that are the effect's own
EFFECTS = {
    "weight": (re.compile(r"weight"), ("potential",)),
    "connections": (re.compile(r"connection"), ("connection", "connected", "near_contacts")),
    "contact loss": (re.compile(r"contact_loss|loss_rate"), ("contact_loss", "contact_law", "scalar_contact")),
}
MAX_ARGUMENTS = 6
OTHER_WAYS = "begin_flight", "step_saved_motion", "advance_free_masses"  # to advance a sample, without a StepOutcome


class Function(NamedTuple):
    """A function of the kernel."""

    file: str  # without its ending
    name: str
    arguments: int
    identifiers: frozenset[str]  # names and attributes in it, its arguments among them
    makes_outcome: bool  # whether it says what a step did


class Shape(NamedTuple):
    """What can be counted of the kernel."""

    lines: int
    files: int
    arrows: int  # from a file to another that it imports
    ways: int  # to advance a sample
    know: dict[str, int]  # functions outside an effect's own files that know it, by its name
    wide: int  # functions of more than MAX_ARGUMENTS arguments


def kernel_files() -> list[Path]:
    """Return all files of the kernel that have code."""
    return sorted(path for path in KERNEL.rglob("*.py") if path.stem != "__init__")


def functions_of(path: Path) -> list[Function]:
    """Return all functions of a file, those within others as parts of these."""
    tree = ast.parse(path.read_text("utf-8"))
    return [_describe(path.stem, node) for node in tree.body if isinstance(node, ast.FunctionDef)]


def _describe(file: str, node: ast.FunctionDef) -> Function:
    inner = list(ast.walk(node))
    names = {n.id for n in inner if isinstance(n, ast.Name)} | {n.attr for n in inner if isinstance(n, ast.Attribute)}
    names |= {n.arg for n in inner if isinstance(n, ast.arg)}
    calls = {n.func.id for n in inner if isinstance(n, ast.Call) and isinstance(n.func, ast.Name)}
    count = len(node.args.args) + len(node.args.kwonlyargs)
    return Function(file, node.name, count, frozenset(names), "StepOutcome" in calls)


def imports_of(path: Path) -> set[str]:
    """Return the files of the kernel that a file imports."""
    tree = ast.parse(path.read_text("utf-8"))
    modules = [node.module or "" for node in ast.walk(tree) if isinstance(node, ast.ImportFrom)]
    return {module for module in modules if module.startswith("engine.kernel.")}


def measure_kernel() -> Shape:
    """Count everything."""
    files = kernel_files()
    functions = [function for path in files for function in functions_of(path)]
    know = {}
    for effect, (word, own) in EFFECTS.items():
        outside = [f for f in functions if f.file not in DATA and not (own and f.file.startswith(own))]
        know[effect] = sum(any(map(word.search, f.identifiers)) for f in outside)
    return Shape(
        lines=sum(len(path.read_text("utf-8").splitlines()) for path in files),
        files=len(files),
        arrows=sum(len(imports_of(path)) for path in files),
        ways=sum(f.makes_outcome for f in functions) + sum(f.name in OTHER_WAYS for f in functions),
        know=know,
        wide=sum(f.arguments > MAX_ARGUMENTS for f in functions),
    )


if __name__ == "__main__":
    for name, value in measure_kernel()._asdict().items():
        print(f"{name:<8} {value}")
