"""Scenes for the tests: shipped patches, and variations of them."""

import ctypes.util
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import engine

ROOT = Path(__file__).parent.parent
PATCHES = sorted((ROOT / "patches").glob("*.toml"))
ALSA = Path("/usr/share/alsa/alsa.conf")
needs_portaudio = pytest.mark.skipif(not ctypes.util.find_library("portaudio"), reason="no PortAudio library")
needs_alsa = pytest.mark.skipif(not ALSA.exists(), reason="no ALSA")


def scene(body: list[dict[str, Any]], **parts: Any) -> engine.Scene:
    """A scene of the given bodies, heard at the first."""
    pickup = [{"body": body[0]["name"], "quantity": "velocity"}]
    return engine.Scene.model_validate({"body": body, "pickup": pickup} | parts)


def mass(**more: Any) -> dict[str, Any]:
    return {"name": "body", "kind": "mass", "mass": 1.0} | more


def oscillator(**more: Any) -> dict[str, Any]:
    return {"name": "body", "kind": "oscillator", "mass": 1.0} | more


def barrier(**more: Any) -> dict[str, Any]:
    return {"body": "body", "barrier": 0.0, "stiffness": 1e8, "exponent": 2.0} | more


def mostly_hard(values: list[Any], *kept: Any) -> list[Any]:
    """Cases of a test of which all but the kept ones are among the hard: each needs a kernel of its own."""
    cases = {v: v if isinstance(v, tuple) else (v,) for v in values}
    return [v if v in kept else pytest.param(*case, marks=pytest.mark.hard) for v, case in cases.items()]


def slope(x: list[float], y: list[float]) -> float:
    """Slope of log y against log x."""
    return float(np.polyfit(np.log(x), np.log(np.abs(y)), 1)[0])


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
