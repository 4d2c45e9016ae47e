"""The kinds of machines that kernels are made for: an archive for each comes with the engine (engine.compiler.shipped),
and a library in C is for one of them."""

import platform
import sys
from typing import NamedTuple

X86_64, ARM64 = ("x86_64", "amd64"), ("aarch64", "arm64")
V3 = "avx", "avx2", "bmi", "bmi2", "f16c", "fma", "lzcnt", "movbe"
V4 = *V3, "avx512bw", "avx512cd", "avx512dq", "avx512f", "avx512vl"


class Target(NamedTuple):
    """A kind of machine."""

    name: str  # of its archive
    triple: str  # as LLVM names it
    processor: str  # as LLVM names it
    system: str  # as `sys.platform` names it
    machines: tuple[str, ...]  # as the module `platform` names it, in small letters
    needed: tuple[str, ...] = ()  # features that its processors have beyond the least of their family
    tested_in: str = "use"  # on such machines; "an emulator"; "" if neither was at hand
    features: str = ""  # that LLVM is to use beyond those of the processor


LINUX, MACOS, WINDOWS = "unknown-linux-gnu", "apple-macosx11.0.0", "pc-windows-gnu"
TARGETS = (  # of each system and machine the best first
    Target("linux-x86-64-v4", f"x86_64-{LINUX}", "x86-64-v4", "linux", X86_64, V4),
    Target("linux-x86-64-v3", f"x86_64-{LINUX}", "x86-64-v3", "linux", X86_64, V3),
    Target("linux-x86-64", f"x86_64-{LINUX}", "x86-64", "linux", X86_64),
    Target("linux-aarch64", f"aarch64-{LINUX}", "generic", "linux", ARM64, tested_in="an emulator"),
    Target("macos-arm64", f"arm64-{MACOS}", "apple-m1", "darwin", ARM64, tested_in=""),
    Target("macos-x86-64-v3", f"x86_64-{MACOS}", "x86-64-v3", "darwin", X86_64, V3, tested_in=""),
    Target("windows-x86-64-v4", f"x86_64-{WINDOWS}", "x86-64-v4", "win32", X86_64, V4, tested_in=""),
    Target("windows-x86-64-v3", f"x86_64-{WINDOWS}", "x86-64-v3", "win32", X86_64, V3, tested_in=""),
)
OF_LIBRARIES = {  # names of targets of libraries in C, which leave the level of the processor open
    "x86_64-linux": "linux-x86-64-v3",
    "aarch64-linux": "linux-aarch64",
    "aarch64-macos": "macos-arm64",
    "x86_64-macos": "macos-x86-64-v3",
    "x86_64-windows": "windows-x86-64-v3",
}
WASM = Target(
    "wasm32",
    "wasm32-unknown-unknown",
    "generic",
    "wasm",
    (),
    features="+simd128,+relaxed-simd,+bulk-memory,+sign-ext,+nontrapping-fptoint,+mutable-globals",
)


def target_named(name: str) -> Target:
    """Return a target by its name, or by that which it has for libraries. Raises KeyError."""
    return {target.name: target for target in (*TARGETS, WASM)}[OF_LIBRARIES.get(name, name)]


def is_of_family(target: Target) -> bool:
    """True if a target has the system and the family of processors of this machine."""
    return target.system == sys.platform and platform.machine().lower() in target.machines


def fitting_targets() -> list[Target]:
    """Return the targets that this machine can run, the best first."""
    import llvmlite.binding as llvm

    features = llvm.get_host_cpu_features()
    return [target for target in TARGETS if is_of_family(target) and all(map(features.get, target.needed))]
