"""Scenes for the tests: shipped patches, and variations of them."""

import ctypes.util
import os
from pathlib import Path
from typing import Any

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # before NumPy is imported: where tests share the
# cores, eigenvalues take 40 times as long with more

import numpy as np
import pytest

import engine

pytest_plugins = ["kernel_files"]
os.environ.setdefault("FDH_KERNEL", "general")  # one kernel for all scenes; that special ones give the same is a test
os.environ["FDH_BACKGROUND"] = "off"  # also for the commands that tests start
ROOT = Path(__file__).parent.parent
PATCHES = sorted((ROOT / "patches").glob("*.toml"))
ALSA = Path("/usr/share/alsa/alsa.conf")
needs_portaudio = pytest.mark.skipif(
    not ctypes.util.find_library("portaudio"), reason="the PortAudio library is not installed"
)
needs_alsa = pytest.mark.skipif(not ALSA.exists(), reason="no ALSA")


def mostly_hard(values: list[Any], *kept: Any) -> list[Any]:
    """Cases of a test of which all but the kept ones are among the hard: each needs a kernel of its own."""
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
