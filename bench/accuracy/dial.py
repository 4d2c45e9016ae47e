"""Requirements on the accuracy settings: orders 2 and 4 at equal error, refinement, orders of convergence."""

from typing import Any

import numpy as np

import engine
from bench.publish.report import ROOT, publish
from bench.rivals.single_body_errors import TOLERANCES, as_single_body, dop853_with_events
from engine.analysis.metrics import relative_rms_error
from engine.assembly.build import build
from engine.offline.simulation import Simulation, time_block
from engine.patch.accuracy import Accuracy

RATE = 44_100
RUNS = 5


def settled(scene: engine.Scene, seconds: float, finer: int = 1, always: bool = False, **accuracy: Any) -> tuple:
    """Return the sound at 44.1 kHz, computed at a multiple of that rate, and ns per sample of it, without the call."""
    best, out = np.inf, np.zeros((round(seconds * RATE) * finer, 1))
    for _ in range(RUNS):
        model, state, _ = build(scene, RATE * finer, Accuracy(silence=-np.inf, iterations=200).replace(**accuracy))
        if always:
            model = model._replace(refinement=model.refinement._replace(refine_free_flight=True))
        simulation = Simulation(model, state, measure_energy=False)
        idle = min(time_block(simulation, out[:0]) for _ in range(20))
        best = min(best, time_block(simulation, out) - idle)
        if best > 1.0:
            break
    return out[::finer], best / len(out) * finer * 1e9


def cheapest(scene: engine.Scene, seconds: float, reference: np.ndarray, goal: float, order: int) -> tuple[str, float]:
    """The first setting of an order, coarse to fine, whose error is no larger than the goal, and its ns per sample."""
    steps = [(1, n) for n in (1, 2, 3, 4, 6, 8, 12, 16, 24, 32, 36, 40, 44, 48, 56, 64)]
    if order == 2:  # beyond, at multiples of the rate
        steps += [(k, 16) for k in (8, 16, 32, 64, 128, 256, 384, 512, 768, 1024)]
    for finer, substeps in steps:
        found, ns = settled(scene, seconds, finer, order=order, substeps=substeps)
        if relative_rms_error(found, reference, len(reference)) <= goal:
            return f"{finer * substeps} ×", ns
    return "none", np.inf


def slope(order: int, alpha: float) -> float:
    """Power of the step with which the error falls, for the repelled oscillator with another exponent."""
    told = engine.load(ROOT / "patches" / "repelled_oscillator.toml")
    # as deep in the barrier for any exponent
    law = {"exponent": alpha, "stiffness": 2.5e10 * 1e-3 ** (2.0 - alpha)}
    told = told.model_copy(update={"contact": [c.model_copy(update=law) for c in told.contact]})
    counts = np.array([8, 12, 16, 24, 32, 48, 64]) if order == 2 else np.array([3, 4, 6, 8, 12, 16])
    reference, _ = settled(told, 0.02, 4, order=6, substeps=16)
    errors = [relative_rms_error(settled(told, 0.02, order=order, substeps=int(n))[0], reference, 882) for n in counts]
    return -float(np.polyfit(np.log(counts), np.log(errors), 1)[0])


def heard(name: str, quantity: str, has_loss: bool = False) -> engine.Scene:
    """A shipped patch, with or without loss in contact, and a pickup of one quantity."""
    told = engine.load(ROOT / "patches" / f"{name}.toml")
    pickup = [told.pickup[0].model_copy(update={"quantity": quantity})]
    contact = list(told.contact) if has_loss else [c.model_copy(update={"loss": 0.0}) for c in told.contact]
    body = [b.model_copy(update={"modes": 60}) if b.kind == "string" else b for b in told.body]
    return told.model_copy(update={"pickup": pickup, "contact": contact, "event": [], "body": body})


def run() -> None:
    """Measure and publish."""
    rows: list[list[str]] = []

    def add(quantity: str, required: str, measured: str) -> None:
        rows.append([quantity, required, measured])

    told = heard("repelled_oscillator", "displacement")
    fine, _ = settled(told, 0.05, 4, order=6, substeps=16)
    for goal, ratio in ((3e-5, 8), (1e-9, 100)):
        (coarse, slow), (few, fast) = (cheapest(told, 0.05, fine, goal, order) for order in (2, 4))
        what = f"Fig. 6, 50 ms, error {goal:.0e}: time of order 2 ({coarse}) over that of order 4 ({few})"
        add(what, f"≥ {ratio}", f"{slow / fast:.1f}")
    case = as_single_body(told)
    scipy = [dop853_with_events(case, fine[:, 0], RATE, tolerance) for tolerance in (1e-3, *TOLERANCES)]
    good = min((row["ns_per_sample"] for row in scipy if row["error"] <= 1e-3), default=np.inf)
    few, fast = cheapest(told, 0.05, fine, 1e-3, 4)
    what = f"the same, error 1e-03: time of DOP853 with events over that of this engine (order 4, {few})"
    add(what, "≥ 100", f"{good / fast:.0f}")
    for name in ("piano_c2", "piano_c4"):
        string = heard(name, "velocity")
        fine, _ = settled(string, 0.05, order=6, substeps=16)
        once, _ = settled(string, 0.05, order=4)
        what = f"hammer on 60 modes ({name}), 50 ms, order 4, one step per sample: error of the velocity"
        add(what, "≤ 5e-06", f"{relative_rms_error(once, fine, len(fine)):.1e}")
        for seconds, always, most, how in ((0.05, True, 4.5, "everywhere"), (0.5, False, 1.5, "in contact only")):
            _, plain = settled(string, seconds)
            _, refined = settled(string, seconds, always=always, order=4)
            what = f"the same, refined {how}, over {seconds:g} s: time relative to one step of order 2 per sample"
            add(what, f"≤ {most}", f"{refined / plain:.2f}")
    felt = heard("piano_c4", "velocity", has_loss=True)
    fine, _ = settled(felt, 0.05, order=4, substeps=64)
    for order, required in ((2, "none"), (4, "≤ 1e-04")):
        once, _ = settled(felt, 0.05, order=order)
        what = f"the same with the damping of the felt, order {order}, one step per sample: error of the velocity"
        add(what, required, f"{relative_rms_error(once, fine, len(fine)):.1e}")
    (_, plain), (_, refined) = settled(felt, 0.5), settled(felt, 0.5, order=4)
    what = "the same, order 4 in contact only, over 0.5 s: time relative to one step of order 2 per sample"
    add(what, "≤ 1.5", f"{refined / plain:.2f}")
    for order in (2, 4):
        slopes = ", ".join(f"{slope(order, alpha):.1f} (α = {alpha:g})" for alpha in (1.0, 1.5, 2.0, 3.0))
        what = f"order {order}: power of the step with which the error falls"
        add(what, f"{order} for α ≥ 2", slopes)
    publish("dial", ["quantity", "required", "measured"], rows, "price")
