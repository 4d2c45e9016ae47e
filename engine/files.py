"""Reading of files that a patch or a command names: regular files only, read as a whole, up to a size."""

import os
import re
import stat
from pathlib import Path

MB = 1_000_000
PACKAGE_FOLDER = Path(__file__).parent
INSTALLED_PATCHES = PACKAGE_FOLDER / "patches"  # of a wheel; in the sources, patches lie beside render.py
SHIPPED_PATCHES = INSTALLED_PATCHES if INSTALLED_PATCHES.is_dir() else PACKAGE_FOLDER.parent / "patches"
SHIPPED_NAME = re.compile(r"\w+")


class UnreadableFile(ValueError):
    """A path leads to nothing that can be read. The message says why."""


def check_regular_file(path: Path) -> None:
    """Raise OSError or UnreadableFile if a path leads to no regular file: a pipe blocks, and a device has no end."""
    if "\0" in str(path):
        raise UnreadableFile("no file has such a name")
    if not stat.S_ISREG(os.stat(path).st_mode):
        raise UnreadableFile("is not a file, but a pipe, a device or a folder")


def read_bytes(path: Path, max_bytes: int) -> bytes:
    """Read a whole file. Raises OSError, or UnreadableFile, also if it has more than `max_bytes`."""
    check_regular_file(path)
    with open(path, "rb", opener=_open_without_waiting) as file:
        data = file.read(max_bytes + 1)
    if data is None or len(data) > max_bytes:  # a pipe that has nothing ready gives None
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
