"""A sweep: many points of a patch rendered, one sound each, with an index that grows as they are done.

A sweep that is stopped at any time goes on when it is started again: what is done is not done twice.
"""

import os
from collections.abc import Callable, Iterator
from contextlib import closing, contextmanager
from dataclasses import asdict, dataclass
from functools import partial
from pathlib import Path
from typing import Any

from engine import index
from engine.index import Cell, Row
from engine.machine import sources
from engine.patch import PatchError
from engine.point import Answers, Found, Task
from engine.processes import here
from engine.save import amplified, reason, save_audio
from engine.scene import Scene
from engine.vary import Plan, Point

Progress = Callable[[float], None]
Renderer = Callable[[list[Task]], Answers]


@dataclass
class Outcome:
    """How far a sweep has come: of its points, how many are done, were done before, or failed; how many sounds of
    other settings, that were in the folder, are no more; and how many of its own are gone again at the end."""

    points: int
    done: int = 0
    before: int = 0
    failed: int = 0
    replaced: int = 0
    gone: int = 0
    interrupted: bool = False

    @property
    def code(self) -> int:
        """Of the command line: 0 if all are done."""
        return 130 if self.interrupted else 1 if self.failed or self.gone else 0

    def told(self, folder: Path) -> dict[str, Any]:
        """What is said of it."""
        return {"folder": str(folder)} | asdict(self) | {"index": str(folder / "index.csv")}


def asked(
    plan: Plan,
    folder: Path,
    numbers: dict[str, float | None],
    dial: dict[str, Any],
    subtype: str | None,
    cluster: str | None,
    progress: Progress,
) -> Outcome:
    """A sweep as the command line asks for it. Raises OSError or RuntimeError, which say what cannot be done."""
    rate, cores = int(numbers["samplerate"] or 44_100), int(numbers["cores"] or os.cpu_count() or 1)
    options = {"seconds": numbers["seconds"], "samplerate": rate} | dial
    renderer: Renderer = partial(here, cores=cores)
    if cluster is not None:
        from engine.cluster import there

        renderer = partial(there, address=cluster)
    return sweep(plan, folder, renderer, options, numbers["gain"], subtype, progress)


def sweep(
    plan: Plan,
    folder: Path,
    renderer: Renderer,
    options: dict[str, Any],
    gain: float | None = None,
    subtype: str | None = None,
    progress: Progress = lambda share: None,
) -> Outcome:
    """Render the points of a plan into a folder, which is made if it is missing, with its index.csv.

    renderer: gives the answers to tasks, in any order, each once
    options:  seconds, samplerate and accuracy (engine.offline.render)
    gain:     dB on SI units; each sound is normalised if None

    Rows of the index that say "done" of the same point, with its file there, are kept. Raises OSError or
    RuntimeError if a file cannot be written, or the folder has an index of something else.
    """
    path, paths = folder / "index.csv", [axis.path for axis in plan.axes]
    if what := index.foreign(path, paths):
        raise RuntimeError(what)
    tasks, begun, answers = _tasks(plan, options, (gain, subtype, sources()), progress)
    folder.mkdir(exist_ok=True)
    for part in [*folder.glob(".[0-9][0-9][0-9][0-9]*.wav.*.part"), *folder.glob(".index.csv.*.part")]:  # of one killed
        part.unlink(missing_ok=True)
    header = index.columns(paths)
    held = index.read(path)
    rows = {n: row for n, row in held.items() if n in tasks and _stands(row, begun[n], folder, tasks[n])}
    others = {n for n, row in held.items() if n not in rows and row["status"] == "done"}
    _write(path, header, rows)
    outcome = Outcome(len(plan.points), done=len(rows), before=len(rows))
    rate = options["samplerate"]

    def enter(number: int, found: Found) -> None:
        name, cells = index.sound(number), dict(found.cells)
        if found.audio is not None:
            peak = 0.0 if found.cells["silent"] else float(abs(found.audio).max())
            audio, cells["gain_db"] = amplified(found.audio, peak, gain)
            outcome.replaced += number in others and (folder / name).exists()
            try:
                save_audio(folder / name, audio, rate, subtype)
            except (OSError, RuntimeError) as error:
                raise _unwritten(folder / name, error) from error
        told = begun[number] | cells
        told |= {"file": name if found.audio is not None else "", "status": found.error or "done"}
        rows[number] = {column: index.shown(told.get(column)) for column in header}
        try:
            line = index.line(rows[number].values()).encode()
            while line:  # a disk that is nearly full takes a part of it
                line = line[os.write(file, line) :]
        except OSError as error:
            raise _unwritten(path, error) from error
        outcome.done += found.audio is not None
        outcome.failed += found.audio is None

    try:
        with opened(path) as file:
            for number, found in answers.items():
                enter(number, found)
            left = [task for n, task in tasks.items() if n not in rows]
            with closing(renderer(left)) as source:
                for answer in source:
                    if answer is not None:
                        enter(*answer)
                    progress(len(rows) / outcome.points)
    except KeyboardInterrupt:
        outcome.interrupted = True
    for number in [n for n, row in rows.items() if row["status"] == "done" and not (folder / row["file"]).is_file()]:
        del rows[number]
        outcome.gone, outcome.done = outcome.gone + 1, outcome.done - 1
    _write(path, header, rows)
    return outcome


def _write(path: Path, header: list[str], rows: dict[int, Row]) -> None:
    """Write the index anew. Raises RuntimeError, which says what stands against it."""
    try:
        index.write(path, header, rows)
    except OSError as error:
        raise _unwritten(path, error) from error


def _unwritten(path: Path, error: Exception) -> RuntimeError:
    """That a file could not be written, and how to go on."""
    return RuntimeError(f"cannot write {path} ({reason(error)}); when it can be, the same command goes on")


def _tasks(
    plan: Plan, options: dict[str, Any], more: tuple[Any, ...], progress: Progress
) -> tuple[dict[int, Task], dict[int, dict[str, Cell]], dict[int, Found]]:
    """What is to be rendered, what its rows begin with, and what fails before it is."""
    tasks, begun, failed = {}, {}, {}
    for number, point in enumerate(plan.points, 1):
        progress(0.0)
        values: dict[str, Cell] = {"number": number} | _named(plan, point)
        try:
            task = Task(number, plan.scene(point).model_dump(exclude_unset=True), options)
            tasks[number], values["fingerprint"] = task, task.fingerprint(*more)
        except (PatchError, OSError) as error:
            faults = [f"{f.path}: {f.what}" for f in error.faults] if isinstance(error, PatchError) else [str(error)]
            failed[number] = Found(None, {}, "; ".join(faults))
        begun[number] = values
    return tasks, begun, failed


def _named(plan: Plan, point: Point) -> dict[str, Cell]:
    """Values by their paths, with all their digits."""
    return {axis.path: str(value) for axis, value in zip(plan.axes, point, strict=True)}


def _stands(row: Row, begun: dict[str, Cell], folder: Path, task: Task) -> bool:
    """Whether a row tells of this very point, and its sound is there, whole as far as its header and length tell."""
    same = row["status"] == "done" and row["fingerprint"] == begun["fingerprint"]
    path, rate = folder / row["file"], task.options["samplerate"]
    if not same or not row["file"] or not path.is_file():
        return False
    import soundfile

    seconds = task.options["seconds"] or task.document.get("seconds") or Scene.model_fields["seconds"].default
    try:
        held = soundfile.info(str(path))
    except (OSError, RuntimeError):
        return False
    return bool((held.frames, held.samplerate) == (max(1, round(seconds * rate)), rate))


@contextmanager
def opened(path: Path) -> Iterator[int]:
    """A file to add lines to; each is there at once, and nothing is left to be written when it is closed."""
    file = os.open(path, os.O_WRONLY | os.O_APPEND)
    try:
        yield file
    finally:
        os.close(file)
