"""Sound synthesis in which things really collide: energy-exact contacts, in real time.

import fdh
scene = fdh.load("tanpura")  # a shipped patch; or the path of a file
rendering = fdh.render(scene, seconds=2.0)
rendering.audio, rendering.stats
"""

from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from engine.analysis.error_estimate import ErrorEstimate, estimate_error
    from engine.api.audio_input import AudioInput
    from engine.api.page import Page, export_page, show
    from engine.api.player import Player
    from engine.api.plugin import export_plugin
    from engine.api.rendering import Rendering, render
    from engine.api.sweeping import run_sweep, run_sweep_rows
    from engine.export.plugin import PluginForm
    from engine.faults import BuildError, PatchError, PatchWarning
    from engine.patch.scene import Scene, load
    from engine.sound.form import SoundForm
    from engine.sweep.dataset import read_sweep
    from engine.sweep.rows import read_sweep_rows

    __version__: str

__all__ = [
    "AudioInput",
    "BuildError",
    "ErrorEstimate",
    "Page",
    "PatchError",
    "PatchWarning",
    "Player",
    "PluginForm",
    "Rendering",
    "Scene",
    "SoundForm",
    "estimate_error",
    "export_page",
    "export_plugin",
    "load",
    "read_sweep",
    "read_sweep_rows",
    "render",
    "run_sweep",
    "run_sweep_rows",
    "show",
]

_HOME = {
    "AudioInput": "api.audio_input",
    "BuildError": "faults",
    "ErrorEstimate": "analysis.error_estimate",
    "estimate_error": "analysis.error_estimate",
    "export_page": "api.page",
    "export_plugin": "api.plugin",
    "PluginForm": "export.plugin",
    "Page": "api.page",
    "PatchError": "faults",
    "PatchWarning": "faults",
    "Player": "api.player",
    "Rendering": "api.rendering",
    "Scene": "patch.scene",
    "SoundForm": "sound.form",
    "load": "patch.scene",
    "read_sweep": "sweep.dataset",
    "read_sweep_rows": "sweep.rows",
    "render": "api.rendering",
    "run_sweep": "api.sweeping",
    "run_sweep_rows": "api.sweeping",
    "show": "api.page",
}
_FROM_SOURCE = "0+source"  # the version of what is not installed


def __getattr__(name: str) -> Any:
    """Import a public name when it is first used: Numba alone takes a second."""
    if name == "__version__":
        return _installed_version()
    if name not in _HOME:
        raise AttributeError(f"module 'engine' has no attribute '{name}'")
    import importlib

    return getattr(importlib.import_module(f"engine.{_HOME[name]}"), name)


def _installed_version() -> str:
    from importlib.metadata import PackageNotFoundError, version

    try:
        return version("fdh-engine")
    except PackageNotFoundError:
        return _FROM_SOURCE
