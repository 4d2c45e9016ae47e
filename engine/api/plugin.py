"""A patch as a plug-in for programs for music, from Python."""

from collections.abc import Callable
from functools import partial
from pathlib import Path

from engine.api.page import level_of
from engine.argument_checks import checked_integer
from engine.export.plugin import PluginForm, write_plugins
from engine.export.plugin_data import SAMPLERATES, PluginSettings
from engine.patch.scene import Scene, check_scene


def export_plugin(
    scene: Scene,
    folder: str | Path,
    name: str,
    form: PluginForm | None = None,
    report: Callable[[float, str], object] | None = None,
) -> list[Path]:
    """Write a scene as plug-ins that programs for music load: NAME.clap with NAME.fdh beside it, NAME.lv2, NAME.vst3.
    Its keys are notes; of a patch without a keyboard, hammers and plucks are notes from 36 (C2). Live parameters are
    parameters.

    folder: made if it is not there; `~/.clap` and `~/.lv2` are where programs look for them
    name:   of the files, and of the plug-in for projects that use it
    form:   formats, sample rates, systems; `PluginForm()` if None
    report: called with the share that is done, and what is done next

    >>> import fdh
    >>> fdh.export_plugin(fdh.load("vibraphone"), "plugins", "vibraphone")  # doctest: +SKIP
    [PosixPath('plugins/vibraphone.clap'), PosixPath('plugins/vibraphone.lv2')]

    Returns the files and folders that programs load. Raises TypeError or ValueError for a wrong argument; CannotExport
    (a ValueError) with the reason if the scene cannot become a plug-in, or the package `ziglang`, which links it, is
    missing; BuildError (a ValueError) if the scene cannot be built; OSError if a file cannot be written.
    """
    check_scene(scene)
    if not name or not isinstance(name, str):
        raise ValueError("name = '' names no plug-in; give the name of its files")
    form = form or PluginForm()
    rates = [checked_integer("samplerates", rate) for rate in form.samplerates]
    find_gain = partial(level_of, scene, rates[0] if rates else SAMPLERATES[0])
    settings = PluginSettings(name, find_gain, rates, (form.slide,) if isinstance(form.slide, str) else form.slide)
    return write_plugins(scene, Path(folder).expanduser(), form, settings, report)
