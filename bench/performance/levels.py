"""The kernels for each level of this machine's processors: times and samples.

`uv run python -m bench levels [PATCH …]` renders patches with each archive that this machine can run, in turn, and
prints nanoseconds per sample, least of several, their ratio to the best level's, and whether the samples are the same.
"""

import copy
import hashlib
import os
import subprocess
import sys
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

import engine
from engine.assembly.build import build
from engine.compiler import archive_trial
from engine.compiler.shipped import archive
from engine.compiler.targets import Target, fitting_targets
from engine.offline.simulation import Simulation, time_block

PATCHES = "piano_c4", "piano", "sympathetic_strings", "violin", "snare", "slack_bass", "tanpura", "guitar_frets"
SAMPLERATE, BLOCK, BLOCKS, ROUNDS = 44_100, 441, 50, 5
SECONDS = BLOCKS * BLOCK / SAMPLERATE


class Level(NamedTuple):
    """What a level does with a patch."""

    time: float  # ns per sample
    digest: str  # of the samples


def measure(patches: Sequence[str], target: Target) -> dict[str, Level]:
    """Render patches with the archive of a target, in a process of its own on one core."""
    code = "import sys; from bench.performance.levels import render_each; render_each(sys.argv[1:])"
    environment = os.environ | {archive_trial.TRIED: str(archive(target))}
    words = [sys.executable, "-c", code, *patches]
    ran = subprocess.run(words, env=environment, check=True, capture_output=True, text=True)
    lines = [line.split() for line in ran.stdout.splitlines()]
    return {name: Level(float(time), digest) for name, time, digest in lines}


def render_each(patches: Sequence[str]) -> None:
    """Print for each patch its time, the sum of the least times of its blocks, and the digest of its samples."""
    for name in patches:
        scene = engine.load(name)
        built, times = build(scene, SAMPLERATE, seconds=SECONDS), []
        for _ in range(ROUNDS):
            state = copy.deepcopy(built.state)
            simulation = Simulation(built.model, state, measure_energy=False, kernel="general")
            audio = np.zeros((BLOCKS, BLOCK, scene.channels))
            times.append([time_block(simulation, block) for block in audio])
        digest = hashlib.sha256(audio.tobytes()).hexdigest()[:16]
        print(name, 1e9 * np.min(times, axis=0).sum() / (BLOCKS * BLOCK), digest, flush=True)


def main(words: list[str]) -> int:
    """Print the table; returns the exit code, which is 1 if samples differ."""
    patches, targets = words or list(PATCHES), fitting_targets()
    levels = [dict[str, Level]() for _ in targets]
    for _ in range(2):
        for n, target in enumerate(targets):
            for name, level in measure(patches, target).items():
                known = levels[n].get(name, level)
                levels[n][name] = Level(min(level.time, known.time), level.digest)
    print(f"| patch | {' | '.join(target.name for target in targets)} | the same samples |")
    print(f"| --- |{' --- |' * (len(targets) + 1)}")
    are_same = True
    for name in patches:
        times = [level[name].time for level in levels]
        cells = [f"{time:.0f} ({time / times[0]:.2f})" for time in times]
        is_same = len({level[name].digest for level in levels}) == 1
        are_same &= is_same
        print(f"| {name} | {' | '.join(cells)} | {'yes' if is_same else 'NO'} |", flush=True)
    return 0 if are_same else 1
