"""How long a user waits: for --help, for the first sound of each patch, and when it is compiled already; how long
before a sound, in a program that runs; and how many kernels the patches need."""

import math
import os
import resource
import subprocess
import sys
import tempfile
import time
import timeit
from collections.abc import Callable
from typing import NamedTuple

import numpy as np

import engine
from bench.publish.report import ROOT, pin, publish
from engine.analysis.profile import kernel_id
from engine.assembly.build import build
from engine.live.key_allocator import KeyAllocator, live_scene
from engine.live.midi_notes import Note
from engine.live.player import Player

NAMES = "repelled_oscillator", "tanpura"
SPECIAL = ["--kernel", "special"]
WITH_SPECIAL = "barrier_linear", "piano_c4", "guitar_frets", "tanpura", "snare_wires", "toms"


class Cost(NamedTuple):
    """What a process took, s."""

    wall: float
    cpu: float


def cost_of(words: list[str], cache: str, environment: dict[str, str]) -> Cost:
    """One run of a program."""
    with tempfile.TemporaryDirectory() as folder:
        begin, before = time.perf_counter(), resource.getrusage(resource.RUSAGE_CHILDREN)
        told = {**os.environ, "NUMBA_CACHE_DIR": cache, **environment}
        subprocess.run(words, cwd=folder, env=told, capture_output=True, check=True)
        after = resource.getrusage(resource.RUSAGE_CHILDREN)
        cpu = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
        return Cost(time.perf_counter() - begin, cpu)


def least(words: list[str], cache: str, runs: int = 5, **environment: str) -> Cost:
    """The least of several runs."""
    costs = [cost_of(words, cache, environment) for _ in range(runs)]
    return Cost(min(cost.wall for cost in costs), min(cost.cpu for cost in costs))


def command(*words: str) -> list[str]:
    """The words of a command of the engine."""
    return [sys.executable, str(ROOT / "render.py"), *words]


def run() -> None:
    """Measure and publish."""
    commands()
    kernels()
    before_sound()


def commands() -> None:
    """Whole commands: the very first, which finds no kernel on the machine, and those after it."""
    rows = []

    def add(what: str, cost: Cost) -> None:
        rows.append([what, f"{cost.wall:.2f}", f"{cost.cpu:.2f}", f"{cost.cpu / numba.cpu:.2f}"])

    with tempfile.TemporaryDirectory() as empty, tempfile.TemporaryDirectory() as cache:
        numba = least([sys.executable, "-c", "import numba"], cache)
        add('`python -c "import numba"`, for comparison', numba)
        add("`--help`", least(command("--help"), cache))
        for name in NAMES:
            render = command(str(ROOT / "patches" / f"{name}.toml"), "--seconds", "1")
            add(f"1 s of {name}, the very first time: general kernel, shipped", least(render, empty))
            add(f"1 s of {name}, special kernel, compiled first", least([*render, *SPECIAL], cache, 1))
            add(f"1 s of {name}, special kernel, compiled before", least([*render, *SPECIAL], cache))
    publish("start", ["from command to finished file", "s", "CPU, s", "CPU / importing Numba"], rows)


def before_sound() -> None:
    """What a program that runs, with its kernels compiled, computes before a sound: the least of several times."""
    short, piano = engine.load("piano_c4"), live_scene(engine.load("piano"))
    pin()

    def seconds(do: Callable[[], object], runs: int) -> float:
        return min(timeit.repeat(do, number=1, repeat=runs))

    def play_piano() -> KeyAllocator:
        keys = KeyAllocator(Player(piano, 44_100, math.inf, waiting=True))
        keys.player.render_into(np.zeros((128, keys.player.channels), np.float32))
        return keys

    def bend(keys: KeyAllocator, cents: float) -> float:
        keys.play(Note(0.0, "bend", 0, cents))
        return seconds(lambda: (keys.poll(), keys.player.make_tables()), 1)

    bends = [[bend(keys, cents) for cents in (10.0, -150.0, 200.0)] for keys in [play_piano() for _ in range(3)]]
    rows = [
        ["0.1 s of piano_c4, rendered whole", seconds(lambda: engine.render(short, seconds=0.1, cores=1), 50)],
        ["player of the piano, with all strings", seconds(lambda: Player(piano, 44_100, math.inf, waiting=True), 5)],
        ["first move of its wheel: 226 strings are bent", min(first for first, *_ in bends)],
        ["another move", min(min(later) for _, *later in bends)],
    ]
    publish("before_sound", ["in a program that runs", "ms"], [[w, f"{1000 * s:.2f}"] for w, s in rows], "start")


def kernels() -> None:
    """Every shipped patch in turn on the general kernel, and some on their special ones too, from an empty cache, where
    these are compiled."""
    rows, seen, slowest = [], set[str](), 0.0
    with tempfile.TemporaryDirectory() as cache:
        paths = sorted((ROOT / "patches").glob("*.toml"))
        for path in paths:
            model, state, _ = build(engine.load(path), 44_100)
            seen.add(kernel_id(model, state))
            words = command(str(path), "--seconds", "0.01")
            general = least(words, cache, 1)
            slowest = max(slowest, general.wall)
            if path.stem in WITH_SPECIAL:
                costs = [general, *(least([*words, *SPECIAL], cache, 1) for _ in range(2))]
                rows.append([path.stem, *(f"{cost.wall:.2f}" for cost in costs)])
    rows.append([f"slowest of all {len(paths)} patches, which have {len(seen)} kernels", f"{slowest:.2f}", "", ""])
    times = ["general kernel, s", "special kernel, first run, s", "special kernel, second run, s"]
    publish("kernels", ["patch", *times], rows, "start")
