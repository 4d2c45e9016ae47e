"""Render a scene to an array: the engine at full speed, with its statistics."""

import os
import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, cast

import numpy as np

from engine.assembly.build import build
from engine.assembly.table_changes import scored_exchanges
from engine.kernel.data.state import Trace
from engine.offline.decimation import decimate, decimation_tail
from engine.offline.shape_snapshots import ShapeSnapshots
from engine.offline.simulation import Simulation
from engine.offline.statistics import RenderStatistics, island_statistics, simulation_statistics
from engine.offline.stretching_record import FRAMES_OF_RENDER, Renderer, StretchingRecord
from engine.offline.trace import TraceArrays, allocate_trace, name_columns, trace_rows
from engine.offline.tremolo import apply_tremolo
from engine.offline.trust import (
    explain_build_doubts,
    explain_doubts,
    warn_of_capped_samples,
    warn_of_strong_loss,
    warnings,
)
from engine.patch.frames import check_samplerate, frame_count
from engine.patch.scene import Scene
from engine.patch.tables import MAX_SECONDS

FIRST_CHUNK_FRAMES = 64  # to see how long they take
MAX_CHUNK_FRAMES = 16_384  # between two looks at the clock and at Ctrl-C
QUICK_CHUNK_SECONDS = 0.02  # what takes less is followed by eight times as many


@dataclass(frozen=True, eq=False)
class RenderedArrays:
    """The arrays and statistics of a rendered scene; `engine.Rendering` describes them."""

    audio: np.ndarray
    samplerate: int
    stats: RenderStatistics
    trace: TraceArrays | None


def render_arrays(
    scene: Scene,
    seconds: float | None = None,
    samplerate: int = 44_100,
    trace: bool = False,
    cores: int | None = None,
    progress: Callable[[float], None] | None = None,
    kernel: str | None = None,
    trace_shapes: bool = False,
    **accuracy: Any,
) -> RenderedArrays:
    """Render a scene to arrays. The arguments are those of `engine.render`, of the right kinds. Raises ValueError if
    one is out of range, BuildError (a ValueError) if the scene cannot be built at this sample rate."""
    seconds = scene.seconds if seconds is None else seconds
    _check_arguments(seconds, samplerate, cores)
    used = scene.accuracy.replace(**accuracy)
    fine = samplerate * used.oversample
    start = time.perf_counter()
    model, state, layout = built = build(scene, fine, used, seconds)
    build_seconds = time.perf_counter() - start
    exchanges = scored_exchanges(scene, built, accuracy=used, seconds=seconds)
    simulation = Simulation(model, state, cores or os.cpu_count() or 1, kernel=kernel, exchanges=exchanges)
    frames = frame_count(seconds, samplerate) * used.oversample
    audio = np.zeros((frames + decimation_tail(used.oversample), scene.channels))
    kept = allocate_trace(model, len(audio)) if trace or trace_shapes else None
    snapshots = ShapeSnapshots(simulation, layout, frames) if trace_shapes else None
    renderer: Renderer = snapshots or simulation
    stretching = None
    if state.tension is not None:
        renderer = stretching = StretchingRecord(renderer, state, layout, FRAMES_OF_RENDER, only_beyond=True)
    elapsed = _render_in_chunks(renderer, audio[:frames], kept, progress)
    simulated = simulation_statistics(simulation)
    if used.oversample > 1:
        simulation.render_block(audio[frames:], None if kept is None else trace_rows(kept, frames, len(audio)))
        audio = decimate(audio, used.oversample, frames // used.oversample)
    audio = apply_tremolo(audio, scene.tremolo, samplerate)
    finite = bool(np.isfinite(audio).all())
    reasons = explain_build_doubts(scene.model_copy(update={"accuracy": used}), layout, model)
    reasons += explain_doubts(simulated.newton, simulated.energy.error_max, finite, used.precision)
    stats = RenderStatistics(
        **vars(simulated),
        seconds=frames / fine,
        samplerate=samplerate,
        channels=audio.shape[1],
        peak=float(np.max(np.abs(audio))),
        real_time_factor=frames / fine / elapsed,
        ns_per_sample=elapsed / len(audio) * 1e9,
        build_seconds=build_seconds,
        cores=simulation.cores if kept is None else 1,
        kernel=simulation.kernel,
        islands=island_statistics(layout),
        accuracy=used.model_dump(),
        trusted=not reasons,
        reasons=reasons,
        warnings=[
            *warnings(scene),
            *warn_of_strong_loss(state, used.order),
            *warn_of_capped_samples(state, used),
            *(stretching.warnings(fine) if stretching is not None else []),
        ],
    )
    named = None if kept is None else name_columns(trace_rows(kept, 0, frames), layout, fine)
    if named is not None and snapshots is not None:
        named["units"] = np.concatenate([named["units"], snapshots.units])
        named = cast(TraceArrays, {**named, **snapshots.arrays(fine)})
    return RenderedArrays(audio, samplerate, stats, named)


def _check_arguments(seconds: float, samplerate: int, cores: int | None) -> None:
    """Raise ValueError if an argument of `render_arrays` is out of range."""
    if not 0 < seconds <= MAX_SECONDS:
        raise ValueError(f"seconds = {seconds:g} is out of range; more than 0, at most {MAX_SECONDS:g}")
    check_samplerate(samplerate)
    if cores is not None and cores < 1:
        raise ValueError(f"cores = {cores} is out of range; at least 1")


def _render_in_chunks(
    renderer: Renderer,
    audio: np.ndarray,
    trace: Trace | None,
    progress: Callable[[float], None] | None,
) -> float:
    """Fill audio [frames, channels] in chunks of about equal time. Returns the seconds that took, compiling apart."""
    renderer.render_block(audio[:0], None if trace is None else trace_rows(trace, 0, 0))  # compile
    elapsed, end, size = 0.0, 0, FIRST_CHUNK_FRAMES
    while end < len(audio):
        begin, end = end, min(end + size, len(audio))
        part = None if trace is None else trace_rows(trace, begin, end)
        start = time.perf_counter()
        renderer.render_block(audio[begin:end], part)
        taken = time.perf_counter() - start
        elapsed += taken
        if taken < QUICK_CHUNK_SECONDS:
            size = min(8 * size, MAX_CHUNK_FRAMES)
        elif taken > 16 * QUICK_CHUNK_SECONDS:
            size = max(1, size // 8)
        if progress is not None:
            progress(end / len(audio))
    return elapsed
