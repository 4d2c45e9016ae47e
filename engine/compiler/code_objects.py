"""Machine code of kernels: an object file as LLVM makes it, what it has, and what it needs from outside."""

import ctypes
import json
import sys
from collections.abc import Sequence
from contextlib import suppress
from functools import lru_cache
from typing import Any, NamedTuple

HELPERS = "numba_", "NRT_", "_NRT"  # of Numba, for what kernels never do: to raise, or to ask for memory

# what instructions may become that a processor does not have
C_FUNCTIONS = "memcpy", "memmove", "memset", "pow", "exp", "log", "sin", "cos", "expm1", "log1p", "fma"


class Code(NamedTuple):
    """A function of machine code that has been loaded."""

    address: int
    engine: Any  # of LLVM, with which it lives


class Content(NamedTuple):
    """An object file, with the names of its functions and of those that it calls."""

    functions: Sequence[str]
    needed: Sequence[str]
    machine_code: bytes

    def to_bytes(self) -> bytes:
        """Return the content as it is kept."""
        return json.dumps({"functions": self.functions, "needed": self.needed}).encode() + b"\n" + self.machine_code


def read_content(kept: bytes) -> Content | None:
    """Return the content that was kept as bytes; None if they are none."""
    header, _, machine_code = kept.partition(b"\n")
    try:
        about = json.loads(header)
        functions, needed = ([str(name) for name in about[key]] for key in ("functions", "needed"))
    except (ValueError, TypeError, KeyError):
        return None
    return Content(functions, needed, machine_code) if machine_code else None


def load_code(content: Content) -> dict[str, Code]:
    """Load machine code. Return its functions by name; none if this is no code, or it needs what is not there."""
    addresses = {name: _address_of(name) for name in (*content.needed, *C_FUNCTIONS)}
    if None in (addresses[name] for name in content.needed):
        return {}
    llvm = _llvm()
    for name, address in addresses.items():
        if address is not None and not llvm.address_of_symbol(name):  # or Numba, in this process, has its own
            llvm.add_symbol(name, address)
    engine = llvm.create_mcjit_compiler(
        llvm.parse_assembly(""), llvm.Target.from_default_triple().create_target_machine()
    )
    try:
        engine.add_object_file(llvm.ObjectFileRef.from_data(content.machine_code))
    except (RuntimeError, ValueError):
        return {}
    engine.finalize_object()
    loaded = {name: engine.get_function_address(name) for name in content.functions}
    return {name: Code(address, engine) for name, address in loaded.items() if address}


@lru_cache
def _llvm() -> Any:
    import llvmlite.binding as llvm

    with suppress(RuntimeError):  # of later versions, which need it no longer
        llvm.initialize()
    llvm.initialize_native_target()
    llvm.initialize_native_asmprinter()
    return llvm


@lru_cache
def _address_of(name: str) -> int | None:
    """Address of a function of the C library; of a helper of Numba's that of `abort`, for it is never called."""
    if name.startswith(HELPERS):
        name = "abort"
    for library in _libraries():
        try:
            return ctypes.cast(getattr(library, name), ctypes.c_void_p).value
        except AttributeError:
            continue
    return None


@lru_cache
def _libraries() -> tuple[Any, ...]:
    if sys.platform == "win32":  # that of Python and Numba before the old one, whose pow has other last digits
        return ctypes.cdll.ucrtbase, ctypes.cdll.msvcrt, ctypes.pythonapi
    try:
        return ctypes.CDLL(None), ctypes.CDLL("libm.so.6"), ctypes.pythonapi
    except OSError:  # macOS, musl and BSD, where it is part of the C library, or has another name
        return ctypes.CDLL(None), ctypes.pythonapi
