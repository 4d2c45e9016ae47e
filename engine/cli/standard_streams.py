"""Standard input and output of a program: closed, full, of another encoding, or with nobody who reads."""

import codecs
import errno
import io
import os
import sys
from contextlib import suppress
from typing import Any

from engine.output_files import error_reason
from engine.wording import program_name


def escaped(error: UnicodeError) -> tuple[str | bytes, int]:
    """Replace a character that an encoding does not have by \\u and its number, as in JSON; and restore a byte of a
    file name that is not text."""
    if not isinstance(error, UnicodeEncodeError):
        raise error
    code, after = ord(error.object[error.start]), error.start + 1
    if 0xDC80 <= code <= 0xDCFF:
        return bytes([code - 0xDC00]), after
    units = error.object[error.start].encode("utf-16-be", "surrogatepass").hex()
    return "".join(f"\\u{units[n : n + 4]}" for n in range(0, len(units), 4)), after


class Stream(io.TextIOWrapper):
    """An output that raises nothing: what is at work goes on. After an error, all is thrown away."""

    trouble: OSError | None = None

    def write(self, text: str) -> int:
        try:
            return super().write(text)
        except OSError as error:
            self._give_up(error)
            return len(text)

    def flush(self) -> None:
        try:
            super().flush()
        except OSError as error:
            self._give_up(error)

    def _give_up(self, error: OSError) -> None:
        self.trouble = self.trouble or error
        with suppress(OSError):
            nowhere = os.open(os.devnull, os.O_WRONLY)
            os.dup2(nowhere, self.fileno())
            os.close(nowhere)


def prepare() -> None:
    """Make the standard streams fit for what is printed. Those that are closed are opened: the next file would have
    their number otherwise, and a library that complains would write into it."""
    codecs.register_error("escaped", escaped)
    for number, how in enumerate((os.O_RDONLY, os.O_RDONLY, os.O_WRONLY)):  # writing to the second gives an error
        try:
            os.fstat(number)
        except OSError:
            os.open(os.devnull, how)
    sys.stdin = sys.stdin or open(os.devnull, encoding="utf-8")  # noqa: SIM115
    sys.stdout, sys.stderr = _stream(sys.stdout, 1), _stream(sys.stderr, 2)


def _stream(before: Any, number: int) -> Stream:
    if before is None:
        return Stream(io.BufferedWriter(io.FileIO(number, "wb", closefd=False)), "utf-8", "escaped")
    buffering = {"line_buffering": before.line_buffering, "write_through": before.write_through}
    return Stream(before.detach(), before.encoding, "escaped", **buffering)


def finish(code: int) -> int:
    """The exit code of a program, once all is written: 1 if standard output could not be."""
    for stream in (sys.stdout, sys.stderr):
        stream.flush()
    trouble = getattr(sys.stdout, "trouble", None)
    if trouble is None:
        return code
    if trouble.errno not in (errno.EPIPE, errno.EINVAL):  # the reader has gone; Windows says EINVAL
        message = f"cannot write to standard output ({error_reason(trouble)})"
        print(f"{program_name()}: {message}", file=sys.stderr, flush=True)
    return code or 1
