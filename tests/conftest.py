"""Scenes for the tests: shipped patches, and variations of them."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest

import engine

ROOT = Path(__file__).parent.parent
PATCHES = sorted((ROOT / "patches").glob("*.toml"))


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


def slope(x: list[float], y: list[float]) -> float:
    """Slope of log y against log x."""
    return float(np.polyfit(np.log(x), np.log(np.abs(y)), 1)[0])


@pytest.fixture
def patch():  # type: ignore[no-untyped-def]
    """A shipped patch by name."""
    return lambda name: engine.load(ROOT / "patches" / f"{name}.toml")
