"""The folder of compiled kernels: where it is, which of its files can be trusted, and how large it may be.

A kernel is kept as a pickle, and who loads a pickle runs what it says. A file is therefore read only if it belongs to
this user and no one else can write to it. Each file begins with a digest of its content, so that damage is found before
the content is loaded.
"""

import hashlib
import math
import os
import re
import stat
import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path
from typing import NamedTuple

SOURCES = 4  # how many sources have kernels; the folders of older ones are deleted
DEFAULT_MEGABYTES = 500.0  # MB, if the environment does not set another
KERNEL = ".nbc"
PART_SUFFIX = ".tmp"  # a file that is being written
ABANDONED = 3600.0  # s, after which a file that is being written belongs to a process that has died
FOLDER = re.compile("[0-9a-f]{16}(-[0-9a-f]{8})?")  # sources, processor
OURS = re.compile(rf"\.(nbc|nbi|trial)(\.tmp\.\w+)?$|{re.escape(PART_SUFFIX)}$")  # .nbi: of earlier versions
DIGEST = hashlib.sha256().digest_size
OPEN = os.O_RDONLY | getattr(os, "O_NOFOLLOW", 0) | getattr(os, "O_BINARY", 0)


class File(NamedTuple):
    """A file of ours."""

    path: Path
    size: int
    used: float  # when it was loaded last, or written


def folder(name: str = "") -> Path:
    """The folder of all kernels, or of one digest of sources; it is made if need be.

    It is in the user's cache folder, or where that cannot be used, in the temporary folder. Raises OSError.
    """
    reasons = []
    for place, shared in ((_in_cache, False), (_in_temporary, True)):
        try:
            base = place()
            base.parent.mkdir(parents=True, exist_ok=True)
            if shared and not _keeps(base.parent):
                raise OSError(f"{base.parent} lets other users rename what is in it")
            _private(base, shared)
            if name:
                _private(base / name, shared)
            return base / name
        except OSError as error:
            reasons.append(f"{error.filename}: {error.strerror}" if error.filename else error.strerror or str(error))
        except RuntimeError as error:  # this user has no home
            reasons.append(str(error))
    raise OSError("; ".join(reasons))


def _in_cache() -> Path:
    """In the user's cache folder. Raises RuntimeError without a home."""
    if configured := os.environ.get("NUMBA_CACHE_DIR"):
        return Path(configured) / "fdh-engine"
    if sys.platform == "win32":
        return Path(os.environ.get("LOCALAPPDATA") or Path.home()) / "fdh-engine"
    if sys.platform == "darwin":
        return Path.home() / "Library" / "Caches" / "fdh-engine"
    return Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "fdh-engine"


def _in_temporary() -> Path:
    """In the temporary folder, which users may share: one for each user."""
    user = os.geteuid() if hasattr(os, "geteuid") else "own"
    return Path(tempfile.gettempdir()) / f"fdh-engine-{user}"


def _private(path: Path, shared: bool) -> None:
    """Make a folder that only this user can write to. Raises OSError if another user can.

    Where others can write to its parent, a folder that is open to them is refused. Elsewhere it is closed: with a umask
    of 002, earlier versions of this engine left it open to a group.
    """
    if not os.path.lexists(path):
        with suppress(FileExistsError):  # of another process
            path.mkdir(mode=0o700)
    status = os.lstat(path)
    if not stat.S_ISDIR(status.st_mode):
        raise OSError(f"{path} is not a folder")
    if not shared and _owned(status) and not _trusted(status):
        os.chmod(path, 0o700)
        status = os.lstat(path)
    if not _owned(status):
        raise OSError(f"{path} belongs to another user")
    if not _trusted(status):
        raise OSError(f"{path} can be written to by other users")


def _keeps(path: Path) -> bool:
    """True if other users cannot replace the files of this user in a folder."""
    status = os.stat(path)
    return not hasattr(os, "geteuid") or bool(status.st_mode & stat.S_ISVTX) or not status.st_mode & 0o022


def _owned(status: os.stat_result) -> bool:
    """True if a file belongs to this user; Windows has no such number."""
    return not hasattr(os, "geteuid") or status.st_uid == os.geteuid()


def _trusted(status: os.stat_result) -> bool:
    """True if no other user can have written to a file."""
    return not hasattr(os, "geteuid") or (_owned(status) and not status.st_mode & 0o022)


def read(path: Path) -> bytes | None:
    """The content of a file; None if there is none. A file that is damaged, or not to be trusted, is deleted."""
    try:
        with open(os.open(path, OPEN), "rb") as file:
            status = os.fstat(file.fileno())
            whole = file.read() if _trusted(status) and stat.S_ISREG(status.st_mode) else b""
    except OSError:  # it is not there, is a link, or cannot be read: to write the file replaces it
        return None
    content = whole[DIGEST:]
    if not content or hashlib.sha256(content).digest() != whole[:DIGEST]:
        delete(path)
        return None
    with suppress(OSError):  # a folder that cannot be written to can still be read
        os.utime(path)
    return content


def write(path: Path, content: bytes) -> None:
    """Write a file whole, or raise OSError and leave nothing."""
    try:
        _write(path, content)
    except FileNotFoundError:  # another process has just deleted the folder, as one of older sources
        _write(path, content)


def _write(path: Path, content: bytes) -> None:
    _private(path.parent, shared=True)
    number, part = tempfile.mkstemp(suffix=PART_SUFFIX, dir=path.parent)
    try:
        with open(number, "wb") as file:
            file.write(hashlib.sha256(content).digest())
            file.write(content)
        _replace(part, path, content)
    except BaseException:
        delete(Path(part))
        raise


def _replace(part: str, path: Path, content: bytes) -> None:
    """Rename a file; where another process has just kept the same, and Windows has it open, that one is as good."""
    try:
        os.replace(part, path)
    except PermissionError:
        if read(path) != content:
            raise
        delete(Path(part))


def delete(path: Path) -> bool:
    """Delete a file; whether it is gone."""
    try:
        path.unlink(missing_ok=True)
    except OSError:
        return False
    return True


def files(base: Path) -> list[File]:
    """All files of ours, whatever sources they are of."""
    return [file for part in _folders(base) for file in _files(part)]


def count(files: list[File]) -> tuple[int, int]:
    """Count the kernels among files, and the bytes of all files."""
    return sum(file.path.suffix == KERNEL for file in files), sum(file.size for file in files)


def _folders(base: Path) -> list[Path]:
    """The folders of ours, one for each digest of sources and processor."""
    try:
        with os.scandir(base) as entries:
            folders = [e for e in entries if e.is_dir(follow_symlinks=False)]
    except OSError:
        return []
    return [Path(entry.path) for entry in folders if FOLDER.fullmatch(entry.name)]


def _files(part: Path) -> Iterator[File]:
    """The files of ours in a folder. Links are not followed."""
    try:
        with os.scandir(part) as entries:
            listed = list(entries)
    except OSError:  # another process has just deleted it
        return
    for entry in listed:
        if entry.is_dir(follow_symlinks=False):  # earlier versions of this engine made folders in it
            yield from _files(Path(entry.path))
        elif OURS.search(entry.name):
            with suppress(OSError):
                status = entry.stat(follow_symlinks=False)
                yield File(Path(entry.path), status.st_size, status.st_mtime)


def limit() -> float:
    """Return the size limit of the cache, bytes. Raises ValueError."""
    text = os.environ.get("FDH_CACHE_LIMIT", "") or DEFAULT_MEGABYTES
    try:
        size = float(text)
    except ValueError:
        size = -1.0
    if not size >= 0.0:
        raise ValueError(f'FDH_CACHE_LIMIT: "{text}" is not a number of MB; such as {DEFAULT_MEGABYTES:g}')
    return size * 1e6


def prune(present: Path, room: float) -> None:
    """Delete the folders of older sources, then what was not used for longest, until the rest fits in.

    A process that still uses what is deleted has it in memory, or compiles it again.
    """
    parts = _folders(present.parent)
    newest: dict[str, float] = {}  # of the sources, when they were used last
    for part in parts:
        used = max((file.used for file in _files(part)), default=0.0)
        newest[_sources(part)] = max(used, newest.get(_sources(part), 0.0))
    newest[_sources(present)] = math.inf
    recent = sorted(newest, key=lambda sources: newest[sources], reverse=True)[:SOURCES]
    for part in parts:
        if _sources(part) not in recent:
            _empty(part)
    _shrink(present.parent, room)


def _sources(part: Path) -> str:
    """The digest of sources that a folder is of."""
    return part.name[:16]


def _shrink(base: Path, room: float) -> None:
    """Delete what was not used for longest, until the rest fits in; and what dead processes have left half-written."""
    now = time.time()
    for file in sorted(files(base), key=lambda file: file.used, reverse=True):
        room -= file.size
        if room < 0 or (file.path.name.endswith(PART_SUFFIX) and now - file.used > ABANDONED):
            delete(file.path)


def clear(base: Path) -> list[File]:
    """Delete all files of ours; returns those that could not be deleted."""
    for part in _folders(base):
        _empty(part)
    return files(base)


def _empty(part: Path) -> None:
    """Delete the files of ours in a folder, and the folder if nothing else is in it."""
    for file in _files(part):
        delete(file.path)
    for inner, _, _ in os.walk(part, topdown=False):
        with suppress(OSError):
            os.rmdir(inner)
