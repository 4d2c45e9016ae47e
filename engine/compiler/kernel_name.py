"""The names of kernels that a user chooses from (engine.runtime.kernel_choice)."""

from enum import StrEnum


class KernelName(StrEnum):
    """Names of the choices of a kernel."""

    GENERAL = "general"
    SPECIAL = "special"


def read_kernel_name(requested: str | None) -> KernelName:
    """Return the requested kernel; the general one if there is none. Raises ValueError."""
    try:
        return KernelName(requested or KernelName.GENERAL)
    except ValueError:
        raise ValueError(f'"{requested}" is not a kernel; give {", ".join(KernelName)}') from None
