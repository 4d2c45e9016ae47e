"""Compiled kernels on disk: a second start does not compile again.

Numba's own cache keeps an index beside its files. It fails on a damaged file at every later start, and two processes
that write at once can make an index that names the wrong kernel. Here each kernel is one file, named by a digest of
what it is of, and it holds that in full. Whatever is wrong with a file, its kernel is compiled again.

The files are in a folder named by a digest of all kernel sources. Numba alone looks only at the file of the outermost
function, so that after an edit of an imported kernel it would use a stale one.
"""

import hashlib
import pickle
import sys
from functools import lru_cache
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import llvmlite
import llvmlite.binding
import numba
import numpy as np
from numba.core.caching import CompileResultCacheImpl, FunctionCache
from numba.core.codegen import get_host_cpu_features
from numba.core.serialize import dumps

from engine.compiler import cache_files
from engine.compiler.tricks import Trick, in_use, switched_off

MARKS = ("engine.compiler", "numba", "(NamedTuple)")


def kernel_sources() -> list[Path]:
    """The files of this package that hold compiled code, or say how what it is given is laid out."""
    files = sorted(Path(__file__).parents[1].rglob("*.py"))
    return [path for path in files if any(mark in path.read_text("utf-8") for mark in MARKS)]


@lru_cache
def digest() -> str:
    """Digest of all kernel sources and of what compiles them, then of the processor.

    Machines of several kinds may share a home folder: each has kernels of its own, and none counts as older sources.
    """
    package = Path(__file__).parents[1]
    versions = (numba.__version__, llvmlite.__version__, np.__version__, sys.version, *sorted(switched_off()))
    sources = hashlib.sha256("\0".join(versions).encode())
    for path in kernel_sources():
        content = path.read_bytes()
        sources.update(f"\0{path.relative_to(package).as_posix()}\0{len(content)}\0".encode() + content)
    processor = (sys.platform, llvmlite.binding.get_host_cpu_name(), get_host_cpu_features())
    return f"{sources.hexdigest()[:16]}-{hashlib.sha256(repr(processor).encode()).hexdigest()[:8]}"


@lru_cache
def kernel_folder() -> Path:
    """The folder of kernels of the present sources; what there is too much of is deleted. Raises OSError."""
    path = cache_files.folder(digest())
    _prune(path)
    return path


def _prune(present: Path) -> None:
    try:
        size = cache_files.limit()
    except ValueError as error:
        warn_once(f"{error}; {cache_files.LIMIT:g} MB is used")
        size = cache_files.LIMIT * 1e6
    cache_files.prune(present, size)


@lru_cache
def warn_once(message: str) -> None:
    """Tell the user, once, and not from each process of a sweep."""
    from multiprocessing import parent_process

    if parent_process() is None:
        print(f"fdh-engine: {message}", file=sys.stderr)


@lru_cache
def file_digest(path: str) -> str | None:
    """Digest of a source file; None if there is none, as at a prompt."""
    try:
        return hashlib.sha256(Path(path).read_bytes()).hexdigest()
    except OSError:
        return None


class _Results(CompileResultCacheImpl):
    """Compiled functions as Numba takes them apart; where they are kept is not its concern."""

    def __init__(self, function: Any) -> None:
        self._lineno = function.__code__.co_firstlineno
        self._locator = SimpleNamespace(_py_file=function.__code__.co_filename)  # named in warnings


class KernelCache(FunctionCache):
    """The compiled code of one function: a file for each signature."""

    def __init__(self, function: Any) -> None:
        code = function.__code__
        self._py_func, self._impl = function, _Results(function)
        self._source = code.co_filename
        name = f"{Path(self._source).stem}.{function.__qualname__}-{code.co_firstlineno}"
        self._name = "".join(letter if letter.isalnum() or letter in "._-" else "" for letter in name)[:100]
        self.enable()

    @classmethod
    def attach(cls, compiled: Any, function: Any) -> None:
        """Let a dispatcher or a C callback keep its code on disk."""
        if in_use(Trick.KERNEL_FILES, cls.self_test):
            compiled._cache = cls(function)

    @staticmethod
    def self_test() -> bool:
        """Whether Numba takes results apart and puts them together as it is asked to here."""
        inner = (CompileResultCacheImpl.reduce, CompileResultCacheImpl.rebuild, CompileResultCacheImpl.check_cachable)
        return all(map(callable, inner)) and callable(FunctionCache._index_key)

    @property
    def cache_path(self) -> str | None:
        """The folder, as Numba's statistics tell it."""
        try:
            return str(kernel_folder())
        except OSError:
            return None

    def flush(self) -> None:
        """Forget all signatures of this function."""
        if path := self.cache_path:
            for file in Path(path).glob(f"{self._name}-*{cache_files.KERNEL}"):
                cache_files.delete(file)

    def _load_overload(self, signature: Any, target: Any) -> Any:
        """The compiled function; None if it is to be compiled."""
        key = self._key(signature, target.codegen())
        if key is None:
            return None
        try:
            path = self._path(key)
        except OSError:
            return None
        content = cache_files.read(path)
        if content is None:
            return None
        try:
            stored_key, parts = pickle.loads(content)
            return self._impl.rebuild(target, parts) if stored_key == key else None
        except Exception:  # whatever it is that cannot be loaded, it can be compiled
            cache_files.delete(path)
            return None

    def _save_overload(self, signature: Any, result: Any) -> None:
        """Keep a compiled function, or say why that cannot be."""
        key = self._key(signature, result.codegen)
        if key is None or not self._impl.check_cachable(result):
            return
        try:
            path = self._path(key)
            cache_files.write(path, dumps((key, self._impl.reduce(result))))
            _prune(path.parent)
        except OSError as error:
            reason = error.strerror or error
            warn_once(f"compiled kernels cannot be kept ({reason}); they are compiled again at each start")

    def _key(self, signature: Any, codegen: Any) -> Any:
        """What a file must be of: source, types, processor, code and what it closes over. None if it is not kept."""
        stamp = file_digest(self._source)
        return (stamp, *self._index_key(signature, codegen)) if self._enabled and stamp else None

    def _path(self, key: Any) -> Path:
        """The file of a key; after an edit, the same. Raises OSError."""
        key_digest = hashlib.sha256(repr((self._source, key[1:])).encode()).hexdigest()[:16]
        return kernel_folder() / f"{self._name}-{key_digest}{cache_files.KERNEL}"
