"""Compile a kernel to machine code that runs without Numba."""

import importlib
from typing import Any

import numba
from numba.core import types

from engine.compiler.code_objects import to_content
from engine.compiler.decorators import kernel, prepared_to_compile
from engine.compiler.kinds import FLOAT, INT, Kind, example_of
from engine.compiler.struct_types import StructHandleType
from engine.faults import BuildError, Fault


def compile_kernel(module: str, function: str, kinds: tuple[Kind, ...]) -> bytes:
    """Compile a function for arguments of these kinds. Return the bytes that engine.compiler.code_objects loads. Raises
    BuildError if Numba's settings let it compile nothing."""
    if numba.config.DISABLE_JIT:
        where = "NUMBA_DISABLE_JIT is set, in the environment or in .numba_config.yaml"
        raise BuildError(Fault("", f"{where}: kernels cannot be compiled; unset it"))
    dispatcher = kernel(getattr(importlib.import_module(module), function).py_func, from_python=False)
    signature = tuple(map(numba_type, kinds))
    with prepared_to_compile():
        dispatcher.compile(signature)
    compiled = dispatcher.overloads[signature]
    machine_code = compiled.library._get_compiled_object()
    return to_content(compiled.fndesc.llvm_cfunc_wrapper_name, _needed(compiled.library), machine_code)


def numba_type(kind: Kind) -> Any:
    """Return Numba's type for the kind of an argument."""
    if isinstance(kind, str):
        return {INT: types.int64, FLOAT: types.float64}[kind]
    return StructHandleType(numba.typeof(example_of(kind[1])))


def _needed(library: Any) -> list[str]:
    """Return the names of the functions that the code of a library calls, but does not contain."""
    functions = library._final_module.functions
    return sorted(f.name for f in functions if f.is_declaration and not f.name.startswith("llvm."))
