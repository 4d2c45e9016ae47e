"""Reading of files that a patch or a command names: regular files only, read as a whole, up to a size."""

import os
import re
import stat
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from importlib.resources.abc import Traversable

MB = 1_000_000
PACKAGE_FOLDER = Path(__file__).parent


def _shipped_folder() -> Path:
    """The folder of the patches that come with the engine: in a wheel it is in the package; in the sources, beside
    render.py. From a zip, they are unpacked for as long as this process lasts."""
    for folder in (PACKAGE_FOLDER / "patches", PACKAGE_FOLDER.parent / "patches"):
        if folder.is_dir():
            return folder
    import atexit
    import shutil
    import tempfile
    from importlib.resources import files

    unpacked = Path(tempfile.mkdtemp(prefix="fdh-patches-"))
    atexit.register(shutil.rmtree, unpacked, ignore_errors=True)
    _unpack(files("engine") / "patches", unpacked)
    return unpacked


def _unpack(packed: "Traversable", folder: Path) -> None:
    """Copy the content of a folder of a package, if there is such a folder."""
    for entry in packed.iterdir() if packed.is_dir() else ():
        if entry.is_dir():
            (folder / entry.name).mkdir()
            _unpack(entry, folder / entry.name)
        else:
            (folder / entry.name).write_bytes(entry.read_bytes())


SHIPPED_PATCHES = _shipped_folder()
SHIPPED_NAME = re.compile(r"\w+")


class UnreadableFile(ValueError):
    """A path leads to nothing that can be read. The message says why."""


def check_regular_file(path: Path) -> None:
    """Raise OSError or UnreadableFile if a path leads to no regular file: a pipe blocks, and a device has no end."""
    if "\0" in str(path):
        raise UnreadableFile("no file has such a name")
    if not stat.S_ISREG(os.stat(path).st_mode):
        raise UnreadableFile("is not a file, but a pipe, a device or a folder")


def read_bytes(path: Path, max_bytes: int | None) -> bytes:
    """Read a whole file. Raises OSError, or UnreadableFile, also if it has more than `max_bytes`; None: of any size."""
    check_regular_file(path)
    with open(path, "rb", opener=_open_without_waiting) as file:
        data = file.read(-1 if max_bytes is None else max_bytes + 1)
    if data is None:  # a pipe that has nothing ready
        raise UnreadableFile("is not a file, but a pipe")
    if max_bytes is not None and len(data) > max_bytes:
        raise UnreadableFile(f"is larger than {max_bytes / MB:g} MB")
    return data


def _open_without_waiting(path: str, flags: int) -> int:
    """Open a file without blocking, even if a pipe has taken its place since it was checked."""
    return os.open(path, flags | getattr(os, "O_NONBLOCK", 0))


def path_exists(path: Path) -> bool:
    """True if a file or folder has that name; False if the name is too long, or not a name at all."""
    try:
        return path.exists()
    except (OSError, ValueError):
        return False


def is_folder(path: Path) -> bool:
    """True if a path leads to a folder; False if it is not a path at all, or may not be looked at."""
    try:
        return path.is_dir()
    except (OSError, ValueError):
        return False


def shipped_names() -> list[str]:
    """The names of the patches that come with the engine."""
    return sorted(path.stem for path in SHIPPED_PATCHES.glob("*.toml"))


def find_patch(name: str | Path) -> Path:
    """The file of a patch: what lies at this path, or else the shipped patch of this name.

    A folder does not stand in the way of a shipped patch: a sweep of `tanpura` writes a folder of that name.
    """
    path = Path(name)
    if SHIPPED_NAME.fullmatch(str(name)) and (not path_exists(path) or is_folder(path)):
        shipped = SHIPPED_PATCHES / f"{path}.toml"
        return shipped if path_exists(shipped) else path
    return path


def shortest_name(path: Path) -> str:
    """Return the shortest name of a patch to type: that of a shipped one, or the path, relative to the current folder
    if that is shorter."""
    if path.parent == SHIPPED_PATCHES:
        return path.stem
    try:
        return min(os.path.relpath(path), str(path), key=len)
    except (OSError, ValueError):  # the current folder was removed, or is on another drive
        return str(path)


def is_shipped(path: Path) -> bool:
    """True if a path leads to a patch that comes with the engine, and that is found by its name alone."""
    try:
        return path.suffix == ".toml" and path.resolve().parent == SHIPPED_PATCHES.resolve()
    except (OSError, RuntimeError, ValueError):  # a loop of links, or no path at all
        return False
