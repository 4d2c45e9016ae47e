"""MIDI input ports, of the driver that the system has and of JACK, which has ports of its own. mido is imported when
needed."""

import os
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

LAST_WITH_DRIVER = 3, 12  # the last Python that python-rtmidi has wheels for
JACK = "UNIX_JACK"  # as python-rtmidi calls it
OF_MIDO = "MIDO_BACKEND"  # environment variable: with it, no other driver is asked


class MidiError(RuntimeError):
    """The notes cannot be played. The message says why and what to do."""


def list_ports() -> list[str]:
    """The names of the MIDI input ports. Raises MidiError."""
    return [name for name, _ in _find_ports()]


def open_port(name: str) -> Any:
    """An open input port of a name, or of a part of it. Raises MidiError."""
    ports = _find_ports()
    chosen = [port for port in ports if name.lower() in port[0].lower()]
    if len(chosen) != 1:
        what = "several MIDI ports match" if chosen else "no MIDI port is called"
        names = ", ".join(name for name, _ in ports) or "none"
        raise MidiError(f'{what} "{name}"; the ports are {names}; give one of these, or a .mid file')
    name, driver = chosen[0]
    with _silent_libraries():
        return driver.open_input(name)


def _find_ports() -> list[tuple[str, Any]]:
    """The names of the MIDI input ports, each with what opens it. Raises MidiError if no driver answers."""
    import mido

    ports, reason = list[tuple[str, Any]](), None
    with _silent_libraries():
        for driver in (mido, *_jack(mido)):
            try:
                ports += [(name, driver) for name in driver.get_input_names() if name not in dict(ports)]
            except ImportError as error:
                raise MidiError(
                    f"a MIDI port needs python-rtmidi: {how_to_install_driver()}; or give a .mid file"
                ) from error
            except OSError as error:
                reason = reason or error
    if reason is not None and not ports:
        raise MidiError(f"there are no MIDI ports ({reason}); give a .mid file") from reason
    return ports


def _jack(mido: Any) -> list[Any]:
    """Return the driver of JACK's ports, if python-rtmidi has it and MIDO_BACKEND names no other."""
    if os.environ.get(OF_MIDO):
        return []
    try:
        import rtmidi
    except ImportError:
        return []
    if getattr(rtmidi, f"API_{JACK}", None) not in rtmidi.get_compiled_api():
        return []
    return [mido.Backend(f"mido.backends.rtmidi/{JACK}")]


@contextmanager
def _silent_libraries() -> Iterator[None]:
    """Keep what ALSA and JACK print, where one of them does not run, from the terminal."""
    try:
        kept = os.dup(2)
    except OSError:  # there is none
        yield
        return
    nowhere = os.open(os.devnull, os.O_WRONLY)
    try:
        sys.stderr.flush()
        os.dup2(nowhere, 2)
        yield
    finally:
        os.dup2(kept, 2)
        os.close(kept)
        os.close(nowhere)


def how_to_install_driver() -> str:
    """The way to install the driver of MIDI ports, on this version of Python."""
    how = "run uv sync --extra midi, or pip install python-rtmidi"
    if sys.version_info[:2] > LAST_WITH_DRIVER:
        how += f"; from Python 3.{LAST_WITH_DRIVER[1] + 1} on that needs a C++ compiler and, on Linux, libasound2-dev"
    return how
