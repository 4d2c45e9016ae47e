"""A patch as a plug-in that a program for music loads: the data of the patch beside a library, in files and folders as
CLAP and LV2 have them."""

import re
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import NamedTuple

from engine.export.faults import CannotExport
from engine.export.lv2_text import description_of, manifest_of
from engine.export.plugin_data import PluginData, PluginSettings, make_plugin_data
from engine.export.plugin_library import CLAP, DPF, LV2, VST3, check_dpf, check_linker, link_library
from engine.export.vst3_text import info_of
from engine.output_files import atomic_write, write_text
from engine.patch.scene import Scene

FORMATS = CLAP, LV2, VST3
FOLDERS_OF_VST3 = {"linux": "x86_64-linux", "linux-aarch64": "aarch64-linux", "windows": "x86_64-win", "macos": "MacOS"}
LIBRARY_WORK = 10_000  # of linking one, where tables for a sample rate are so many as it has Hz
ENDINGS = {"windows": ".dll", "macos": ".dylib"}  # of libraries in bundles of LV2; elsewhere .so
PROPERTIES = """<?xml version="1.0" encoding="UTF-8"?>
<!DOCTYPE plist PUBLIC "-//Apple//DTD PLIST 1.0//EN" "http://www.apple.com/DTDs/PropertyList-1.0.dtd">
<plist version="1.0"><dict><key>CFBundleExecutable</key><string>{name}</string>
<key>CFBundleIdentifier</key><string>fdh-engine.{name}</string><key>CFBundleName</key><string>{name}</string>
<key>CFBundlePackageType</key><string>BNDL</string><key>CFBundleVersion</key><string>1</string></dict></plist>
"""


class PluginForms(NamedTuple):
    """What is written of a plug-in.

    formats: of FORMATS
    systems: keys of engine.export.plugin_library.BUILDS; for several, each has a folder of its own
    dpf:     folder of the sources of DPF, for VST3
    """

    formats: Sequence[str]
    systems: Sequence[str]
    dpf: Path = DPF


def export_plugin_files(
    scene: Scene,
    name: str,
    folder: Path,
    forms: PluginForms,
    find_gain: Callable[[], float],
    settings: PluginSettings,
    report: Callable[[float, str], object] = lambda share, phase: None,
) -> list[Path]:
    """Write a scene as plug-ins to a folder, which is made if it is not there. Returns the files and folders that hosts
    load.

    report: is told the share that is done, and what is done next

    Raises CannotExport (a ValueError) with the reason if the scene cannot become a plug-in or nothing links it,
    BuildError (a ValueError) if it cannot be built, OSError if a file cannot be written.
    """
    check_linker()
    if VST3 in forms.formats:
        check_dpf(forms.dpf)
    name = re.sub(r"[^\w-]", "_", name, flags=re.ASCII)
    rates, written = list(settings.samplerates), list[Path]()
    work = sum(rates) + LIBRARY_WORK * len(forms.systems) * len(forms.formats)

    def report_rate(rate: int) -> None:
        report(sum(rates[: rates.index(rate)]) / work, f"tables for {rate} Hz")

    data = make_plugin_data(scene, name, find_gain, settings, report_rate)
    for system in forms.systems:
        place = folder if len(forms.systems) == 1 else folder / system
        for plugin_format in forms.formats:
            report((sum(rates) + LIBRARY_WORK * len(written)) / work, f"library for {system}, {plugin_format.upper()}")
            library = link_library(system, plugin_format, info_of(name, data), forms.dpf)
            place.mkdir(parents=True, exist_ok=True)
            write = {CLAP: _write_clap, LV2: _write_lv2, VST3: _write_vst3}[plugin_format]
            written.append(write(place, name, system, library, data))
    return written


def _write_clap(place: Path, name: str, system: str, library: bytes, data: PluginData) -> Path:
    bundle = place / f"{name}.clap"
    if system != "macos":
        _write_bytes(place / f"{name}.fdh", data.content)
        _write_bytes(bundle, library)
        return bundle
    contents = bundle / "Contents"
    for inner in ("MacOS", "Resources"):
        contents.joinpath(inner).mkdir(parents=True, exist_ok=True)
    _write_bytes(contents / "Resources" / f"{name}.fdh", data.content)
    write_text(contents / "Info.plist", PROPERTIES.format(name=name))
    _write_bytes(contents / "MacOS" / name, library)
    return bundle


def _write_lv2(place: Path, name: str, system: str, library: bytes, data: PluginData) -> Path:
    bundle, binary = place / f"{name}.lv2", f"fdh{ENDINGS.get(system, '.so')}"
    bundle.mkdir(exist_ok=True)
    _write_bytes(bundle / "patch.fdh", data.content)
    _write_bytes(bundle / binary, library)
    write_text(bundle / "patch.ttl", description_of(name, data))
    write_text(bundle / "manifest.ttl", manifest_of(name, binary))
    return bundle


def _write_vst3(place: Path, name: str, system: str, library: bytes, data: PluginData) -> Path:
    bundle = place / f"{name}.vst3"
    of_system, resources = bundle / "Contents" / FOLDERS_OF_VST3[system], bundle / "Contents" / "Resources"
    for folder in (of_system, resources):
        folder.mkdir(parents=True, exist_ok=True)
    _write_bytes(resources / "patch.fdh", data.content)
    if system == "macos":
        write_text(bundle / "Contents" / "Info.plist", PROPERTIES.format(name=name))
    ending = {"windows": ".vst3", "macos": ""}.get(system, ".so")
    _write_bytes(of_system / f"{name}{ending}", library)
    return bundle


def _write_bytes(path: Path, content: bytes) -> None:
    """Write a file, which is complete or not there. What a host has in memory of an older one is not changed."""
    if path.is_dir():
        raise CannotExport(f"{path} is a folder")
    with atomic_write(path) as beside:
        beside.write_bytes(content)
