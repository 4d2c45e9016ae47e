"""Lines that are shown while a patch plays."""

import threading

MAX_LINES = 50  # that are shown in all


class Notices:
    """Lines that any thread may add, and one shows: each once, and not too many, however often their cause comes. The
    last line says that others are not shown."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._added: set[str] = set()
        self._waiting: list[str] = []

    def add(self, line: str) -> None:
        """Add a line, unless it was added before or there are too many."""
        with self._lock:
            if line not in self._added and len(self._added) < MAX_LINES:
                self._added.add(line)
                self._waiting.append(line)
                if len(self._added) == MAX_LINES:
                    self._waiting.append("further messages of this kind are not shown; the summary has their number")

    def take(self) -> list[str]:
        """Return the lines that were added since the last call."""
        with self._lock:
            lines, self._waiting = self._waiting, []
        return lines
