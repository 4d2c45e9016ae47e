"""A patch as a plug-in that a program for music loads: the data of the patch beside a library, in files and folders as
CLAP and LV2 have them."""

import platform
import re
import sys
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

from engine.compiler.targets import ARM64
from engine.export.faults import CannotExport
from engine.export.lv2_text import description_of, manifest_of
from engine.export.plugin_data import SAMPLERATES, PluginData, PluginSettings, make_plugin_data
from engine.export.plugin_library import BUILDS, CLAP, DPF, LV2, VST3, check_dpf, check_linker, link_library
from engine.export.vst3_text import info_of
from engine.output_files import atomic_write, write_text
from engine.patch.scene import Scene

FORMATS = CLAP, LV2, VST3
THIS, ALL = "this", "all"
SYSTEMS = (*BUILDS, THIS, ALL)
OF_PLATFORM = {"win32": "windows", "darwin": "macos"}
FOLDERS_OF_VST3 = {"linux": "x86_64-linux", "linux-aarch64": "aarch64-linux", "windows": "x86_64-win", "macos": "MacOS"}
LIBRARY_WORK = 10_000  # of linking one, where tables for a sample rate are so many as it has Hz
ENDINGS = {"windows": ".dll", "macos": ".dylib"}  # of libraries in bundles of LV2; elsewhere .so
PROPERTIES = """<?xml version="1.0" encoding="UTF-8"?>
<!DOCTYPE plist PUBLIC "-//Apple//DTD PLIST 1.0//EN" "http://www.apple.com/DTDs/PropertyList-1.0.dtd">
<plist version="1.0"><dict><key>CFBundleExecutable</key><string>{name}</string>
<key>CFBundleIdentifier</key><string>fdh-engine.{name}</string><key>CFBundleName</key><string>{name}</string>
<key>CFBundlePackageType</key><string>BNDL</string><key>CFBundleVersion</key><string>1</string></dict></plist>
"""


@dataclass(frozen=True)
class PluginForm:
    """The files of a plug-in.

    formats: clap, lv2, vst3; if None, the one that their folder is called by, or else clap and lv2
    samplerates: Hz, for which there are tables; at others the sound of the nearest is resampled
    slide:   live parameters that become parameters though each of their positions needs tables of its own; `bend` is
             the pitch wheel, which instruments with strings have anyway
    system:  linux, linux-aarch64, windows, macos, this or all, which have folders of their own
    dpf:     folder of the sources of DPF, with which vst3 is compiled

    Raises ValueError for an unknown format or system.

    >>> import fdh
    >>> fdh.PluginForm(samplerates=[48_000]).formats_in("~/.lv2")
    ('lv2',)
    """

    formats: Sequence[str] | None = None
    samplerates: Sequence[int] = SAMPLERATES
    slide: Sequence[str] = ()
    system: str = THIS
    dpf: str | Path = DPF

    def __post_init__(self) -> None:
        for one in self.formats or ():
            if one not in FORMATS:
                raise ValueError(f"no format of plug-ins is called {one!r}; there are {', '.join(FORMATS)}")
        if self.system not in SYSTEMS:
            raise ValueError(f"no system is called {self.system!r}; there are {', '.join(SYSTEMS)}")

    def formats_in(self, folder: str | Path) -> tuple[str, ...]:
        """Return the formats that are written to a folder."""
        by_name = Path(folder).name.lower().lstrip(".")
        return tuple(self.formats or ([by_name] if by_name in FORMATS else (CLAP, LV2)))

    @property
    def systems(self) -> list[str]:
        """The systems that files are written for."""
        return list(BUILDS) if self.system == ALL else [this_system() if self.system == THIS else self.system]


def this_system() -> str:
    """Return the name of the system that this process runs on."""
    is_arm = platform.machine().lower() in ARM64
    return OF_PLATFORM.get(sys.platform, "linux-aarch64" if is_arm else "linux")


def write_plugins(
    scene: Scene,
    folder: Path,
    form: PluginForm,
    settings: PluginSettings,
    report: Callable[[float, str], object] | None = None,
) -> list[Path]:
    """Write a scene as plug-ins to a folder, which is made if it is not there. Returns the files and folders that hosts
    load. report: called with the share that is done, and what is done next

    Raises CannotExport (a ValueError) with the reason if the scene cannot become a plug-in or nothing links it,
    BuildError (a ValueError) if it cannot be built, OSError if a file cannot be written.
    """
    formats, systems, rates = form.formats_in(folder), form.systems, list(settings.samplerates)
    check_linker()
    if VST3 in formats:
        check_dpf(Path(form.dpf))
    settings = settings._replace(name=re.sub(r"[^\w-]", "_", settings.name, flags=re.ASCII))
    work, written = sum(rates) + LIBRARY_WORK * len(systems) * len(formats), list[Path]()

    def report_work(done: float, phase: str) -> None:
        if report is not None:
            report(done / work, phase)

    def report_rate(rate: int) -> None:
        report_work(sum(rates[: rates.index(rate)]), f"tables for {rate} Hz")

    data = make_plugin_data(scene, settings, report_rate)
    for system in systems:
        place = folder if len(systems) == 1 else folder / system
        for plugin_format in formats:
            report_work(sum(rates) + LIBRARY_WORK * len(written), f"library for {system}, {plugin_format.upper()}")
            library = link_library(system, plugin_format, info_of(settings.name, data), Path(form.dpf))
            place.mkdir(parents=True, exist_ok=True)
            write = {CLAP: _write_clap, LV2: _write_lv2, VST3: _write_vst3}[plugin_format]
            written.append(write(place, settings.name, system, library, data))
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
