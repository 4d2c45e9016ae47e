"""The names of kernels that a user chooses from (engine.runtime.kernel_choice)."""

import os
from enum import StrEnum

VARIABLE = "FDH_KERNEL"  # of the environment: the choice where none is made


class KernelName(StrEnum):
    """Names of the choices of a kernel."""

    SPECIAL = "special"
    GENERAL = "general"
    AUTO = "auto"  # the special one if it is there, or else the general one if that is


def read_kernel_name(requested: str | None) -> KernelName:
    """Return the requested kernel; if there is none, what the environment says, or AUTO. Raises ValueError."""
    name = requested or os.environ.get(VARIABLE, "").lower() or KernelName.AUTO
    try:
        return KernelName(name)
    except ValueError:
        where = "" if requested else f"{VARIABLE}: "
        raise ValueError(f'{where}"{name}" is not a kernel; give {", ".join(KernelName)}') from None
