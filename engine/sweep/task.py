"""The task of rendering one point of a sweep. It holds all that a worker needs, and its result all that comes of it."""

import hashlib
import json
import tempfile
import threading
from collections.abc import Generator
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from engine.analysis.features import features
from engine.patch.scene import Scene
from engine.sweep.index_csv import Cell

POLL_INTERVAL = 0.2  # s
_COMPILE_LOCK = threading.Lock()  # threads of one process take turns, so that each kernel is compiled once


@dataclass(frozen=True)
class RenderTask:
    """A point to be rendered.

    document: the scene, complete but for the audio files of forces
    options:  arguments of engine.offline.render.render_arrays
    files:    contents of audio files by the index of their force, where the worker may not have them
    contacts: the names of those that are measured, from a trace
    """

    number: int
    document: dict[str, Any]
    options: dict[str, Any]
    files: dict[int, bytes] = field(default_factory=dict)
    contacts: tuple[str, ...] = ()

    def complete(self) -> "RenderTask":
        """A copy with the contents of its files. Raises OSError."""
        forces = self.document.get("force", [])
        return replace(self, files={n: Path(f["file"]).read_bytes() for n, f in enumerate(forces) if "file" in f})

    def fingerprint(self, *settings: Any) -> str:
        """12 hexadecimal digits that differ for any other scene, contents of files, options or settings."""
        files = [hashlib.sha256(data).hexdigest() for data in self.complete().files.values()]
        content = json.dumps([self.document, self.options, files, settings], sort_keys=True)
        return hashlib.sha256(content.encode()).hexdigest()[:12]


@dataclass(frozen=True)
class RenderResult:
    """The result of a task: the audio in SI units, with cells of the index; or the error that it ended with."""

    audio: np.ndarray | None  # [frames, channels]
    cells: dict[str, Cell]
    error: str = ""


Results = Generator[tuple[int, RenderResult] | None, None, None]  # by number, in any order; None: nothing yet


def render_task(task: RenderTask) -> RenderResult:
    """Render a point. Whatever error is raised is returned as a result."""
    try:
        with _COMPILE_LOCK, tempfile.TemporaryDirectory() as folder:
            return _render_in_folder(task, Path(folder))
    except MemoryError:
        return RenderResult(None, {}, "there is not enough memory for so many samples; give fewer seconds")
    except Exception as error:
        return RenderResult(None, {}, " ".join(str(error).split()) or type(error).__name__)


def _render_in_folder(task: RenderTask, folder: Path) -> RenderResult:
    """Render a point, whose files are written to a temporary folder."""
    from engine.analysis.contact_summaries import ContactSummaries
    from engine.analysis.silence import explain_silence
    from engine.offline.render import render_arrays

    document = task.document
    if task.files:
        forces = [dict(force) for force in document["force"]]
        for n, data in task.files.items():
            path = folder / f"{n}{Path(forces[n]['file']).suffix}"
            path.write_bytes(data)
            forces[n]["file"] = str(path)
        document = document | {"force": forces}
    scene = Scene.model_validate(document)
    rendering = render_arrays(scene, cores=1, trace=bool(task.contacts), **task.options)
    if not np.isfinite(rendering.audio).all():
        return RenderResult(None, {}, "samples are not finite")
    stats, newton = rendering.stats, rendering.stats.newton
    cells: dict[str, Cell] = {
        **features(rendering.audio, rendering.samplerate),
        "contact": stats.activity.contact,
        "newton_mean": newton.mean,
        "newton_max": newton.max,
        "unconverged": newton.unconverged,
        "capped": newton.solve_outcomes.capped,
        "energy_error": stats.energy.error_max,
        "trusted": int(stats.trusted),
        "reasons": "; ".join(stats.reasons),
    }
    if task.contacts and rendering.trace is not None:
        summaries = ContactSummaries(rendering.trace, task.contacts)
        for name in summaries:  # others are out of reach, or of no stiffness
            measured = summaries[name].as_dict()
            cells |= {f"{name}.{measure}": None if value != value else value for measure, value in measured.items()}
    if explain_silence(scene, stats.seconds, stats.samplerate, stats.peak, stats):  # what rounding leaves is no sound
        cells["silent"] = 1.0
    return RenderResult(rendering.audio, cells)
