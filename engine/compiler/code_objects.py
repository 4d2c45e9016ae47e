"""Machine code of a kernel: an object file as LLVM makes it, and what it needs from outside."""

import ctypes
import json
import sys
from contextlib import suppress
from functools import lru_cache
from typing import Any, NamedTuple

HELPERS = "numba_", "NRT_", "_NRT"  # of Numba, for what kernels never do: to raise, or to ask for memory

# what instructions may become that a processor does not have
C_FUNCTIONS = "memcpy", "memmove", "memset", "pow", "exp", "log", "sin", "cos", "expm1", "log1p", "fma"


class Code(NamedTuple):
    """Machine code that has been loaded."""

    address: int
    engine: Any  # of LLVM, with which it lives


def to_content(symbol: str, needed: list[str], machine_code: bytes) -> bytes:
    """An object file, with the name of its function and of those that it calls, as it is kept."""
    return json.dumps({"symbol": symbol, "needed": needed}).encode() + b"\n" + machine_code


def load_code(content: bytes) -> Code | None:
    """Load machine code; None if this is none, or it needs what is not there."""
    header, _, machine_code = content.partition(b"\n")
    try:
        about = json.loads(header)
        symbol, needed = str(about["symbol"]), [str(name) for name in about["needed"]]
    except (ValueError, TypeError, KeyError):
        return None
    addresses = {name: _address_of(name) for name in (*needed, *C_FUNCTIONS)}
    if not machine_code or None in (addresses[name] for name in needed):
        return None
    llvm = _llvm()
    for name, address in addresses.items():
        if address is not None and not llvm.address_of_symbol(name):  # or Numba, in this process, has its own
            llvm.add_symbol(name, address)
    engine = llvm.create_mcjit_compiler(
        llvm.parse_assembly(""), llvm.Target.from_default_triple().create_target_machine()
    )
    try:
        engine.add_object_file(llvm.ObjectFileRef.from_data(machine_code))
    except (RuntimeError, ValueError):
        return None
    engine.finalize_object()
    address = engine.get_function_address(symbol)
    return Code(address, engine) if address else None


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
