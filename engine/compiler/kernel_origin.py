"""The origin of the machine code of a kernel on this machine. Nothing is compiled to find out."""

from enum import StrEnum

from engine.compiler import cache
from engine.compiler.code_objects import load_code
from engine.compiler.kernels import Kernel
from engine.compiler.kinds import Kind
from engine.compiler.shipped import read_shipped


class KernelOrigin(StrEnum):
    """Places that the machine code of a kernel comes from."""

    CACHE = "cache"
    SHIPPED = "shipped"
    COMPILER = "compiler"  # it has to be compiled before the first sample


def find_origin(kernel: Kernel, kinds: tuple[Kind, ...]) -> KernelOrigin:
    """Return where the machine code of a kernel would be loaded from, in the order in which Kernel.address looks."""
    for origin, read in ((KernelOrigin.CACHE, cache.read_kernel), (KernelOrigin.SHIPPED, read_shipped)):
        content = read(kernel.module, kernel.function, kinds)
        if content is not None and load_code(content) is not None:
            return origin
    return KernelOrigin.COMPILER
