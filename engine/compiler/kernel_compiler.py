"""Compile a kernel to machine code that runs without Numba."""

import numba

from engine.compiler.code_objects import Content
from engine.compiler.kinds import Kind
from engine.compiler.machine_code import neutral_code, object_code
from engine.compiler.targets import host_target
from engine.faults import BuildError, Fault


def compile_kernel(module: str, function: str, kinds: tuple[Kind, ...]) -> bytes:
    """Compile a function for arguments of these kinds, and this machine. Return the bytes of a Content. Raises
    BuildError if Numba's settings let it compile nothing."""
    if numba.config.DISABLE_JIT:
        where = "NUMBA_DISABLE_JIT is set, in the environment or in .numba_config.yaml"
        raise BuildError(Fault("", f"{where}: kernels cannot be compiled; unset it"))
    made = object_code({function: neutral_code(module, function, kinds)}, host_target(), {})
    return Content([function], made.needed, made.content).to_bytes()
