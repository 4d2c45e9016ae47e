"""How kernels are compiled: every option in one place, with its reason.

Compiled code is cached on disk, in a folder named by a digest of all kernel
sources. Numba alone looks only at the file of the outermost function, so that
editing an imported kernel would leave a stale cache.
"""

import hashlib
import os
import shutil
import sys
import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import Any, ClassVar

import numba
import numpy as np
from numba.core import config as numba_config
from numba.core.codegen import CPUCodeLibrary, JITCPUCodegen

config: Any = numba_config
# literals of Python as arguments, or as initial values of what becomes one, would make Numba compile what
# they are passed to once more
ZERO, ONE, NO = np.int64(0), np.int64(1), np.bool_(False)
KEPT_DIGESTS = 4  # caches of older sources beyond this many are deleted

OPTIONS: dict[str, Any] = {
    "nogil": True,  # a block runs beside Python threads
    "error_model": "numpy",  # 1/0 is inf, not an exception: 3.4 times faster divisions
    "fastmath": False,  # fastmath assumes no NaN, and would remove our guards against it
    "boundscheck": False,
    "_nrt": False,  # no reference counts (530 → 72 ns); a kernel that allocates does not compile
}
PART: dict[str, Any] = OPTIONS | {
    "forceinline": True,  # a call passes every array of its slots: 960 → 530 ns per sample
    "no_cpython_wrapper": True,  # only kernels call it; this and the next halve the time to compile
    "no_cfunc_wrapper": True,
}
# sums of many products: the order of addition is the compiler's, so that it can be vector code; no
# flag here lets it assume that NaN does not occur
SUM: dict[str, Any] = PART | {"fastmath": {"reassoc", "nsz", "contract"}}
ENTRY: dict[str, Any] = OPTIONS | {"cache": True}  # a second start must not compile again


def kernel_sources() -> list[Path]:
    """The files of this package that hold compiled code, or say how what it is given is laid out."""
    here = Path(__file__).parent
    files = sorted(here.glob("*.py"))
    return [p for p in files if any(mark in p.read_text("utf-8") for mark in ("engine.jit", "numba", "(NamedTuple)"))]


def source_digest() -> str:
    """Digest of all kernel sources and the compiler's version."""
    digest = hashlib.sha256(numba.__version__.encode())
    for path in kernel_sources():
        digest.update(path.name.encode() + b"\0" + path.read_bytes())
    return digest.hexdigest()[:16]


def _own() -> Path:
    """The user's cache folder. Raises RuntimeError without a home."""
    if configured := os.environ.get("NUMBA_CACHE_DIR"):
        return Path(configured)
    if sys.platform == "win32":
        return Path(os.environ.get("LOCALAPPDATA") or Path.home())
    if sys.platform == "darwin":
        return Path.home() / "Library" / "Caches"
    return Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache")


def _base() -> Path:
    """The user's cache folder, or a temporary one where that cannot be written: each user's own."""
    try:
        base = _own() / "fdh-engine"
        base.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=base):
            return base
    except (OSError, RuntimeError):
        user = os.getuid() if hasattr(os, "getuid") else "own"
        return Path(tempfile.gettempdir()) / f"fdh-engine-{user}"


def _used(folder: Path) -> float:
    """When a cache folder was used last; of one that another process has just pruned, never."""
    try:
        return folder.stat().st_mtime
    except OSError:
        return 0.0


def _cache() -> Path:
    """The cache folder of the present sources; those of old sources are pruned."""
    folder = _base() / source_digest()
    folder.mkdir(parents=True, exist_ok=True)
    os.utime(folder)
    others = sorted(folder.parent.iterdir(), key=_used, reverse=True)
    for old in others[KEPT_DIGESTS:]:
        shutil.rmtree(old, ignore_errors=True)
    return folder


CACHE = _cache()


class _Part:
    """Whether a part of a kernel is being compiled, rather than an entry.

    Numba makes each function a library of its own, with all it calls, optimises it and translates it
    to machine code. A part is never run from there: left to the entry that inlines it, both are
    done once instead of at each level of calls (28 → 18 s for a string on a bridge).
    """

    compiling: ClassVar[list[bool]] = []

    @classmethod
    def now(cls) -> bool:
        return bool(cls.compiling) and cls.compiling[-1]

    @classmethod
    def mark(cls, dispatcher: Any, part: bool) -> Any:
        """Let a function be compiled as a part, or as an entry."""
        whole = dispatcher._compiler.compile

        def compile_marked(*arguments: Any) -> Any:
            cls.compiling.append(part)
            try:
                return whole(*arguments)
            finally:
                cls.compiling.pop()

        dispatcher._compiler.compile = compile_marked
        return dispatcher

    @classmethod
    def spare(cls, library: Any, codegen: Any) -> None:
        """Teach Numba to leave the libraries of parts as they are."""
        optimise, finish = library._optimize_final_module, library._finalize_final_module
        place = codegen.set_env

        def optimise_entries(self: Any) -> None:
            if not cls.now():
                optimise(self)

        def finish_entries(self: Any) -> None:
            if cls.now():
                self._finalize_dynamic_globals()
                self._finalized = True
            else:
                finish(self)

        def place_entries(self: Any, name: str, environment: Any) -> None:
            if not cls.now():  # of a part, it is not in memory; only code that raises would use it
                place(self, name, environment)

        library._optimize_final_module, library._finalize_final_module = optimise_entries, finish_entries
        codegen.set_env = place_entries


_Part.spare(CPUCodeLibrary, JITCPUCodegen)


def jit(function: Callable[..., Any]) -> Any:
    """Compile a part of a kernel: it is inlined where it is called."""
    return _Part.mark(numba.njit(**PART)(function), part=True)


def outlined(function: Callable[..., Any]) -> Any:
    """Compile a part of a kernel that is large and seldom runs: inlined wherever it is called, the
    coupled contact solve alone would take 15 s to compile."""
    return _Part.mark(numba.njit(**PART | {"forceinline": False})(function), part=True)


def summing(function: Callable[..., Any]) -> Any:
    """Compile a part of a kernel that sums many products, as vector code (1.0 → 0.1 ns each)."""
    return _Part.mark(numba.njit(**SUM)(function), part=True)


def entry(function: Callable[..., Any]) -> Any:
    """Compile a kernel that Python calls, into the cache of these sources."""
    return _Part.mark(_cached(lambda: numba.njit(**ENTRY)(function)), part=False)


def callback(kind: Any) -> Callable[[Callable[..., Any]], Any]:
    """Compile a function of the given signature that others than Python call, into the cache of these sources."""
    options = {name: value for name, value in OPTIONS.items() if name not in ("nogil",)}
    return lambda function: _cached(lambda: numba.cfunc(kind, cache=True, **options)(function))


def pointer(dispatcher: Any, *arguments: Any) -> int:
    """Address by which C calls a kernel of `entry` with such arguments; it is compiled if need be."""
    kinds = tuple(numba.typeof(argument) for argument in arguments)  # type: ignore[no-untyped-call]
    dispatcher.compile(kinds)
    found = dispatcher.overloads[kinds]
    return int(found.library.get_pointer_to_function(found.fndesc.llvm_cfunc_wrapper_name))


def _cached(declare: Callable[[], Any]) -> Any:
    """Declare a function whose compiled code is kept among that of these sources."""
    other = config.CACHE_DIR
    config.CACHE_DIR = str(CACHE)  # read when the function is declared; other packages keep theirs
    try:
        return declare()
    finally:
        config.CACHE_DIR = other
