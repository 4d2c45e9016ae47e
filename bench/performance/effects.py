"""What each effect costs: absent, there with no strength, and at work; and what sleeping islands cost."""

import json
import os
import subprocess
import sys
import tempfile
from pathlib import Path

import numpy as np

import engine
from bench.performance.stripped import strip
from bench.performance.turns import RATE, Replay, time_in_turn
from bench.publish.report import ROOT, figure, pin, publish
from bench.scenes.families import EFFECTS, NOTHING, with_effects

FRAMES = 8_192


def each() -> None:
    """Each effect alone, and all together."""
    rows, bars, base = [], [], Replay(with_effects({}), FRAMES / RATE)
    for name in (*EFFECTS, "all"):
        names = EFFECTS if name == "all" else ("contact", name) if name == "contact loss" else (name,)
        scenes = (with_effects(dict.fromkeys(names, strength)) for strength in (NOTHING, 1.0))
        times = time_in_turn(base, *(Replay(scene, FRAMES / RATE) for scene in scenes))
        rows.append([name, *(taken.nanoseconds for taken in times)])
        bars.append((name, *(taken.median * 1e9 for taken in times)))
    publish("effects", ["effect, ns per sample", "absent", "present with zero strength", "active"], rows)
    with figure("effects", 9.0, 4.0) as axes:
        place = np.arange(len(bars))
        for shift, n, label in ((-0.27, 1, "absent"), (0.0, 2, "present with zero strength"), (0.27, 3, "active")):
            axes.bar(place + shift, [bar[n] for bar in bars], 0.26, label=label)
        axes.set_xticks(place, [bar[0] for bar in bars])
        axes.set(ylabel="ns per sample", title="A string of 12 modes, a hammer and a reed: what each effect adds")
        axes.legend()


def pruned() -> None:
    """The kernel without an effect against one in whose source the effects were never written."""
    instructions, ns = {}, {}
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        strip(ROOT, folder)
        for where in (ROOT, folder) * 8:  # in turn, so that a slow phase of the machine meets both
            path = f"{where}{os.pathsep}{ROOT}"
            environment = {**os.environ, "NUMBA_CACHE_DIR": str(folder / f"cache_{where.name}"), "PYTHONPATH": path}
            command = [sys.executable, "-m", "bench.performance.stripped", str(where)]
            done = subprocess.run(command, cwd=where, env=environment, capture_output=True, check=True)
            found = json.loads(done.stdout)
            instructions.setdefault(where, found["instructions"])
            ns[where] = min(ns.get(where, np.inf), found["ns"])
        ours, theirs, fast, faster = instructions[ROOT], instructions[folder], ns[ROOT], ns[folder]
    rows = [
        ["absent effects removed by type", str(ours), f"{fast:.2f}"],
        ["source without these effects", str(theirs), f"{faster:.2f}"],
        ["ratio", f"{ours / theirs:.3f}", f"{fast / faster:.3f}"],
    ]
    publish("stripped", ["24 free modes", "instructions", "ns per sample"], rows, "effects")


def awake(count: int, islands: int = 64) -> engine.Scene:
    """Islands of a string of 40 modes and a hammer each, all asleep; in `count` of them it strikes at 0.19 s."""
    parts: dict[str, list] = {"body": [], "contact": [], "pickup": [], "event": []}
    for i in range(islands):
        material = {"length": 0.62, "mass": 4e-3, "tension": 670.0, "modes": 40, "sigma0": 0.5}
        parts["body"].append({"name": f"string{i}", "kind": "string"} | material)
        parts["body"].append({"name": f"hammer{i}", "kind": "mass", "mass": 3e-3, "displacement": -1e-3})
        felt = {"stiffness": 4e9, "exponent": 2.5}
        parts["contact"].append({"body": f"hammer{i}", "on": f"string{i}", "on_at": 0.12} | felt)
        parts["pickup"].append({"body": f"string{i}", "at": 0.4})
        strike = {"kind": "strike", "time": 0.19 if i < count else 99.0, "velocity": 3.0}
        parts["event"].append(strike | {"body": f"hammer{i}"})
    return engine.Scene.model_validate(parts | {"seconds": 100.0})


def culling() -> None:
    """Cost against the number of islands awake, and of a tail in which all has died."""
    turn, silence = FRAMES / RATE, -120.0
    counts = (0, 1, 8, 32, 64)
    times = time_in_turn(*(Replay(awake(n), turn, turn, silence=silence) for n in counts))
    rows = [
        [f"{n} of 64 subsystems active", taken.nanoseconds, f"{taken.median / times[-1].median:.3f}"]
        for n, taken in zip(counts, times, strict=True)
    ]
    tanpura = engine.load(ROOT / "patches" / "tanpura.toml")
    away = [c.model_copy(update={"bridge": c.bridge.model_copy(update={"height": -1.0})}) for c in tanpura.contact]
    free = tanpura.model_copy(update={"contact": away})
    scenes = {"tanpura string on its bridge": tanpura, "the same string, too far from the bridge to touch it": free}
    replays = [Replay(scene, turn, turn, silence=silence) for scene in scenes.values()]
    names = [*scenes, "the same string, after its sound has ended"]
    times = time_in_turn(*replays, Replay(tanpura, turn, 60.0, silence=silence))
    for name, taken in zip(names, times, strict=True):
        rows.append([name, taken.nanoseconds, f"{taken.median / times[0].median:.3g}"])
    publish("culling", ["scene", "ns per sample", "ratio"], rows, "effects")


def run() -> None:
    """Measure, publish and draw."""
    pin()
    each()
    pruned()
    culling()
