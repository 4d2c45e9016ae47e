"""Compile a kernel for this machine, to machine code that runs without Numba."""

import importlib
from typing import Any

import numba

from engine.compiler.code_objects import Content
from engine.compiler.decorators import kernel, prepared_to_compile
from engine.compiler.kinds import Kind
from engine.compiler.machine_code import numba_type
from engine.faults import BuildError, Fault


def compile_kernel(module: str, function: str, kinds: tuple[Kind, ...]) -> bytes:
    """Compile a function for arguments of these kinds. Return the bytes of a Content. Raises BuildError if Numba's
    settings let it compile nothing.

    Numba does it all: code that is fitted to no machine at first, as that of archives, takes half as long again.
    """
    if numba.config.DISABLE_JIT:
        where = "NUMBA_DISABLE_JIT is set, in the environment or in .numba_config.yaml"
        raise BuildError(Fault("", f"{where}: kernels cannot be compiled; unset it"))
    dispatcher = kernel(getattr(importlib.import_module(module), function).py_func, from_python=False)
    signature = tuple(map(numba_type, kinds))
    with prepared_to_compile():
        dispatcher.compile(signature)
    compiled = dispatcher.overloads[signature]
    machine_code = compiled.library._get_compiled_object()
    return Content([compiled.fndesc.llvm_cfunc_wrapper_name], _needed(compiled.library), machine_code).to_bytes()


def _needed(library: Any) -> list[str]:
    """Return the names of the functions that the code of a library calls, but does not contain."""
    functions = library._final_module.functions
    return sorted(f.name for f in functions if f.is_declaration and not f.name.startswith("llvm."))
