"""How kernels are compiled: every option in one place, with its reason."""

from collections.abc import Callable
from typing import Any, ClassVar

import numba
import numpy as np
from numba.core.ccallback import CFunc
from numba.core.codegen import CPUCodeLibrary, JITCPUCodegen
from numba.core.sigutils import normalize_signature

from engine.kernel_cache import KernelCache

# literals of Python as arguments, or as initial values of what becomes one, would make Numba compile what
# they are passed to once more
ZERO, ONE, NO = np.int64(0), np.int64(1), np.bool_(False)

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
    """Compile a kernel that Python calls; it is kept on disk, for a second start must not compile again."""
    dispatcher: Any = numba.njit(**OPTIONS)(function)
    dispatcher._cache = KernelCache(function)
    return _Part.mark(dispatcher, part=False)


def callback(kind: Any) -> Callable[[Callable[..., Any]], Any]:
    """Compile a function of the given signature that others than Python call; it is kept on disk."""
    options = {name: value for name, value in OPTIONS.items() if name not in ("nogil",)}

    def declare(function: Callable[..., Any]) -> Any:
        made: Any = CFunc(function, normalize_signature(kind), locals={}, options=options)
        made._cache = KernelCache(function)
        made.compile()
        return made

    return declare


def pointer(dispatcher: Any, *arguments: Any) -> int:
    """Address by which C calls a kernel of `entry` with such arguments; it is compiled if need be."""
    kinds = tuple(numba.typeof(argument) for argument in arguments)
    dispatcher.compile(kinds)
    found = dispatcher.overloads[kinds]
    return int(found.library.get_pointer_to_function(found.fndesc.llvm_cfunc_wrapper_name))
