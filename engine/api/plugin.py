"""A patch as a plug-in for programs for music, from Python."""

import platform
import sys
from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path

from engine.api.page import level_of
from engine.argument_checks import checked_integer
from engine.compiler.targets import ARM64
from engine.export.plugin import FORMATS, PluginForms, export_plugin_files
from engine.export.plugin_data import SAMPLERATES, PluginSettings
from engine.export.plugin_library import BUILDS, DPF, VST3
from engine.patch.scene import Scene, check_scene

THIS, ALL = "this", "all"
SYSTEMS = (*BUILDS, THIS, ALL)
OF_PLATFORM = {"win32": "windows", "darwin": "macos"}


def export_plugin(
    scene: Scene,
    folder: str | Path,
    name: str,
    formats: str | Sequence[str] | None = None,
    samplerates: Sequence[int] = SAMPLERATES,
    slide: str | Sequence[str] = (),
    system: str = THIS,
    dpf: str | Path = DPF,
    report: Callable[[float, str], object] = lambda share, phase: None,
) -> list[Path]:
    """Write a scene as plug-ins that programs for music load: NAME.clap with NAME.fdh beside it, and NAME.lv2, or NAME.vst3.
    Its keys are notes; of a patch without a keyboard, hammers and plucks are notes from 36 (C2). Live parameters are parameters.

    folder:  made if it is not there; `~/.clap` and `~/.lv2` are where programs look for them
    name:    of the files, and of the plug-in for projects that use it
    formats: "clap", "lv2", "vst3" or several; if None, the one that the folder is named by, or else clap and lv2
    samplerates: Hz, for which there are tables; at others the sound of the nearest is resampled
    slide:   live parameters that become parameters though each of their positions needs tables of its own
    system:  linux, linux-aarch64, windows, macos, this or all; all have folders of their own
    dpf:     folder of the sources of DPF, with which "vst3" is compiled
    report:  is told the share that is done, and what is done next

    >>> import fdh
    >>> fdh.export_plugin(fdh.load("vibraphone"), "plugins", "vibraphone")  # doctest: +SKIP
    [PosixPath('plugins/vibraphone.clap'), PosixPath('plugins/vibraphone.lv2')]

    Returns the files and folders that programs load. Raises TypeError or ValueError for a wrong argument; CannotExport
    (a ValueError) with the reason if the scene cannot become a plug-in, or the package `ziglang`, which links it, is
    missing; BuildError (a ValueError) if the scene cannot be built; OSError if a file cannot be written.
    """
    check_scene(scene)
    folder = Path(folder).expanduser()
    if not name or not isinstance(name, str):
        raise ValueError("name = '' names no plug-in; give the name of its files")
    rates = [checked_integer("samplerates", rate) for rate in samplerates]
    chosen = formats_of(folder, formats)
    if system not in SYSTEMS:
        raise ValueError(f"no system is called {system!r}; there are {', '.join(SYSTEMS)}")
    systems = list(BUILDS) if system == ALL else [this_system() if system == THIS else system]
    settings = PluginSettings(rates, (slide,) if isinstance(slide, str) else slide)
    find_gain = partial(level_of, scene, rates[0] if rates else SAMPLERATES[0])
    return export_plugin_files(
        scene, name, folder, PluginForms(chosen, systems, Path(dpf).expanduser()), find_gain, settings, report
    )


def formats_of(folder: Path, formats: str | Sequence[str] | None) -> list[str]:
    """Return the formats that are written to a folder. Raises ValueError for an unknown one."""
    if formats is None:
        by_name = folder.name.lower().lstrip(".")
        return [by_name] if by_name in FORMATS else [one for one in FORMATS if one != VST3]
    chosen = [formats] if isinstance(formats, str) else list(formats)
    for one in chosen:
        if one not in FORMATS:
            raise ValueError(f"no format of plug-ins is called {one!r}; there are {', '.join(FORMATS)}")
    return chosen


def this_system() -> str:
    """Return the name of the system that this process runs on."""
    is_arm = platform.machine().lower() in ARM64
    return OF_PLATFORM.get(sys.platform, "linux-aarch64" if is_arm else "linux")
