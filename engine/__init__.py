"""Sound synthesis in which things really collide: energy-exact contacts, in real time.

import engine
scene = engine.load("patches/bouncing_ball.toml")
take = engine.render(scene, seconds=2.0)
take.audio, take.stats
"""

from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from engine.offline import Take, render
    from engine.patch import PatchError, load
    from engine.scene import Scene

__all__ = ["PatchError", "Scene", "Take", "load", "render"]

_HOME = {"PatchError": "patch", "Scene": "scene", "Take": "offline", "load": "patch", "render": "offline"}


def __getattr__(name: str) -> Any:
    """Import a public name when it is first used: Numba alone takes a second."""
    if name not in _HOME:
        raise AttributeError(f"module 'engine' has no attribute '{name}'")
    import importlib

    return getattr(importlib.import_module(f"engine.{_HOME[name]}"), name)
