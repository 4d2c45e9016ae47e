"""A patch that is edited while it is played: values glide, a changed structure takes over, faults change nothing."""

import threading
from collections.abc import Callable, Iterable
from functools import partial
from pathlib import Path
from typing import Any

from engine.faults import PatchError
from engine.live.player import Player
from engine.patch.live_parameters import live_paths, value_at, with_value
from engine.patch.scene import Scene, load


def changed_parameters(old: Scene, new: Scene) -> dict[str, float] | None:
    """The live parameters that make the old scene the new one, and their values; None if none can."""
    paths, new_paths = live_paths(old, True), live_paths(new, True)
    changed, scene = dict[str, float](), old
    for name, path in paths.items():
        if new_paths.get(name) != path:
            continue
        before, after = value_at(old, path), value_at(new, path)
        may_vanish = path.section != "contact" or before * after != 0.0
        if before != after and may_vanish:
            changed[name] = after
            try:
                scene = with_value(scene, path, name, after)
            except ValueError:  # further than what sounds can be turned
                return None
    return changed if scene.model_dump(exclude_none=True) == new.model_dump(exclude_none=True) else None


class PatchWatcher:
    """Watches the file of a patch, and brings what is saved to its player. It is read, and a player of it is built,
    beside the sound.

    make:    builds a Player of a scene
    with_accuracy: gives a scene its accuracy
    follow:  called with each new scene and player
    edited:  called with the live parameters to which an edit gave other values
    """

    def __init__(
        self,
        path: Path,
        scene: Scene,
        player: Player,
        make: Any,
        with_accuracy: Any = lambda scene: scene,
        follow: Callable[[Scene, Player], None] = lambda scene, player: None,
        edited: Callable[[Iterable[str]], None] = lambda paths: None,
    ) -> None:
        self._follow, self._edited = follow, edited
        self.path, self.scene, self.player, self._make, self._with_accuracy = path, scene, player, make, with_accuracy
        self._seen = self._stamp()
        self._refused = self._seen  # the last file that was refused
        self._done: list[Callable[[], list[str]]] = []  # what is to be done with what was read or made
        self._thread: threading.Thread | None = None

    def _stamp(self) -> tuple[int, int]:
        try:
            status = self.path.stat()
        except OSError:  # between two halves of a save
            return (0, 0)
        return status.st_mtime_ns, status.st_size

    def poll(self) -> list[str]:
        """Apply what has been saved, as soon as it is read. Returns messages to print."""
        if self._done:
            return self._done.pop()()
        stamp = self._stamp()
        if stamp not in (self._seen, (0, 0)) and not (self._thread is not None and self._thread.is_alive()):
            self._start(self._read, stamp)
        return []

    def _start(self, work: Callable[..., Callable[[], list[str]]], *arguments: Any) -> None:
        """Do something beside the sound; what it returns is done at a poll after it."""
        self._thread = threading.Thread(target=lambda: self._done.append(work(*arguments)), daemon=True)
        self._thread.start()

    def _read(self, stamp: tuple[int, int]) -> Callable[[], list[str]]:
        """Read the file, and build a player of it unless live parameters make all the difference."""
        try:
            scene = self._with_accuracy(load(str(self.path)))
        except PatchError as error:
            return partial(self._refuse, stamp, [str(fault) for fault in error.faults])
        if self._stamp() != stamp:  # it was saved while it was read: it is read once more
            return list
        self._seen = stamp
        parameters = changed_parameters(self.scene, scene)
        if parameters is not None and set(parameters) <= set(self.player.live_parameters):
            return partial(self._set, scene, parameters)
        return self._build(scene)

    def _build(self, scene: Scene) -> Callable[[], list[str]]:
        """Build a player of a scene."""
        try:
            return partial(self._take_over, scene, self._make(scene))
        except Exception as error:  # whatever it is, the sound goes on
            said = [f"{error}; the previous version keeps playing"]
            return lambda: said

    def _refuse(self, stamp: tuple[int, int], faults: list[str]) -> list[str]:
        """Say why a file is refused. It may be half written: it is read once more first."""
        if stamp != self._refused:
            self._refused = stamp
            return []
        self._seen = stamp
        return [*faults, "the previous version keeps playing"]

    def _set(self, scene: Scene, parameters: dict[str, float]) -> list[str]:
        """Give live parameters the values of a scene; have a player of it built if they do not take them."""
        try:
            for path, value in parameters.items():
                self.player.set(path, value)
            self.player.make_tables()
            is_changed = not self.player.refused.keys() & parameters.keys()
        except ValueError:
            is_changed = False
        if not is_changed:  # it takes no other tables than those that sound
            self._start(self._build, scene)
            return []
        self.scene = scene
        self._edited(parameters)
        return [f"{path} → {value:g}" for path, value in parameters.items()]

    def _take_over(self, scene: Scene, player: Player) -> list[str]:
        """Let another player take over."""
        try:
            self.player.cross_fade_to(player)
        except ValueError as error:
            return [f"{error}; the previous version keeps playing"]
        self.scene, self.player = scene, player
        self._follow(scene, player)
        return [f"{scene.title or self.path.stem}: switched to the new version"]
