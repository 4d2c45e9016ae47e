"""The error that remains at many steps per sample, where modes decay: at orders 4 and 6 they lose at the ends of a
sample alone."""

import math

import numpy as np

from bench.publish.report import publish
from bench.ruler.problems import SAMPLERATE, ruler_scene
from engine.analysis.metrics import relative_rms_error
from engine.assembly.build import build
from engine.offline.simulation import Simulation
from engine.problems import load_problem

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
SETTINGS = [(4, 1), (4, FINEST), (2, 1), (2, FINEST), (2, 1024)]  # order, substeps


def run() -> None:
    """Measure the errors of all scenes, and publish them."""
    header = ["scene", *(f"order {order}, {substeps} ×" for order, substeps in SETTINGS)]
    rows = [
        [f"{title} (`{name}`)", *(f"{motion_error(name, order, substeps):.0e}" for order, substeps in SETTINGS)]
        for name, title in SCENES.items()
    ]
    publish("loss", header, rows)


def motion_error(name: str, order: int, substeps: int) -> float:
    """The error of the motion of a problem of the ruler; substeps may be more than a patch may have."""
    scene, (problem, reference) = ruler_scene(name), load_problem(name)
    accuracy = scene.accuracy.replace(order=order, silence=-math.inf, iterations=200)
    model, state, _ = build(scene, SAMPLERATE, accuracy.model_copy(update={"substeps": substeps}))
    audio = np.zeros((problem.frames + 1, 1))
    Simulation(model, state, kernel="general").render_block(audio)
    return relative_rms_error(audio[1:], reference.displacement[1:, None], reference.horizon)
