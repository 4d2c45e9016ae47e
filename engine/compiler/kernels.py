"""Kernels: compiled functions that Python, an audio driver or a thread calls by their address.

A kernel is kept on disk as machine code, and loaded through llvmlite. A start that finds it imports neither Numba,
which takes a second, nor the modules of compiled code.
"""

import ctypes
import threading
from collections.abc import Callable
from typing import Any

from engine.compiler import archive_trial, cache
from engine.compiler.code_objects import Code, load_code, read_content
from engine.compiler.kinds import FLOAT, INT, Kind, effects_of
from engine.compiler.shipped import load_shipped
from engine.compiler.special_kernels import call_with_effects

C_TYPES = {INT: ctypes.c_ssize_t, FLOAT: ctypes.c_double}


class Kernel:
    """A function of a module of compiled code, for arguments of any kinds (engine.compiler.kinds).

    module, function: their names; the function is decorated with engine.compiler.decorators.kernel
    """

    def __init__(self, module: str, function: str) -> None:
        self.module, self.function = module, function
        self._loaded: dict[tuple[Kind, ...], Code] = {}
        self._lock = threading.Lock()

    def address(self, *kinds: Kind) -> int:
        """Return the kernel's address for arguments of these kinds; compile the kernel if necessary."""
        with self._lock:
            if kinds not in self._loaded:
                code = self._from_disk(kinds)
                self._loaded[kinds] = code if code is not None else self._compile(kinds)
            return self._loaded[kinds].address

    def is_ready(self, *kinds: Kind) -> bool:
        """True if the kernel need not be compiled."""
        with self._lock:
            if kinds not in self._loaded and (code := self._from_disk(kinds)) is not None:
                self._loaded[kinds] = code
            return kinds in self._loaded

    def callable(self, *kinds: Kind) -> Callable[..., None]:
        """Return a function that calls the kernel with integers, addresses and numbers. Other threads run meanwhile."""
        types: list[Any] = [C_TYPES[kind] if isinstance(kind, str) else ctypes.c_void_p for kind in kinds]
        return ctypes.CFUNCTYPE(None, *types)(self.address(*kinds))

    def _from_disk(self, kinds: tuple[Kind, ...]) -> Code | None:
        """Return the stored or shipped code of the kernel; None if there is none that is complete and runs here."""
        for load in (load_stored, load_shipped):
            if (code := load(self.module, self.function, kinds)) is not None:
                return code
        return None

    def _compile(self, kinds: tuple[Kind, ...]) -> Code:
        name = f"{self.module}.{self.function}"
        if archive_trial.tried_archive() is not None:
            raise RuntimeError(f"the archive has no kernel {name} for these arguments, or it cannot be loaded")
        effects, compiler = effects_of(kinds), "engine.compiler.kernel_compiler"  # imported where Numba is needed
        content = call_with_effects(effects, compiler, "compile_kernel", self.module, self.function, kinds)
        cache.write_kernel(self.module, self.function, kinds, content)
        code = _load_content(content)
        if code is None:
            raise RuntimeError(f"{name} was compiled, but its machine code cannot be loaded")
        return code


def load_stored(module: str, function: str, kinds: tuple[Kind, ...]) -> Code | None:
    """Return the code of a kernel that was compiled on this machine; None if there is none that can be loaded."""
    if archive_trial.tried_archive() is not None:
        return None
    content = cache.read_kernel(module, function, kinds)
    return None if content is None else _load_content(content)


def _load_content(kept: bytes) -> Code | None:
    """Return the code of a kernel from the bytes of a Content that has nothing else; None if it cannot be loaded."""
    content = read_content(kept)
    return None if content is None else next(iter(load_code(content).values()), None)
