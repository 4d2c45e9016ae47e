"""The command `doctor`: all of this machine that a bug report needs, on one page."""

import argparse
import os
import platform
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple

from engine.cli import arguments
from engine.cli.messages import print_result
from engine.cli.progress import progress_feedback
from engine.files import SHIPPED_PATCHES
from engine.wording import to_one_line

PACKAGES = (
    *("fdh-engine", "numpy", "scipy", "numba", "llvmlite", "pydantic"),
    *("soundfile", "soxr", "sounddevice", "mido", "python-rtmidi", "python-osc"),
)
EXAMPLE = "piano_c4"  # the patch whose cost is measured
RUNS = 7
WARM_SECONDS, MEASURED_SECONDS = 0.05, 1.0  # of the patch
COARSEST_CLOCK = 1e-3  # s: the time of a thread is of no use where it counts in larger steps
KERNEL_DIGITS = 8  # of a digest, as in the captions of docs/bench.md
REASON_CHARACTERS = 200
HEADING_CHARACTERS = 12


class Section(NamedTuple):
    """A section of the page: its values for --json, and a text of one line or more."""

    values: dict[str, Any]
    text: str


def add_doctor_command(commands: "arguments.Commands") -> None:
    """Add `doctor` and its options."""
    text = (
        "Describe this machine on one page, for a bug report: system, versions, kernels, whether the tables of the"
        f" shipped patches are the published ones, devices, and the cost of {EXAMPLE}. It compiles nothing, and names"
        " neither the user nor the machine."
    )
    summary = "describe this machine, for a bug report"
    parser = arguments.add_command(commands, "doctor", doctor_command, summary, description=text)
    arguments.add_json(parser, "all of it")


def doctor_command(args: argparse.Namespace) -> int:
    """Print what this machine is and what works on it; return the exit code, 0 whatever does not."""
    sections = {name: describe_safely(describe) for name, describe in SECTIONS.items()}
    report = {name: section.values for name, section in sections.items()}
    print_result(args.json, report, lambda: print_page(sections))
    return 0


def print_page(sections: dict[str, Section]) -> None:
    """Print a line for each section; further lines of its text are indented."""
    for name, section in sections.items():
        first, *others = section.text.splitlines() or [""]
        print(f"{name:<{HEADING_CHARACTERS}} {first}")
        for line in others:
            print(f"{'':<{HEADING_CHARACTERS}} {line}")


def describe_safely(describe: Callable[[], Section]) -> Section:
    """Return a section; if anything in it fails, the reason is its text, so that all others are printed."""
    try:
        return describe()
    except Exception as error:  # whatever is broken here is what the page is for
        reason = str(error).partition(". To play live")[0].partition("\n")[0] or type(error).__name__
        reason = to_one_line(hide_home(reason), REASON_CHARACTERS)
        return Section({"error": reason}, f"not known: {reason}")


def hide_home(text: str) -> str:
    """Return a text with ~ in place of the folder of the user, whose name is nobody's business."""
    try:
        home = Path.home()
    except RuntimeError:  # this user has none
        return text
    return text.replace(str(home), "~") if home.parts[1:] else text


def describe_system() -> Section:
    """Describe the operating system, the processor and the cores."""
    from engine.compiler.processor_level import describe_level
    from engine.provenance import processor_name, usable_cores

    values = {"system": platform.platform(), "processor": processor_name(), "level": describe_level()}
    cores = {"cores": usable_cores(), "cores_of_machine": os.cpu_count()}
    used = f"{cores['cores']} of {cores['cores_of_machine']} cores may be used"
    return Section(values | cores, f"{values['system']}\n{values['processor']}, {values['level']}; {used}")


def describe_versions() -> Section:
    """Describe Python and the packages."""
    from engine.compiler.cache import package_version
    from engine.provenance import source_digest

    python = f"{platform.python_implementation()} {platform.python_version()}"
    packages = {name: package_version(name) for name in PACKAGES}
    listed = [f"{name} {number}" for name, number in packages.items()]
    half = len(listed) // 2
    text = "\n".join([f"{python}, sources {source_digest()}", ", ".join(listed[:half]), ", ".join(listed[half:])])
    return Section({"python": python, "sources": source_digest(), **packages}, text)


def describe_blas() -> Section:
    """Describe the library of linear algebra."""
    from engine.provenance import blas_name

    name = blas_name()
    return Section({"name": name}, name)


def describe_kernel() -> Section:
    """Describe which kernel runs the example, and where its machine code comes from."""
    from engine.assembly.build import build
    from engine.compiler import cache, shipped
    from engine.compiler.kernel_origin import KernelOrigin, find_origin
    from engine.patch.scene import load
    from engine.runtime.job_memory import RENDER_USE
    from engine.runtime.kernel_choice import prepare

    model, state, _ = build(load(SHIPPED_PATCHES / f"{EXAMPLE}.toml"), 44_100)
    prepared = prepare([model], state)
    origin, archive = find_origin(RENDER_USE.kernel, prepared.kinds_for(RENDER_USE)), shipped.explain_choice()
    texts = {
        KernelOrigin.CACHE: "kept in the cache",
        KernelOrigin.SHIPPED: f"shipped in {archive}",
        KernelOrigin.COMPILER: f"compiled before the first sound, as none is kept, and {archive}",
    }
    digest = cache.source_digest()[:KERNEL_DIGITS]
    values = {"digest": digest, "kernel": str(prepared.name), "origin": str(origin), "archive": archive}
    return Section(values, f"{digest}; {EXAMPLE} runs on the {prepared.name} kernel, {texts[origin]}")


def describe_cache() -> Section:
    """Describe where compiled kernels are stored."""
    from engine.compiler import cache_files

    base = cache_files.folder()
    kernels, size = cache_files.count(cache_files.files(base))
    values = {"folder": hide_home(str(base)), "kernels": kernels, "bytes": size}
    return Section(values, f"{values['folder']}: {kernels} kernels, {size / 1e6:.1f} MB")


def describe_tables() -> Section:
    """Compare the tables of the shipped patches with those that were published."""
    from engine.assembly.table_digest import digest_scene, read_shipped_digests
    from engine.patch.scene import load

    published, different = read_shipped_digests(), []
    with progress_feedback("computing the tables of the shipped patches") as progress:
        for number, (name, digest) in enumerate(published.items()):
            if digest_scene(load(SHIPPED_PATCHES / f"{name}.toml")) != digest:
                different.append(name)
            progress((number + 1) / len(published))
    values = {"patches": len(published), "same": len(published) - len(different), "different": different}
    text = f"{values['same']} of {len(published)} shipped patches have the published tables, bit for bit"
    return Section(values, text + (f"; not {', '.join(different)}" if different else ""))


def describe_outputs() -> Section:
    """Describe the audio output devices."""
    from engine.live.audio_device import output_devices

    devices = output_devices()
    values = [{"name": name, "channels": channels, "samplerate": rate} for _, name, channels, rate in devices]
    lines = [f"{name}: {channels} channels, {rate} Hz" for _, name, channels, rate in devices]
    return Section({"devices": values}, "\n".join(lines) or "there is no output device")


def describe_midi_ports() -> Section:
    """Describe the MIDI input ports."""
    from engine.live.midi_drivers import list_ports

    ports = list_ports()
    return Section({"ports": ports}, "\n".join(ports) or "there is no port")


def describe_cost() -> Section:
    """Measure what a sample of the example costs on one core, unless its kernel would have to be compiled first."""
    import numpy as np

    from engine.assembly.build import build
    from engine.kernel.data.axes import arrays_of
    from engine.offline.simulation import Simulation
    from engine.patch.scene import load

    scene, samplerate = load(SHIPPED_PATCHES / f"{EXAMPLE}.toml"), 44_100
    model, state, _ = build(scene, samplerate)
    simulation = Simulation(model, state)
    if not simulation.is_compiled:
        return Section({"error": "not compiled"}, "not measured, as its kernel would be compiled first")
    coarse = time.get_clock_info("thread_time").resolution > COARSEST_CLOCK
    clock = time.perf_counter if coarse else time.thread_time
    audio = np.zeros((round(MEASURED_SECONDS * samplerate), scene.channels))
    simulation.render_block(audio[: round(WARM_SECONDS * samplerate)])
    saved = [(array, array.copy()) for array in arrays_of(state)]
    least = np.inf
    for _ in range(RUNS):
        for array, copy in saved:
            array[...] = copy
        begin = clock()
        simulation.render_block(audio)
        least = min(least, clock() - begin)
    cost, factor = least / len(audio) * 1e9, MEASURED_SECONDS / least
    values = {"patch": EXAMPLE, "kernel": simulation.kernel, "ns_per_sample": cost, "real_time_factor": factor}
    return Section(values, f"{cost:.0f} ns a sample of {EXAMPLE} on one core, {factor:.0f} × real time")


SECTIONS: dict[str, Callable[[], Section]] = {
    "system": describe_system,
    "versions": describe_versions,
    "blas": describe_blas,
    "kernel": describe_kernel,
    "cache": describe_cache,
    "tables": describe_tables,
    "audio": describe_outputs,
    "midi": describe_midi_ports,
    "cost": describe_cost,
}
