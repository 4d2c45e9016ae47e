"""Compiled kernels on disk, so that a second start does not compile them again.

Each kernel is one file, named by a digest of its key, and it begins with that key in full. If a file is invalid in any
way, its kernel is compiled again. The files are in a folder named by a digest of all kernel sources, of the compilers
and of the processor, so that machine code for another processor is never run.
"""

import hashlib
import json
import os
import sys
from contextlib import suppress
from functools import lru_cache
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path

import numpy as np

from engine.compiler import cache_files
from engine.compiler.kinds import Kind
from engine.compiler.tricks import Trick, in_use, switched_off

MARKS = "engine.compiler.decorators", "from numba", "import numba", "(IntEnum)"
COMPILED = "kernel"  # a package of which all files count
COMPILERS = "numba", "llvmlite"
OF_MACHINE_CODE = (  # other settings of Numba that reach its code generator, by which a kernel may be 50 times slower
    "NUMBA_OPT",
    "NUMBA_LOOP_VECTORIZE",
    "NUMBA_SLP_VECTORIZE",
    "NUMBA_ENABLE_AVX",
    "NUMBA_BOUNDSCHECK",
    "NUMBA_DEBUGINFO",
)
IN_USE = in_use(Trick.KERNEL_FILES)


def kernel_sources() -> list[Path]:
    """Return the files of this package that hold compiled code, or define the layout of its arguments."""
    package = Path(__file__).parents[1]
    files = [(path, path.relative_to(package).parts[0]) for path in sorted(package.rglob("*.py"))]
    compiled = [path for path, room in files if room == COMPILED or any(m in path.read_text("utf-8") for m in MARKS)]
    return [*compiled, *sorted(package.rglob("*.ll"))]


@lru_cache
def source_digest() -> str:
    """Return the digest of all kernel sources."""
    package, sources = Path(__file__).parents[1], hashlib.sha256()
    for path in kernel_sources():
        content = path.read_bytes()
        sources.update(f"\0{path.relative_to(package).as_posix()}\0{len(content)}\0".encode() + content)
    return sources.hexdigest()


@lru_cache
def digest() -> str:
    """Return the digest of all kernel sources and of the compilers, then that of the processor.

    Machines of several kinds may share a home folder. Each has its own kernels, and none counts as older sources.
    """
    versions = (*map(package_version, COMPILERS), np.__version__, sys.version, *sorted(switched_off()))
    sources = hashlib.sha256("\0".join((*versions, source_digest())).encode())
    return f"{sources.hexdigest()[:16]}-{hashlib.sha256(repr(processor()).encode()).hexdigest()[:8]}"


def package_version(name: str) -> str:
    """Return the version of a package, without importing it."""
    try:
        return version(name)
    except PackageNotFoundError:
        return "not installed"


def processor() -> tuple[str, ...]:
    """Return the properties that machine code depends on: the system, the processor and its features, and Numba's
    settings of them."""
    import llvmlite.binding as llvm

    settings = [os.environ.get(name, "") for name in ("NUMBA_CPU_NAME", "NUMBA_CPU_FEATURES")]
    settings += [f"{name}={os.environ[name]}" for name in OF_MACHINE_CODE if os.environ.get(name)]
    with suppress(OSError):  # Numba reads this file, too
        settings.append(Path(".numba_config.yaml").read_text("utf-8", "replace"))
    return sys.platform, llvm.get_host_cpu_name(), llvm.get_host_cpu_features().flatten(), *settings


@lru_cache
def kernel_folder() -> Path:
    """Return the folder of kernels of the present sources, and delete old kernels above the size limit. Raises
    OSError."""
    path = cache_files.folder(digest())
    _prune(path)
    return path


def _prune(present: Path) -> None:
    try:
        size = cache_files.limit()
    except ValueError as error:
        warn_once(f"{error}; {cache_files.DEFAULT_MEGABYTES:g} MB is used")
        size = cache_files.DEFAULT_MEGABYTES * 1e6
    cache_files.prune(present, size)


@lru_cache
def warn_once(message: str) -> None:
    """Warn the user, once, and not from each process of a sweep."""
    from multiprocessing import parent_process

    if parent_process() is None:
        print(f"fdh-engine: {message}", file=sys.stderr)


def read_kernel(module: str, function: str, kinds: tuple[Kind, ...]) -> bytes | None:
    """Return the stored machine code of a kernel; None if the kernel must be compiled."""
    if not IN_USE:
        return None
    try:
        path = _path(module, function, kinds)
    except OSError:
        return None
    content = cache_files.read(path)
    if content is None:
        return None
    found, _, rest = content.partition(b"\n")
    return rest if found == key(module, function, kinds) else None


def write_kernel(module: str, function: str, kinds: tuple[Kind, ...], content: bytes) -> None:
    """Store the machine code of a kernel, or warn that it cannot be stored, with the reason."""
    if not IN_USE:
        return
    try:
        path = _path(module, function, kinds)
        cache_files.write(path, key(module, function, kinds) + b"\n" + content)
        _prune(path.parent)
    except OSError as error:
        reason = error.strerror or error
        warn_once(f"compiled kernels cannot be kept ({reason}); they are compiled again at each start")


def key(module: str, function: str, kinds: tuple[Kind, ...]) -> bytes:
    """Return the key of a kernel, which is the first line of its file."""
    return json.dumps([digest(), module, function, kinds]).encode()


def _path(module: str, function: str, kinds: tuple[Kind, ...]) -> Path:
    """Return the file of a kernel. Raises OSError."""
    name = f"{module.rpartition('.')[2]}.{function}"[:100]
    key_digest = hashlib.sha256(key(module, function, kinds)).hexdigest()[:16]
    return kernel_folder() / f"{name}-{key_digest}{cache_files.KERNEL}"
