"""How long a user waits: for --help, for a rendered second with a warm cache, and the first time ever."""

import os
import subprocess
import sys
import tempfile
import time

from bench.report import ROOT, publish

PATCH = str(ROOT / "patches" / "repelled_oscillator.toml")


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
    rows = []
    render = [PATCH, "--seconds", "1"]
    with tempfile.TemporaryDirectory() as cache:
        rows.append(["`--help`", f"{min(seconds(['--help'], cache) for _ in range(5)):.2f}"])
        rows.append(["render 1 s, the very first time (compiles)", f"{seconds(render, cache):.2f}"])
        rows.append(["render 1 s, compiled before", f"{min(seconds(render, cache) for _ in range(5)):.2f}"])
    publish("start", ["from command to finished file", "s"], rows)
