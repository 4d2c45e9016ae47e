"""Estimate the error of a rendering: its distance from the motion of the continuous system, by a second, finer
rendering."""

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np

from engine.analysis.finer_scene import FinerScene, enlarge_rounding
from engine.analysis.metrics import relative_rms_error
from engine.offline.render import RenderedArrays, render_arrays
from engine.offline.statistics import RenderStatistics
from engine.offline.statistics_base import Statistics
from engine.patch.accuracy import MAX_SUBSTEPS, SMALLEST_ERROR, Accuracy
from engine.patch.frames import frame_count
from engine.patch.scene import Scene

TRUST_LIMIT = 0.1  # of the largest sample so far: a motion that is farther off than that is another one
QUIET = 0.01  # of the largest sample of all: what differs in a quieter beginning matters less
COMPARED_SECONDS = 0.005  # s
ROUNDING = 1e-13  # of the largest sample: what differs by less is the same motion …
RATE_ROUNDING = 1e-10  # … and at another rate, whose rounding errors add up
REFINEMENT = 2  # times the substeps, and the sample rate
MAX_CONTACT_STEPS = 0.1  # in contact, for each sample, that a finer rendering may have for brief contacts
FINER_ERROR = 0.1  # times `max_error`
FINER_COST = 3  # times the time, at most; as much again at twice the rate


@dataclass(frozen=True)
class ErrorEstimate(Statistics):
    """An estimate of the error of a rendering. It is that of the computation alone: not of the numbers of the patch.

    motion:      root mean square of the error from `begin` up to the horizon, relative to that of the sound; that of
                 `whole` if the horizon is not beyond `begin`; NaN if the rendering already has the finest setting
    whole:       the same from `begin` up to the end of what was compared
    begin:       time at which the two renderings begin to differ, as a rule that of the first contact, s
    horizon:     time up to which the error is below a tenth of the largest sample, s
    seconds:     length of the sound that was compared, s
    finer:       settings of the finer rendering
    time_factor: computing time of the finer rendering over that of this one
    rounding:    what the rounding of times of the patch to samples adds to `motion`, of the same range
    left_out:    names of errors that it does not include
    """

    motion: float
    whole: float
    begin: float
    horizon: float
    seconds: float
    finer: dict[str, Any]
    time_factor: float
    rounding: float
    left_out: list[str]


def estimate_error(
    scene: Scene,
    rendering: RenderedArrays,
    progress: Callable[[float], None] | None = None,
    seconds: float | None = None,
    **settings: Any,
) -> ErrorEstimate:
    """Estimate the error of a rendering of a scene by a second one, with twice the steps, or as many as its contacts
    need that last only a few; and at twice the sample rate where forces are known once a sample. If times of the patch
    lie between two samples, a third one tells what their rounding changes.

    seconds:  how much of the beginning is compared; all of it if None
    progress: called now and then with the share rendered, 0 to 1
    settings: cores and kernel of the others

    >>> import fdh
    >>> scene = fdh.load("piano_c4")
    >>> coarse, fine = (fdh.render(scene, seconds=0.05, substeps=n) for n in (1, 8))
    >>> fdh.estimate_error(scene, fine).motion < fdh.estimate_error(scene, coarse).motion < 0.1
    True
    """
    used = Accuracy.model_validate(rendering.stats["accuracy"])
    samples = len(rendering.audio) if seconds is None else frame_count(seconds, rendering.samplerate)
    audio, samplerate = rendering.audio[: max(1, samples)], rendering.samplerate
    seconds = len(audio) / samplerate
    accuracy = finer_setting(used, resolving_substeps(rendering.stats))
    finer = FinerScene.of(scene, seconds, samplerate, used, REFINEMENT)
    moved = enlarge_rounding(scene, samplerate * used.oversample)
    shares = _share_progress(progress, 1 if moved is None else 2)
    settings |= {"progress": next(shares), **accuracy.model_dump()}
    fine = finer.render(seconds, **settings)
    exact = RATE_ROUNDING if finer.factor > 1 else ROUNDING
    horizon, begin = trusted_frames(audio, fine.audio, samplerate), equal_frames(audio, fine.audio, exact)
    ratio = 1 / FINER_ERROR  # of the errors of the two renderings
    if used.max_error is None:
        ratio = max(REFINEMENT, accuracy.substeps / used.substeps) ** used.order
    if finer.factor > 1:
        ratio = min(ratio, finer.factor**2)
    whole, motion = (
        ratio / (ratio - 1) * relative_rms_error(audio[begin:end], fine.audio[begin:end], len(fine.audio[begin:end]))
        for end in (len(fine.audio), horizon if horizon > begin else len(fine.audio))
    )
    rounding = 0.0
    if moved is not None:
        settings |= {"progress": next(shares), **used.model_dump()}
        changed = render_arrays(moved.scene, seconds, samplerate, **settings).audio
        end = horizon if horizon > begin else len(audio)
        rounding = relative_rms_error(changed[begin:end], audio[begin:end], end - begin) / moved.factor
    is_finer = accuracy != used.replace(tolerance=accuracy.tolerance, iterations=accuracy.iterations)
    return ErrorEstimate(
        motion=motion if is_finer else math.nan,
        whole=whole if is_finer else math.nan,
        begin=begin / samplerate,
        horizon=horizon / samplerate,
        seconds=seconds,
        finer={name: getattr(accuracy, name) for name in ("order", "substeps", "max_error")}
        | ({"samplerate": samplerate * finer.factor} if finer.factor > 1 else {}),
        time_factor=finer.factor * fine.stats["ns_per_sample"] / rendering.stats["ns_per_sample"],
        rounding=rounding,
        left_out=finer.left_out,
    )


def _share_progress(progress: Callable[[float], None] | None, count: int) -> Iterator[Callable[[float], None] | None]:
    """Yield what tells the progress of each of some renderings, as a share of all."""
    for number in range(count):

        def report_share(share: float, before: int = number) -> None:
            if progress is not None:
                progress((before + share) / count)

        yield None if progress is None else report_share


def resolving_substeps(stats: RenderStatistics) -> int:
    """Return the substeps that resolve all contacts of a rendering; fewer if these would take long."""
    needed = max((contact.substeps for contact in stats.brief_contacts), default=1)
    return min(needed, int(MAX_CONTACT_STEPS / max(stats.activity.contact, MAX_CONTACT_STEPS / MAX_SUBSTEPS)))


def finer_setting(used: Accuracy, substeps: int = 1) -> Accuracy:
    """Return the setting with twice as many steps, whose error is several times smaller; the same if there is none.

    substeps: at least so many
    """
    exact = {"tolerance": 1e-15, "iterations": max(used.iterations, 200)}
    finer = used.replace(substeps=min(max(REFINEMENT * used.substeps, substeps), MAX_SUBSTEPS), **exact)
    if used.max_error is None:
        return finer
    return finer.replace(max_error=max(SMALLEST_ERROR, FINER_ERROR * used.max_error), max_substeps=MAX_SUBSTEPS)


def equal_frames(audio: np.ndarray, fine: np.ndarray, rounding: float = ROUNDING) -> int:
    """The number of frames before the first in which two renderings differ by more than rounding; 0 if none does.
    audio, fine: [frames, channels]; rounding: of the largest sample"""
    differs = np.any(~(np.abs(audio - fine) <= rounding * np.abs(fine).max(initial=0.0)), axis=1)
    return int(np.argmax(differs))


def trusted_frames(audio: np.ndarray, fine: np.ndarray, samplerate: float) -> int:
    """The number of frames before the first window in which two renderings differ by more than TRUST_LIMIT of the
    largest sample so far, or of what is quiet beside the largest of all. audio, fine: [frames, channels]"""
    size = max(1, round(COMPARED_SECONDS * samplerate))
    largest = QUIET * float(np.abs(fine).max(initial=0.0))
    for begin in range(0, len(fine), size):
        window = slice(begin, begin + size)
        largest = max(largest, float(np.abs(fine[window]).max(initial=0.0)))
        if not np.abs(audio[window] - fine[window]).max(initial=0.0) <= TRUST_LIMIT * largest:
            return begin
    return len(fine)
