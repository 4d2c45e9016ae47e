"""What the command line says of errors: one line each, on standard error, with the name of the program."""

import sys
from collections.abc import Iterable
from typing import TYPE_CHECKING

from engine.faults import Fault, PatchError
from engine.wording import program_name

if TYPE_CHECKING:
    from engine.patch.scene import Scene


def print_error(message: object) -> None:
    """Print one line with the program's name before it."""
    print(f"{program_name()}: {message}", file=sys.stderr)


def print_faults(faults: Iterable[Fault]) -> None:
    """Print one line for each fault."""
    for fault in faults:
        print(fault, file=sys.stderr)


def read_patch(path: str) -> "tuple[Scene | None, list[Fault]]":
    """Read a patch; returns its scene, or its faults."""
    from engine.patch.reader import load

    try:
        return load(path), []
    except PatchError as error:
        return None, error.faults
