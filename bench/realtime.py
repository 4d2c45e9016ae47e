"""How fast each shipped patch runs on one core, once compiled, with its energy error beside it."""

import time

import numpy as np

import engine
from bench.report import ROOT, pin, publish
from engine.build import build
from engine.offline import newton
from engine.runner import Runner

RATE = 44_100
REPEATS = 3
LONGEST = 4.0  # s of each patch
FRAMES = 16_384


def measure(scene: engine.Scene, metered: bool) -> tuple[float, dict, dict]:
    """Seconds per sample (minimum of the repeats) over the patch's length, from 1 to 4 s; its energies and
    its Newton iterations."""
    best = np.inf
    out = np.zeros((FRAMES, max(p.channel for p in scene.pickup)))
    blocks = max(1, round(min(LONGEST, max(1.0, scene.seconds)) * RATE / FRAMES))
    for _ in range(REPEATS + 1):  # the first run compiles, and is not better than the best
        model, state, _ = build(scene, RATE)
        runner = Runner(model, state, metered=metered)
        begin = time.perf_counter()
        for _ in range(blocks):
            runner.block(out)
        best = min(best, (time.perf_counter() - begin) / (blocks * FRAMES))
    return best, runner.energies(), newton(model, state)


def run() -> None:
    """Measure and publish."""
    pin()
    rows = []
    for path in sorted((ROOT / "patches").glob("*.toml")):
        scene = engine.load(path)
        seconds, energies, iterations = measure(scene, True)
        bare, _, _ = measure(scene, False)
        rows.append(
            [
                path.stem,
                f"{1 / seconds / RATE:.0f}",
                f"{seconds * 1e9:.1f}",
                f"{bare * 1e9:.1f}",
                f"{energies['error_max']:.0e}",
                f"{iterations['mean']:.2f} / {iterations['max']}" if iterations["solves"] else "closed form",
            ]
        )
    header = ["patch", "× real time", "ns per sample", "without energy metering", "energy error", "Newton mean / max"]
    publish("realtime", header, rows)
