"""Files that a program which was killed has left half-written, with the recordings among them."""

import re
import time
from pathlib import Path

from engine.live.audio_recording import lock_file, readable_frames
from engine.wording import program_name

TEMPORARY_NAME = re.compile(r"\.(.+)\.\d+\.part", re.DOTALL)
IDLE_SECONDS = 2.0  # s: what was written since then may still be at work
UNUSABLE_AFTER = 7 * 86_400.0  # s, after which what is of no use is deleted
MAX_LISTED = 3  # names that are said


def find_leftovers(folder: Path) -> list[tuple[Path, str]]:
    """Half-written files that no process is at work on, and the names that they were to have. Raises OSError."""
    leftovers = []
    for path in sorted(folder.iterdir()):
        name = TEMPORARY_NAME.fullmatch(path.name)
        if name and path.is_file() and _is_abandoned(path):
            leftovers.append((path, name[1]))
    return leftovers


def _is_abandoned(path: Path) -> bool:
    """True if no process writes to a file. The process number says little: another process may have it by now."""
    try:
        if time.time() - path.stat().st_mtime < IDLE_SECONDS:
            return False
        with path.open("rb") as file:
            return lock_file(file)
    except OSError:
        return False


def delete_unusable(leftovers: list[tuple[Path, str]]) -> int:
    """Delete what is older than a week and holds no sound; returns how many."""
    count = 0
    for path, _ in leftovers:
        try:
            if time.time() - path.stat().st_mtime > UNUSABLE_AFTER and not readable_frames(path):
                path.unlink()
                count += 1
        except OSError:
            continue
    return count


def describe_leftovers(folder: Path) -> str:
    """List the unfinished recordings in a folder as a message for the user, and delete those without sound."""
    try:
        leftovers = find_leftovers(folder)
    except OSError:
        return ""
    names = [path.name for path, _ in leftovers if readable_frames(path)]
    delete_unusable(leftovers)
    if not names:
        return ""
    listing = ", ".join(names[:MAX_LISTED]) + (
        f" and {len(names) - MAX_LISTED} more" if len(names) > MAX_LISTED else ""
    )
    return f"there are interrupted recordings: {listing}; recover them with {program_name()} recover {folder}"
