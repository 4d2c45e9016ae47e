"""The machine and the versions that a measurement was made with."""

import hashlib
import os
import platform
from functools import lru_cache
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path


def describe_machine() -> dict[str, str]:
    """Processor, cores, and the versions of Python, of packages, and of this engine."""
    record = {"processor": processor_name(), "cores": str(os.cpu_count()), "Python": platform.python_version()}
    for package in ("numba", "numpy", "fdh-engine"):
        try:
            record[package] = version(package)
        except PackageNotFoundError:
            record[package] = "not installed"  # run from a folder of sources
    return record


@lru_cache  # the sources as they were imported, not as they are edited since
def source_digest() -> str:
    """12 hexadecimal digits that differ for any other sources of the engine."""
    files = sorted(Path(__file__).parent.rglob("*.py"))
    return hashlib.sha256(b"".join(path.read_bytes() for path in files)).hexdigest()[:12]


def processor_name() -> str:
    """The name of the processor."""
    try:
        for line in Path("/proc/cpuinfo").read_text().splitlines():
            if line.startswith("model name"):
                return line.partition(":")[2].strip()
    except OSError:
        pass
    return platform.processor() or platform.machine()
