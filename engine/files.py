"""Files that a patch or a command names: they are read whole, if they are files and not too large."""

import os
import stat
from pathlib import Path

MB = 1_000_000


class NoFile(ValueError):
    """A path leads to nothing that can be read; it says why."""


def regular(path: Path) -> None:
    """Raises OSError or NoFile, if a path leads to no file: a pipe would be waited for, a device has no end."""
    if "\0" in str(path):
        raise NoFile("no file has such a name")
    if not stat.S_ISREG(os.stat(path).st_mode):
        raise NoFile("is not a file, but a pipe, a device or a folder")


def content(path: Path, most: int) -> bytes:
    """All bytes of a file. Raises OSError or NoFile, also if there are more than `most` of them."""
    regular(path)
    with open(path, "rb", opener=_at_once) as file:
        found = file.read(most + 1)
    if found is None or len(found) > most:  # what has nothing ready yet gives None
        raise NoFile(f"is larger than {most / MB:g} MB")
    return found


def _at_once(path: str, flags: int) -> int:
    """Open without waiting, even if a pipe has taken the file's place."""
    return os.open(path, flags | getattr(os, "O_NONBLOCK", 0))


def there(path: Path) -> bool:
    """Whether anything has that name; nothing has one that is too long, or no name at all."""
    try:
        return path.exists()
    except (OSError, ValueError):
        return False


def is_folder(path: Path) -> bool:
    """Whether a path leads to a folder; also where it is no path at all, or may not be looked at."""
    try:
        return path.is_dir()
    except (OSError, ValueError):
        return False
