"""Render a scene to an array: the engine at full speed, with its statistics."""

import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, cast

import numpy as np

from engine.assembly.build import build
from engine.assembly.scored_changes import scored_tables
from engine.assembly.table_digest import digest_tables
from engine.faults import RenderInterrupted
from engine.kernel.data.state import Trace
from engine.offline.brief_contacts import BriefContactRecord, warn_of_brief_contacts, watch_contacts
from engine.offline.decimation import decimate, decimation_tail
from engine.offline.infrasound import warn_of_infrasound
from engine.offline.large_motion import LargeMotion, MotionRecord
from engine.offline.recorder import Renderer
from engine.offline.shape_snapshots import ShapeSnapshots
from engine.offline.simulation import Simulation
from engine.offline.statistics import RenderStatistics, island_statistics, simulation_statistics
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
from engine.provenance import usable_cores

FIRST_CHUNK_FRAMES = 8  # to see how long they take: where a sample takes 0.1 s, too
MAX_CHUNK_FRAMES = 16_384  # between two looks at the clock and at Ctrl-C
QUICK_CHUNK_SECONDS = 0.02  # what takes less is followed by eight times as many


@dataclass(frozen=True, eq=False)
class RenderedArrays:
    """The arrays and statistics of a rendered scene; `fdh.Rendering` describes them."""

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
    """Render a scene to arrays. The arguments are those of `fdh.render`, of the right kinds. Raises ValueError if
    one is out of range, BuildError (a ValueError) if the scene cannot be built at this sample rate; and
    RenderInterrupted (a KeyboardInterrupt) at Ctrl-C, if something is rendered by then."""
    seconds = scene.seconds if seconds is None else seconds
    _check_arguments(seconds, samplerate, cores)
    used = scene.accuracy.replace(**accuracy)
    fine = samplerate * used.oversample
    start = time.perf_counter()
    built = build(scene, fine, used, seconds)
    watched = watch_contacts(scene, built, used, seconds)
    model, state, layout = watched.built
    build_seconds = time.perf_counter() - start
    table_digest = digest_tables(built.model, built.state)  # before anything moves
    tables = scored_tables(watched.scene, watched.built, accuracy=used, seconds=seconds)
    simulation = Simulation(model, state, cores or usable_cores(), kernel=kernel, tables=tables)
    frames = frame_count(seconds, samplerate) * used.oversample
    audio = np.zeros((frames + decimation_tail(used.oversample), scene.channels))
    kept = allocate_trace(model, len(audio)) if trace or trace_shapes else None
    snapshots = ShapeSnapshots(simulation, layout, frames) if trace_shapes else None
    renderer: Renderer = snapshots or simulation
    touches = None
    if watched.contacts:
        renderer = touches = BriefContactRecord(renderer, watched, used, scene.channels)
    motion = LargeMotion(model, state, layout)
    if motion.has_limits:
        renderer = MotionRecord(renderer, motion)
    chunks = _Chunks(renderer, simulation, audio[:frames], kept)
    interruption = None
    try:
        chunks.render(progress)
    except KeyboardInterrupt as stop:  # what there is can be kept
        interruption = stop
        frames = max(0, chunks.done - decimation_tail(used.oversample)) // used.oversample * used.oversample
        audio = audio[: chunks.done]
        if frames == 0:
            raise
    simulated = simulation_statistics(simulation, chunks.energy_totals)
    if used.oversample > 1:
        if interruption is None:
            tail = np.zeros((len(audio) - frames, watched.scene.channels))
            simulation.render_block(tail, None if kept is None else trace_rows(kept, frames, len(audio)))
            audio[frames:] = tail[:, : scene.channels]
        audio = decimate(audio, used.oversample, frames // used.oversample)
    audio = apply_tremolo(audio, scene.tremolo, samplerate)
    brief_contacts = [] if touches is None else touches.statistics()
    finite = bool(np.isfinite(audio).all())
    reasons = explain_build_doubts(scene.model_copy(update={"accuracy": used}), layout, model)
    reasons += explain_doubts(simulated.newton, simulated.energy.error_max, finite)
    stats = RenderStatistics(
        **vars(simulated),
        seconds=frames / fine,
        samplerate=samplerate,
        channels=audio.shape[1],
        peak=float(np.max(np.abs(audio))),
        real_time_factor=frames / fine / chunks.elapsed,
        ns_per_sample=chunks.elapsed / len(audio) * 1e9,
        build_seconds=build_seconds,
        cores=simulation.cores if kept is None else 1,
        kernel=simulation.kernel,
        table_digest=table_digest,
        islands=island_statistics(layout),
        accuracy=used.model_dump(),
        trusted=not reasons,
        reasons=reasons,
        warnings=[
            *warnings(scene),
            *warn_of_strong_loss(state, used.order),
            *warn_of_capped_samples(state, used),
            *motion.warnings(fine),
            *warn_of_infrasound(scene, audio, samplerate),
            *warn_of_brief_contacts(brief_contacts, used),
        ],
        brief_contacts=brief_contacts,
    )
    named = None if kept is None else name_columns(trace_rows(kept, 0, frames), layout, fine)
    if named is not None and snapshots is not None:
        named["units"] = np.concatenate([named["units"], snapshots.units])
        named = cast(TraceArrays, {**named, **snapshots.arrays(fine, frames)})
    rendered = RenderedArrays(audio, samplerate, stats, named)
    if interruption is not None:
        raise RenderInterrupted(rendered) from interruption
    return rendered


def _check_arguments(seconds: float, samplerate: int, cores: int | None) -> None:
    """Raise ValueError if an argument of `render_arrays` is out of range."""
    if not 0 < seconds <= MAX_SECONDS:
        raise ValueError(f"seconds = {seconds:g} is out of range; more than 0, at most {MAX_SECONDS:g}")
    check_samplerate(samplerate)
    if cores is not None and cores < 1:
        raise ValueError(f"cores = {cores} is out of range; at least 1")


class _Chunks:
    """A rendering in chunks of about equal time.

    simulation:    what the renderer advances
    audio:         [frames, channels], to be filled
    done:          frames that are rendered
    elapsed:       s, that they took, compiling apart
    energy_totals: of the simulation at the last frame, before its step; None until then
    """

    def __init__(self, renderer: Renderer, simulation: Simulation, audio: np.ndarray, trace: Trace | None) -> None:
        self._renderer, self._simulation, self._audio, self._trace = renderer, simulation, audio, trace
        self.done, self.elapsed = 0, 0.0
        self.energy_totals: np.ndarray | None = None

    def render(self, progress: Callable[[float], None] | None) -> None:
        """Fill the audio. progress: called with the share that is done, first with 0"""
        self._render_to(0)  # compile
        size = FIRST_CHUNK_FRAMES
        if progress is not None:
            progress(0.0)
        last = len(self._audio) - 1
        while self.done < last:
            taken = self._render_to(min(self.done + size, last))
            if taken < QUICK_CHUNK_SECONDS:
                size = min(8 * size, MAX_CHUNK_FRAMES)
            elif taken > 16 * QUICK_CHUNK_SECONDS:
                size = max(1, size // 8)
            if progress is not None:
                progress(self.done / len(self._audio))
        self.energy_totals = self._simulation.energy_totals()
        self._render_to(last + 1)
        if progress is not None:
            progress(1.0)

    def _render_to(self, end: int) -> float:
        """Render all up to a frame. Returns the seconds that took."""
        rows = None if self._trace is None else trace_rows(self._trace, self.done, end)
        start = time.perf_counter()
        self._renderer.render_block(self._audio[self.done : end], rows)
        taken = time.perf_counter() - start
        if end > 0:
            self.elapsed, self.done = self.elapsed + taken, end
        return taken
