"""Time the building of shipped patches by two versions in turn: `uv run python -m bench builds OLD [--only NAME …]`.

OLD is a revision; the other is the working tree. A time is the processor time of reading a patch and making its tables,
on one thread, the least of several; what a version keeps of a patch is let go before each. The last lines have the
geometric means of the ratios, of patches without and with bodies whose modes are found by the Rayleigh-Ritz method.
"""

import argparse
import json
import math
import os
import subprocess
import sys
import tempfile
from pathlib import Path

from bench.publish.report import ROOT
from bench.publish.revisions import checked_out

ROUNDS = 2
RITZ = "guitar", "guitar_body", "kalimba", "kalimba_keys", "sitar", "snare", "sympathetic_strings", "tanpura_body"
WORKER = """
import functools, gc, json, sys, time
sys.path.insert(0, sys.argv[1])
import engine
from engine.assembly.build import build
assert engine.__file__.startswith(sys.argv[1])

def time_build(path):
    for kept in gc.get_objects():
        if isinstance(kept, functools._lru_cache_wrapper):
            kept.cache_clear()
    begin = time.process_time()
    build(engine.load(path), 44_100.0)
    return time.process_time() - begin

times = {}
for name in sys.argv[2:]:
    path = f"{sys.argv[1]}/patches/{name}.toml"
    first = time_build(path)
    times[name] = min(time_build(path) for _ in range(5 if first < 0.5 else 2))
print(json.dumps(times))
"""


def time_builds(tree: Path, names: list[str]) -> dict[str, float]:
    """Return the least time to build each patch of a tree, s."""
    environment = {**os.environ, "OPENBLAS_NUM_THREADS": "1"}
    environment.pop("PYTHONPATH", None)
    with tempfile.TemporaryDirectory() as elsewhere:
        command = [sys.executable, "-c", WORKER, str(tree), *names]
        done = subprocess.run(command, cwd=elsewhere, env=environment, capture_output=True, text=True, check=True)
    return dict(json.loads(done.stdout))


def geometric_mean(ratios: list[float]) -> float:
    return math.exp(sum(map(math.log, ratios)) / len(ratios))


def main(words: list[str]) -> int:
    """Print the times; return 0."""
    parser = argparse.ArgumentParser(prog="bench builds")
    parser.add_argument("old")
    parser.add_argument("--only", nargs="+", metavar="NAME")
    options = parser.parse_args(words)
    with checked_out([options.old]) as (old,):
        there = {path.stem for path in (old / "patches").glob("*.toml")}
        names = options.only or sorted(there & {path.stem for path in (ROOT / "patches").glob("*.toml")})
        rounds = [[time_builds(tree, names) for tree in (old, ROOT)] for _ in range(ROUNDS)]
    ratios: dict[bool, list[float]] = {False: [], True: []}
    for name in names:
        before, after = (min(times[side][name] for times in rounds) for side in (0, 1))
        ratios[name in RITZ].append(after / before)
        print(f"{name:<24}{1e3 * before:9.1f} ms{1e3 * after:9.1f} ms{after / before:7.2f}")
    for has_ritz, of_kind in ratios.items():
        if of_kind:
            print(f"{'with' if has_ritz else 'without'} Ritz bodies: {geometric_mean(of_kind):.2f}")
    return 0
