"""What tests of variations and of sweeps share: axes and plans of a patch, and sweeps in this process."""

import csv
import math
import tomllib
from pathlib import Path

from conftest import ROOT

import engine
from engine.sound.form import SoundForm
from engine.sweep.axes import SweepAxis, parse_axis
from engine.sweep.plan import SweepPlan, grid_points
from engine.sweep.sweep import run_sweep
from engine.sweep.task import render_task

MARBLE = str(ROOT / "patches" / "marble_on_a_bell.toml")
SECONDS = 0.02  # of a sound, in which a marble close to the bell strikes it
STIFFNESS, MASS = "contact.glass.stiffness", "body.marble.mass"
GRID = {STIFFNESS: "1e8..1e10:log:3", MASS: [0.002, 0.004]}


def axis(text: str, patch: str = MARBLE, sampling: bool = False) -> SweepAxis:
    return parse_axis(text, engine.load(patch), tomllib.loads(Path(patch).read_text("utf-8")), sampling)


def plan(*texts: str, patch: str = MARBLE) -> SweepPlan:
    found = [axis(text, patch) for text in texts]
    return SweepPlan(patch, tomllib.loads(Path(patch).read_text("utf-8")), found, grid_points(found))


def rows(folder: Path) -> list[dict[str, str]]:
    with open(folder / "index.csv", newline="", encoding="utf-8") as file:
        return list(csv.DictReader(file))


class Alone:
    """Renders in this process, and keeps the numbers of what it was given; Ctrl-C comes after `most` answers."""

    def __init__(self, most: float = math.inf) -> None:
        self.given: list[int] = []
        self.most = most

    def __call__(self, tasks):
        for task in tasks:
            if len(self.given) == self.most:
                raise KeyboardInterrupt
            self.given.append(task.number)
            yield task.number, render_task(task)


def swept(folder: Path, *texts: str, most: float = math.inf, patch: str = MARBLE, gain=None, **options):
    """The outcome of a sweep, and the numbers of the points that were rendered."""
    alone = Alone(most)
    told = {"seconds": SECONDS, "samplerate": 44_100} | options
    return run_sweep(plan(*texts, patch=patch), folder, alone, told, SoundForm(gain=gain)), alone.given
