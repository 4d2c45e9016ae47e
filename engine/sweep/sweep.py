"""A sweep: many points of a patch rendered, one sound each, with an index that grows as they are done.

A sweep that is stopped at any time goes on when it is started again: what is done is not done twice.
"""

import argparse
import os
from collections import Counter
from collections.abc import Callable, Iterator
from contextlib import closing, contextmanager, suppress
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import Any

from engine.compiler.kernel_name import KernelName
from engine.faults import PatchError
from engine.instrument.key_names import parse_key
from engine.output_files import NORMALISED_PEAK_DBFS, error_reason, resolve_subtype, soundfile_path
from engine.patch.frames import frame_count
from engine.patch.scene import Scene
from engine.provenance import source_digest, usable_cores
from engine.sound.about import About, is_whole
from engine.sound.form import PLAIN_FORM, SoundForm
from engine.sound.sound_file import PreparedSound, SoundFile
from engine.sweep import index_csv
from engine.sweep.common_gain import UNSCALED_FOLDER, common_gain, rescale, sound_path
from engine.sweep.index_csv import Cell, IndexRow
from engine.sweep.local_workers import run_local
from engine.sweep.note_axes import release_time
from engine.sweep.plan import SweepPlan
from engine.sweep.sfz import Sample, write_sfz
from engine.sweep.sound_names import is_name_of_number, is_plain_name, plain_text
from engine.sweep.task import RenderResult, RenderTask, Results

Progress = Callable[[float], None]
Renderer = Callable[[list[RenderTask]], Results]


@dataclass
class SweepOutcome:
    """Progress and result of a sweep.

    points:       of the plan
    done:         of these, now or before
    already_done: of these, before
    failed:       of these
    overwritten:  sounds of other settings that were in the folder, and are no more
    gone:         sounds of this sweep that were removed while it ran
    gain_db:      of all sounds, if they have one in common
    sfz:          the file that lists the notes, if there is one
    sheet:        the page that plays the sounds, if there is one
    warnings:     lines, of the sounds that are cut or limited
    """

    points: int
    done: int = 0
    already_done: int = 0
    failed: int = 0
    overwritten: int = 0
    gone: int = 0
    interrupted: bool = False
    gain_db: float | None = None
    sfz: Path | None = None
    sheet: Path | None = None
    warnings: list[str] = field(default_factory=list)

    @property
    def exit_code(self) -> int:
        """Of the command line: 0 if all points are done."""
        return 130 if self.interrupted else 1 if self.failed or self.gone else 0

    def as_dict(self, folder: Path) -> dict[str, Any]:
        """The outcome by the names of --json, with the folder and its index."""
        of_notes: dict[str, Any] = {"gain_db": self.gain_db} if self.gain_db is not None else {}
        of_notes |= {"sfz": str(self.sfz)} if self.sfz is not None else {}
        of_notes |= {"sheet": str(self.sheet)} if self.sheet is not None else {}
        return of_notes | {
            "folder": str(folder),
            "points": self.points,
            "done": self.done,
            "before": self.already_done,
            "failed": self.failed,
            "replaced": self.overwritten,
            "gone": self.gone,
            "interrupted": self.interrupted,
            "index": str(folder / "index.csv"),
        }


def sweep_from_arguments(
    plan: SweepPlan, folder: Path, args: argparse.Namespace, form: SoundForm, progress: Progress
) -> SweepOutcome:
    """Run a sweep as the command line asks for it (`run_sweep`), on this machine or on a cluster.

    args: with numbers, or None, for seconds, samplerate, gain and cores; and accuracy, the settings
    """
    options = {"seconds": args.seconds, "samplerate": args.samplerate or 44_100} | args.accuracy
    renderer: Renderer = partial(run_local, cores=args.cores or usable_cores())
    if args.cluster is not None:
        from engine.sweep.dask_workers import run_dask

        renderer = partial(run_dask, address=args.cluster)
    return run_sweep(plan, folder, renderer, options, form, progress)


def run_sweep(
    plan: SweepPlan,
    folder: Path,
    renderer: Renderer,
    options: dict[str, Any],
    form: SoundForm = PLAIN_FORM,
    progress: Progress = lambda share: None,
) -> SweepOutcome:
    """Render the points of a plan into a folder, which is made if it is missing, with its index.csv.

    renderer: gives the results of tasks, in any order, each once
    options:  seconds, samplerate and accuracy (engine.offline.render.render_arrays)
    form:     of the sounds; without a gain or a loudness, the loudest is normalised, and all have its gain

    Rows of the index that say "done" of the same point, with its file there, are kept. Raises OSError or
    RuntimeError if a file cannot be written, or the folder has an index of something else.
    """
    if message := index_csv.check_index(folder / "index.csv", [axis.path for axis in plan.axes]):
        raise RuntimeError(message)
    unusual = [repr(form)] * (form != SoundForm(form.subtype, form.gain))
    settings = (form.gain, form.subtype, source_digest(), *unusual)
    tasks, values, failures = _make_tasks(plan, options, settings, progress)
    sounds = SoundFolder(folder, plan, tasks, values, form)
    try:
        with _open_for_append(sounds.index) as file:
            for number, result in failures.items():
                sounds.add(number, result, file)
            remaining = [task for number, task in tasks.items() if number not in sounds.rows]
            with closing(renderer(remaining)) as results:
                for item in results:
                    if item is not None:
                        sounds.add(*item, file)
                    progress(len(sounds.rows) / len(plan.points))
    except KeyboardInterrupt:
        sounds.outcome.interrupted = True
    sounds.finish()
    return sounds.outcome


def write_note_map(plan: SweepPlan, folder: Path, is_loop: bool = False) -> Path | None:
    """Write the SFZ file of a set of notes that is done: what is in its folder. Returns its path; None if there is no
    sound. Raises RuntimeError if it cannot be written."""
    rows = index_csv.read_index(folder / "index.csv")
    numbers = [n for n, row in rows.items() if row["status"] == "done" and 1 <= n <= len(plan.points)]
    points = {n: plan.points[n - 1] for n in numbers if rows[n]["file"] == plan.sound_name(n)}
    notes = {number: plan.note(point) for number, point in points.items()}
    samples = [Sample(parse_key(key), velocity, plan.sound_name(n)) for n, (key, velocity) in notes.items()]
    if not samples:
        return None
    release = {parse_key(notes[n][0]): release_time(plan.scene(point), plan.hold) for n, point in points.items()}
    path = folder / f"{plain_text(Path(plan.patch).stem)}.sfz"
    try:
        write_sfz(path, plan.data.get("title") or path.stem, samples, release, is_loop)
    except OSError as error:
        raise _write_error(path, error) from error
    return path


class SoundFolder:
    """The folder of a sweep: sounds, and an index whose rows are kept if they are of the same points.

    tasks:  by the number of their point
    values: what the rows of all points begin with: number, values and fingerprint
    """

    def __init__(
        self,
        folder: Path,
        plan: SweepPlan,
        tasks: dict[int, RenderTask],
        values: dict[int, dict[str, Cell]],
        form: SoundForm,
    ) -> None:
        """Make the folder, remove what a killed sweep left half-written, and read and rewrite the index."""
        self.folder, self.index = folder, folder / "index.csv"
        self.header = index_csv.index_header([axis.path for axis in plan.axes], plan.contacts)
        self.tasks, self.values, self.form, self.plan = tasks, values, form, plan
        self.name_of, self.unscaled = plan.sound_name, folder / UNSCALED_FOLDER
        self.is_scaled_last = not form.has_own_level
        self.text = read_patch_text(plan)
        self.cut, self.limited = list[float](), list[float]()  # dB of ends, and LUFS, of such sounds
        folder.mkdir(exist_ok=True)
        self._remove_leftovers()
        previous = {n: row for n, row in index_csv.read_index(self.index).items() if n in tasks}
        names = Counter(row["file"] for row in previous.values()) + Counter(map(self.name_of, tasks))
        settled = {n for n, row in previous.items() if row["file"] == self.name_of(n) or names[row["file"]] == 1}
        self.rows = {
            n: self._named_anew(n, previous[n]) for n in previous if n in settled and self._is_current(n, previous[n])
        }
        self.outdated = {
            n: sound_path(folder, row)
            for n, row in previous.items()
            if n not in self.rows and (row["file"] == self.name_of(n) or is_name_of_number(row["file"], n))
        }
        self.outcome = SweepOutcome(len(plan.points), done=len(self.rows), already_done=len(self.rows))
        self._write_index()

    def add(self, number: int, result: RenderResult, file: int) -> None:
        """Write the sound of a point, and append its row to the index, whose descriptor is given. Raises
        RuntimeError."""
        name, cells = self.name_of(number), dict(result.cells)
        if result.audio is not None:
            samplerate, is_silent = self.tasks[number].options["samplerate"], bool(result.cells["silent"])
            target = self.sound_file(number)
            if self.is_scaled_last:
                in_si_units = replace(self.form, subtype="DOUBLE", gain=0.0, fade=self.form.fades, dither=False)
                target = SoundFile(self.unscaled / name, in_si_units)
            sound, path = target.prepare(result.audio, samplerate, is_silent), target.path
            if self.is_scaled_last:
                cells["peak"] = float(abs(sound.audio).max())  # by which all are scaled
            else:
                cells["gain_db"] = sound.gain
            self._note(sound)
            try:
                path.parent.mkdir(exist_ok=True)
                outdated = self.outdated.get(number)
                self.outcome.overwritten += outdated is not None and outdated.exists()
                sound.write()
                if outdated is not None and outdated != path:
                    outdated.unlink(missing_ok=True)
            except (OSError, RuntimeError) as error:
                raise _write_error(path, error) from error
        cells = self.values[number] | cells
        cells |= {"file": name if result.audio is not None else "", "status": result.error or "done"}
        self.rows[number] = {column: index_csv.format_cell(cells.get(column)) for column in self.header}
        try:
            line = index_csv.csv_line(self.rows[number].values()).encode()
            while line:  # a disk that is nearly full takes a part of it
                line = line[os.write(file, line) :]
        except OSError as error:
            raise _write_error(self.index, error) from error
        self.outcome.done += result.audio is not None
        self.outcome.failed += result.audio is None

    def sound_file(self, number: int) -> SoundFile:
        """Return the file of the sound of a point."""
        plan, values = self.plan, self.plan.values(number)
        key = parse_key(plan.note(plan.points[number - 1])[0]) if plan.has_notes else None
        title, patch = plan.data.get("title") or Path(plan.patch).stem, Path(plan.patch)
        author, licence = (str(plan.data.get(name, "")) for name in ("author", "licence"))
        about = About(title, patch.name, self.text, values, KernelName.GENERAL, key, author=author, licence=licence)
        return SoundFile(self.folder / self.name_of(number), self.form, about)

    def _note(self, sound: PreparedSound) -> None:
        """Keep what there is to say of a sound."""
        if sound.shaped.cut is not None:
            self.cut.append(sound.shaped.cut.level)
        if sound.is_limited and sound.loudness is not None:
            self.limited.append(sound.loudness)

    def _warnings(self) -> list[str]:
        """A line for the sounds that are cut, and one for those whose loudness is another one."""
        of_all, lines = f"of {self.outcome.points} sounds", list[str]()
        if self.cut:
            ends = f"at {max(self.cut):.0f} dB at most; more --seconds hold them"
            lines.append(f"{len(self.cut)} {of_all} are cut, {ends}")
        if self.limited:
            wanted = f"quieter than {self.form.loudness:g} LUFS, {min(self.limited):.1f} at least"
            peak = f"their peaks would exceed {NORMALISED_PEAK_DBFS:g} dBFS"
            lines.append(f"{len(self.limited)} {of_all} are {wanted}: {peak}")
        return lines

    def finish(self) -> None:
        """Drop the rows whose sounds were removed meanwhile, bring sounds that are to have one gain to it, if all are
        there, and write the index in order. Raises RuntimeError."""
        for number, row in self._rows_done():
            if not sound_path(self.folder, row).is_file():
                self._drop(number)
        if self.is_scaled_last and not self.outcome.interrupted:
            self._scale()
        self.outcome.warnings = self._warnings()
        self._write_index()
        if not self.outcome.interrupted and self.unscaled.is_dir():
            for path in [self.unscaled / self.name_of(number) for number in self.tasks]:
                path.unlink(missing_ok=True)
            with suppress(OSError):  # something else is in there
                self.unscaled.rmdir()

    def _is_current(self, number: int, row: IndexRow) -> bool:
        """True if a row is of this very point, and its sound exists and is complete, judging by header and length."""
        task = self.tasks[number]
        is_same = row["status"] == "done" and row["fingerprint"] == self.values[number]["fingerprint"]
        path, rate = sound_path(self.folder, row), task.options["samplerate"]
        if not is_same or not is_plain_name(row["file"]) or not path.is_file() or not is_whole(path):
            return False
        import soundfile

        seconds = task.options["seconds"] or task.document.get("seconds") or Scene.model_fields["seconds"].default
        try:
            info = soundfile.info(soundfile_path(path))
        except (OSError, RuntimeError):
            return False
        has_length = self.form.trim or self.form.loop is not None or info.frames == frame_count(seconds, rate)
        return bool(has_length and info.samplerate == rate)

    def _named_anew(self, number: int, row: IndexRow) -> IndexRow:
        """Give the sound of a row the name that it has today. Raises RuntimeError."""
        old, new = sound_path(self.folder, row), row | {"file": self.name_of(number)}
        if row["file"] != new["file"]:
            try:
                os.replace(old, sound_path(self.folder, new))
            except OSError as error:
                raise _write_error(old, error) from error
        return new

    def _rows_done(self) -> list[tuple[int, IndexRow]]:
        return [(number, row) for number, row in self.rows.items() if row["status"] == "done"]

    def _drop(self, number: int) -> None:
        """Forget a row, so that the same command renders it again."""
        del self.rows[number]
        self.outcome.gone, self.outcome.done = self.outcome.gone + 1, self.outcome.done - 1

    def _scale(self) -> None:
        """Write the sounds at their common gain. Those that have another one, of a time when there were fewer sounds,
        are dropped if their files are of integers, which would lose precision. Raises RuntimeError."""
        self.outcome.gain_db = common_gain(row for _, row in self._rows_done())
        gain = index_csv.format_cell(self.outcome.gain_db)
        for number, row in self._rows_done():
            source, target, before = self.unscaled / row["file"], self.folder / row["file"], 0.0
            if not source.is_file():
                source, before = target, float(row["gain_db"])
                if row["gain_db"] == gain:
                    continue
                if resolve_subtype(target, self.form.subtype) not in ("FLOAT", "DOUBLE"):
                    self._drop(number)
                    continue
            try:
                rescale(source, self.sound_file(number), self.outcome.gain_db - before)
            except (OSError, RuntimeError) as error:
                raise _write_error(target, error) from error
            row["gain_db"] = gain

    def _remove_leftovers(self) -> None:
        """Remove what a killed sweep left half-written."""
        names = {"index.csv", *map(self.name_of, self.values)}
        for folder in (self.folder, self.unscaled):
            for path in [*folder.glob(".*.part")]:
                if path.name[1:].rsplit(".", 2)[0] in names:
                    path.unlink(missing_ok=True)

    def _write_index(self) -> None:
        try:
            index_csv.write_index(self.index, self.header, self.rows)
        except OSError as error:
            raise _write_error(self.index, error) from error


def _write_error(path: Path, error: Exception) -> RuntimeError:
    """The error that a file could not be written, with how to go on."""
    return RuntimeError(
        f"cannot write {path} ({error_reason(error)}); when this is possible again, run the same command to continue"
    )


def _make_tasks(
    plan: SweepPlan, options: dict[str, Any], settings: tuple[Any, ...], progress: Progress
) -> tuple[dict[int, RenderTask], dict[int, dict[str, Cell]], dict[int, RenderResult]]:
    """The tasks of a plan, what the rows of its points begin with, and the results of points that have no valid scene;
    all by the numbers of the points, from 1.

    settings: what else makes a sound another one
    """
    tasks, failures = {}, {}
    values: dict[int, dict[str, Cell]] = {}
    for number, point in enumerate(plan.points, 1):
        progress(0.0)
        values[number] = {"number": number, **plan.values(number)}
        try:
            document = plan.scene(point).model_dump(exclude_unset=True)
            task = RenderTask(number, document, options, contacts=plan.contacts)
            values[number]["fingerprint"] = task.fingerprint(*settings, *plan.contacts)
            tasks[number] = task
        except (PatchError, OSError) as error:
            faults = [f"{f.path}: {f.message}" for f in error.faults] if isinstance(error, PatchError) else [str(error)]
            failures[number] = RenderResult(None, {}, "; ".join(faults))
    return tasks, values, failures


def read_patch_text(plan: SweepPlan) -> str:
    """Return the text of the patch of a plan; "" if it is no file."""
    try:
        return Path(plan.patch).read_text("utf-8-sig", "replace")
    except OSError:
        return ""


@contextmanager
def _open_for_append(path: Path) -> Iterator[int]:
    """Open a file to append lines to, without a buffer. Gives its descriptor."""
    file = os.open(path, os.O_WRONLY | os.O_APPEND)
    try:
        yield file
    finally:
        os.close(file)
