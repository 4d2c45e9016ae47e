"""Variations of a patch: which values of it vary, and the points at which it is to be rendered."""

import argparse
import copy
import itertools
import math
import os
import random
import tomllib
import typing
from dataclasses import dataclass
from importlib.util import find_spec
from pathlib import Path
from typing import Any

from pydantic import BaseModel

from engine.arguments import unheard
from engine.index import foreign
from engine.lines import Where
from engine.patch import PatchError, nearest, validated
from engine.save import absolute
from engine.scene import Scene

MOST = 100_000  # points; more are a mistake
DIGITS = 12  # of a value between two ends: 0.3, not 0.30000000000000004
FORMS = "PATH=A..B:N, PATH=A..B:log:N or PATH=A,B,C"

Value = int | float | str
Point = tuple[Value, ...]
Wrong = list[tuple[str, str]]


@dataclass(frozen=True)
class Axis:
    """One value of a patch that varies.

    path:  what the user calls it
    where: its place in the document
    ends:  the values of a list; or the two ends of a range
    count: how many values a range has, or None for a list, or a range that is to be sampled
    """

    path: str
    where: Where
    ends: tuple[Value, ...]
    ranged: bool = False
    log: bool = False
    whole: bool = False
    count: int | None = None

    def at(self, share: float) -> Value:
        """The value at a share of the range, 0 to 1; of a list, one of its values."""
        if not self.ranged:
            return self.ends[min(int(share * len(self.ends)), len(self.ends) - 1)]
        low, high = (float(end) for end in self.ends)
        if self.whole and self.count is None and not self.log:  # each as often as any
            first, last = math.ceil(min(low, high)), math.floor(max(low, high))
            return min(first + int(share * (last - first + 1)), last)
        if share in (0.0, 1.0):
            value = high if share else low
        else:
            value = low * (high / low) ** share if self.log else low + (high - low) * share
            value = float(f"{value:.{DIGITS}g}")
        return round(value) if self.whole else value

    def values(self) -> list[Value]:
        """All values of the grid along this axis; whole numbers of a range are not repeated."""
        if self.count is None:
            return list(self.ends)
        return list(dict.fromkeys(self.at(n / (self.count - 1)) for n in range(self.count)))


@dataclass(frozen=True)
class Plan:
    """What is to be rendered: points of a patch. `data` is the document as it was read."""

    patch: str
    data: dict[str, Any]
    axes: list[Axis]
    points: list[Point]

    def scene(self, point: Point) -> Scene:
        """The scene of a point. Raises PatchError."""
        return varied(self.data, self.patch, self.axes, point)


def points(axes: list[Axis]) -> list[Point]:
    """The grid: the last axis varies fastest."""
    return list(itertools.product(*(axis.values() for axis in axes)))


def sampled(axes: list[Axis], count: int, seed: int) -> list[Point]:
    """Random points, the same for the same seed; fewer of them are the first of more."""
    draw = random.Random(seed).random  # kept the same by every version of Python
    return [tuple(axis.at(draw()) for axis in axes) for _ in range(count)]


def axis(text: str, scene: Scene, data: dict[str, Any], sampling: bool = False) -> Axis:
    """An axis from PATH=RANGE. Raises ValueError, in one line."""
    path, equals, values = (part.strip() for part in text.partition("="))
    if not equals or not path or not values:
        raise ValueError(f'"{text}" is no variation; {FORMS}')
    where, whole = place(path, scene, data)
    try:
        if ".." not in values or "/" in values:  # ../bell.csv is a file
            return Axis(path, where, tuple(_value(word.strip()) for word in values.split(",")))
        low, _, rest = values.partition("..")
        high, *more = rest.split(":")
        ends = float(low), float(high)
        log = more[:1] == ["log"]
        count = [int(word) for word in more[log:]]
    except ValueError:
        raise ValueError(f'{path}: "{values}" is neither a range nor a list; {FORMS}') from None
    if len(count) > 1 or not all(map(math.isfinite, ends)) or ends[0] == ends[1]:
        raise ValueError(f'{path}: "{values}" is no range; {FORMS}')
    if log and min(ends) <= 0.0:
        raise ValueError(f'{path}: "{values}" reaches to 0 or below, where there is no logarithm; A..B:N')
    if not count and not sampling:
        right = f"{values}:16 for as many, or --sample N for points at random"
        raise ValueError(f'{path}: "{values}" does not say how many; {right}')
    if count and not 2 <= count[0] <= MOST:
        raise ValueError(f'{path}: {count[0]} values from "{low}" to "{high}"; 2 to {MOST}')
    if whole and math.ceil(min(ends)) > math.floor(max(ends)):
        raise ValueError(f'{path}: "{values}" holds no whole number; {FORMS}')
    return Axis(path, where, ends, True, log, whole, count[0] if count else None)


def _value(word: str) -> Value:
    """A number if it is one. Raises ValueError if there is nothing."""
    if not word:
        raise ValueError(word)
    try:
        return int(word)
    except ValueError:
        pass
    try:
        return float(word)
    except ValueError:
        return word


def place(path: str, scene: Scene, data: dict[str, Any]) -> tuple[Where, bool]:
    """Where a path leads in the document, and whether whole numbers belong there. Raises ValueError."""
    here: Any = scene
    where: Where = ()
    whole, before = False, ""
    for part in path.split("."):
        whole, after = False, path[len(before + part) :]
        if isinstance(here, BaseModel):
            known = type(here).model_fields
            if part not in known:
                raise ValueError(f'{path}: there is no "{before}{part}"; {nearest(part, list(known), before, after)}')
            where, here, whole = (*where, part), getattr(here, part), _whole(known[part].annotation)
        elif isinstance(here, list):
            number = _number(part, here, before, path)
            where, here = (*where, number), here[number]
        elif isinstance(here, dict) and part in here:
            where, here = (*where, part), here[part]
        elif isinstance(here, dict):
            raise ValueError(f'{path}: there is no "{before}{part}"; {nearest(part, list(here), before, after)}')
        else:
            what = "is not in the patch; write it there" if here is None else "has no parts; leave out what follows it"
            raise ValueError(f"{path}: {before[:-1]} {what}")
        before += f"{part}."
    if isinstance(here, BaseModel | dict) or (isinstance(here, list) and any(isinstance(i, BaseModel) for i in here)):
        inner = type(here[0] if isinstance(here, list) else here)
        keys = list(inner.model_fields) if issubclass(inner, BaseModel) else list(here)
        whose = f"{path}.0" if isinstance(here, list) else path
        raise ValueError(f"{path}: a table; give one of its keys: {', '.join(f'{whose}.{key}' for key in keys)}")
    _written(data, where, path)
    return where, whole


def _number(part: str, items: list[Any], before: str, path: str) -> int:
    """Number of an item of a list: as it stands, or of the only one of that name, or on that body."""
    name = before[:-1]
    if part.isdecimal() and int(part) < len(items):
        return int(part)
    names = [getattr(item, "name", None) or getattr(item, "body", None) for item in items]
    if all(hasattr(item, "name") for item in items):  # unnamed contacts have numbers only
        names = [item.name for item in items]
    found = [n for n, own in enumerate(names) if own == part]
    if len(found) == 1:
        return found[0]
    if found:
        raise ValueError(
            f'{path}: {len(found)} of {name} are on "{part}"; {" or ".join(f"{before}{n}" for n in found)}'
        )
    if not items:
        raise ValueError(f"{path}: the patch has no {name}; write it there")
    known = [own for own in names if own] if not part.isdecimal() else []
    right = f"{before}0" + (f" to {before}{len(items) - 1}" if len(items) > 1 else "")
    right = nearest(part, known, before, path[len(before + part) :]) if known else right
    raise ValueError(f'{path}: there is no "{before}{part}"; {right}')


def _whole(annotation: Any) -> bool:
    """Whether a field takes whole numbers only."""
    inner = typing.get_args(annotation)
    return annotation is int or isinstance(annotation, int) or (float not in inner and any(map(_whole, inner)))


def _written(data: dict[str, Any], where: Where, path: str) -> None:
    """All but the last part of a path must stand in the document, or be a table that can. Raises ValueError."""
    here: Any = data
    for n, part in enumerate(where[:-1]):
        if isinstance(here, dict) and part not in here:
            if where[:1] == ("accuracy",):
                return
            what = "its modes come from a file" if "file" in here else "it is not in the patch"
            raise ValueError(f"{path}: {what}; write {'.'.join(map(str, where[: n + 1]))} there")
        here = here[part]


def varied(data: dict[str, Any], patch: str, axes: list[Axis], point: Point) -> Scene:
    """The scene of a point: the document with its values in place. Raises PatchError."""
    data = copy.deepcopy(data)
    for one, value in zip(axes, point, strict=True):
        here: Any = data
        for part in one.where[:-1]:
            here = here.setdefault(part, {}) if isinstance(here, dict) else here[part]
        here[one.where[-1]] = value
    return validated(data, Path(patch).parent, patch, "")


def plan(args: argparse.Namespace, scene: Scene) -> tuple[Plan, Wrong]:
    """What is to be rendered, and what is wrong with what is asked for."""
    data = tomllib.loads(Path(args.patch).read_text("utf-8-sig"))
    axes: list[Axis] = []
    wrong: Wrong = []
    numbers = {}
    for name, low in (("sample", 1), ("seed", 0)):
        text = getattr(args, name)
        if text is not None and not (text.isdecimal() and low <= int(text) <= 10**9):
            wrong.append((f"--{name}", f'"{text}" is not a whole number; {low} to 1000000000'))
        numbers[name] = int(text) if text is not None and text.isdecimal() else None
    if args.seed is not None and args.sample is None:
        wrong.append(("--seed", "for --sample; give that too"))
    for text in args.vary:
        try:
            found = axis(text, scene, data, args.sample is not None)
        except ValueError as error:
            wrong.append(("--vary", str(error)))
            continue
        if any(found.where == other.where for other in axes):
            wrong.append(("--vary", f"{found.path}: it varies twice; give it once"))
        option = found.where[-1] if found.where[0] in ("seconds", "accuracy") else None
        if option is not None and getattr(args, str(option), None) is not None:
            wrong.append(("--vary", f"{found.path}: --{option} is given too; give one of them"))
        axes.append(found)
    count = numbers["sample"] or math.prod(one.count or len(one.ends) for one in axes)
    if count > MOST:
        wrong.append(("--vary", f"{count} points; at most {MOST}, such as --sample 1000 of them"))
    if wrong:
        return Plan(args.patch, data, axes, []), wrong
    wrong = impossible(data, args.patch, axes)
    chosen = sampled(axes, count, numbers["seed"] or 0) if numbers["sample"] else points(axes)
    return Plan(args.patch, data, axes, chosen), wrong


def impossible(data: dict[str, Any], patch: str, axes: list[Axis]) -> Wrong:
    """What is wrong with the patch at the ends of each axis, the others being at their first."""
    found: dict[tuple[str, str], None] = {}
    named = {"".join(f"[{p}]" if isinstance(p, int) else f".{p}" for p in a.where).lstrip("."): a for a in axes}
    for n, one in enumerate(axes):
        for share, end in enumerate(one.ends):
            value = one.at(float(share)) if one.ranged else end
            point = tuple(value if k == n else a.at(0.0) for k, a in enumerate(axes))
            try:
                varied(data, patch, axes, point)
            except PatchError as error:
                for fault in error.faults:
                    own = named.get(fault.path)
                    if own is None:
                        found["--vary", f"{one.path} = {value}: {fault.path}: {fault.what}"] = None
                    else:
                        found["--vary", f"{own.path}: {fault.what}"] = None
    return list(found)


def folder_of(args: argparse.Namespace) -> Path:
    """The folder to write to."""
    return Path(args.output or Path(args.patch).stem)


def unsuitable(args: argparse.Namespace) -> Wrong:
    """What is wrong with where the variations are to be written, and rendered."""
    folder, wrong = folder_of(args), unheard(Path("a.wav"), args.subtype, "--subtype")
    within = folder if folder.is_dir() else absolute(folder).parent
    if folder.exists() and not folder.is_dir():
        wrong.append(("--output", f"{folder} is a file; --vary writes a folder, give the name of one"))
    elif not within.is_dir():
        wrong.append(("--output", f"no such folder: {within}; make it, or write elsewhere"))
    elif not os.access(within, os.W_OK):
        wrong.append(("--output", f"{within} cannot be written to; write elsewhere"))
    elif folder.is_dir() and any(folder.glob("[!.]*")) and not (folder / "index.csv").exists():
        wrong.append(("--output", f"{folder} holds other things; give a folder that is empty, or not there yet"))
    elif what := foreign(folder / "index.csv", [text.partition("=")[0].strip() for text in args.vary]):
        wrong.append(("--output", what))
    if args.cluster is not None and find_spec("distributed") is None:
        wrong.append(("--cluster", "needs distributed; uv sync --extra cluster, or pip install distributed"))
    if args.cluster is not None and args.cores is not None:
        wrong.append(("--cores", "not for --cluster; its workers have cores of their own"))
    return wrong
