"""`import fdh` is the engine under a name of its own: the same names, the same modules, typed."""

import importlib
import os
import re
import subprocess
import sys

import pytest
from conftest import ROOT

import engine
import fdh

GUIDES = [*(ROOT / "docs").glob("*.md"), *(ROOT / "docs").glob("*.ipynb"), *(ROOT / "docs/examples").glob("*.py")]
BY_ANOTHER_NAME = re.compile(r"\bimport engine$|\bfrom engine import", re.MULTILINE)
DIFF = re.compile(r"^```diff\n.*?^```$", re.MULTILINE | re.DOTALL)


def run(folder, code):
    """What Python says of a piece of code, run in a folder."""
    environment = os.environ | {"PYTHONPATH": os.pathsep.join([str(folder), str(ROOT)])}
    return subprocess.run([sys.executable, "-c", code], cwd=folder, env=environment, capture_output=True, text=True)


def test_all_names_are_those_of_the_engine():
    assert fdh.__all__ == engine.__all__ and "Scene" in fdh.__all__
    assert all(getattr(fdh, name) is getattr(engine, name) for name in fdh.__all__)
    assert fdh.__version__ == engine.__version__
    assert {*fdh.__all__, "__version__"} <= set(dir(fdh))
    with pytest.raises(AttributeError, match="module 'fdh' has no attribute 'rendr'"):
        fdh.rendr  # noqa: B018


@pytest.mark.parametrize("module", ["faults", "analysis", "analysis.features", "live.key_allocator", "sweep.plan"])
def test_modules_are_the_same_and_no_copies(module):
    other, own = (importlib.import_module(f"{name}.{module}") for name in ("fdh", "engine"))
    assert other is own and own.__spec__.name == own.__name__ == f"engine.{module}"


def test_a_module_that_is_not_there_is_said_by_the_name_that_was_asked_for():
    with pytest.raises(ModuleNotFoundError, match=r"No module named 'fdh\.anlysis'"):
        importlib.import_module("fdh.anlysis")


def test_a_copy_comes_neither_from_the_one_order_nor_from_the_other(tmp_path):
    """Also where a module is imported under the name fdh first, and with nothing imported before it is used."""
    code = (
        "import sys, fdh; early = {'numba', 'numpy', 'pydantic'} & set(sys.modules)\n"
        "from fdh.faults import PatchError; import engine.faults\n"
        "print(early, PatchError is engine.faults.PatchError is fdh.PatchError, sys.modules['fdh.faults'].__name__)"
    )
    assert run(tmp_path, code).stdout == "set() True engine.faults\n"


def test_an_engine_of_the_user_that_hides_ours_is_named_in_one_line(tmp_path):
    (tmp_path / "engine.py").write_text("print('the engine of the user was run')\n")
    done = run(tmp_path, "import fdh")
    said = done.stderr.splitlines()[-1]
    assert said == f"ImportError: fdh needs its package engine: {tmp_path / 'engine.py'} hides it; rename that"
    assert done.stdout == ""


def test_it_is_a_program_and_typed(tmp_path):
    done = subprocess.run(
        [sys.executable, "-m", "fdh", "--help"],
        cwd=tmp_path,
        env=os.environ | {"PYTHONPATH": str(ROOT)},
        capture_output=True,
        text=True,
    )
    assert done.stdout.startswith("usage: python -m fdh [-h] [--version] COMMAND ...")
    assert (ROOT / "fdh" / "py.typed").exists()


def test_guides_use_the_name():
    said = {path.name: DIFF.sub("", path.read_text("utf-8")) for path in [ROOT / "README.md", *GUIDES]}
    assert [name for name, text in said.items() if BY_ANOTHER_NAME.search(text.replace('\\n",', ""))] == []
    assert all(
        "import fdh" in said[name] for name in ("README.md", "first_sound.ipynb", "api.md", "render_and_plot.py")
    )
