"""One point of a sweep, rendered wherever it is sent: a task holds all that it takes, and the answer all that is
found."""

import hashlib
import json
import tempfile
import threading
from collections.abc import Generator
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from engine.features import features
from engine.index import Cell
from engine.scene import Scene

LOOK = 0.2  # s between two looks at what is done
_TURN = threading.Lock()  # threads of one process take turns: kernels are compiled by one at a time


@dataclass(frozen=True)
class Task:
    """What to render.

    document: the scene, complete but for the audio files of forces
    options:  arguments of engine.offline.render
    files:    contents of audio files by the number of their force, where the worker may not have them
    """

    number: int
    document: dict[str, Any]
    options: dict[str, Any]
    files: dict[int, bytes] = field(default_factory=dict)

    def complete(self) -> "Task":
        """The same with the contents of its files. Raises OSError."""
        forces = self.document.get("force", [])
        return replace(self, files={n: Path(f["file"]).read_bytes() for n, f in enumerate(forces) if "file" in f})

    def fingerprint(self, *more: Any) -> str:
        """12 hexadecimal digits that tell this point from any other: scene, contents of files, options."""
        files = [hashlib.sha256(data).hexdigest() for data in self.complete().files.values()]
        told = json.dumps([self.document, self.options, files, more], sort_keys=True)
        return hashlib.sha256(told.encode()).hexdigest()[:12]


@dataclass(frozen=True)
class Found:
    """What came of it: the audio in SI units, with cells of the index; or what failed."""

    audio: np.ndarray | None
    cells: dict[str, Cell]
    error: str = ""


Answers = Generator[tuple[int, Found] | None, None, None]  # by number, in any order; None: nothing yet


def rendered(task: Task) -> Found:
    """Render a point. Whatever goes wrong with it is an answer too."""
    try:
        with _TURN, tempfile.TemporaryDirectory() as folder:
            return _rendered(task, Path(folder))
    except MemoryError:
        return Found(None, {}, "not enough memory for so many samples; fewer seconds")
    except Exception as error:
        return Found(None, {}, " ".join(str(error).split()) or type(error).__name__)


def _rendered(task: Task, folder: Path) -> Found:
    from engine.offline import render
    from engine.silence import why

    document = task.document
    if task.files:
        forces = [dict(force) for force in document["force"]]
        for n, data in task.files.items():
            path = folder / f"{n}{Path(forces[n]['file']).suffix}"
            path.write_bytes(data)
            forces[n]["file"] = str(path)
        document = document | {"force": forces}
    scene = Scene.model_validate(document)
    take = render(scene, cores=1, **task.options)
    if not np.isfinite(take.audio).all():
        return Found(None, {}, "samples are not finite")
    newton = take.stats["newton"]
    told = {
        "contact": take.stats["activity"]["contact"],
        "newton_mean": newton["mean"],
        "newton_max": newton["max"],
        "unconverged": newton["unconverged"],
        "energy_error": take.stats["energy"]["error_max"],
    }
    if why(scene, take.stats):  # what rounding leaves is no sound
        told["silent"] = 1.0
    return Found(take.audio, features(take.audio, take.samplerate) | told)
