"""What a measurement was made with: the machine, and the versions of what computes."""

import hashlib
import os
import platform
from functools import lru_cache
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path


def machine() -> dict[str, str]:
    """Processor, cores, and the versions of Python, of packages, and of this engine."""
    found = {"processor": processor(), "cores": str(os.cpu_count()), "Python": platform.python_version()}
    for package in ("numba", "numpy", "fdh-engine"):
        try:
            found[package] = version(package)
        except PackageNotFoundError:
            found[package] = "not installed"  # run from a folder of sources
    return found


@lru_cache  # as they were when they were read, not as they are edited since
def sources() -> str:
    """A few digits that tell these sources of the engine from any others."""
    files = sorted(Path(__file__).parent.glob("*.py"))
    return hashlib.sha256(b"".join(path.read_bytes() for path in files)).hexdigest()[:12]


def processor() -> str:
    """The machine's processor, as it calls itself."""
    try:
        for line in Path("/proc/cpuinfo").read_text().splitlines():
            if line.startswith("model name"):
                return line.partition(":")[2].strip()
    except OSError:
        pass
    return platform.processor() or platform.machine()
