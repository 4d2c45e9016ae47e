"""Machine code that comes with the engine, for processors of a kind: the general kernels, so that the very first start
need not compile. `python -m bench shipped` makes it from the sources.

An archive for each kind of processor holds a kernel per member, and says which sources it was made from: with others it
is not used.
"""

import hashlib
import json
import platform
import sys
import zipfile
from functools import lru_cache
from pathlib import Path
from typing import NamedTuple

from engine.compiler import cache
from engine.compiler.kinds import Kind
from engine.compiler.tricks import switched_off

FOLDER = Path(__file__).parents[1] / "shipped"
ABOUT = "about.json"
V3 = "avx", "avx2", "bmi", "bmi2", "f16c", "fma", "lzcnt", "movbe"


class Target(NamedTuple):
    """A kind of processor, under Linux."""

    name: str  # as LLVM calls it
    features: tuple[str, ...]  # beyond those that all of its family have
    machines: tuple[str, ...]  # as the platform names it


X86_64 = "x86_64", "amd64"
TARGETS = (  # the best first
    Target("x86-64-v3", V3, X86_64),
    Target("x86-64", (), X86_64),
    Target("aarch64", (), ("aarch64", "arm64")),
)


def archive(target: Target) -> Path:
    """The file of a target."""
    return FOLDER / f"linux-{target.name}.zip"


def member_name(module: str, function: str, kinds: tuple[Kind, ...]) -> str:
    """The name of a kernel in an archive."""
    return f"{module}.{function}-{hashlib.sha256(json.dumps(kinds).encode()).hexdigest()[:16]}"


def read_shipped(module: str, function: str, kinds: tuple[Kind, ...]) -> bytes | None:
    """The machine code of a kernel for this processor; None if none is shipped."""
    path = _fitting_archive()
    if path is None:
        return None
    try:
        with zipfile.ZipFile(path) as file:
            return file.read(member_name(module, function, kinds))
    except (OSError, KeyError, zipfile.BadZipFile):  # what is damaged fails the check of its digest
        return None


@lru_cache
def _fitting_archive() -> Path | None:
    """The best archive that fits this processor and the present sources."""
    if sys.platform != "linux" or switched_off():
        return None
    import llvmlite.binding as llvm

    features, machine = llvm.get_host_cpu_features(), platform.machine().lower()
    for target in TARGETS:
        if machine not in target.machines:
            continue
        path = archive(target)
        if all(features.get(name) for name in target.features) and sources_of(path) == cache.source_digest():
            return path
    return None


def explain_choice() -> str:
    """Name the archive that fits this processor and the present sources, or say why none does."""
    if (path := _fitting_archive()) is not None:
        return path.name
    machine = platform.machine().lower()
    if sys.platform != "linux" or not any(machine in target.machines for target in TARGETS):
        return f"no archive is shipped for {sys.platform} on {machine}"
    if switched_off():
        return "archives are not used while tricks of the compiler are switched off"
    return "the shipped archives were made from other sources"


def sources_of(path: Path) -> str | None:
    """The digest of the sources that an archive was made from; None if it cannot be read."""
    try:
        with zipfile.ZipFile(path) as file:
            return str(json.loads(file.read(ABOUT))["sources"])
    except (OSError, KeyError, ValueError, zipfile.BadZipFile):
        return None
