"""Who may import whom, and that stale caches cannot be."""

import ast
import functools
import os
import re
import shutil
import subprocess
import sys
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
from conftest import ROOT
from kernel_shape import functions_of, measure_kernel
from source_trees import tree_of

# a package imports only from those to its left; those of one group do not know each other, but all know the first
ORDER = [
    [
        "wording",
        "faults",
        "argument_checks",
        "files",
        "audio_formats",
        "output_files",
        "provenance",
        "compiler",
        "arithmetic",
        "sound",
    ],
    ["bodies", "kernel"],
    ["instrument"],
    ["patch"],
    ["assembly"],
    ["runtime"],
    ["offline"],
    ["live", "analysis"],
    ["export"],
    ["sweep", "report"],
    ["api"],
    ["cli"],
]
KERNEL_ROOMS = ["data", "modes", "contact", "interactions", "run"]  # the same holds for the rooms of the kernel
PLACE = {room: place for place, rooms in enumerate(ORDER) for room in rooms}
FILES = [path for path in (ROOT / "engine").rglob("*.py") if path.parent != ROOT / "engine" or path.stem[0] != "_"]
MODULES = {".".join(path.relative_to(ROOT / "engine").with_suffix("").parts): path for path in FILES}


@functools.cache
def imports(path: Path) -> frozenset[str]:
    """The modules that a file imports, anywhere in it, but not for type checking alone."""
    nodes = list(walk_outside_type_checking(tree_of(path)))
    froms = [node for node in nodes if isinstance(node, ast.ImportFrom)]
    modules = {node.module or "" for node in froms} | {f"{node.module}.{a.name}" for node in froms for a in node.names}
    return frozenset(modules | {a.name for node in nodes if isinstance(node, ast.Import) for a in node.names})


def walk_outside_type_checking(node: ast.AST) -> Iterator[ast.AST]:
    """Yield a node and all within it, but not what is under `if TYPE_CHECKING`."""
    yield node
    if isinstance(node, ast.expr):  # where no imports are
        return
    is_guard = isinstance(node, ast.If) and isinstance(node.test, ast.Name) and node.test.id == "TYPE_CHECKING"
    for child in node.orelse if isinstance(node, ast.If) and is_guard else ast.iter_child_nodes(node):
        yield from walk_outside_type_checking(child)


def imports_that(rule: Callable[[str, frozenset[str]], set[str]], within: str = "") -> dict[str, set[str]]:
    """Return, by module, the imports that break a rule, which takes a module and what it imports."""
    chosen = {module: path for module, path in MODULES.items() if module.startswith(within)}
    assert chosen
    return {module: wrong for module, path in chosen.items() if (wrong := rule(module, imports(path)))}


def test_a_package_imports_only_from_those_to_its_left():
    def to_the_right(module: str, found: frozenset[str]) -> set[str]:
        room = module.partition(".")[0]
        others = {name.split(".")[1] for name in found if name.startswith("engine.")} - {room}
        return {other for other in others if PLACE[other] >= PLACE[room] and (PLACE[room] > 0 or other == "compiler")}

    assert imports_that(to_the_right) == {}


def test_a_room_of_the_kernel_imports_only_from_those_to_its_left():
    def to_the_right(module: str, found: frozenset[str]) -> set[str]:
        rooms = {name.split(".")[2] for name in found if name.startswith("engine.kernel.")}
        place = len(KERNEL_ROOMS) if module == "kernel.__init__" else KERNEL_ROOMS.index(module.split(".")[1])
        return {room for room in rooms if KERNEL_ROOMS.index(room) > place}

    assert imports_that(to_the_right, "kernel.") == {}


def test_what_a_file_imports_is_found():
    assert {"numpy", "engine.assembly.build", "engine.kernel.data.state"} <= imports(MODULES["offline.render"])


def test_no_files_import_each_other_in_a_circle():
    """Imports within functions count too. A package's own `__init__` may gather what its files have."""
    files = {f"engine.{name}": path for name, path in MODULES.items() if not name.endswith("__init__")}
    arrows = {name: imports(path) & files.keys() for name, path in files.items()}
    while arrows:
        leaves = [name for name, of in arrows.items() if not of & arrows.keys()]
        assert leaves, {name: sorted(of & arrows.keys()) for name, of in arrows.items()}
        arrows = {name: of for name, of in arrows.items() if name not in leaves}


def test_the_page_names_every_package():
    page = (ROOT / "docs" / "architecture.md").read_text("utf-8")
    packages = {path.name for path in (ROOT / "engine").iterdir() if (path / "__init__.py").exists()}
    rule = page[page.index("## Import rule") :].split("```")[1]
    assert packages - set(re.findall(r"\w+", rule)) == set()
    assert [name for name in packages if f"  {name}/ " not in page] == []


def test_interactions_use_the_same_verbs():
    files = [path for name, path in MODULES.items() if name.startswith("kernel.interactions.")]
    names = {function.name for path in files for function in functions_of(path)}
    kinds = "connections", "contacts", "external_forces"
    assert {f"{verb}_{kind}" for kind in kinds for verb in ("has", "push_by", "finish")} <= names


def test_only_the_compiler_knows_the_inner_parts_of_numba():
    inner = "llvmlite", "numba.core", "numba.extending"
    found = imports_that(lambda module, names: {name for name in names if name.startswith(inner)})
    assert [module for module in found if not module.startswith("compiler.")] == []
    assert found


def test_kernels_import_nothing_but_the_compiler_and_numbers():
    known = {"math", "typing", "numpy", "enum", "types", "dataclasses", "collections"}

    def outside(module: str, found: frozenset[str]) -> set[str]:
        strange = {name for name in found if not name.startswith(("engine.kernel", "engine.compiler"))}
        return {name.partition(".")[0] for name in strange} - known

    assert imports_that(outside, "kernel.") == {}


def test_no_numba_is_imported_before_something_is_computed():
    rooms = (
        "files",
        "provenance",
        "bodies",
        "patch",
        "assembly",
        "offline",
        "sweep",
        "report",
        "kernel.data.model",
        "kernel.data.state",
    )
    names = [f"engine.{name}" for name in MODULES if name.startswith(rooms) and not name.endswith("__init__")]
    code = f"import sys\nimport {', '.join(names)}\nsys.exit('numba' in sys.modules)"
    subprocess.run([sys.executable, "-c", code], cwd=ROOT, check=True)


def test_there_are_at_most_ten_files_beside_the_packages():
    assert sum(1 for path in (ROOT / "engine").iterdir() if not path.is_dir()) <= 10


def test_public_names_are_the_documented_ones():
    import engine

    for name in engine.__all__:
        assert getattr(engine, name).__doc__
    with pytest.raises(AttributeError, match="no attribute 'rendr'"):
        engine.rendr  # noqa: B018


@pytest.mark.hard  # it compiles two kernels
def test_an_edited_kernel_is_used(tmp_path):
    """After an edit of a file that the sample loop imports, the next run computes with the edit."""
    shutil.copytree(ROOT / "engine", tmp_path / "engine", ignore=shutil.ignore_patterns("__pycache__"))
    environment = {**os.environ, "NUMBA_CACHE_DIR": str(tmp_path / "cache"), "PYTHONPATH": str(tmp_path)}
    code = (
        "import engine; rendering = engine.render(engine.Scene.model_validate({"
        "'body': [{'name': 'b', 'kind': 'mass', 'mass': 1.0, 'velocity': 1.0}],"
        "'pickup': [{'body': 'b', 'quantity': 'displacement'}]}), 0.01, kernel='special');"
        "print(rendering.audio[-1, 0])"
    )

    def last() -> float:
        run = [sys.executable, "-c", code]
        return float(subprocess.run(run, cwd=tmp_path, env=environment, capture_output=True, check=True).stdout)

    first = last()
    assert last() == first
    assert list((tmp_path / "cache").rglob("*.nbc")), "nothing was cached"
    kernel = tmp_path / "engine" / "kernel" / "run" / "pickups.py"
    text = kernel.read_text("utf-8")
    assert "frame + (k - first), values[k] * gain)" in text
    kernel.write_text(text.replace("values[k] * gain)", "2.0 * values[k] * gain)"), "utf-8")
    assert last() == pytest.approx(2 * first, rel=1e-12)


def test_the_kernel_has_no_more_special_cases_than_it_had():
    """Limits that fall with each change: `python tests/docs/kernel_shape.py` prints what there is."""
    shape = measure_kernel()
    # 1204, 3 and 30 of bodies that stretch, each by itself; 420, 2 and 18 of friction; 39 and 1 of powers that are
    # found once a step, and of contact solves that begin near their solution: a quarter of the dearest blocks; 99 of
    # plucks of the score, which are rows of it and no longer forces, and of one rule for events that overlap; 110, 1
    # and 11 of islands that fade out where quality is reduced, and are gone, and no longer sleep with their notes; 164,
    # 1 and 5 of forces as functions of time, 112, 1 and 7 of glides within a sample and 53 of dampers there, so that
    # more steps find the motion; 150, 1 and 7 of bodies that stretch before they are struck, and of tensions that do
    # not settle together; 148, 1 and 2 of coefficients of friction that follow the slip of the same step, two curves of
    # them, and bristles that are damped: a bowed string is in tune at any sample rate; 162, 2 and 9 of felt with
    # memory, and 2 files and 13 arrows of the door of the laws and of the bits of effects
    assert shape.lines <= 9112 and shape.files <= 51 and shape.arrows <= 254
    assert shape.ways <= 5 and shape.wide <= 1
    assert shape.know["weight"] <= 11 and shape.know["connections"] <= 36 and shape.know["contact loss"] <= 6


def test_patches_are_small_enough_to_read():
    """The kit is as large as three: the snare, the toms, and 14 more drums."""
    sizes = {path.name: path.stat().st_size for path in (ROOT / "patches").glob("*.toml")}
    assert sizes.pop("kit.toml") < 3 * 8000
    assert sizes and max(sizes.values()) < 8000, sizes
