"""Files that a program which was killed has left half-written, and `render.py recover`, which keeps the recordings."""

import os
import re
import sys
import time
from pathlib import Path

from engine.arguments import Parser
from engine.recording import frames_of, lock, mend
from engine.save import free, reason

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
    return f"recordings were broken off: {some}; keep them with render.py recover {folder}"


def recover(words: list[str]) -> int:
    """Keep recordings that were broken off."""
    from engine.patch import Fault

    what = "Keep recordings that were broken off, as files that can be played; delete what else was left for a week."
    parse = Parser(prog="render.py recover", description=what)
    parse.add_argument("folder", metavar="FOLDER", nargs="?", default=".", help="where they were made (default: here)")
    folder = Path(parse.parse_args(words).folder)
    if not folder.is_dir():
        print(Fault("render.py", None, "FOLDER", f"no such folder: {folder}"), file=sys.stderr)
        return 2
    kept = 0
    try:
        found = leftovers(folder)
        for path, name in found:
            if frames := mend(path):
                target = free(folder / name)
                os.replace(path, target)
                kept += 1
                print(f"{target}: {frames} frames, of {path.name}")
    except OSError as error:
        print(f"render.py: cannot recover {folder} ({reason(error)})", file=sys.stderr)
        return 1
    deleted = clear([(path, name) for path, name in found if path.exists()])
    if deleted:
        print(f"{deleted} other half-written files, older than a week, deleted")
    if not kept:
        print(f"{folder}: no recording was broken off")
    return 0
