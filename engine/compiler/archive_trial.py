"""The trial of an archive of kernels on a machine, in another process, so that code which does not run here harms
nothing: four small scenes have to sound as they did where the archive was made.

The result is kept beside the kernels of this machine. Two processes that begin at once both make the trial; where
nothing can be kept, each process makes it.
"""

import hashlib
import os
import subprocess
import sys
from functools import lru_cache
from pathlib import Path
from typing import Any

from engine.compiler import cache, cache_files

TRIED = "FDH_TRIED_ARCHIVE"  # of the environment of the process that makes the trial: the archive that it may use
SCENES = "engine.offline.trial_scenes"  # the program: it prints the digest of the samples
SECONDS = 10.0  # after which a trial has failed
PASSED = "passed"
MARK = ".trial"


def tried_archive() -> Path | None:
    """Return the archive that this process tries: it has no other kernels. None if it makes no trial."""
    path = os.environ.get(TRIED)
    return Path(path) if path else None


@lru_cache
def find_result(path: Path, samples: str) -> str:
    """Return PASSED, or why the kernels of an archive do not run on this machine. The first time, they are tried, and a
    failure is said. samples: the digest that is expected"""
    if not _can_start_python():
        return PASSED
    result = _kept_result(path)
    if result is None:
        result = _try(path, samples)
        _keep_result(path, result)
        if result != PASSED:
            cache.warn_once(f"{path.name} does not run on this machine ({result}); its kernels are compiled")
    return result


def _can_start_python() -> bool:
    """True if another process of this Python can be started: not from a program that is frozen into one file."""
    return bool(sys.executable) and not getattr(sys, "frozen", False)


def _try(path: Path, samples: str) -> str:
    """Return PASSED, or why an archive failed."""
    environment = os.environ | {TRIED: str(path), "PYTHONPATH": os.pathsep.join(filter(None, sys.path))}
    settings: dict[str, Any] = {"creationflags": getattr(subprocess, "CREATE_NO_WINDOW", 0)}  # a word of Windows
    settings |= {"env": environment, "stdin": subprocess.DEVNULL, "capture_output": True, "timeout": SECONDS}
    try:
        ran = subprocess.run([sys.executable, "-m", SCENES], check=False, **settings)
    except subprocess.TimeoutExpired:
        return f"no sound within {SECONDS:g} s"
    except OSError as error:
        return f"it could not be tried: {error.strerror}"
    if ran.returncode:
        last = ran.stderr.decode("utf-8", "replace").strip().splitlines()[-1:]
        return f"its trial ended with {ran.returncode}{': ' if last else ''}{''.join(last)[:200]}"
    return PASSED if ran.stdout.decode().strip() == samples else "its samples are others"


def _kept_result(path: Path) -> str | None:
    try:
        content = cache_files.read(_mark(path))
    except OSError:
        return None
    return None if content is None else content.decode()


def _keep_result(path: Path, result: str) -> None:
    try:
        cache_files.write(_mark(path), result.encode())
    except OSError:
        return


def _mark(path: Path) -> Path:
    """Return the file of the result. Raises OSError."""
    digest = hashlib.sha256(path.read_bytes()).hexdigest()[:16]
    return cache.kernel_folder() / f"{path.stem}-{digest}{MARK}"
