"""What each trick of the compiler buys (engine.compiler.tricks): time to compile, and time of a sample, without it."""

import os
import subprocess
import sys
import tempfile

from bench.publish.report import ROOT, pin, publish
from engine.compiler.tricks import Trick

PATCHES = "repelled_oscillator", "piano_c4", "guitar_frets"
MEASURE = """
import sys, time
import numba, numpy, engine
from engine.assembly.build import build
from engine.offline.simulation import Simulation
scene = engine.load(sys.argv[1])
model, state, _ = build(scene, 44_100, scene.accuracy, 1.0)
out = numpy.zeros((4096, scene.channels))
begin = time.process_time()
Simulation(model, state, kernel="special").render_block(out[:0])
compiled = time.process_time() - begin
best = float("inf")
for _ in range(25):
    model, state, _ = build(scene, 44_100, scene.accuracy, 1.0)
    simulation = Simulation(model, state, measure_energy=False, kernel="special")
    simulation.render_block(out[:64])
    begin = time.perf_counter()
    simulation.render_block(out)
    best = min(best, time.perf_counter() - begin)
print(compiled, best / len(out) * 1e9)
"""


def measure(patch: str, plain: str) -> tuple[float, float]:
    """Seconds of processor time to compile the kernel of a patch, and ns per sample."""
    with tempfile.TemporaryDirectory() as cache:
        environment = {**os.environ, "FDH_PLAIN": plain, "NUMBA_CACHE_DIR": cache}
        command = [sys.executable, "-c", MEASURE, patch]
        done = subprocess.run(command, cwd=ROOT, env=environment, capture_output=True, text=True, check=True)
    compiled, sample = done.stdout.split()
    return float(compiled), float(sample)


def run() -> None:
    """Measure and publish."""
    pin()
    rows = []
    for name in ("", *Trick, "all"):
        label = {"": "all in use", "all": "none in use"}.get(name, f"without `{name}`")
        found = [measure(patch, name) for patch in PATCHES]
        rows.append([label, *(f"{seconds:.1f}" for seconds, _ in found), *(f"{ns:.0f}" for _, ns in found)])
    header = ["", *(f"{patch}: compiled in, s" for patch in PATCHES), *(f"{patch}, ns/sample" for patch in PATCHES)]
    publish("tricks", header, rows)
