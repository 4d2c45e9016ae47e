"""The general kernel against the special one of each patch, which has the effects of that patch and no other.

`uv run python -m bench special [PATCH …]` renders patches with both in turn, and prints nanoseconds per sample, least
of several, their ratio, and whether the samples are the same. Each set of effects is compiled first, which takes half a
minute.
"""

import copy
import math
from typing import Any

import numpy as np

import engine
from bench.publish.report import ROOT, pin
from engine.assembly.build import BuildResult, build
from engine.offline.simulation import Simulation, time_block

SAMPLERATE, BLOCK, BLOCKS, ROUNDS, TURNS = 44_100, 441, 30, 4, 2
MANY_MODES = 10  # the ratio of scenes with more decides


def time_kernel(built: BuildResult, channels: int, kernel: str) -> tuple[float, Any]:
    """Return the time of a sample, ns: the sum of the least times of blocks; and the samples."""
    times = []
    for _ in range(ROUNDS):
        simulation = Simulation(built.model, copy.deepcopy(built.state), measure_energy=False, kernel=kernel)
        audio = np.zeros((BLOCKS, BLOCK, channels))
        times.append([time_block(simulation, block) for block in audio])
    return 1e9 * float(np.min(times, axis=0).sum()) / (BLOCKS * BLOCK), audio


def main(words: list[str]) -> int:
    """Print the table; returns the exit code, which is 1 if samples differ."""
    pin()
    names, ratios, are_same = words or sorted(path.stem for path in (ROOT / "patches").glob("*.toml")), {}, True
    print("| patch | modes | general, ns per sample | special | general/special | the same samples |")
    print("| --- | --- | --- | --- | --- | --- |")
    for name in names:
        scene = engine.load(name)
        built = build(scene, SAMPLERATE, seconds=BLOCKS * BLOCK / SAMPLERATE)
        least, sounds = dict.fromkeys(("general", "special"), math.inf), {}
        for kernel in [*least] * TURNS:
            time, sounds[kernel] = time_kernel(built, scene.channels, kernel)
            least[kernel] = min(least[kernel], time)
        ratio, is_same = least["general"] / least["special"], np.array_equal(sounds["general"], sounds["special"])
        modes = built.state.q.size
        ratios[name] = ratio if modes > MANY_MODES else 1.0
        are_same &= is_same
        cells = f"{least['general']:.0f} | {least['special']:.0f} | {ratio:.2f} | {'yes' if is_same else 'NO'}"
        print(f"| {name} | {modes} | {cells} |", flush=True)
    mean = math.exp(np.mean(np.log(list(ratios.values()))))
    print(f"\nof scenes of more than {MANY_MODES} modes: {mean:.3f} in the mean, {max(ratios.values()):.2f} at most")
    return 0 if are_same else 1
