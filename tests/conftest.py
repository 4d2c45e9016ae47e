"""Scenes for the tests: shipped patches, and variations of them."""

import ctypes.util
import functools
import gc
import os
import sys
from collections import Counter
from importlib.util import find_spec
from pathlib import Path
from typing import Any

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # before NumPy is imported: where tests share the
# cores, eigenvalues take 40 times as long with more

import numpy as np
import pytest

import engine

ROOT = Path(__file__).parent.parent
gc.disable()  # until all is collected: to look for garbage in what is read, which stays, takes a quarter of the time
pytest_plugins = ["kernel_files"]
if os.environ.pop("PYTHONDONTWRITEBYTECODE", None):  # then in a folder of pytest's, or each command reads all anew
    sys.pycache_prefix = os.environ["PYTHONPYCACHEPREFIX"] = str(ROOT / ".pytest_cache" / "bytecode")
    sys.dont_write_bytecode = False
PATCHES = sorted((ROOT / "patches").glob("*.toml"))
ALSA = Path("/usr/share/alsa/alsa.conf")
needs_portaudio = pytest.mark.skipif(
    not ctypes.util.find_library("portaudio"), reason="the PortAudio library is not installed"
)
needs_alsa = pytest.mark.skipif(not ALSA.exists(), reason="no ALSA")


def pytest_configure() -> None:
    """Say in a line what the tests need, where only what a first sound needs is installed."""
    missing = [name for name in ("hypothesis", "jsonschema", "mpmath", "pythonosc") if find_spec(name) is None]
    if missing:
        raise pytest.UsageError(f"the tests need {', '.join(missing)}: uv run --group dev pytest")


@pytest.hookimpl(tryfirst=True)
def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Function]) -> None:
    """Mark those cases of a test as hard or slow that its mark `hard_for` or `slow_for` names, and all but those that
    `hard_but` or `slow_but` names; with `slow_but_each`, all of the hard but each n-th."""
    named, found, places = set(), set(), Counter[pytest.Function]()
    for item in items:
        for kind in ("hard", "slow"):
            for mark in (*item.iter_markers(f"{kind}_for"), *item.iter_markers(f"{kind}_but")):
                named |= {(item.originalname, case) for case in mark.args}
                found.add((item.originalname, item.callspec.id))
                if (item.callspec.id in mark.args) == (mark.name == f"{kind}_for"):
                    item.add_marker(kind)
        for mark in item.iter_markers("slow_but_each") if item.get_closest_marker("hard") else ():
            if places[item.function] % mark.args[0]:
                item.add_marker("slow")
            places[item.function] += 1
    unknown = named - found
    if unknown and not any("::" in argument for argument in config.args):
        raise pytest.UsageError(f"cases that are marked and do not exist: {unknown}")


def pytest_collection_finish() -> None:
    """Leave all that was collected out of later searches for garbage."""
    gc.freeze()
    gc.enable()


def mostly_hard(values: list[Any], *kept: Any) -> list[Any]:
    """Cases of a test of which all but the kept ones are among the hard: each takes seconds, or a kernel of its own."""
    cases = {v: v if isinstance(v, tuple) else (v,) for v in values}
    return [v if v in kept else pytest.param(*case, marks=pytest.mark.hard) for v, case in cases.items()]


def slope(x: list[float], y: list[float]) -> float:
    """Slope of log y against log x."""
    return float(np.polyfit(np.log(x), np.log(np.abs(y)), 1)[0])


def exit_code(*words: str) -> int:
    """The exit code of a command line; the parser of options leaves with an exception."""
    from engine.cli import main

    try:
        return main.main(list(words))
    except SystemExit as end:
        return end.code if isinstance(end.code, int) else 0


@pytest.fixture
def patch():  # type: ignore[no-untyped-def]
    """A shipped patch by name."""
    return lambda name: engine.load(ROOT / "patches" / f"{name}.toml")


@pytest.fixture
def file_device(tmp_path):  # type: ignore[no-untyped-def]
    """An environment whose default device writes what it is given, and the file."""
    raw = tmp_path / "out.raw"
    device = f'pcm.!default {{ type file slave.pcm "null" file "{raw}" format "raw" }}'
    (tmp_path / "asound.conf").write_text(f"<{ALSA}>\n{device}\n")
    return {"ALSA_CONFIG_PATH": str(tmp_path / "asound.conf"), "JACK_NO_START_SERVER": "1"}, raw


@pytest.fixture(scope="session")
def library(tmp_path_factory):
    """The library in C of a shipped patch, by its name."""
    from tests.export.test_c_library import Library

    @functools.cache
    def find(name):
        return Library(engine.load(name), tmp_path_factory.mktemp(name))

    return find
