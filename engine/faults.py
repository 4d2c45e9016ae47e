"""Faults of patches, builds and options: where each is, what is wrong, and what would be right."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from engine.wording import program_name, to_one_line

MAX_FILE_CHARACTERS = 400  # of a file's name in a fault
MAX_MESSAGE_CHARACTERS = 500


@dataclass(frozen=True)
class Fault:
    """One thing that is wrong with a patch, or with an option of the command line.

    path:    of the key, such as "body[0].mass", or the option; "" for the file as a whole
    message: what is wrong, and after a semicolon what would be right
    file:    the patch as it was named; "" for an option
    line:    from 1; None where no line is to blame
    """

    path: str
    message: str
    file: str = ""
    line: int | None = None

    def __str__(self) -> str:
        file = to_one_line(self.file, MAX_FILE_CHARACTERS) if self.file else program_name()
        place = file if self.line is None else f"{file}:{self.line}"
        message = to_one_line(self.message, MAX_MESSAGE_CHARACTERS)
        return f"{place} {self.path}: {message}" if self.path else f"{place}: {message}"


class RenderInterrupted(KeyboardInterrupt):
    """Ctrl-C while a scene or notes are rendered. rendering: the first part, as a rendering of so many seconds"""

    def __init__(self, rendering: Any) -> None:
        super().__init__()
        self.rendering = rendering


class PatchWarning(FutureWarning):
    """A patch that works, and something in it that has no effect, or is said better otherwise."""


class PatchError(ValueError):
    """A patch that cannot be used. Its `faults` list all that is wrong with it, or the first of very many.

    >>> import fdh
    >>> try:
    ...     fdh.load("piano_c4").replace({"contact.felt.exponent": 0.5, "body.string.length": -1.0})
    ... except fdh.PatchError as error:
    ...     print([fault.path for fault in error.faults])
    ['body[0].length', 'contact[0].exponent']
    """

    def __init__(self, faults: Sequence[Fault]) -> None:
        super().__init__("\n".join(map(str, faults)))
        self.faults = list(faults)

    def __reduce__(self) -> tuple[Any, ...]:  # from another process
        return type(self), (self.faults,)


class BuildError(ValueError):
    """A valid scene that cannot be built with the given settings. Its `faults` have paths of keys, but no file.

    >>> import fdh
    >>> whistle = fdh.load("repelled_oscillator").replace("body.oscillator.frequency", 30_000.0)
    >>> fdh.render(whistle, samplerate=44_100)
    Traceback (most recent call last):
    engine.faults.BuildError: ...
    """

    def __init__(self, *faults: Fault) -> None:
        super().__init__("\n".join(f"{fault.path}: {fault.message}" for fault in faults))
        self.faults = list(faults)

    def __reduce__(self) -> tuple[Any, ...]:  # from another process
        return type(self), tuple(self.faults)
