"""The log of a session as a file that grows while it is played, so that memory does not."""

import json
import shutil
import sys
from pathlib import Path
from typing import Any, TextIO

from engine.live.player import Player
from engine.output_files import replace_file, resolve_links, temporary_path

NEXT = '"next": '  # the log of a player that takes over, which comes last


class LogFile:
    """Events go to a file beside its target, a line each, which takes its name at the end. Once one cannot be written,
    no more are, and what was written is kept.

    error: why it could not be written
    Raises OSError.
    """

    def __init__(self, target: Path, player: Player) -> None:
        self.target = resolve_links(target)
        self.error: OSError | None = None
        self.temporary = temporary_path(self.target)
        self._file: TextIO = self.temporary.open("w+", encoding="utf-8")
        self._player, self._depth = player, 0
        self._begin()

    def write(self) -> None:
        """Write what has happened, and nothing changes any more."""
        self._try(self._write_events)

    def close(self) -> None:
        """Write the rest, and give the file its name."""
        self._try(self._finish)
        if sys.platform == "win32":  # an open file cannot be renamed there
            self._file.close()
        if self.error is None:
            self._try(self._name)
        self._file.close()

    def _name(self) -> None:
        self.target.parent.mkdir(parents=True, exist_ok=True)  # it was there before
        try:
            replace_file(self.temporary, self.target)
        except FileNotFoundError:  # it was removed with its folder
            self._file.seek(0)
            with self.target.open("w", encoding="utf-8") as copy:
                shutil.copyfileobj(self._file, copy)

    def _try(self, action: Any) -> None:
        if self.error is None:
            try:
                action()
                if not self._file.closed:
                    self._file.flush()
            except OSError as error:
                self.error = error

    def _begin(self) -> None:
        """Begin the log of a player."""
        self._file.write(json.dumps(self._player.log_head())[:-1] + ', "events": [\n')
        self._is_first = True

    def _write_events(self, is_last: bool = False) -> None:
        self._write_entries(self._player.take_entries())
        while (following := self._player.successor) is not None and (is_last or self._player.is_over):
            self._write_entries(self._player.log_entries())
            self._file.write(f"\n], {json.dumps(self._player.log_tail())[1:-1]}, {NEXT}")
            self._player, self._depth = following, self._depth + 1
            self._begin()
            self._write_entries(following.take_entries())

    def _write_entries(self, entries: list[dict[str, Any]]) -> None:
        for entry in entries:
            self._file.write(("" if self._is_first else ",\n") + json.dumps(entry))
            self._is_first = False

    def _finish(self) -> None:
        """Write what the players say at the end."""
        self._write_events(is_last=True)
        self._write_entries(self._player.log_entries())
        self._file.write(f"\n], {json.dumps(self._player.log_tail())[1:-1]}" + "}" * (self._depth + 1) + "\n")
