"""Messages of Open Sound Control, received over UDP. python-osc is imported when needed."""

import logging
import math
import socket
import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, NamedTuple

LOOPBACK = "127.0.0.1"
MAX_PACKET_BYTES = 65_536
RECEIVE_BUFFER_BYTES = 1 << 21  # some thousands of packets, while Python does something else
POLL_SECONDS = 0.1  # between two looks at whether to end
JOIN_SECONDS = 1.0  # that the thread gets to end
LATE_SECONDS = 0.001  # by which the time of a bundle may have passed
BUNDLE, BUNDLE_HEAD = b"#bundle\0", 16  # how bundles begin, and bytes before their first element
LONG_AGO = 3600.0  # s
MAX_DEPTH = 64  # of bundles in bundles
AT_ONCE = 1  # a time tag
SECONDS_1900_TO_1970 = 2_208_988_800
MAX_PORT = 65_535


class OscError(RuntimeError):
    """OSC cannot be received. The message says why and what to do."""


def parse_address(text: str) -> tuple[str, int]:
    """Host and port of `PORT` or `HOST:PORT`; this machine alone unless a host is given. Raises ValueError."""
    host, _, port = text.rpartition(":")
    if not port.isdecimal() or int(port) > MAX_PORT:
        raise ValueError(text)
    return host.strip("[]") or LOOPBACK, int(port)


def load_message_parser() -> Any:
    """The class that reads messages. Raises OscError."""
    try:
        from pythonosc.osc_message import OscMessage
    except ImportError:
        raise OscError("OSC needs python-osc; run uv sync --extra osc, or pip install python-osc") from None
    return OscMessage


class TimedMessage(NamedTuple):
    """A message, and when it is to be done, s since 1970; None: at once."""

    address: str
    arguments: list[Any]
    time: float | None


class Malformed(ValueError):
    """A packet is none of OSC."""


def split_bundle(data: bytes, time: float | None = None, depth: int = 0) -> Iterator[tuple[float | None, bytes]]:
    """Yield the messages of a packet, each with the time of the bundle that it is in, s since 1970; None: at once.
    Raises Malformed if the size of an element does not fit, which makes some parsers loop for ever."""
    if not data.startswith(BUNDLE):
        yield time, data
        return
    if len(data) < BUNDLE_HEAD or depth > MAX_DEPTH:
        raise Malformed
    tag, at = int.from_bytes(data[8:BUNDLE_HEAD], "big"), BUNDLE_HEAD
    time = None if tag <= AT_ONCE else tag / 2**32 - SECONDS_1900_TO_1970
    while at < len(data):
        size = int.from_bytes(data[at : at + 4], "big", signed=True)
        at += 4
        if size < 4 or size % 4 or at + size > len(data):
            raise Malformed
        yield from split_bundle(data[at : at + size], time, depth + 1)
        at += size


class OscServer:
    """Receives packets in a thread, and hands their messages on.

    receive:   called with each message; returns whether it makes sense
    report:    called with a line about the first malformed packet
    messages:  how many were handed on
    malformed: packets that are none of OSC, and messages that make no sense
    late:      messages that came after their time; they are done at once
    port:      that it listens at
    Raises OscError.
    """

    def __init__(
        self,
        address: tuple[str, int],
        receive: Callable[[TimedMessage], bool],
        report: Callable[[str], None] = lambda line: None,
    ) -> None:
        self._parser, self._receive, self._report = load_message_parser(), receive, report
        self.messages = self.malformed = self.late = 0
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
        self._ended = False
        self._thread = threading.Thread(target=self._serve, daemon=True)
        logging.getLogger().addFilter(self._refuse_warning)  # of the parser, which prints some
        self._thread.start()

    def close(self) -> None:
        """End the thread; one that does not end is left to the end of the program."""
        self._ended = True
        self._thread.join(JOIN_SECONDS)
        logging.getLogger().removeFilter(self._refuse_warning)
        self._socket.close()

    def remarks(self) -> list[str]:
        """Return lines for the summary: the numbers of malformed packets, and of late messages."""
        lines = [f"OSC: {self.malformed} malformed packets or messages were ignored"] if self.malformed else []
        return lines + ([f"OSC: {self.late} messages came after their time"] if self.late else [])

    def _serve(self) -> None:
        while not self._ended:
            try:
                data = self._socket.recv(MAX_PACKET_BYTES)
            except OSError:  # nothing came; or on Windows, that a packet of ours was refused
                continue
            self._take(data)

    def _take(self, data: bytes) -> None:
        """Hand on the messages of a packet, in the order of their times; what is malformed is counted. Messages whose
        time has passed are done at once."""
        now = time.time()
        try:
            parsed = [(when, self._parser(one)) for when, one in split_bundle(data)]
        except Exception:  # whatever the parser stumbles over
            self._count_malformed(data)
            return
        messages = [TimedMessage(one.address, one.params, when) for when, one in parsed]
        for message in sorted(messages, key=lambda one: now if one.time is None else one.time):
            if message.time is not None and message.time <= now:
                self._count_late(now - message.time)
                message = message._replace(time=None)
            if self._receive(message):
                self.messages += 1
            else:
                self._count_malformed(data)

    def _count_late(self, seconds: float) -> None:
        """Count a message that came after its time, if it is by more than a little; the first is reported."""
        if seconds > LATE_SECONDS:
            self.late += 1
            if self.late == 1:
                by = f"{1000 * seconds:.0f} ms" if seconds < LONG_AGO else "long"
                self._report(f"OSC: a message came {by} after its time; such messages are done at once, and counted")

    def _count_malformed(self, data: bytes) -> None:
        """Count a malformed packet or message; the first is reported."""
        self.malformed += 1
        if self.malformed == 1:
            self._report(f"OSC: a packet of {len(data)} bytes is malformed; such packets are ignored and counted")

    def _refuse_warning(self, record: logging.LogRecord) -> bool:
        """Raise Malformed at a warning of the parser in the thread of this server: it is counted, and not printed."""
        if record.thread != self._thread.ident or "pythonosc" not in Path(record.pathname).parts:
            return True
        raise Malformed


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
