"""Machine code that comes with the engine: the general kernels, so that the very first start need not compile.
`python -m bench shipped` makes it from the sources.

An archive for each kind of machine holds object files as a linker takes them, and says first which sources they were
made from: with others they are not used. They are compressed together, for they are much alike. The first use on a
machine is a trial in another process (engine.compiler.archive_trial).
"""

import hashlib
import io
import json
import platform
import sys
import tarfile
from collections.abc import Mapping
from functools import lru_cache
from pathlib import Path
from typing import Any

from engine.compiler import archive_trial, cache
from engine.compiler.code_objects import Code, Content, load_code
from engine.compiler.kinds import Kind
from engine.compiler.targets import Target, fitting_targets
from engine.compiler.tricks import switched_off

FOLDER = Path(__file__).parents[1] / "shipped"
ABOUT = "about.json"
SAMPLES = "samples"  # what an archive says of the digest of the trial's samples
UNREADABLE = OSError, EOFError, KeyError, ValueError, tarfile.TarError  # the last also where Python has no LZMA


def archive(target: Target) -> Path:
    """Return the file of a target."""
    return FOLDER / f"{target.name}.tar.xz"


def kernel_key(module: str, function: str, kinds: tuple[Kind, ...]) -> str:
    """Return the name of a kernel in an archive."""
    return f"{module}.{function}-{hashlib.sha256(json.dumps(kinds).encode()).hexdigest()[:16]}"


def load_shipped(module: str, function: str, kinds: tuple[Kind, ...]) -> Code | None:
    """Return the shipped machine code of a kernel; None if none fits this machine and the present sources."""
    path = fitting_archive()
    if path is None:
        return None
    part, entry = read_about(path)["kernels"].get(kernel_key(module, function, kinds), (None, None))
    return None if part is None else _load_part(path, part).get(entry)


@lru_cache
def _load_part(path: Path, part: str) -> dict[str, Code]:
    """Load an object file of an archive."""
    try:
        return load_code(read_part(path, part))
    except UNREADABLE:  # what is damaged fails the check of its digest
        return {}


def read_part(path: Path, part: str) -> Content:
    """Return an object file of an archive. Raises one of UNREADABLE."""
    about = read_about(path)["parts"][part]
    return Content(about["functions"], about["needed"], read_member(path, part))


def read_member(path: Path, name: str) -> bytes:
    """Return a file of an archive. Raises one of UNREADABLE."""
    with tarfile.open(path, "r:xz") as archived:
        for member in archived:  # in their order: what is not wanted after it is not unpacked
            if member.name == name and (file := archived.extractfile(member)) is not None:
                return file.read()
    raise KeyError(name)


def write_members(path: Path, members: Mapping[str, bytes]) -> None:
    """Write an archive: the same bytes for the same files."""
    with tarfile.open(path, "w:xz", preset=9, format=tarfile.USTAR_FORMAT) as archived:
        for name, content in members.items():
            member = tarfile.TarInfo(name)
            member.size = len(content)
            archived.addfile(member, io.BytesIO(content))


@lru_cache
def read_about(path: Path) -> dict[str, Any]:
    """Return what an archive says of itself; nothing if it cannot be read."""
    try:
        return dict(json.loads(read_member(path, ABOUT)))
    except UNREADABLE:
        return {}


def sources_of(path: Path) -> str | None:
    """Return the digest of the sources that an archive was made from; None if it cannot be read."""
    return read_about(path).get("sources")


@lru_cache
def fitting_archive() -> Path | None:
    """Return the best archive that fits this machine and the present sources, and has passed its trial here."""
    if (tried := archive_trial.tried_archive()) is not None:
        return tried
    if switched_off():
        return None
    paths = [archive(target) for target in fitting_targets()]
    current = (path for path in paths if sources_of(path) == cache.source_digest())
    return next((path for path in current if result_of_trial(path) == archive_trial.PASSED), None)


def result_of_trial(path: Path) -> str:
    """Return PASSED, or why the kernels of an archive do not run on this machine."""
    return archive_trial.find_result(path, read_about(path)[SAMPLES])


def explain_choice() -> str:
    """Name the archive that fits this machine and the present sources, or say why none does."""
    if (path := fitting_archive()) is not None:
        return path.name
    if switched_off():
        return "archives are not used while tricks of the compiler are switched off"
    targets = fitting_targets()
    paths = [archive(target) for target in targets if sources_of(archive(target)) == cache.source_digest()]
    if paths:
        return f"{paths[0].name} failed its trial on this machine: {result_of_trial(paths[0])}"
    if targets:
        return "the shipped archives were made from other sources"
    machine = platform.machine().lower()
    return f"no archive is shipped for {sys.platform} on {machine}"
