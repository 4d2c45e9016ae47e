"""What to type for an error, and what it takes; steps chosen by error, beside the cheapest number of steps for the same
error; what one step of a sample misses."""

import math
import time
from typing import NamedTuple

import numpy as np

from bench.publish.report import figure, pin, publish
from bench.ruler.contact_ruler import NAMES, load_problem
from bench.ruler.problems import SAMPLERATE, ruler_scene
from engine.analysis.metrics import relative_rms_error
from engine.assembly.build import build
from engine.offline.simulation import Simulation
from engine.offline.trace import allocate_trace
from engine.patch.accuracy import MAX_SUBSTEPS, ORDER_4_ERROR
from engine.report.figures import BLUE, GREY, ORANGE

ERRORS = [1e-2, 1e-3, 1e-4, 1e-5]
ORDERS, STEPS = (2, 4), [2**k for k in range(10)]  # fixed ones; steps per sample
WANTED = [1e-2, 1e-3, 1e-4, 1e-6]  # errors that somebody may want
SAME_ERROR = 1.05  # times the other
SHORT = 0.5  # s: what takes less is timed again
REPEATS = 3
SHOWN = "tanpura"
FRAME = 1090  # the sample that is drawn: the string lies on the bridge
FINEST = 1024  # steps of it
NEAR = 5e-6  # m: how near a point that is drawn comes to the bridge
DRAWN_ERROR = 1e-3
MARKED = 64  # steps at most: more would hide the line
SAMPLE = 1e6 / SAMPLERATE  # µs


class Measured(NamedTuple):
    """Error and time of a problem at a setting."""

    setting: str
    error: float
    nanoseconds: float  # per sample


def run() -> None:
    """Measure all problems, and publish a table and a figure."""
    pin()
    rows, ratios, answers = [], list[float](), []
    for name in NAMES:
        orders = (2,) if ruler_scene(name).friction else ORDERS  # friction has no other
        settings = [(order, n) for order in orders for n in STEPS]
        fixed = [measure(name, f"order {order}, {n} ×", order=order, substeps=n) for order, n in settings]
        by_error = []
        for error in ERRORS:
            accuracy = settings_for_error(error)
            accuracy["order"] = min(accuracy["order"], orders[-1])
            chosen = measure(name, f"{error:.0e}, order {accuracy['order']}", **accuracy)
            by_error.append(chosen)
            row = [name, chosen.setting, f"{chosen.error:.0e}", f"{chosen.nanoseconds:.0f}"]
            within = [one for one in fixed if one.error <= SAME_ERROR * chosen.error]
            if within:
                cheapest = min(within, key=lambda one: one.nanoseconds)
                ratios.append(chosen.nanoseconds / cheapest.nanoseconds)
                row += [cheapest.setting, f"{cheapest.error:.0e}", f"{cheapest.nanoseconds:.0f}", f"{ratios[-1]:.2g}"]
            rows.append(row + [""] * (8 - len(row)))
        answers.append([f"`{name}`", *(answer(error, [*fixed, *by_error]) for error in WANTED)])
    publish("answers", ["problem", *(f"an error of {error:g}" for error in WANTED)], answers, "chosen")
    mean = math.exp(np.mean(np.log(ratios)))
    rows.append(["geometric mean", *[""] * 6, f"{mean:.2g}"])
    header = ["problem", "max_error", "error", "ns per sample", "cheapest fixed setting", "its error"]
    publish("chosen", [*header, "its ns per sample", "ratio of times"], rows)
    draw_sample()


def answer(error: float, measured: list[Measured]) -> str:
    """Return the options of the cheapest setting with at most an error, and what it takes."""
    within = [one for one in measured if one.error <= error]
    if not within:
        return "none of these"
    best = min(within, key=lambda one: one.nanoseconds)
    if best.setting.endswith("×"):
        order, steps = best.setting.removesuffix(" ×").split(", ")
        options = f"--{order} --substeps {steps}"
    else:
        largest, order = best.setting.split(", ")
        options = f"--{order} --max-error {largest} --max-substeps {MAX_SUBSTEPS}"
    factor = 1e9 / SAMPLERATE / best.nanoseconds
    speed = f"{factor:.0f}" if factor >= 10.0 else f"{factor:.2g}"
    return f"`{options}`: {best.nanoseconds:.0f} ns, {speed} × real time"


def settings_for_error(error: float) -> dict[str, float]:
    """Return the settings that --target-error chooses."""
    order = 4 if error <= ORDER_4_ERROR else 2
    return {"order": order, "max_error": error, "max_substeps": MAX_SUBSTEPS}


def measure(name: str, setting: str, **accuracy: float) -> Measured:
    """Measure error and time of a problem of the ruler, with the general kernel."""
    scene, (problem, reference) = ruler_scene(name), load_problem(name)
    used = scene.accuracy.replace(silence=-math.inf, iterations=200, **accuracy)
    audio, least = np.zeros((problem.frames + 1, 1)), math.inf
    for _ in range(REPEATS):
        model, state, _ = build(scene, SAMPLERATE, used)
        simulation = Simulation(model, state, measure_energy=False, kernel="general")
        simulation.render_block(audio[:0])
        begin = time.perf_counter()
        simulation.render_block(audio)
        elapsed = time.perf_counter() - begin
        least = min(least, elapsed)
        if elapsed > SHORT:
            break
    error = relative_rms_error(audio[1:], reference.displacement[1:, None], reference.horizon)
    return Measured(setting, error, least / problem.frames * 1e9)


def compressions_within_sample(name: str, frame: int, steps: int) -> np.ndarray:
    """Return the compressions [steps + 1, points] (m) within a sample, from the state that the finest steps lead to."""
    scene = ruler_scene(name)
    accuracy = scene.accuracy.replace(silence=-math.inf, iterations=200)
    fine = Simulation(*build(scene, SAMPLERATE, accuracy.replace(substeps=FINEST))[:2], kernel="general")
    fine.render_block(np.zeros((frame, 1)))
    model, state, _ = build(scene, steps * SAMPLERATE, accuracy)  # one step for each of its samples
    state.q[:], state.p[:] = fine.state.q, fine.state.p
    state.compression[:] = fine.state.compression
    trace = allocate_trace(model, steps + 1)
    Simulation(model, state, kernel="general").render_block(np.zeros((steps + 1, 1)), trace)
    return trace.compression


def chosen_steps(name: str, frame: int, error: float) -> int:
    """Return how many steps are chosen for a sample."""
    scene = ruler_scene(name)
    used = scene.accuracy.replace(silence=-math.inf, iterations=200, max_error=error, max_substeps=MAX_SUBSTEPS)
    model, state, _ = build(scene, SAMPLERATE, used)
    Simulation(model, state, kernel="general").render_block(np.zeros((frame + 1, 1)))
    return 1 << int(state.refinement.level[0])


def draw_sample() -> None:
    """Draw the compressions of all points of the tanpura's bridge within one sample, by few steps and by many."""
    fine, chosen = compressions_within_sample(SHOWN, FRAME, FINEST), chosen_steps(SHOWN, FRAME, DRAWN_ERROR)
    seen = fine.max(axis=0) > -NEAR
    shown = {"1 step": 1, "16 steps": 16, f"max_error = {DRAWN_ERROR:g}: {chosen} steps": chosen}
    with figure("tanpura_sample", 11.0, 4.5, ncols=3, sharey=True) as panels:
        for panel, (title, steps) in zip(panels, shown.items(), strict=True):
            panel.axhline(0.0, color=GREY, lw=0.8)
            panel.plot(np.linspace(0.0, SAMPLE, len(fine)), fine[:, seen] * 1e6, color=ORANGE, lw=3.0, alpha=0.4)
            coarse = compressions_within_sample(SHOWN, FRAME, steps)[:, seen] * 1e6
            panel.plot(
                np.linspace(0.0, SAMPLE, steps + 1),
                coarse,
                color=BLUE,
                lw=1.0,
                marker="o" if steps <= MARKED else "",
                ms=3.0,
            )
            panel.set(title=title, xlabel="time within the sample, µs")
        panels[0].set_ylabel("compression of each point of the bridge, µm")
