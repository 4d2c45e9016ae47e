"""Messages of Open Sound Control, received over UDP. python-osc is imported when needed."""

import logging
import math
import socket
import threading
from collections.abc import Callable
from pathlib import Path
from typing import Any

LOOPBACK = "127.0.0.1"
MAX_PACKET_BYTES = 65_536
RECEIVE_BUFFER_BYTES = 1 << 21  # some thousands of packets, while Python does something else
POLL_SECONDS = 0.1  # between two looks at whether to end
MAX_PORT = 65_535


class OscError(RuntimeError):
    """OSC cannot be received. The message says why and what to do."""


def parse_address(text: str) -> tuple[str, int]:
    """Host and port of `PORT` or `HOST:PORT`; this machine alone unless a host is given. Raises ValueError."""
    host, _, port = text.rpartition(":")
    if not port.isdecimal() or int(port) > MAX_PORT:
        raise ValueError(text)
    return host.strip("[]") or LOOPBACK, int(port)


def load_packet_parser() -> Any:
    """The module that reads packets. Raises OscError."""
    try:
        from pythonosc import osc_packet
    except ImportError:
        raise OscError("OSC needs python-osc; run uv sync --extra osc, or pip install python-osc") from None
    return osc_packet


class OscServer:
    """Receives packets in a thread, and hands their messages on.

    receive:   called with the address and the arguments of each message; returns whether it makes sense
    report:    called with a line about the first malformed packet
    messages:  how many were handed on
    malformed: packets that are none of OSC, and messages that make no sense
    port:      that it listens at
    Raises OscError.
    """

    def __init__(
        self,
        address: tuple[str, int],
        receive: Callable[[str, list[Any]], bool],
        report: Callable[[str], None] = lambda line: None,
    ) -> None:
        self._parser, self._receive, self._report = load_packet_parser(), receive, report
        self.messages = self.malformed = 0
        family = socket.AF_INET6 if ":" in address[0] else socket.AF_INET
        self._socket = socket.socket(family, socket.SOCK_DGRAM)
        try:
            self._socket.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, RECEIVE_BUFFER_BYTES)
            self._socket.bind(address)
        except (OSError, OverflowError) as error:
            self._socket.close()
            reason = getattr(error, "strerror", None) or error
            raise OscError(f"cannot listen at {address[0]}:{address[1]} ({reason}); give another --osc PORT") from None
        self._socket.settimeout(POLL_SECONDS)
        self.port = int(self._socket.getsockname()[1])
        self._ended = self._warned = False
        self._thread = threading.Thread(target=self._serve, daemon=True)
        logging.getLogger().addFilter(self._note_warning)  # of the parser, which prints a line for each of some faults
        self._thread.start()

    def close(self) -> None:
        """End the thread."""
        self._ended = True
        self._thread.join()
        logging.getLogger().removeFilter(self._note_warning)
        self._socket.close()

    def remarks(self) -> list[str]:
        """Return the line for the summary: the number of malformed packets."""
        return [f"OSC: {self.malformed} malformed packets or messages were ignored"] if self.malformed else []

    def _serve(self) -> None:
        while not self._ended:
            try:
                data = self._socket.recv(MAX_PACKET_BYTES)
            except OSError:  # nothing came; or on Windows, that a packet of ours was refused
                continue
            self._take(data)

    def _take(self, data: bytes) -> None:
        """Hand on what is in a packet; what is malformed is counted. Bundles are done at once, whatever their time."""
        self._warned = False
        try:
            messages = [timed.message for timed in self._parser.OscPacket(data).messages]
        except Exception:  # whatever it stumbles over
            messages = []
            self._warned = True
        if self._warned:
            self._count_malformed(data)
            return
        for message in messages:
            if self._receive(message.address, message.params):
                self.messages += 1
            else:
                self._count_malformed(data)

    def _count_malformed(self, data: bytes) -> None:
        """Count a malformed packet or message; the first is reported."""
        self.malformed += 1
        if self.malformed == 1:
            self._report(f"OSC: a packet of {len(data)} bytes is malformed; such packets are ignored and counted")

    def _note_warning(self, record: logging.LogRecord) -> bool:
        """Note a warning of the parser in the thread of this server, so that it is counted, and not printed."""
        if record.thread != self._thread.ident or Path(record.pathname).parent.name != "pythonosc":
            return True
        self._warned = True
        return False


def number_in(arguments: list[Any]) -> float | None:
    """The number that the arguments of a message are; None if they are no finite one."""
    return finite_number(arguments[0]) if len(arguments) == 1 else None


def finite_number(argument: Any) -> float | None:
    """An argument of a message as a number; None if it is no finite one."""
    try:
        value = float(argument) if isinstance(argument, int | float) and not isinstance(argument, bool) else math.nan
    except OverflowError:
        return None
    return value if math.isfinite(value) else None
