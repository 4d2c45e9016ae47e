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


def describe_leftover(unknown_keys: list[str], ignored: dict[str, int], stolen: int = 0, refused: int = 0) -> list[str]:
    """What of the notes was not played, a line for each reason.

    unknown_keys: that an instrument has not; ignored: messages by what they are
    stolen, refused: notes that ended for others; and notes, or bends, beyond the pitches that there are
    """
    lines = []
    if unknown_keys:
        lines.append(f"notes left out, for the instrument has no such keys: {', '.join(unknown_keys)}")
    if ignored:
        what = ", ".join(f"{kind} ({count})" for kind, count in sorted(ignored.items()))
        lines.append(f"MIDI messages ignored: {what}")
    if stolen:
        lines.append(f"{stolen} notes ended early to make room for others; more --voices")
    if refused:
        lines.append(f"{refused} notes or bends refused: beyond the pitches or keys that there are")
    return lines
