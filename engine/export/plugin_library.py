"""The library of plug-ins: our sources in C with the kernels that come with the engine, linked by the package ziglang
for any system from any other."""

import importlib.util
import struct
import subprocess
import sys
import tempfile
from collections.abc import Mapping
from importlib.resources import files
from pathlib import Path
from typing import NamedTuple

from engine.compiler import cache, shipped
from engine.compiler.targets import Target, target_named
from engine.export.faults import CannotExport
from engine.export.plugin_data import RATE_NUMBERS, source_word
from engine.export.row_recorder import LEVELS, RowRecorder
from engine.instrument.held_keys import PEDAL_STEPS
from engine.kernel.data.enums import Balance, EventKind, Sleep
from engine.live.shared_memory import Gauge, Slot
from engine.runtime.event_slots import VALUES_PER_EVENT, EventSlot

SOURCES = "fdh_file.c", "fdh_inflate.c", "fdh_kernels.c", "fdh_midi.c", "fdh_player.c", "fdh_resampler.c"
HEADERS = (
    "clap_abi.h",
    "fdh_file.h",
    "fdh_kernels.h",
    "fdh_midi.h",
    "fdh_player.h",
    "fdh_resampler.h",
    "lv2_abi.h",
)
CLAP, LV2, VST3 = "clap", "lv2", "vst3"
SHELLS = {CLAP: "fdh_clap.c", LV2: "fdh_lv2.c", VST3: "fdh_vst3.cpp"}  # of each format …
ENTRIES = {  # … and what hosts look for in it
    CLAP: "clap_entry",
    LV2: "lv2_lib_descriptor",
    VST3: "GetPluginFactory; ModuleEntry; ModuleExit",
}
INFO = "DistrhoPluginInfo.h"  # what DPF reads of a plug-in
DPF = Path("/usr/share/dpf")  # where Debian's package dpf-source puts it
PARTS = "plain.o", "stages.o"  # of an archive: the kernels of scenes with one step a sample, and with stages
NUMBERS = "fdh_numbers.h"
MAX_CHANNELS = 64
FLAGS = (
    "-O2",
    "-shared",
    "-fvisibility=hidden",
    "-ffp-contract=off",
    "-fno-sanitize=all",
    "-Wall",
    "-Wextra",
)
FLAGS_OF_DPF = "-DDISTRHO_PLUGIN_TARGET_VST3", "-DHAVE_PTHREAD", "-w"
FAT_MAGIC, PAGE = 0xCAFEBABE, 1 << 14  # of a file of macOS that holds code for several processors


class Build(NamedTuple):
    """A library for a processor of a system.

    levels: names of archives, by the number with which the names of their functions begin here
    triple: as Zig names it
    """

    levels: Mapping[int, str]
    triple: str


BUILDS = {  # by system
    "linux": [Build({4: "linux-x86-64-v4", 3: "linux-x86-64-v3"}, "x86_64-linux-gnu.2.17")],
    "linux-aarch64": [Build({1: "linux-aarch64"}, "aarch64-linux-gnu.2.17")],
    "windows": [Build({4: "windows-x86-64-v4", 3: "windows-x86-64-v3"}, "x86_64-windows-gnu")],
    "macos": [Build({1: "macos-arm64"}, "aarch64-macos.11.0"), Build({3: "macos-x86-64-v3"}, "x86_64-macos.11.0")],
}
FAT_PROCESSORS = {"aarch64": (0x0100000C, 0), "x86_64": (0x01000007, 3)}  # as macOS numbers them


def check_linker() -> None:
    """Raise CannotExport if Zig is not there."""
    if importlib.util.find_spec("ziglang") is None:
        raise CannotExport(
            "a plug-in is linked by Zig, which is a package: pip install 'fdh-engine[plugin]' (or ziglang)"
        )


def check_dpf(folder: Path) -> None:
    """Raise CannotExport if the sources of DPF are not in a folder."""
    if not folder.joinpath("distrho", "DistrhoPluginMain.cpp").is_file():
        raise CannotExport(
            f"VST3 needs the sources of DPF, which are not in {folder}: install Debian's dpf-source, or give --dpf"
            " FOLDER with a copy of github.com/DISTRHO/DPF"
        )


def link_library(system: str, plugin_format: str, info: str = "", dpf: Path = DPF) -> bytes:
    """Return the library of a format for a system, a key of BUILDS. Raises CannotExport if Zig, the kernels or DPF are
    missing.

    info, dpf: of VST3: what DPF is to know of the plug-in, and the folder of its sources
    """
    check_linker()
    added = {} if plugin_format != VST3 else {INFO: info}
    linked = {b.triple.split("-")[0]: _link(b, plugin_format, added, dpf) for b in BUILDS[system]}
    return next(iter(linked.values())) if len(linked) == 1 else join_processors(linked)


def write_sources(folder: Path, levels: Mapping[int, str]) -> list[Path]:
    """Write the sources and the kernels of a library. Returns what is to be compiled and linked, without a shell.
    Raises CannotExport if the kernels are missing."""
    sources = files("engine.export").joinpath("plugin")
    for name in (*SOURCES, *HEADERS, *SHELLS.values()):
        folder.joinpath(name).write_bytes(sources.joinpath(name).read_bytes())
    folder.joinpath(NUMBERS).write_text("\n".join(_lines_of_numbers(levels)) + "\n", "ascii")
    objects = [folder / f"kernels_{level}_{part}" for level in levels for part in PARTS]
    contents = [_kernels(target_named(name), level, part) for level, name in levels.items() for part in PARTS]
    for path, content in zip(objects, contents, strict=True):
        path.write_bytes(content)
    return [*(folder / name for name in SOURCES), *objects]


def _link(build: Build, plugin_format: str, added: Mapping[str, str], dpf: Path) -> bytes:
    with tempfile.TemporaryDirectory(prefix="fdh-plugin-") as name:
        folder = Path(name)
        inputs = [*write_sources(folder, build.levels), folder / SHELLS[plugin_format]]
        folder.joinpath("exports.map").write_text(f"{{ global: {ENTRIES[plugin_format]}; local: *; }};\n", "ascii")
        flags = [*FLAGS, *_flags_of(build.triple)]
        for file, text in added.items():
            folder.joinpath(file).write_text(text, "utf-8")
        if plugin_format == VST3:
            check_dpf(dpf)
            inputs.append(dpf / "distrho" / "DistrhoPluginMain.cpp")
            flags += ["-Wl,-z,nodelete"] * ("linux" in build.triple)  # its destructors run when the host ends
            flags += [*FLAGS_OF_DPF, f"-I{dpf / 'distrho'}", f"-I{dpf / 'distrho' / 'src'}", "-I."]
        compiler = "c++" if plugin_format == VST3 else "cc"
        command = [sys.executable, "-m", "ziglang", compiler, "-target", build.triple, *flags]
        done = subprocess.run([*command, "-o", folder / "library", *inputs], capture_output=True, text=True, cwd=folder)
        if done.returncode:
            raise CannotExport(f"the library could not be linked for {build.triple}: {done.stderr.strip()[-800:]}")
        return folder.joinpath("library").read_bytes()


def _flags_of(triple: str) -> list[str]:
    """Return flags of a system: without what a debugger would want, and with its library of functions."""
    of_linux = ["-Wl,--version-script=exports.map"] * ("linux" in triple)  # kernels of another plug-in are not ours
    return ["-s"] if "windows" in triple else ["-s", "-lm", *of_linux]


def _kernels(target: Target, level: int, part: str) -> bytes:
    """Return an object file of an archive, whose functions have names of their level: two levels are in one library.
    Raises CannotExport if it is not there or of other sources."""
    path = shipped.archive(target)
    try:
        if shipped.sources_of(path) != cache.source_digest():
            raise CannotExport(
                f"the kernels for {target.name} that came with the engine are not of these sources; make them with:"
                " python -m bench shipped"
            )
        read = shipped.read_part(path, part)
    except shipped.UNREADABLE as error:
        raise CannotExport(f"{path.name} cannot be read: {error}") from None
    content = read.machine_code
    for name in read.functions:  # of the same length, so that nothing else in the file moves
        content = content.replace(f"{name}\0".encode(), f"fd{level}_{name.removeprefix('fdh_')}\0".encode())
    return content


def _lines_of_numbers(levels: Mapping[int, str]) -> list[str]:
    """Return the numbers of the engine as the sources in C know them."""
    numbers = {
        "SOURCES": source_word(),
        "LEVELS": len(LEVELS),
        "PEDAL_STEPS": PEDAL_STEPS,
        "MAX_CHANNELS": MAX_CHANNELS,
        "QUEUE": RowRecorder.queue_size,
        "VALUES": VALUES_PER_EVENT,
        "EVENT": len(EventSlot),
        "START": int(EventSlot.START),
        "TABLE_AT": int(EventSlot.TABLE),
        "KINDS": max(EventKind) + 1,
        "EXCHANGE": int(EventKind.EXCHANGE_TABLES),
        "SLOTS": len(Slot),
        **{name: int(Slot[name]) for name in ("WRITE_INDEX", "READ_INDEX", "FRAME", "WAITING", "DROPPED")},
        "GAUGES": len(Gauge),
        "GAIN": int(Gauge.GAIN),
        "BALANCE": len(Balance),
        "MAX_ERROR": int(Balance.MAX_ERROR),
        "LARGEST": int(Balance.LARGEST),
        "WAKE_FRAME": int(Sleep.WAKE_FRAME),
        **{f"RATE_{name}": n for n, name in enumerate(RATE_NUMBERS)},
        "RATE_NUMBERS": len(RATE_NUMBERS),
    }
    lines = [f"#define FDH_{name} {number}" for name, number in numbers.items()]
    return [*lines, f"#define FDH_KERNEL_LEVELS(LEVEL) {' '.join(f'LEVEL({level})' for level in levels)}"]


def join_processors(libraries: Mapping[str, bytes]) -> bytes:
    """Return a file of macOS that holds a library for each of several processors."""
    head, place = struct.pack(">2I", FAT_MAGIC, len(libraries)), PAGE
    body = bytearray()
    for name, content in libraries.items():
        head += struct.pack(">5I", *FAT_PROCESSORS[name], place + len(body), len(content), PAGE.bit_length() - 1)
        body += content + bytes(-len(content) % PAGE)
    return head + bytes(PAGE - len(head)) + bytes(body)
