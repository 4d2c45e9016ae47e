"""The terminal while a patch plays: keys that are pressed, and a line that shows how the player does."""

import math
import os
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, nullcontext, suppress
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from engine.live.meter import MeterReading

MAX_COLUMNS = 80  # of the meter
KEYS = "keys: space to strike, 1 to 9 softer to harder, m to mute, n for the next patch, q to quit"


@contextmanager
def read_keyboard(alone: bool) -> Iterator[Any]:
    """A function that waits so many seconds for keys, and gives those that were pressed; without that for the next
    patch, where one alone is to be recorded."""

    def none(seconds: float) -> str:
        time.sleep(seconds)
        return ""

    if sys.stdin is None or not sys.stdin.isatty():
        yield none
        return
    print(KEYS.replace("n for the next patch, ", "") if alone else KEYS, file=sys.stderr)
    unused = "n" if alone else ""
    if sys.platform == "win32":
        import msvcrt

        def waiting(seconds: float) -> str:
            time.sleep(seconds)
            return "".join(iter(lambda: msvcrt.getwch() if msvcrt.kbhit() else "", "")).replace(unused, "")

        yield waiting
        return
    with read_terminal(sys.stdin.fileno()) as pressed:
        yield lambda seconds: pressed(seconds).replace(unused, "")


@contextmanager
def read_terminal(number: int) -> Iterator[Callable[[float], str]]:
    """A function that waits for keys of a terminal, which is as it was when all is over."""
    import select
    import termios
    import tty

    def pressed(seconds: float) -> str:
        try:
            if not select.select([number], [], [], seconds)[0]:
                return ""
            pressed = os.read(number, 64)
        except OSError:
            pressed = b""
        if not pressed:  # it was closed, and will always answer at once
            time.sleep(seconds)
        return pressed.decode(errors="replace")

    before = termios.tcgetattr(number)
    try:
        tty.setcbreak(number)
        yield pressed
    finally:
        with suppress(termios.error):
            termios.tcsetattr(number, termios.TCSADRAIN, before)


@contextmanager
def show_meter(block: int, latency: float) -> Iterator[Any]:
    """A function that shows the reading of a meter, which another one makes, on a terminal."""
    if not sys.stderr.isatty():
        with nullcontext():
            yield lambda read: None
        return
    from rich.console import Console
    from rich.live import Live
    from rich.text import Text

    with Live(Text(""), console=Console(stderr=True), transient=True, auto_refresh=False) as line:
        columns = min(MAX_COLUMNS, line.console.width)
        yield lambda read: line.update(Text(format_meter(read(), block, latency, columns)), refresh=True)


def format_meter(now: "MeterReading", block: int, latency: float | None, columns: int = MAX_COLUMNS) -> str:
    """Return a meter as one line, as much of it as fits: level, load and dropouts first."""
    line = ""
    for part in [_describe_level(now), *meter_parts(now, block, latency)]:
        longer = f"{line}  {part}" if line else part
        line = longer if len(longer) <= columns else line
    return line


def meter_parts(now: "MeterReading", block: int, latency: float | None = None) -> list[str]:
    """Return the texts that a meter shows beside the level, the most important first.

    block: frames per block that the options give; latency: of the device, s; None if it is not known
    """
    parts = [
        f"load {now.worst_block:.0%}",
        f"dropouts {now.dropouts}" + (f" (try --block-size {2 * block})" if now.dropouts else ""),
    ]
    if now.limited:
        parts.append(f"limiter samples {now.limited}")
    if now.capped:
        parts.append(f"too few steps {now.capped}")
    if now.quality_steps:
        parts.append(_describe_quality(now))
    parts.append(f"{now.seconds:.1f} s")
    if now.voices:
        parts.append(f"voices {now.sounding}/{now.voices}")
    return [
        *parts,
        f"energy {now.energy_error:.0e}",
        f"Newton {now.newton.mean:.1f}/{now.newton.max}",
        f"active {now.awake}/{now.islands}",
        *([] if latency is None else [f"latency {1000 * latency:.0f} ms"]),
        f"{now.real_time_factor:.0f} × real time",
    ]


def _describe_level(now: "MeterReading") -> str:
    """The largest sample since the last reading, always as wide."""
    return f"{20 * math.log10(now.peak):5.1f} dB" if now.peak > 1e-5 else "  silent"


def _describe_quality(now: "MeterReading") -> str:
    """Describe the present quality, and the number of its changes; "" if it never changed."""
    changes = f"{now.quality_steps} change{'s' if now.quality_steps != 1 else ''}"
    return f"{f'reduced quality ({now.quality})' if now.quality else 'full quality'}, {changes}"
