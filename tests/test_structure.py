"""Who may import whom, and that stale caches cannot be."""

import ast
import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest
from conftest import ROOT

# from the ground up: a file imports only from floors below its own, or from its own
FLOORS = [
    ["kernel_files", "wording", "files", "lines"],
    ["kernel_cache"],
    ["jit", "vector", "held", "native", "parts", "measured", "formats"],
    ["references", "spots", "waveform"],
    ["accuracy", "measures", "features", "laws", "scene", "bodies", "baselines", "save", "feedback", "machine"],
    ["model", "others", "draw", "solve", "patch", "index", "describe"],
    ["modes", "tables", "rounds", "coupled", "islands", "layout"],
    ["limits"],
    ["force", "contact", "compliance", "voices"],
    ["energy"],
    ["events"],
    ["rest", "step"],
    ["refine", "stages"],
    ["block", "score", "deck"],
    ["build", "runner", "post", "doubts"],
    ["offline"],
    ["params", "silence", "recording", "streams"],
    ["explain", "price", "tell", "arguments", "player", "point"],
    ["vary", "cluster", "processes"],
    ["sound", "reload", "midi", "replay", "sweep", "page", "commands", "leftovers"],
    ["once"],
    ["cli", "live"],
    ["__init__"],
]
KERNELS = [
    "laws",
    "solve",
    "rounds",
    "coupled",
    "modes",
    "islands",
    "force",
    "contact",
    "energy",
    "events",
    "rest",
    "step",
    "refine",
    "block",
]
WITHOUT_NUMBA = ["accuracy", "parts", "measured", "references", "scene", "patch", "bodies", "spots", "waveform", "draw"]
WITHOUT_NUMBA += ["save", "feedback", "machine", "measures", "features", "index", "point", "vary", "sweep", "cluster"]
WITHOUT_NUMBA += ["describe", "params", "silence", "commands", "arguments", "tell", "page", "once", "cli", "__init__"]
WITHOUT_NUMBA += ["processes", "wording", "files", "lines", "limits", "kernel_files", "doubts", "formats"]
WITHOUT_NUMBA += ["recording", "leftovers", "streams"]


def imports(name: str) -> set[str]:
    """What a file of the engine imports, anywhere in it, but not for type checking alone."""
    tree = ast.parse((ROOT / "engine" / f"{name}.py").read_text("utf-8"))
    for node in ast.walk(tree):
        if isinstance(node, ast.If) and isinstance(node.test, ast.Name) and node.test.id == "TYPE_CHECKING":
            node.body = []
    found = set()
    for node in ast.walk(tree):
        if isinstance(node, ast.ImportFrom) and node.module:
            found |= {f"engine.{a.name}" for a in node.names} if node.module == "engine" else {node.module}
        elif isinstance(node, ast.Import):
            found |= {a.name for a in node.names}
    return found


FLOOR_OF = {name: floor for floor, names in enumerate(FLOORS) for name in names}


def test_every_file_has_its_floor():
    assert {p.stem for p in (ROOT / "engine").glob("*.py")} == set(FLOOR_OF)


@pytest.mark.parametrize("name", FLOOR_OF)
def test_files_import_from_below(name):
    for module in imports(name):
        package, _, part = module.partition(".")
        if package == "engine" and part:
            assert FLOOR_OF[part] <= FLOOR_OF[name], f"{name} imports {part} from above"


@pytest.mark.parametrize("name", KERNELS)
def test_kernels_know_nothing_of_files_or_patches(name):
    outside = {m.partition(".")[0] for m in imports(name)} - {"engine"}
    assert outside <= {"math", "typing", "numpy", "numba"}
    assert not imports(name) & {"engine.scene", "engine.patch", "engine.cli"}


@pytest.mark.parametrize("name", WITHOUT_NUMBA)
def test_patches_and_arguments_know_nothing_of_numba(name):
    assert not any(m.startswith("numba") for m in imports(name))


def test_public_names_are_the_documented_ones():
    import engine

    for name in engine.__all__:
        assert getattr(engine, name).__doc__
    with pytest.raises(AttributeError, match="no attribute 'rendr'"):
        engine.rendr  # noqa: B018


def test_an_edited_kernel_is_used(tmp_path):
    """After an edit of a file that the sample loop imports, the next run computes with the edit."""
    shutil.copytree(ROOT / "engine", tmp_path / "engine", ignore=shutil.ignore_patterns("__pycache__"))
    environment = {**os.environ, "NUMBA_CACHE_DIR": str(tmp_path / "cache"), "PYTHONPATH": str(tmp_path)}
    code = (
        "import engine; take = engine.render(engine.Scene.model_validate({"
        "'body': [{'name': 'b', 'kind': 'mass', 'mass': 1.0, 'velocity': 1.0}],"
        "'pickup': [{'body': 'b', 'quantity': 'displacement'}]}), seconds=0.01); print(take.audio[-1, 0])"
    )

    def last() -> float:
        run = [sys.executable, "-c", code]
        return float(subprocess.run(run, cwd=tmp_path, env=environment, capture_output=True, check=True).stdout)

    first = last()
    assert last() == first
    assert list((tmp_path / "cache").rglob("*.nbc")), "nothing was cached"
    kernel = tmp_path / "engine" / "modes.py"
    text = kernel.read_text("utf-8")
    assert "modes.drift[m] * p" in text
    kernel.write_text(text.replace("modes.drift[m] * p", "2.0 * modes.drift[m] * p"), "utf-8")
    assert last() == pytest.approx(2 * first, rel=1e-12)


def test_patches_are_small_enough_to_read():
    assert all(Path(p).stat().st_size < 8000 for p in (ROOT / "patches").glob("*.toml"))
