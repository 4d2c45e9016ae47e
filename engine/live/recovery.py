"""Files that a program which was killed has left half-written, with the recordings among them."""

import re
import time
from pathlib import Path

from engine.live.recording import frames_of, lock
from engine.wording import program_name

PART = re.compile(r"\.(.+)\.\d+\.part", re.DOTALL)
QUIET = 2.0  # s: what was written since then may still be at work
WEEK = 7 * 86_400.0  # s, after which what is of no use is deleted
MOST = 3  # names that are said


def leftovers(folder: Path) -> list[tuple[Path, str]]:
    """Half-written files that no process is at work on, and the names that they were to have. Raises OSError."""
    found = []
    for path in sorted(folder.iterdir()):
        name = PART.fullmatch(path.name)
        if name and path.is_file() and _left(path):
            found.append((path, name[1]))
    return found


def _left(path: Path) -> bool:
    """Whether nobody writes to a file. The number of a process says little: another one may have it by now."""
    try:
        if time.time() - path.stat().st_mtime < QUIET:
            return False
        with path.open("rb") as file:
            return lock(file)
    except OSError:
        return False


def clear(found: list[tuple[Path, str]]) -> int:
    """Delete what is older than a week and holds no sound; returns how many."""
    count = 0
    for path, _ in found:
        try:
            if time.time() - path.stat().st_mtime > WEEK and not frames_of(path):
                path.unlink()
                count += 1
        except OSError:
            continue
    return count


def notice(folder: Path) -> str:
    """What is to be said of a folder before something is recorded in it. Clears what is of no use."""
    try:
        found = leftovers(folder)
    except OSError:
        return ""
    names = [path.name for path, _ in found if frames_of(path)]
    clear(found)
    if not names:
        return ""
    some = ", ".join(names[:MOST]) + (f" and {len(names) - MOST} more" if len(names) > MOST else "")
    return f"recordings were broken off: {some}; keep them with {program_name()} recover {folder}"
