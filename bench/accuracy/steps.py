"""How far shipped patches are from themselves with four times as many steps a sample: third octaves of the first 1.5 s.

Of many blows that depend on each other, a row of bounces or a rattle, each small error changes the next, so that sounds
with ever more steps stay apart: a second difference, between four and sixteen times as many, tells those.
"""

import itertools

import numpy as np

import engine
from bench.publish.report import ROOT, publish
from bench.recordings.measure import Frames, decibels, differences, mean_powers, root_mean_square

RATE = 44_100
SECONDS = 1.5
FRAMES = Frames(seconds=SECONDS)
TIMES = 4


def steps_of(scene: engine.Scene) -> int:
    """Steps that a sample of a patch has, or at least has where an error chooses them."""
    return engine.render(scene, 0.01, RATE).stats.accuracy["substeps"]


def compare_sounds(sound: np.ndarray, finer: np.ndarray) -> tuple[float, float]:
    """RMS differences of third octaves of two sounds, dB, at the best gain, without what is 60 dB below the loudest: in
    frames of 50 ms; and of the powers of all frames together. Sounds: [frames, channels]"""
    powers = [mean_powers(audio, RATE, FRAMES) for audio in (sound, finer)]
    whole = [power.sum(axis=0, keepdims=True) for power in powers]
    both = (differences(*(decibels(p + 1e-30) for p in pair)) for pair in (powers, whole))
    apart, together = (root_mean_square(off[counted]) for off, counted in both)
    return apart, together


def compare_steps(patch: str) -> tuple[int, list[tuple[float, float]]]:
    """The steps of a patch; and differences of its own sound between these and four times as many, and between four and
    sixteen times as many: what no number of steps mends."""
    scene = engine.load(ROOT / "patches" / f"{patch}.toml")
    steps = steps_of(scene)
    sounds = [engine.render(scene, SECONDS, RATE, substeps=steps * TIMES**n).audio for n in range(3)]
    return steps, [compare_sounds(*pair) for pair in itertools.pairwise(sounds)]


def shipped_patches() -> list[str]:
    """Names of all shipped patches."""
    return sorted(path.stem for path in (ROOT / "patches").glob("*.toml"))


def run() -> None:
    """Measure and publish."""
    rows = []
    for patch in shipped_patches():
        steps, found = compare_steps(patch)
        rows.append([patch, f"{steps}", *(f"{difference:.1f}" for pair in found for difference in pair)])
        print(*rows[-1], sep=" | ", flush=True)
    head = [
        text for n in (1, TIMES) for text in (f"{n} against {n * TIMES} times as many, dB", "all frames together, dB")
    ]
    publish("steps", ["patch", "steps a sample", *head], rows)
