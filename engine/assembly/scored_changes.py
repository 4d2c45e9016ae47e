"""Changes of tables in the score of a scene (engine.assembly.table_changes)."""

import threading
from typing import Any, NamedTuple

from engine.assembly.build import BuildResult
from engine.assembly.table_changes import SCORE, NewValue, TableChanges
from engine.patch.frames import nearest_frame
from engine.patch.live_parameters import live_paths
from engine.patch.scene import Scene
from engine.patch.tables import ChangeEvent


class ScoredChange(NamedTuple):
    """Changes of tables at one time of the score."""

    frame: int
    seconds: float  # that it glides
    values: tuple[NewValue, ...]


def scored_changes(scene: Scene, samplerate: float) -> list[ScoredChange]:
    """Return the changes of tables in the score of a scene, in their order. Those of one time and duration are made
    together."""
    events = [e for e in scene.event if isinstance(e, ChangeEvent) and e.parameter is not None]
    paths, together = live_paths(scene, True) if events else {}, dict[tuple[int, float], list[NewValue]]()
    for event in events:
        name, value = event.parameter or "", event.value or 0.0
        new = NewValue(paths[name], name, value)
        together.setdefault((nearest_frame(event.time, samplerate), event.duration), []).append(new)
    return [ScoredChange(frame, seconds, tuple(values)) for (frame, seconds), values in together.items()]


def plan_score(tables: TableChanges, scene: Scene) -> int:
    """Plan the changes of tables in the score of a scene. Return how many steps they have."""
    thread, changes = threading.get_ident(), scored_changes(scene, tables.samplerate)
    return sum(tables.plan(one.values, one.seconds, one.frame, thread, SCORE).steps for one in changes)


def scored_tables(scene: Scene, built: BuildResult, **options: Any) -> TableChanges | None:
    """Return the changes of tables in the score of a scene; None without any. options: of TableChanges"""
    tables = TableChanges(scene, built, **options)
    return tables if plan_score(tables, scene) else None
