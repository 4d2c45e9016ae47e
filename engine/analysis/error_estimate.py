"""Estimate the error of a rendering: its distance from the motion of the continuous system, by a second, finer
rendering."""

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from engine.analysis.metrics import relative_rms_error
from engine.offline.render import RenderedArrays, render_arrays
from engine.offline.statistics_base import Statistics
from engine.patch.accuracy import MAX_SUBSTEPS, SMALLEST_ERROR, Accuracy
from engine.patch.frames import frame_count
from engine.patch.scene import Scene

TRUST_LIMIT = 0.1  # of the largest sample so far: a motion that is farther off than that is another one
COMPARED_SECONDS = 0.005  # s
REFINEMENT = 2  # times the substeps
FINER_ERROR = 0.1  # times `max_error`
FINER_COST = 3  # times the time, at most


@dataclass(frozen=True)
class ErrorEstimate(Statistics):
    """An estimate of the error of a rendering. It is that of the computation alone: not of the numbers of the patch.

    motion:      root mean square of the error up to the horizon, relative to that of the sound; over the whole length
                 if the horizon is 0; NaN if the rendering already has the finest setting
    horizon:     time up to which the error is below a tenth of the largest sample, s
    seconds:     length of the sound that was compared, s
    finer:       settings of the finer rendering
    time_factor: computing time of the finer rendering over that of this one
    """

    motion: float
    horizon: float
    seconds: float
    finer: dict[str, Any]
    time_factor: float


def estimate_error(
    scene: Scene,
    rendering: RenderedArrays,
    progress: Callable[[float], None] | None = None,
    seconds: float | None = None,
    **settings: Any,
) -> ErrorEstimate:
    """Estimate the error of a rendering of a scene by a second one, with twice the steps.

    seconds:  how much of the beginning is compared; all of it if None
    progress: called now and then with the share rendered, 0 to 1
    settings: cores and kernel of the second one

    >>> import engine
    >>> scene = engine.load("piano_c4")
    >>> coarse, fine = (engine.render(scene, seconds=0.05, substeps=n) for n in (1, 8))
    >>> engine.estimate_error(scene, fine).motion < engine.estimate_error(scene, coarse).motion < 0.1
    True
    """
    used = Accuracy.model_validate(rendering.stats["accuracy"])
    samples = len(rendering.audio) if seconds is None else frame_count(seconds, rendering.samplerate)
    audio = rendering.audio[: max(1, samples)]
    seconds = len(audio) / rendering.samplerate
    accuracy = finer_setting(used)
    settings |= {"progress": progress, **accuracy.model_dump()}
    fine = render_arrays(scene, seconds, rendering.samplerate, **settings)
    horizon = trusted_frames(audio, fine.audio, rendering.samplerate)
    ratio = REFINEMENT**used.order if used.max_error is None else 1 / FINER_ERROR  # of the errors of the two renderings
    error = ratio / (ratio - 1) * relative_rms_error(audio, fine.audio, horizon or len(fine.audio))
    is_finer = accuracy != used.replace(tolerance=accuracy.tolerance, iterations=accuracy.iterations)
    return ErrorEstimate(
        motion=error if is_finer else math.nan,
        horizon=horizon / rendering.samplerate,
        seconds=seconds,
        finer={name: getattr(accuracy, name) for name in ("order", "substeps", "max_error")},
        time_factor=fine.stats["ns_per_sample"] / rendering.stats["ns_per_sample"],
    )


def finer_setting(used: Accuracy) -> Accuracy:
    """Return the setting with twice as many steps, whose error is several times smaller; the same if there is none."""
    exact = {"precision": "float64", "tolerance": 1e-15, "iterations": max(used.iterations, 200)}
    finer = used.replace(substeps=min(REFINEMENT * used.substeps, MAX_SUBSTEPS), **exact)
    if used.max_error is None:
        return finer
    return finer.replace(max_error=max(SMALLEST_ERROR, FINER_ERROR * used.max_error), max_substeps=MAX_SUBSTEPS)


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
