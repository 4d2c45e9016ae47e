"""Scenes of a string that connections hold, alone or with other bodies."""

import engine
from bench.scenes.choirs import string

MODES = 54
PLUCK = [{"kind": "pluck", "body": "s", "at": 0.2, "amplitude": 5.0, "duration": 2e-3}]


def held(connections, bodies=(), loss=0.5, **more) -> engine.Scene:
    """A C4 string, with other bodies, and connections."""
    body = [string("s", modes=MODES, sigma0=loss), *bodies]
    return engine.Scene.model_validate(
        {"body": body, "connection": connections, "pickup": [{"body": "s", "at": 0.3}], **more}
    )


def spring(stiffness, **keys) -> dict:
    return {"body": "s", **keys, **({"rigid": True} if stiffness == "rigid" else {"stiffness": stiffness})}


def lumped(name, **keys) -> dict:
    """A mass of 10 g; other keys replace or join these."""
    return {"name": name, "kind": "mass", "mass": 0.01} | keys
