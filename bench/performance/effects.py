"""What each effect costs: absent, there with no strength, and at work; and what sleeping islands cost."""

import json
import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np

import engine
from bench.performance.stripped import strip
from bench.publish.report import ROOT, figure, pin, publish
from bench.scenes.families import EFFECTS, NOTHING, with_effects
from engine.assembly.build import build
from engine.kernel.data.axes import arrays_of
from engine.offline.simulation import Simulation
from engine.patch.accuracy import Accuracy

RATE = 44_100
FRAMES = 8_192
REPEATS = 40


def cost(scene: engine.Scene, silence: float = -np.inf, frames: int = FRAMES, warm: int = 0) -> float:
    """ns per sample from time 0 on, or after `warm` samples; minimum of the repeats."""
    model, state, _ = build(scene, RATE, Accuracy(silence=silence))
    simulation = Simulation(model, state, measure_energy=False)
    out = np.zeros((frames, scene.channels))
    for _ in range(warm // frames):
        simulation.render_block(out)
    simulation.render_block(out[:64])
    saved = [(array, array.copy()) for array in arrays_of(state)]
    best = np.inf
    for _ in range(REPEATS):
        for array, copy in saved:
            array[...] = copy
        begin = time.perf_counter()
        simulation.render_block(out)
        best = min(best, time.perf_counter() - begin)
    return best / frames * 1e9


def each() -> None:
    """Each effect alone, and all together."""
    base = cost(with_effects({}))
    rows, bars = [], []
    for name in (*EFFECTS, "all"):
        names = EFFECTS if name == "all" else ("contact", name) if name == "contact loss" else (name,)
        idle, working = (cost(with_effects(dict.fromkeys(names, strength))) for strength in (NOTHING, 1.0))
        rows.append([name, f"{base:.1f}", f"{idle:.1f}", f"{working:.1f}"])
        bars.append((name, base, idle, working))
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
    rows = []
    costs = {n: cost(awake(n), silence=-120.0, warm=FRAMES) for n in (0, 1, 8, 32, 64)}
    for n, ns in costs.items():
        rows.append([f"{n} of 64 subsystems active", f"{ns:.0f}", f"{ns / costs[64]:.3f}"])
    tanpura = engine.load(ROOT / "patches" / "tanpura.toml")
    busy = cost(tanpura, silence=-120.0, warm=FRAMES)
    away = [c.model_copy(update={"bridge": c.bridge.model_copy(update={"height": -1.0})}) for c in tanpura.contact]
    free = cost(tanpura.model_copy(update={"contact": away}), silence=-120.0, warm=FRAMES)
    rows.append(["tanpura string on its bridge", f"{busy:.0f}", "1"])
    rows.append(["the same string, too far from the bridge to touch it", f"{free:.0f}", f"{free / busy:.3f}"])
    died = cost(tanpura, silence=-120.0, warm=60 * RATE)
    rows.append(["the same string, after its sound has ended", f"{died:.1f}", f"{died / busy:.4f}"])
    publish("culling", ["scene", "ns per sample", "ratio"], rows, "effects")


def run() -> None:
    """Measure, publish and draw."""
    pin()
    each()
    pruned()
    culling()
