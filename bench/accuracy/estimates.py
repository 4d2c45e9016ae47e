"""Error estimates against the errors that renderings have, for random scenes that are pushed, changed, struck and
joined. The true error is that against a rendering at 16 times the sample rate, with 12 steps in each of its samples, in
which tables glide in 6 times as many steps."""

from typing import Any, NamedTuple

import numpy as np

import engine
from bench.publish.report import pin, publish
from bench.scenes.forced import KINDS, random_forced_scene
from engine.analysis.finer_scene import with_finer_glides
from engine.analysis.metrics import relative_rms_error

RATE = 44_100
SCENES = 200
RATE_FACTOR, STEPS, GLIDE_FACTOR = 16, 12, 6  # of the reference
SETTINGS: dict[str, dict[str, Any]] = {
    "default": {},
    "substeps = 4": {"substeps": 4},
    "order = 4": {"order": 4},
    "max_error = 1e-3": {"max_error": 1e-3},
}
MOST = 3.0  # what an estimate may be over the error, and the error over it
AGREEMENT = 0.2  # of an error: how near two references must be, that it counts as known
ROUNDING = 1e-9  # of the sound


class Comparison(NamedTuple):
    """An estimate beside the error."""

    seed: int
    setting: str
    stated: float
    error: float
    is_known: bool  # the references agree well enough


def reference(scene: engine.Scene, factor: int) -> np.ndarray:
    """Return the samples of a scene, rendered at a multiple of the sample rate [frames, channels]."""
    finer = with_finer_glides(scene, RATE * factor, GLIDE_FACTOR)
    settings = {"order": 2, "substeps": STEPS, "iterations": 200, "cores": 1, "kernel": "general"}
    return engine.render(finer, scene.seconds, RATE * factor, **settings).audio[::factor]


def compare(seed: int) -> list[Comparison]:
    """Return the estimates of a scene at all settings, beside the errors."""
    scene = random_forced_scene(seed)
    finest, coarser = reference(scene, RATE_FACTOR), reference(scene, RATE_FACTOR // 2)
    comparisons = []
    for name, settings in SETTINGS.items():
        try:
            rendering = engine.render(scene, cores=1, kernel="general", **settings)
        except ValueError:  # order 4 needs light damping
            continue
        estimate = engine.estimate_error(scene, rendering, cores=1, kernel="general")
        begin, end = (round(time * RATE) for time in (estimate.begin, estimate.horizon))
        span = slice(begin, end if end > begin else len(finest))
        error, apart = (
            relative_rms_error(audio[span], finest[span], len(finest[span])) for audio in (rendering.audio, coarser)
        )
        stated = float(np.hypot(estimate.motion, estimate.rounding))
        comparisons.append(Comparison(seed, name, stated + ROUNDING, error + ROUNDING, apart < AGREEMENT * error))
    return comparisons


def describe(name: str, comparisons: list[Comparison]) -> list[str]:
    """Return a row of the table."""
    ratios = np.array([one.stated / one.error for one in comparisons if one.is_known])
    low, high = np.quantile(ratios, [0.025, 0.975])
    within, under = np.mean((ratios > 1 / MOST) & (ratios < MOST)), np.mean(ratios <= 1 / MOST)
    numbers = [f"{len(ratios)}", f"{len(comparisons) - len(ratios)}", f"{np.median(ratios):.2f}"]
    return [name, *numbers, f"{low:.2f} to {high:.2f}", f"{within:.1%}", f"{under:.1%}"]


def run() -> None:
    """Measure, print and write the table."""
    pin()
    comparisons = [one for seed in range(SCENES) for one in compare(seed)]
    rows = [describe(name, [one for one in comparisons if one.setting == name]) for name in SETTINGS]
    for n, kind in enumerate(KINDS):
        rows.append(describe(f"scenes with {kind}", [one for one in comparisons if one.seed % len(KINDS) == n]))
    rows.append(describe("all", comparisons))
    heads = "estimates", "error not known", "median of stated over true", "95 % of them", "within 3 ×", "under a third"
    publish("estimates", ["", *heads], rows)
