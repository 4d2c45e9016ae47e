"""Estimate the error of a rendering: its distance from the motion of the continuous system, by a second, finer
rendering."""

import contextlib
import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from engine.analysis.metrics import relative_rms_error
from engine.assembly.build import build
from engine.faults import BuildError
from engine.offline.render import RenderedArrays, render_arrays
from engine.offline.statistics_base import Statistics
from engine.patch.accuracy import MAX_SUBSTEPS, Accuracy
from engine.patch.scene import Scene

TRUST_LIMIT = 0.1  # of the largest sample so far: a motion that is farther off than that is another one
COMPARED_SECONDS = 0.005  # s
FINER_SUBSTEPS = {2: 4, 4: 3, 6: 3}  # times the substeps, by order; a rigid joint may need an odd number at 4 and 6
SHARED_ERROR = (
    "the estimate does not include one error of orders 4 and 6, which apply loss only at the ends of a sample: about "
    "1e-7 to 1e-6 for short contacts, and 1e-4 to 3e-3 if a string touches frets, a bridge or wires; order 2 does not "
    "have it"
)


@dataclass(frozen=True)
class ErrorEstimate(Statistics):
    """An estimate of the error of a rendering. It is that of the computation alone: not of the numbers of the patch.

    motion:      root mean square of the error up to the horizon, relative to that of the sound; over the whole length
                 if the horizon is 0; NaN if the rendering already has the finest setting
    horizon:     time up to which the error is below a tenth of the largest sample, s
    seconds:     length of the sound that was compared, s
    finer:       settings of the finer rendering
    time_factor: computing time of the finer rendering over that of this one
    unseen:      the error that both renderings share, in words; None if they share none
    """

    motion: float
    horizon: float
    seconds: float
    finer: dict[str, Any]
    time_factor: float
    unseen: str | None = None


def estimate_error(
    scene: Scene, rendering: RenderedArrays, progress: Callable[[float], None] | None = None, **settings: Any
) -> ErrorEstimate:
    """Estimate the error of a rendering of a scene by a second one, several times finer.

    progress: called now and then with the share rendered, 0 to 1
    settings: cores and kernel of the second one

    >>> import engine
    >>> scene = engine.load("piano_c4")
    >>> coarse, fine = (engine.render(scene, seconds=0.05, substeps=n) for n in (1, 8))
    >>> engine.estimate_error(scene, fine).motion < engine.estimate_error(scene, coarse).motion < 0.1
    True
    """
    used = Accuracy.model_validate(rendering.stats["accuracy"])
    seconds = len(rendering.audio) / rendering.samplerate
    fine = _render_finer(scene, used, seconds, rendering.samplerate, progress, settings)
    horizon = trusted_frames(rendering.audio, fine.audio, rendering.samplerate)
    accuracy = Accuracy.model_validate(fine.stats["accuracy"])
    error = relative_rms_error(rendering.audio, fine.audio, horizon or len(fine.audio))
    is_finer = accuracy != used.replace(tolerance=accuracy.tolerance, iterations=accuracy.iterations)
    return ErrorEstimate(
        motion=error if is_finer else math.nan,
        horizon=horizon / rendering.samplerate,
        seconds=seconds,
        finer={name: getattr(accuracy, name) for name in ("order", "substeps")},
        time_factor=fine.stats["ns_per_sample"] / rendering.stats["ns_per_sample"],
        unseen=SHARED_ERROR if used.order > 2 and accuracy.order > 2 and _has_loss(scene, rendering, used) else None,
    )


def finer_settings(used: Accuracy) -> list[Accuracy]:
    """Return settings with an error several times smaller, the first one to try at the front."""
    exact = {"precision": "float64", "tolerance": 1e-15, "iterations": max(used.iterations, 200)}
    substeps = FINER_SUBSTEPS[used.order] * used.substeps
    if substeps <= MAX_SUBSTEPS:
        finer = used.replace(substeps=substeps, **exact)
    else:
        finer = used.replace(order=4 if used.order == 2 else 6, **exact)
    return [finer, used.replace(order=2, substeps=MAX_SUBSTEPS, **exact)]


def _has_loss(scene: Scene, rendering: RenderedArrays, used: Accuracy) -> bool:
    """True if any mode of a scene decays."""
    layout = build(scene, rendering.samplerate * used.oversample, used, seconds=0.0).layout
    return bool(layout.modes.sigma.any())


def _render_finer(
    scene: Scene, used: Accuracy, seconds: float, samplerate: int, progress: Any, settings: dict[str, Any]
) -> RenderedArrays:
    """The rendering at the first of the finer settings that the scene can be built at."""
    first, second = finer_settings(used)
    with contextlib.suppress(BuildError):  # damping is too strong for steps back in time
        return render_arrays(scene, seconds, samplerate, progress=progress, **settings, **first.model_dump())
    return render_arrays(scene, seconds, samplerate, progress=progress, **settings, **second.model_dump())


def trusted_frames(audio: np.ndarray, fine: np.ndarray, samplerate: float) -> int:
    """The number of frames before the first window in which two renderings differ by more than TRUST_LIMIT of the
    largest sample so far. audio, fine: [frames, channels]"""
    size, largest = max(1, round(COMPARED_SECONDS * samplerate)), 0.0
    for begin in range(0, len(fine), size):
        window = slice(begin, begin + size)
        largest = max(largest, float(np.abs(fine[window]).max(initial=0.0)))
        if not np.abs(audio[window] - fine[window]).max(initial=0.0) <= TRUST_LIMIT * largest:
            return begin
    return len(fine)
