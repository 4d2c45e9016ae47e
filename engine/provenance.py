"""The machine: its cores that may be used, its libraries, and what a measurement was made with."""

import ctypes
import hashlib
import math
import os
import platform
from functools import lru_cache
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path

ENGINE = "fdh-engine"
# functions of OpenBLAS that name the processor, as NumPy's wheels and distributions call them
OPENBLAS_PROCESSOR = "scipy_openblas_get_corename64_", "openblas_get_corename64_", "openblas_get_corename"


def describe_machine() -> dict[str, str]:
    """Processor, cores, and the versions of Python, of packages, and of this engine."""
    record = {"processor": processor_name(), "cores": str(usable_cores()), "Python": platform.python_version()}
    return record | {package: version_of(package) for package in ("numba", "numpy", ENGINE)}


@lru_cache
def version_of(package: str) -> str:
    """Return the version of a package that is installed, such as ENGINE; "not installed" of a folder of sources."""
    try:
        return version(package)
    except PackageNotFoundError:
        return "not installed"


def usable_cores() -> int:
    """Return how many cores this process may use: those that it may run on, within the quota of its container."""
    if hasattr(os, "sched_getaffinity"):
        count = len(os.sched_getaffinity(0))
    else:
        count = os.cpu_count() or 1
    return max(1, int(min(count, _processor_quota())))  # half a core more would only be throttled


def _processor_quota(groups: Path = Path("/proc/self/cgroup"), mounted: Path = Path("/sys/fs/cgroup")) -> float:
    """Return how many processors the control groups of this process allow, on Linux; infinite if there is no limit."""
    try:
        listed = [line.split(":", 2)[1:] for line in groups.read_text("utf-8").splitlines()]
    except (OSError, ValueError):
        return math.inf
    limits = [math.inf]
    for controllers, name in listed:
        if controllers and "cpu" not in controllers.split(","):
            continue
        top = mounted / controllers if controllers else mounted  # version 1 has a folder for its controllers
        inner = top / name.lstrip("/")
        for folder in (inner, *inner.parents):  # a container may see its own group as the top
            limits += _read_quota(folder)
            if folder == top:
                break
    return min(limits)


def _read_quota(folder: Path) -> list[float]:
    """The limit of one control group, processors, in a list; an empty list if it has none."""
    for names in (["cpu.max"], ["cpu.cfs_quota_us", "cpu.cfs_period_us"]):
        try:
            quota, period = map(float, " ".join((folder / name).read_text("utf-8") for name in names).split())
        except (OSError, ValueError):  # "max", or no such file
            continue
        return [quota / period] if quota > 0.0 and period > 0.0 else []
    return []


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


def blas_name() -> str:
    """The library of linear algebra that NumPy uses, and the processor that it takes this one for, where it says so."""
    import numpy as np

    about = np.show_config(mode="dicts")["Build Dependencies"]["blas"]
    return " ".join(filter(None, (about["name"], about["version"], blas_processor())))


def blas_processor() -> str:
    """The processor whose code OpenBLAS runs, such as Haswell; "" for another library."""
    import numpy.linalg

    try:
        library = ctypes.CDLL(numpy.linalg._umath_linalg.__file__)
    except (AttributeError, OSError):
        return ""
    for name in OPENBLAS_PROCESSOR:
        if function := getattr(library, name, None):
            function.restype = ctypes.c_char_p
            return (function() or b"").decode()
    return ""
