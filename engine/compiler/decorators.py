"""How kernels are compiled: every option in one place, with its reason."""

import ctypes
import gc
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

import numba
import numpy as np
from numba.core.ccallback import CFunc
from numba.core.sigutils import normalize_signature

from engine.compiler import enum_indices  # noqa: F401, it changes what Numba knows
from engine.compiler.cache import KernelCache
from engine.compiler.numba_patches import SkipInlinedLibraries
from engine.compiler.tricks import Trick, in_use

# literals of Python as arguments, or as initial values of what becomes one, would make Numba compile what
# they are passed to once more
INT64_0, INT64_1, FALSE = np.int64(0), np.int64(1), np.bool_(False)

BASE_OPTIONS: dict[str, Any] = {
    "nogil": True,  # a block runs beside Python threads
    "error_model": "numpy",  # 1/0 is inf, not an exception: 3.4 times faster divisions
    "fastmath": False,  # fastmath assumes no NaN, and would remove our guards against it
    "boundscheck": False,
}


def is_option(name: str) -> bool:
    """Whether Numba knows an option."""
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
    return SkipInlinedLibraries.mark(numba.njit(**INLINE_OPTIONS)(function), inlined=True)


def noinline(function: Callable[..., Any]) -> Any:
    """Compile a function that is large and seldom runs, and is called: inlined wherever it is called, the coupled
    contact solve alone would take 15 s to compile."""
    options = INLINE_OPTIONS | ({"forceinline": False} if "forceinline" in INLINE_OPTIONS else {})  # or it is inherited
    return SkipInlinedLibraries.mark(numba.njit(**options)(function), inlined=True)


def kernel(function: Callable[..., Any]) -> Any:
    """Compile a kernel that Python calls; it is kept on disk, for a second start must not compile again."""
    dispatcher: Any = numba.njit(**BASE_OPTIONS)(function)
    KernelCache.attach(dispatcher, function)
    return SkipInlinedLibraries.mark(dispatcher, inlined=False)


def c_callback(signature: Any) -> Callable[[Callable[..., Any]], Any]:
    """Compile a function of the given signature that others than Python call; it is kept on disk."""
    options = {name: value for name, value in BASE_OPTIONS.items() if name != "nogil"}

    def declare(function: Callable[..., Any]) -> Any:
        compiled: Any = CFunc(function, normalize_signature(signature), locals={}, options=options)
        KernelCache.attach(compiled, function)
        with garbage_kept():
            compiled.compile()
        return compiled

    return declare


@contextmanager
def garbage_kept() -> Iterator[None]:
    """Compile without Python's collection of garbage: what Numba makes is alive until a kernel is done, and looking
    through it again and again takes a fifth of the time (17.4 → 13.9 s for a guitar string)."""
    collects = gc.isenabled()
    gc.disable()
    try:
        yield
    finally:
        if collects:
            gc.enable()


def c_address(dispatcher: Any, *arguments: Any) -> int:
    """Address by which C calls a kernel with such arguments; it is compiled if need be."""
    kinds = tuple(numba.typeof(argument) for argument in arguments)
    with garbage_kept():
        dispatcher.compile(kinds)
    compiled = dispatcher.overloads[kinds]
    return int(compiled.library.get_pointer_to_function(compiled.fndesc.llvm_cfunc_wrapper_name))


def c_function(dispatcher: Any, *arguments: Any) -> Callable[..., Any]:
    """A kernel for such arguments, to be called with whole numbers and addresses; other threads run meanwhile."""
    words = [ctypes.c_void_p if hasattr(a, "address") else ctypes.c_ssize_t for a in arguments]
    return ctypes.CFUNCTYPE(None, *words)(c_address(dispatcher, *arguments))
