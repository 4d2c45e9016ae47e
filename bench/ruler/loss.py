"""The error at many steps per sample, where modes decay, and the time of the finest."""

import math
import time

import numpy as np

from bench.publish.report import publish
from bench.ruler.contact_ruler import load_problem
from bench.ruler.problems import SAMPLERATE, ruler_scene
from engine.analysis.metrics import relative_rms_error
from engine.assembly.build import build
from engine.offline.simulation import Simulation
from engine.patch.accuracy import MAX_SUBSTEPS

SCENES = {
    "joined": "two joined bodies without loss",
    "hammer_c2": "a hammer on a bass string",
    "hammer_c4": "a hammer on a string of C4",
    "drum": "a ball on a drum",
    "frets": "a string on frets",
    "snare": "wires on a drum",
    "tanpura": "a string on a curved bridge",
}
FINEST = 64  # steps per sample
SETTINGS = [(4, 1), (4, FINEST), (4, 1024), (2, 1), (2, FINEST), (2, 1024), (2, MAX_SUBSTEPS)]  # order, substeps


def run() -> None:
    """Measure the errors of all scenes, and publish them."""
    header = ["scene", *(f"order {order}, {substeps} ×" for order, substeps in SETTINGS), "its ns per sample"]
    rows = []
    for name, title in SCENES.items():
        errors = [f"{motion_error(name, order, substeps):.0e}" for order, substeps in SETTINGS[:-1]]
        begin, finest = time.perf_counter(), motion_error(name, *SETTINGS[-1])
        elapsed = time.perf_counter() - begin
        frames = load_problem(name)[0].frames
        rows.append([f"{title} (`{name}`)", *errors, f"{finest:.0e}", f"{elapsed / frames * 1e9:.1e}"])
    publish("loss", header, rows)


def motion_error(name: str, order: int, substeps: int) -> float:
    """The error of the motion of a problem of the ruler."""
    scene, (problem, reference) = ruler_scene(name), load_problem(name)
    accuracy = scene.accuracy.replace(order=order, substeps=substeps, silence=-math.inf, iterations=200)
    model, state, _ = build(scene, SAMPLERATE, accuracy)
    audio = np.zeros((problem.frames + 1, 1))
    Simulation(model, state, kernel="general").render_block(audio)
    return relative_rms_error(audio[1:], reference.displacement[1:, None], reference.horizon)
