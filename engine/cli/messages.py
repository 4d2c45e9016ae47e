"""What the command line says of errors: one line each, on standard error, with the name of the program."""

import sys
from collections.abc import Iterable
from typing import TYPE_CHECKING

from engine.wording import program_name

if TYPE_CHECKING:
    from engine.patch.faults import Fault
    from engine.patch.scene import Scene

OptionFaults = list[tuple[str, str]]  # an option, and what is wrong with it


def print_error(message: object) -> None:
    """Print one line with the program's name before it."""
    print(f"{program_name()}: {message}", file=sys.stderr)


def print_faults(faults: "Iterable[Fault]") -> None:
    """Print one line for each fault."""
    for fault in faults:
        print(fault, file=sys.stderr)


def option_faults(wrong: OptionFaults) -> "list[Fault]":
    """Faults of options, to be told together with those of a patch."""
    from engine.patch.faults import Fault

    return [Fault(program_name(), None, option, what) for option, what in wrong]


def read_patch(path: str) -> "tuple[Scene | None, list[Fault]]":
    """Read a patch; returns its scene, or its faults."""
    from engine.patch.faults import PatchError
    from engine.patch.reader import load

    try:
        return load(path), []
    except PatchError as error:
        return None, error.faults
