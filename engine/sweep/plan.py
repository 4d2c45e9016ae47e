"""The plan of a sweep: the points at which a patch is to be rendered, and the faults of its options."""

import argparse
import copy
import itertools
import math
import os
import random
import tomllib
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, field, replace
from functools import cached_property
from importlib.util import find_spec
from itertools import chain, islice
from pathlib import Path
from typing import Any

from engine.bodies.table import KeyPath, is_number
from engine.faults import Fault, PatchError
from engine.offline.trace import contact_names
from engine.output_files import absolute_path, check_audio_format
from engine.patch.error_messages import format_path
from engine.patch.named_values import VARY
from engine.patch.note_scene import HOLD_SECONDS, TAIL_SECONDS
from engine.patch.paths import set_value
from engine.patch.precision_key import remove_precision
from engine.patch.scene import Scene, scene_of_document
from engine.sweep.axes import MAX_GRID_POINTS, SweepAxis, Value, parse_axis
from engine.sweep.index_csv import check_index
from engine.sweep.note_axes import (
    NOTE,
    NOTE_FORMS,
    OPTIONS,
    VELOCITY,
    parse_notes,
    parse_velocities,
    scene_with_note,
)
from engine.sweep.sound_names import fill_name, note_file_name, plain_text, point_stem, sound_name

SECONDS: KeyPath = ("seconds",)
SEED = "seed"  # in [vary]
MAX_WRONG_DRAWS = 50  # for each variation, that are no scenes

GridPoint = tuple[Value, ...]  # a value per axis


@dataclass(frozen=True)
class SweepPlan:
    """A patch, and the points of its parameters at which it is rendered.

    data: the document of the patch, as it was read
    hold, seconds: of notes, how long the key is down, s, and how long they sound
    left_out: lines of what is left out: notes, events, drawn points that are no scene
    contacts: the names of those that are measured
    template: of the names of sounds, as of `fill_name`; None: what is varied is in their names
    """

    patch: str
    data: dict[str, Any]
    axes: list[SweepAxis]
    points: list[GridPoint]
    hold: float = HOLD_SECONDS
    seconds: float = HOLD_SECONDS + TAIL_SECONDS
    left_out: tuple[str, ...] = ()
    template: str | None = None
    contacts: tuple[str, ...] = ()
    _scenes: dict[GridPoint, Scene] = field(default_factory=dict, repr=False, compare=False)  # without a note; one

    @property
    def has_notes(self) -> bool:
        """True if notes are played, and not the patch's own score."""
        return any(axis.path in OPTIONS and not axis.key_path for axis in self.axes)

    def scene(self, point: GridPoint) -> Scene:
        """The scene of a point. Raises PatchError."""
        pairs = list(zip(self.axes, point, strict=True))
        axes, values = [axis for axis, _ in pairs if axis.key_path], tuple(v for axis, v in pairs if axis.key_path)
        if values not in self._scenes:
            scene = scene_at(self.data, self.patch, axes, values)
            self._scenes.clear()
            self._scenes[values] = scene
        scene = self._scenes[values]
        if not self.has_notes:
            return scene
        note = scene_with_note(scene, *self.note(point), self.hold, self.seconds)
        return note.model_copy(update={"tremolo": None})  # a sampler would change its rate with the pitch

    def note(self, point: GridPoint) -> tuple[str, int]:
        """The name of the key that is played at a point, and its velocity."""
        values = {axis.path: value for axis, value in zip(self.axes, point, strict=True) if not axis.key_path}
        return str(values[NOTE]), int(values[VELOCITY])

    @cached_property
    def has_each_note_once(self) -> bool:
        """True if a note and its velocity are enough to name a point."""
        return len({*map(self.note, self.points)}) == len(self.points)

    def name_fields(self, number: int) -> dict[str, Value]:
        """Fields of a template of names, of a point by its number, from 1."""
        values = {axis.path: value for axis, value in zip(self.axes, self.points[number - 1], strict=True)}
        fields: dict[str, Value] = {"number": number, "patch": Path(self.patch).stem}
        fields |= {path.partition(".")[2]: value for path, value in values.items() if "." in path}
        return fields | values

    def values(self, number: int) -> dict[str, str]:
        """The values of a point by their paths, with all their digits."""
        return {axis.path: str(value) for axis, value in zip(self.axes, self.points[number - 1], strict=True)}

    def sound_name(self, number: int) -> str:
        """The name of the audio file of a point, by its number, from 1."""
        point = self.points[number - 1]
        if self.template is not None:
            return fill_name(self.template, self.name_fields(number))
        varied = [(axis.path, value) for axis, value in zip(self.axes, point, strict=True) if axis.key_path]
        if not self.has_notes:
            return sound_name(number, varied)
        stem = plain_text(Path(self.patch).stem) if self.has_each_note_once else point_stem(number, varied)
        return note_file_name(stem, *self.note(point))


def scene_at(data: dict[str, Any], patch: str, axes: list[SweepAxis], point: GridPoint) -> Scene:
    """The scene of a point: the document with the values of the point in place. Events that come after its seconds are
    left out, as `--seconds` leaves them out. Raises PatchError."""
    data, seconds = copy.deepcopy(data), None
    for axis, value in zip(axes, point, strict=True):
        if axis.key_path == SECONDS:
            seconds = value
        else:
            set_value(data, axis.key_path, value)
    if seconds is None:
        return scene_of_document(data, Path(patch).parent, patch)
    if is_number(seconds) and (end := float(seconds)) > 0.0:
        scene = scene_of_document(data, Path(patch).parent, patch)
        if end <= scene.seconds:
            return scene_until(scene, end)
    set_value(data, SECONDS, seconds)
    return scene_of_document(data, Path(patch).parent, patch)


def scene_until(scene: Scene, seconds: float) -> Scene:
    """A scene that ends earlier, without the events that come later."""
    events = [event for event in scene.event if event.time < seconds]
    fewer = {"event": events} if len(events) < len(scene.event) else {}
    return scene.model_copy(update={"seconds": seconds, **fewer})


def describe_late_events(scene: Scene, axes: list[SweepAxis]) -> list[str]:
    """A line, in a list, if the shortest sound of a sweep over seconds leaves out events of the patch."""
    ends = [bound for axis in axes if axis.key_path == SECONDS for bound in axis.bounds if is_number(bound)]
    count = sum(event.time >= min(map(float, ends), default=math.inf) for event in scene.event)
    if not count:
        return []
    what = "an event that comes" if count == 1 else f"{count} events that come"
    return [f"seconds: {what} later than {min(map(float, ends)):g} s are left out where the sound ends before"]


def grid_points(axes: list[SweepAxis]) -> list[GridPoint]:
    """All points of the grid; the last axis varies fastest."""
    return list(itertools.product(*(axis.grid_values() for axis in axes)))


def draw_points(axes: list[SweepAxis], seed: int) -> Iterator[GridPoint]:
    """Yield random points, the same for the same seed."""
    draw = random.Random(seed).random  # every version of Python draws the same
    while True:
        yield tuple(axis.value_at(draw()) for axis in axes)


def valid_points(points: Iterable[GridPoint], plan: SweepPlan, count: int) -> tuple[list[GridPoint], int]:
    """Return so many of some points which are scenes, fewer if too few are, and how many were drawn that are none."""
    valid, wrong = list[GridPoint](), 0
    for point in points:
        try:
            plan.scene(point)
            valid.append(point)
        except PatchError:
            wrong += 1
        if len(valid) == count or wrong > MAX_WRONG_DRAWS * count:
            break
    return valid, wrong


def plan_sweep(
    args: argparse.Namespace, scene: Scene, lengths: dict[str, float | None]
) -> tuple[SweepPlan, list[Fault]]:
    """Plan the sweep that the arguments of the command line ask for. Its points are empty if there are faults.

    lengths: of notes, by the options hold and seconds; None where they are not given
    """
    data = tomllib.loads(Path(args.patch).read_text("utf-8-sig"))
    remove_precision(data)  # of which a note has said that it has no effect
    numbers, faults = _parse_numbers(args)
    axes: list[SweepAxis] = []
    ranges, range_faults = _ranges_of_patch(args, scene)
    faults += range_faults
    is_random = args.random is not None or args.variations is not None
    for text in [*args.vary, *ranges]:
        try:
            axis = parse_axis(text, scene, data, is_random)
        except ValueError as error:
            faults.append(Fault("--vary", str(error)))
            continue
        faults += _check_axis(axis, axes, args)
        axes.append(axis)
    left_out = describe_late_events(scene, axes)
    note_axes, note_faults = _note_axes(args, scene, left_out)
    axes, faults = axes + note_axes, faults + note_faults
    draws = numbers["random"] or numbers["variations"]
    count = draws or math.prod(axis.count or len(axis.bounds) for axis in axes)
    if count > MAX_GRID_POINTS:
        faults.append(
            Fault(
                "--vary",
                f"the grid has {count} points; the limit is {MAX_GRID_POINTS}: give --random 1000, for example",
            )
        )
    if faults:
        return SweepPlan(args.patch, data, axes, []), faults
    seed = scene.vary.get(SEED, 0) if numbers["seed"] is None else numbers["seed"]
    drawn = draw_points(axes, int(str(seed)))
    points = list(islice(drawn, draws)) if draws else grid_points(axes)
    hold = lengths.get("hold") or HOLD_SECONDS
    seconds = lengths.get("seconds") or hold + TAIL_SECONDS
    contacts = tuple(contact_names(scene)) if args.contacts else ()
    plan = SweepPlan(args.patch, data, axes, points, hold, seconds, tuple(left_out), args.name, contacts)
    if numbers["variations"] is None:
        return plan, check_names(plan) + check_axes(plan)
    points, wrong = valid_points(chain(points, drawn), plan, count)
    if len(points) < count:
        message = (
            f"only {len(points)} of {len(points) + wrong} drawn variations are scenes; narrow the ranges of [vary]"
        )
        return replace(plan, points=points), [Fault("--variations", message)]
    lines = [f"{wrong} drawn variations were no valid scenes, and were drawn again"] * (wrong > 0)
    plan = replace(plan, points=points, left_out=(*left_out, *lines))
    return plan, check_names(plan)


def _ranges_of_patch(args: argparse.Namespace, scene: Scene) -> tuple[list[str], list[Fault]]:
    """Ranges of [vary] in the patch, as --vary takes them, and the faults of --variations."""
    if args.variations is None:
        return [], []
    ranges = {path: values for path, values in scene.vary.items() if path != SEED}
    faults = [Fault("--variations", "cannot be combined with --random; give one of them")] * (args.random is not None)
    if not ranges and not args.vary:
        remedy = f'write [{VARY}], such as "body.ball.mass" = "0.1..0.2", or give --vary'
        faults.append(Fault("--variations", f"the patch does not say what varies; {remedy}"))
    paths = {path: f"values.{path}" if path in scene.values else path for path in ranges}
    lists = {path: ",".join(map(str, v)) if isinstance(v, list) else v for path, v in ranges.items()}
    return [f"{paths[path]}={values}" for path, values in lists.items()], faults


def check_names(plan: SweepPlan) -> list[Fault]:
    """Faults of the template of the names of sounds."""
    names: set[str] = set()
    for number in range(1, len(plan.points) + 1) if plan.template is not None else ():
        try:
            name = plan.sound_name(number)
        except ValueError as error:
            return [Fault("--name", str(error))]
        if name.lower() in names:
            return [Fault("--name", f"two sounds would be called {name}; add {{number}} to their names")]
        names.add(name.lower())
    return []


def _note_axes(args: argparse.Namespace, scene: Scene, left_out: list[str]) -> tuple[list[SweepAxis], list[Fault]]:
    """The axes of the notes that the options name, and their faults. left_out: where to add a line of the keys of a
    range that the instrument does not have"""
    axes, faults = list[SweepAxis](), list[Fault]()
    if args.notes is None:
        given = [f"--{option}" for option in ("velocities", "hold", "sfz") if getattr(args, option)]
        faults += [Fault(option, f"requires --notes; {NOTE_FORMS}") for option in given]
        if not args.vary and not given and args.variations is None:
            faults.append(Fault("--vary", "nothing varies; give --vary PATH=RANGE, or --notes A0..C8"))
        return axes, faults
    for option in ("vary", "random", "variations"):
        if args.sfz and getattr(args, option):
            faults.append(Fault("--sfz", f"requires all notes, one of each; leave out --{option}"))
    if args.contacts:
        faults.append(Fault("--contacts", "cannot be combined with --notes: every key has contacts of its own"))
    parsers: list[tuple[str, Callable[[], SweepAxis]]] = [
        (NOTE, lambda: parse_notes(args.notes, scene, left_out)),
        (VELOCITY, lambda: parse_velocities(args.velocities)),
    ]
    for name, parse in parsers:
        try:
            axes.append(parse())
        except ValueError as error:
            faults.append(Fault(OPTIONS[name], str(error)))
    return axes, faults


def _parse_numbers(args: argparse.Namespace) -> tuple[dict[str, int | None], list[Fault]]:
    """The numbers of --random and --seed."""
    numbers: dict[str, int | None] = {}
    faults: list[Fault] = []
    for name, least in (("random", 1), ("variations", 1), ("seed", 0)):
        text = getattr(args, name)
        if text is not None and not (text.isdecimal() and least <= int(text) <= 10**9):
            faults.append(Fault(f"--{name}", f'"{text}" is not a whole number; give {least} to 1000000000'))
        numbers[name] = int(text) if text is not None and text.isdecimal() else None
    if args.seed is not None and args.random is None and args.variations is None:
        faults.append(Fault("--seed", "requires --random or --variations; give one of them"))
    return numbers, faults


def _check_axis(axis: SweepAxis, others: list[SweepAxis], args: argparse.Namespace) -> list[Fault]:
    """Faults of an axis that varies what another one varies, or what an option gives."""
    faults: list[Fault] = []
    if any(axis.key_path == other.key_path for other in others):
        faults.append(Fault("--vary", f"{axis.path}: it varies twice; give it once"))
    if axis.key_path == SECONDS and args.notes is not None:
        return [*faults, Fault("--vary", "seconds: --hold and --seconds set the length of notes; leave it out")]
    option = axis.key_path[-1] if axis.key_path[0] in ("seconds", "accuracy") else None
    if option is not None and getattr(args, str(option), None) is not None:
        faults.append(Fault("--vary", f"{axis.path}: --{option} is given too; give one of them"))
    return faults


def check_axes(plan: SweepPlan) -> list[Fault]:
    """Faults of the patch at both bounds of each axis, or at each value of a list; the other axes are at their first
    value."""
    faults: dict[Fault, None] = {}  # in order, each once
    by_path = {format_path(axis.key_path): axis for axis in plan.axes if axis.key_path}
    for n, axis in enumerate(plan.axes):
        for fraction, bound in enumerate(axis.bounds):
            value = axis.value_at(0.5 if axis.normal else float(fraction)) if axis.is_range else bound
            point = tuple(value if k == n else other.value_at(0.0) for k, other in enumerate(plan.axes))
            try:
                plan.scene(point)
            except PatchError as error:
                for fault in error.faults:
                    culprit = by_path.get(fault.path)
                    name = f"{culprit.path}" if culprit else f"{axis.path} = {value}: {fault.path}".rstrip(": ")
                    option = OPTIONS.get(axis.path, "--vary") if not axis.key_path else "--vary"
                    faults[Fault(option, f"{name}: {fault.message}")] = None
    return list(faults)


def axis_paths(args: argparse.Namespace, scene: Scene | None) -> list[str]:
    """The paths of the axes that the options name."""
    paths = [text.partition("=")[0].strip() for text in args.vary]
    if scene is not None:
        paths += [text.partition("=")[0] for text in _ranges_of_patch(args, scene)[0]]
    return paths + (list(OPTIONS) if args.notes is not None else [])


def sweep_folder(args: argparse.Namespace) -> Path:
    """The folder to write to."""
    return Path(args.output or Path(args.patch).stem)


def check_output(args: argparse.Namespace, scene: Scene | None) -> list[Fault]:
    """Faults of the folder to write to, and of where the points are to be rendered."""
    folder, faults = sweep_folder(args), check_audio_format(Path("a.wav"), args.subtype, "--subtype")
    parent = folder if folder.is_dir() else absolute_path(folder).parent
    if folder.exists() and not folder.is_dir():
        faults.append(Fault("--output", f"{folder} is a file; give the name of a folder"))
    elif not parent.is_dir():
        faults.append(Fault("--output", f"no such folder: {parent}; make it, or write elsewhere"))
    elif not os.access(parent, os.W_OK):
        faults.append(Fault("--output", f"{parent} cannot be written to; write elsewhere"))
    elif folder.is_dir() and any(folder.glob("[!.]*")) and not (folder / "index.csv").exists():
        faults.append(Fault("--output", f"{folder} has other files in it; give an empty folder, or a new one"))
    elif message := check_index(folder / "index.csv", axis_paths(args, scene)):
        faults.append(Fault("--output", message))
    if args.cluster is not None and find_spec("distributed") is None:
        faults.append(Fault("--cluster", "needs distributed; run uv sync --extra cluster, or pip install distributed"))
    if args.cluster is not None and args.cores is not None:
        faults.append(Fault("--cores", "cannot be combined with --cluster; its workers have their own cores"))
    return faults
