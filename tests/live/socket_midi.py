"""A MIDI driver for mido, by a socket: JACK repeats or loses messages where another program takes the cores.

MIDO_BACKEND=socket_midi, with FDH_TEST_MIDI the folder in which a source is a file `NAME.port`, and listens a socket
`NAME.socket` for bytes of messages.
"""

import os
import socket
from pathlib import Path
from typing import Any

import mido
from mido.ports import BaseInput

FOLDER = Path(os.environ["FDH_TEST_MIDI"])


class Input(BaseInput):
    """An open port."""

    def _open(self, **options: Any) -> None:
        place = FOLDER / f"{self.name}.socket"
        place.unlink(missing_ok=True)
        self._socket = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM)
        self._socket.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 1 << 20)
        self._socket.bind(str(place))
        self._socket.setblocking(False)

    def _receive(self, block: bool = True) -> None:
        while True:
            try:
                self._messages.append(mido.Message.from_bytes(self._socket.recv(64)))
            except BlockingIOError:
                return

    def _close(self) -> None:
        self._socket.close()


def get_devices(**options: Any) -> list[dict[str, Any]]:
    """The sources that there are."""
    names = sorted(path.stem for path in FOLDER.glob("*.port"))
    return [{"name": name, "is_input": True, "is_output": False} for name in names]


class Source:
    """A source of messages, there until it is closed."""

    def __init__(self, name: str) -> None:
        self._port, self._to = FOLDER / f"{name}.port", str(FOLDER / f"{name}.socket")
        self._socket = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM)
        self._port.touch()

    def send(self, message: list[int]) -> None:
        """Send the bytes of a message to who listens; it waits where the other is slow."""
        self._socket.sendto(bytes(message), self._to)

    def close(self) -> None:
        """Be gone."""
        self._port.unlink()
        self._socket.close()
