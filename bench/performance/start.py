"""How long a user waits: for --help, for the first sound of each patch, and when it is compiled already; and how
many kernels the patches need."""

import os
import subprocess
import sys
import tempfile
import time

import engine
from bench.publish.report import ROOT, publish
from engine.analysis.profile import kernel_id
from engine.build.build import build

NAMES = "repelled_oscillator", "tanpura"


def seconds(words: list[str], cache: str) -> float:
    """Wall time of one run of render.py."""
    with tempfile.TemporaryDirectory() as folder:
        begin = time.perf_counter()
        subprocess.run(
            [sys.executable, str(ROOT / "render.py"), *words],
            cwd=folder,
            env={**os.environ, "NUMBA_CACHE_DIR": cache},
            capture_output=True,
            check=True,
        )
        return time.perf_counter() - begin


def run() -> None:
    """Measure and publish."""
    commands()
    kernels()


def commands() -> None:
    """Whole commands, from a cold cache and a warm one."""
    rows = []
    with tempfile.TemporaryDirectory() as cache:
        rows.append(["`--help`", f"{min(seconds(['--help'], cache) for _ in range(5)):.2f}"])
        for name in NAMES:
            render = [str(ROOT / "patches" / f"{name}.toml"), "--seconds", "1"]
            rows.append([f"1 s of {name}, the very first time (compiles)", f"{seconds(render, cache):.1f}"])
            rows.append([f"1 s of {name}, compiled before", f"{min(seconds(render, cache) for _ in range(5)):.1f}"])
    publish("start", ["from command to finished file", "s"], rows)


def kernels() -> None:
    """Every shipped patch in turn, from an empty cache: where the kernel is there already, nothing is compiled."""
    rows, seen = [], set()
    with tempfile.TemporaryDirectory() as cache:
        for path in sorted((ROOT / "patches").glob("*.toml")):
            model, state, _ = build(engine.load(path), 44_100)
            name = kernel_id(model, state)
            words = [str(path), "--seconds", "0.01"]
            first = seconds(words, cache)
            again = seconds(words, cache)
            rows.append([path.stem, name, "new" if name not in seen else "there", f"{first:.1f}", f"{again:.1f}"])
            seen.add(name)
    slowest = [max(float(row[column]) for row in rows) for column in (3, 4)]
    rows.append([f"{len(rows)} patches", f"{len(seen)} kernels", "slowest", *(f"{s:.1f}" for s in slowest)])
    publish("kernels", ["patch", "kernel", "", "first start, s", "again, s"], rows, "start")
