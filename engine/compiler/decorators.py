"""Options by which kernels are compiled, all in one place, each with its reason."""

import gc
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

import numba
import numpy as np
from numba import types

from engine.compiler import enum_indices  # noqa: F401, it changes what Numba knows
from engine.compiler.numba_patches import SkipInlinedLibraries
from engine.compiler.tricks import Trick, in_use

# literals of Python as arguments, or as initial values of what becomes one, would make Numba compile what
# they are passed to once more
INT64_0, INT64_1, FALSE, TRUE = np.int64(0), np.int64(1), np.bool_(False), np.bool_(True)

COMPILER_DEPTH = 4000  # of Python's calls: 1100 are needed for a kernel with all effects

BASE_OPTIONS: dict[str, Any] = {
    "nogil": True,  # a block runs beside Python threads
    "error_model": "numpy",  # 1/0 is inf, not an exception: 3.4 times faster divisions
    "fastmath": False,  # fastmath assumes no NaN, and would remove our guards against it
    "boundscheck": False,
}


def is_option(name: str) -> bool:
    """True if Numba knows an option."""
    from numba.core.cpu import CPUTargetOptions

    return hasattr(CPUTargetOptions, name)


if in_use(Trick.NO_REFERENCE_COUNTS, lambda: is_option("_nrt")):
    BASE_OPTIONS["_nrt"] = False  # no reference counts (530 → 72 ns); a kernel that allocates does not compile
INLINE_OPTIONS = dict(BASE_OPTIONS)
if in_use(Trick.FORCED_INLINING, lambda: is_option("forceinline")):
    INLINE_OPTIONS["forceinline"] = True  # a call passes every array of its slots: 960 → 530 ns per sample
if in_use(Trick.NO_WRAPPERS, lambda: is_option("no_cpython_wrapper") and is_option("no_cfunc_wrapper")):
    INLINE_OPTIONS |= {"no_cpython_wrapper": True, "no_cfunc_wrapper": True}  # half the time to compile


def inline(function: Callable[..., Any]) -> Any:
    """Compile a function that is inlined where kernels call it."""
    return _compile(function, INLINE_OPTIONS, inlined=True)


def noinline(function: Callable[..., Any]) -> Any:
    """Compile a function that is large and seldom runs; kernels call it. Inlined at each call, the coupled contact
    solve alone would take 15 s to compile."""
    options = INLINE_OPTIONS | ({"forceinline": False} if "forceinline" in INLINE_OPTIONS else {})  # or it is inherited
    return _compile(function, options, inlined=True)


def kernel(function: Callable[..., Any], from_python: bool = True) -> Any:
    """Compile a function that is called from outside compiled code: by Python, or by its address
    (engine.compiler.kernels)."""
    options = BASE_OPTIONS | ({} if from_python else {"no_cpython_wrapper": True})
    return _compile(function, options, inlined=False)


def _compile(function: Callable[..., Any], options: dict[str, Any], inlined: bool) -> Any:
    """Let Numba compile a function; the type that it has as an argument is named after it, not after its address in
    memory, so that the same sources make the same bytes."""
    dispatcher = numba.njit(**options)(function)
    types.Dispatcher(dispatcher).name = f"function {function.__module__}.{function.__qualname__}"
    return SkipInlinedLibraries.mark(dispatcher, inlined=inlined)


@contextmanager
def prepared_to_compile() -> Iterator[None]:
    """Compile without Python's garbage collection, and with room for functions that call functions: Numba compiles each
    within the one that calls it. The objects that it makes live until a kernel is done, and searching them again and
    again takes a fifth of the time (17.4 → 13.9 s for a guitar string)."""
    sys.setrecursionlimit(max(sys.getrecursionlimit(), COMPILER_DEPTH))  # for good: another thread may compile, too
    collects = gc.isenabled()
    gc.disable()
    try:
        yield
    finally:
        if collects:
            gc.enable()
