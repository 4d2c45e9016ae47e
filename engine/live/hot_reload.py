"""A patch that is edited while it is played: values glide, a changed structure takes over, faults change nothing."""

import threading
from collections.abc import Callable, Iterable
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
    """Watches the file of a patch, and brings what is saved to its player.

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
        self._made: list[Any] = []
        self._thread: threading.Thread | None = None

    def _stamp(self) -> tuple[int, int]:
        try:
            status = self.path.stat()
        except OSError:  # between two halves of a save
            return (0, 0)
        return status.st_mtime_ns, status.st_size

    def poll(self) -> list[str]:
        """Apply what has been saved since the last call. Returns messages to print."""
        if self._made:
            return self._take_over(self._made.pop())
        stamp = self._stamp()
        if stamp == self._seen or stamp == (0, 0) or (self._thread is not None and self._thread.is_alive()):
            return []
        try:
            scene = self._with_accuracy(load(str(self.path)))
        except PatchError as error:
            if stamp != self._refused:  # it may be half written: it is read once more
                self._refused = stamp
                return []
            self._seen = stamp
            return [*map(str, error.faults), "the previous version keeps playing"]
        if self._stamp() != stamp:  # it was saved while it was read: it is read once more
            return []
        self._seen = stamp
        parameters = changed_parameters(self.scene, scene)
        if parameters is not None and set(parameters) <= set(self.player.live_parameters):
            try:
                for path, value in parameters.items():
                    self.player.set(path, value)
                self.player.make_tables()
            except ValueError:
                is_changed = False
            else:
                is_changed = not self.player.refused.keys() & parameters.keys()
            if is_changed:  # it takes no other tables than those that sound
                self.scene = scene
                self._edited(parameters)
                return [f"{path} → {value:g}" for path, value in parameters.items()]
        self._thread = threading.Thread(target=self._prepare, args=(scene,), daemon=True)
        self._thread.start()
        return []

    def _prepare(self, scene: Scene) -> None:
        """Build and compile beside the sound."""
        try:
            self._made.append((scene, self._make(scene)))
        except Exception as error:  # whatever it is, the sound goes on
            self._made.append((scene, error))

    def _take_over(self, prepared: tuple[Scene, Any]) -> list[str]:
        scene, player = prepared
        if isinstance(player, Exception):
            return [f"{player}; the previous version keeps playing"]
        try:
            self.player.cross_fade_to(player)
        except ValueError as error:
            return [f"{error}; the previous version keeps playing"]
        self.scene, self.player = scene, player
        self._follow(scene, player)
        return [f"{scene.title or self.path.stem}: switched to the new version"]
