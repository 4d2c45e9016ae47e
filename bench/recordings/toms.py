"""Toms beside recorded ones: by how much they fall in pitch after soft and hard blows."""

from collections.abc import Sequence
from functools import cache
from pathlib import Path
from typing import Any, NamedTuple

import soundfile

import engine
from bench.publish.report import figure, publish
from bench.recordings.glide import Glide, first_level, read_glide
from bench.recordings.note import Sound
from bench.recordings.plot import RECORDED, RENDERED
from engine.patch.note_scene import scene_of_note

RATE = 44_100  # Hz
SECONDS = 0.7  # of a rendered note
LAYERS = ("softest", "soft", "medium", "hard", "hardest")
VELOCITIES = (13, 38, 64, 89, 114)  # of MIDI: the middle of the fifth that ForzeeStereo plays each layer for
FORZEE, PEARL = range(5), ("Softest", "Soft", "Med", "Hard", "Hardest")
RECORDINGS = {  # names of files, softest first
    "recorded, ForzeeStereo, low": [f"TomLow-{layer}.wav" for layer in FORZEE],
    "recorded, Black Pearl, floor": [f"PearlTomFloor-{layer}.wav" for layer in PEARL],
    "recorded, Black Pearl, 2": [f"PearlTom2-{layer}.wav" for layer in PEARL],
    "recorded, ForzeeStereo, mid": [f"TomMid-{layer}.wav" for layer in FORZEE],
    "recorded, ForzeeStereo, high": [f"TomHigh-{layer}.wav" for layer in FORZEE],
}
KEYS = {"F2": "16 inches", "A2": "13 inches", "C3": "10 inches"}
COMPARED = "recorded, ForzeeStereo, mid", "A2"  # over time
HEADER = ["drum", "pitch, Hz", *(f"{layer}, cents" for layer in LAYERS), "hardest over softest, dB"]


class Drum(NamedTuple):
    """A drum, by blows from the softest to the hardest."""

    name: str
    glides: list[Glide]
    levels: list[float]  # dB below the hardest


def measure_drum(name: str, sounds: Sequence[Sound]) -> Drum:
    """Read pitch and level of its blows."""
    levels = [first_level(*sound) for sound in sounds]
    return Drum(name, [read_glide(*sound) for sound in sounds], [level - levels[-1] for level in levels])


def render_tom(key: str, velocity: int) -> Sound:
    """Sound of a key of the shipped toms."""
    scene = scene_of_note(load_toms(), key, velocity, hold=0.2, seconds=SECONDS)
    return engine.render(scene, SECONDS, RATE).audio, RATE


@cache
def load_toms() -> engine.Scene:
    """The shipped toms."""
    return engine.load("toms")


def missing_files(paths: dict[str, Path]) -> list[str]:
    """Names of recordings that are not there. paths: of sounds, by name"""
    return [name for names in RECORDINGS.values() for name in names if name not in paths]


def run(paths: dict[str, Path]) -> None:
    """Measure, print and write the table, and draw the figure. paths: of sounds, by name"""
    recorded = [
        measure_drum(name, [soundfile.read(paths[file], always_2d=True) for file in files])
        for name, files in RECORDINGS.items()
    ]
    rendered = [
        measure_drum(f"`toms`, {key}, {size}", [render_tom(key, v) for v in VELOCITIES]) for key, size in KEYS.items()
    ]
    rows = [
        [
            drum.name,
            f"{drum.glides[0].later():.0f}",
            *(f"{g.fall():.0f}" for g in drum.glides),
            f"{-drum.levels[0]:.0f}",
        ]
        for drum in (*recorded, *rendered)
    ]
    publish("recordings_toms", HEADER, rows, "recordings")
    with figure("recordings_toms", 10.0, 4.0, ncols=2) as axes:
        draw_by_level(axes[0], recorded, rendered)
        draw_over_time(axes[1], recorded, rendered)


def draw_by_level(axes: Any, recorded: list[Drum], rendered: list[Drum]) -> None:
    """Draw the fall over the level."""
    for drums, line, colour, label in ((recorded, "o:", RECORDED, "recorded"), (rendered, "o-", RENDERED, "rendered")):
        for number, drum in enumerate(drums):
            falls = [glide.fall() for glide in drum.glides]
            axes.plot(drum.levels, falls, line, color=colour, ms=4, label="" if number else label)
    axes.set(xlabel="level under the hardest blow, dB", ylabel="fall in 0.4 s, cents")
    axes.legend(fontsize="x-small")
    axes.grid(True, alpha=0.2)


def draw_over_time(axes: Any, recorded: list[Drum], rendered: list[Drum]) -> None:
    """Draw the pitch of two like drums, recorded and rendered."""
    shown = [(drum, RECORDED) for drum in recorded if drum.name == COMPARED[0]]
    shown += [(drum, RENDERED) for drum in rendered if f", {COMPARED[1]}," in drum.name]
    for drum, colour in shown:
        for number, glide in enumerate(drum.glides):
            label = "" if number else f"{drum.name.replace('`', '')}, five blows"
            axes.plot(glide.seconds, glide.cents(), color=colour, lw=0.8 + 0.3 * number, label=label)
    axes.set(xlabel="s after the onset", ylabel="above the pitch at 0.4 s, cents")
    axes.legend(fontsize="x-small")
    axes.grid(True, alpha=0.2)
