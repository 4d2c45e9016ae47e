"""The engine's own scheme on the problems of the ruler."""

import time

import numpy as np

import engine
from bench.ruler.contact_ruler import Problem, Trajectory, load_problem
from bench.ruler.methods.common import not_applicable
from bench.ruler.problems import SAMPLERATE, ruler_scene
from engine.assembly.build import build
from engine.offline.simulation import Simulation

RUNS = 5
MAX_SECONDS = 2.0  # of all runs
EMPTY_CALLS = 20  # of which the fastest is what a call costs


def simulate_by_engine(name: str, kernel: str = "special", **accuracy: float) -> Trajectory:
    """The trajectory of a problem by the engine.

    kernel:   special, that of the problem, whose time is its own; or general, which need not be compiled
    accuracy: settings of Accuracy; friction has order 2 alone
    """
    scene = ruler_scene(name)
    if scene.friction and "max_error" in accuracy:
        accuracy["order"] = 2
    if scene.friction and accuracy.get("order", 2) > 2:
        return not_applicable(load_problem(name)[0])
    frames = round(scene.seconds * SAMPLERATE)
    settings = accuracy | {"silence": -np.inf, "iterations": 200}
    seconds = (frames + 1) / SAMPLERATE  # a rendering has the state before each step
    rendering = engine.render(scene, seconds, trace=True, cores=1, kernel=kernel, **settings)
    trace = rendering.trace
    return Trajectory(
        displacement=rendering.audio[:, 0],
        force=np.concatenate([trace["force"][1:], 0.0 - trace.get("friction", trace["force"][:, :0])[1:]], axis=1),
        energy=trace["kinetic"] + trace["potential"] + trace["contact"],
        seconds=time_engine(scene, settings, frames, kernel),
    )


def time_render(simulation: Simulation, audio: np.ndarray) -> float:
    """Return the processor time of a block, s, its memory being there."""
    simulation.memory(*audio.shape)
    begin = time.process_time()
    simulation.render_block(audio)
    return time.process_time() - begin


def time_engine(scene: engine.Scene, settings: dict, frames: int, kernel: str) -> float:
    """Return the processor time, s, that the engine takes for so many frames, the call apart."""
    best, total, out = np.inf, 0.0, np.zeros((frames, 1))
    for _ in range(RUNS):
        model, state, _ = build(scene, SAMPLERATE, scene.accuracy.replace(**settings))
        simulation = Simulation(model, state, 1, measure_energy=False, kernel=kernel)
        idle = min(time_render(simulation, out[:0]) for _ in range(EMPTY_CALLS))
        taken = time_render(simulation, out)
        best, total = min(best, taken - idle), total + taken
        if total > MAX_SECONDS:
            break
    return best


def simulate_oscillator_by_engine(problem: Problem, **accuracy: float) -> Trajectory:
    """The trajectory of an oscillator of 1 kg at a barrier (bench.ruler.stability). accuracy: settings of Accuracy"""
    body = {"name": "body", "kind": "oscillator", "mass": 1.0, "frequency": float(problem.omega[0]) / (2 * np.pi)}
    body |= {"displacement": float(problem.q[0]), "velocity": float(problem.p[0])}
    contact = {"body": "body", "barrier": float(problem.barrier[0]), "exponent": float(problem.exponent[0])}
    contact["stiffness"] = float(problem.stiffness[0])
    scene = engine.Scene.model_validate({"body": [body], "contact": [contact], "pickup": [{"body": "body"}]})
    seconds = (problem.frames + 1) / problem.samplerate
    trace = engine.render(scene, seconds, trace=True, silence=-np.inf, **accuracy).trace
    return Trajectory(trace["displacement"][:, 0], trace["force"][1:], trace["displacement"], trace["velocity"])
