"""Time two versions of the engine in turn, on the general kernel: `uv run python -m bench pairs OLD [NEW]`.

OLD and NEW are revisions; NEW is the working tree if none is given. Both render the shipped patches of OLD. Either
kernel is compiled on this machine from the sources of its version, and kept for the next comparison; machine code that
is shipped with a version is not used.

The two take turns on one core. In each turn a patch is built anew, for its time depends on where its arrays lie, and is
rendered several times. A time is the processor time of a block of about a millisecond, the least of all renders, and
the times of all blocks are added: other work on the machine counts for little, and meets both. Beside the times are the
energy errors and the numbers of solves that were ended early. Changes of the tables in a score are left out.

The last line has the geometric mean of the ratios. A version against itself: 0.99 to 1.01, and single patches 0.93 to
1.08.

`… bench pairs OLD --guard` is the check of a pull request: three patches in less than a minute, by the machine code
that either version ships for its own sources, with a warning where the mean is over 1.15.
"""

import argparse
import json
import math
import os
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

import engine
from bench.publish.report import ROOT
from bench.publish.revisions import checked_out

WORKER = Path(__file__).with_name("block_times.py")
BLOCK_NS = 1e6  # that a block takes, about
FRAMES = 64, 8192  # in a block, at least and at most
TRIAL_FRAMES = 1024  # in a block of the first turn
RATE = 44_100
TIMED = "engine", "patches"  # folders of the working tree that are compared
MACHINE_CODE = "*.zip", "*.tar.xz"  # in engine/shipped: those of earlier versions, and of this one
GUARDED = "piano_c4", "guitar_frets", "tanpura"  # a soft blow, stiff frets, many points
WARNED, GUARD_SECONDS, GUARD_TURNS = 1.15, 0.5, 6


class Version:
    """The engine in a folder, at work in a process of its own."""

    def __init__(self, tree: Path) -> None:
        self.tree = tree
        environment = {**os.environ, "PYTHONPATH": str(tree), "FDH_KERNEL": "general", "FDH_BACKGROUND": "off"}
        pipe = subprocess.PIPE
        self._process = subprocess.Popen(
            [sys.executable, str(WORKER)], cwd=tree, env=environment, stdin=pipe, stdout=pipe, text=True
        )

    def ask(self, **request: Any) -> Any:
        """Return the reply to a request. Raises ChildProcessError if the process has ended; it has printed why."""
        assert self._process.stdin and self._process.stdout
        try:
            print(json.dumps(request), file=self._process.stdin, flush=True)
            return json.loads(self._process.stdout.readline())
        except (BrokenPipeError, json.JSONDecodeError):
            raise ChildProcessError(f"the {self.tree.name} version has ended") from None

    def end(self) -> None:
        """End the process."""
        self._process.kill()
        self._process.communicate()


class Times(NamedTuple):
    """A version at a scene."""

    ns: float  # per sample
    error: float  # of the energy balance
    capped: int  # solves that were ended early


@contextmanager
def copies_of(revisions: list[str], with_machine_code: bool) -> Iterator[list[Path]]:
    """Folders with copies of two revisions, or of one and the working tree. Raises CalledProcessError."""
    ignored = shutil.ignore_patterns("__pycache__", *(() if with_machine_code else MACHINE_CODE))
    with checked_out(revisions) as trees, tempfile.TemporaryDirectory() as folder:
        copies = []
        for tree, age in zip([*trees, ROOT][:2], ("old", "new"), strict=True):
            copies.append(Path(folder) / age)
            for part in TIMED:
                shutil.copytree(tree / part, copies[-1] / part, ignore=ignored)
        yield copies


def documents(folder: Path, only: list[str], count: int | None) -> dict[str, dict[str, Any]]:
    """The patches in a folder by name, or those named, or `count` of them, spread over all. Raises OSError,
    ValueError."""
    names = only or sorted(path.stem for path in folder.glob("*.toml"))
    if count is not None and count < len(names):
        names = [names[n * len(names) // count] for n in range(count)]
    scenes = {name: engine.load(folder / f"{name}.toml") for name in names}
    return {name: scene.model_dump(mode="json", exclude_unset=True) for name, scene in scenes.items()}


def frames_of_block(ns: float) -> int:
    """Frames in a block of about a millisecond, a power of two; ns: per sample."""
    return int(np.clip(2 ** round(math.log2(BLOCK_NS / ns)), *FRAMES))


def measure(versions: list[Version], document: dict[str, Any], seconds: float, turns: int) -> list[Times] | str:
    """Let two versions render a scene in turn. Return their times, or why one refuses the scene."""
    samples, frames = round(seconds * RATE), TRIAL_FRAMES
    least: list[Any] = [np.inf, np.inf]
    replies: list[Any] = [None, None]
    for turn in range(-1, turns):
        for n in (0, 1) if turn % 2 == 0 else (1, 0):
            replies[n] = versions[n].ask(document=document, seconds=seconds, frames=frames)
            if "refused" in replies[n]:
                return f"refused by the {versions[n].tree.name} version: {replies[n]['refused']}"
            if turn >= 0:
                least[n] = np.minimum(least[n], replies[n]["times"])
        if turn < 0:  # the first turn finds the size of blocks
            frames = frames_of_block(sum(replies[0]["times"]) / samples * 1e9)
    both = zip(least, replies, strict=True)
    return [Times(times.sum() / samples * 1e9, reply["error"], reply["capped"]) for times, reply in both]


def row(name: str, old: Times, new: Times) -> str:
    """A line of the table."""
    errors, capped = f"{old.error:.0e} → {new.error:.0e}", f"{old.capped} → {new.capped}"
    return f"{name:<22} {old.ns:9.1f} {new.ns:9.1f} {new.ns / old.ns:10.3f}   {errors:<15}   {capped}"


def mean_ratio(found: list[list[Times]]) -> float:
    """The geometric mean of the ratios."""
    return math.exp(sum(math.log(new.ns / old.ns) for old, new in found) / len(found))


def summary(found: list[list[Times]]) -> str:
    """The geometric mean of the ratios, in words."""
    return f"new / old, geometric mean of {len(found)}: {mean_ratio(found):.3f}"


def warning(found: list[list[Times]]) -> str:
    """A warning where a version is slower than noise explains, in the form that a workflow shows; or nothing."""
    if mean_ratio(found) <= WARNED:
        return ""
    begin = "::warning::" if os.environ.get("GITHUB_ACTIONS") else "warning: "
    remedy = "python -m bench pairs OLD has all patches"
    return f"{begin}this version takes {mean_ratio(found):.2f} of the time of the old one; {remedy}"


def options() -> argparse.ArgumentParser:
    """What the command line may say."""
    parser = argparse.ArgumentParser("bench pairs", description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("revisions", nargs="+", metavar="REVISION", help="OLD, or OLD and NEW")
    parser.add_argument("--only", metavar="PATCH,…", default="", help="these patches alone")
    parser.add_argument("--patches", type=int, metavar="N", help="so many patches, spread over all")
    parser.add_argument("--seconds", type=float, default=1.0, help="of each patch, from its beginning (default: 1)")
    parser.add_argument("--guard", action="store_true", help="three patches by shipped machine code, and a warning")
    parser.add_argument("--turns", type=int, default=12, help="of each version at each patch (default: 12)")
    return parser


def main(words: list[str]) -> int:
    """Print the ratios and their mean; 2 if a version cannot be run."""
    told = options().parse_args(words)
    if len(told.revisions) > 2:
        options().error("give OLD, or OLD and NEW")
    versions: list[Version] = []
    found = []
    only = [name for name in told.only.split(",") if name]
    if told.guard:
        only, told.seconds, told.turns = only or list(GUARDED), GUARD_SECONDS, GUARD_TURNS
    try:
        with copies_of(told.revisions, told.guard) as trees:
            scenes = documents(trees[0] / "patches", only, told.patches)
            versions = [Version(tree) for tree in trees]
            print(f"{'patch':<22} {'old ns':>9} {'new ns':>9} {'new / old':>10}   {'energy error':<15}   capped")
            for name, document in scenes.items():
                times = measure(versions, document, told.seconds, told.turns)
                if isinstance(times, str):
                    print(f"{name:<22} {times}", flush=True)
                else:
                    found.append(times)
                    print(row(name, *times), flush=True)
    except (subprocess.CalledProcessError, OSError, ValueError) as error:
        print(f"bench pairs: {error} {(getattr(error, 'stderr', '') or '').strip()}", file=sys.stderr)
        return 2
    finally:
        for version in versions:
            version.end()
    if found:
        print(summary(found))
    if found and told.guard and (said := warning(found)):
        print(said)
    return 0
