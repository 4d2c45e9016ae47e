"""The smallest scenes: masses, oscillators and barriers, as tables of a patch."""

from typing import Any

import engine


def scene(body: list[dict[str, Any]], **parts: Any) -> engine.Scene:
    """A scene of the given bodies, heard at the first."""
    pickup = [{"body": body[0]["name"], "quantity": "velocity"}]
    return engine.Scene.model_validate({"body": body, "pickup": pickup} | parts)


def mass(**keys: Any) -> dict[str, Any]:
    """A mass of 1 kg, named "body"; other keys replace or join these."""
    return {"name": "body", "kind": "mass", "mass": 1.0} | keys


def oscillator(**keys: Any) -> dict[str, Any]:
    """An oscillator of 1 kg, named "body"; other keys replace or join these."""
    return {"name": "body", "kind": "oscillator", "mass": 1.0} | keys


def barrier(**keys: Any) -> dict[str, Any]:
    """A contact of "body" with a stiff barrier at 0; other keys replace or join these."""
    return {"body": "body", "barrier": 0.0, "stiffness": 1e8, "exponent": 2.0} | keys
