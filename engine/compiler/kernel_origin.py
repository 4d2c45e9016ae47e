"""The origin of the machine code of a kernel on this machine. Nothing is compiled to find out."""

from enum import StrEnum

from engine.compiler.kernels import Kernel, load_stored
from engine.compiler.kinds import Kind
from engine.compiler.shipped import load_shipped


class KernelOrigin(StrEnum):
    """Places that the machine code of a kernel comes from."""

    CACHE = "cache"
    SHIPPED = "shipped"
    COMPILER = "compiler"  # it has to be compiled before the first sample


def find_origin(kernel: Kernel, kinds: tuple[Kind, ...]) -> KernelOrigin:
    """Return where the machine code of a kernel would be loaded from, in the order in which Kernel.address looks."""
    for origin, load in ((KernelOrigin.CACHE, load_stored), (KernelOrigin.SHIPPED, load_shipped)):
        if load(kernel.module, kernel.function, kinds) is not None:
            return origin
    return KernelOrigin.COMPILER
