"""Render a scene to an array: the engine at full speed, with its statistics."""

import os
import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from engine.build.build import build
from engine.build.layout import Layout
from engine.kernel.model import Model
from engine.kernel.state import Trace
from engine.offline.simulation import Simulation
from engine.offline.statistics import island_statistics, statistics
from engine.offline.trust import built_doubts, doubts, warnings
from engine.patch.scene import SAMPLE_RATE_RANGE, Scene
from engine.patch.tables import MAX_SECONDS

FILTER = 140  # samples to either side that the filter of an oversampled render takes …
KAISER = 20.5  # … and the β of its window: 190 dB
FIRST = 64  # samples that are rendered first, to see how long they take
QUICK = 0.02  # s: what takes less is followed by eight times as many
CHUNK = 16_384  # samples between two looks at the clock and at Ctrl-C


@dataclass(frozen=True)
class Take:
    """A rendered scene.

    audio: float64 [frames, channels], in the SI units of the pickups; never normalised
    stats: the names of `fdh render --json` (docs/design.md, sec. 6)
    trace: arrays of every sample by name, or None; sample 0 is the initial state
    """

    audio: np.ndarray
    samplerate: int
    stats: dict[str, Any]
    trace: dict[str, np.ndarray] | None


def render(
    scene: Scene,
    seconds: float | None = None,
    samplerate: int = 44_100,
    trace: bool = False,
    cores: int | None = None,
    progress: Callable[[float], None] | None = None,
    **accuracy: Any,
) -> Take:
    """Render a scene.

    seconds:    length; the scene's own if None
    samplerate: Hz
    trace:      keep every sample's displacements, forces and energies
    cores:      how many may share the work; all of the machine's if None. The samples are the same
    progress:   called now and then with the share rendered, 0 to 1
    accuracy:   scheme, order, substeps, tolerance, oversample, precision, iterations, silence: of each, what
                the scene says if absent or None (engine.patch.accuracy)

    Raises ValueError if an argument is out of range, BuildError (a ValueError) if the scene
    cannot be built at this sample rate.
    """
    seconds = scene.seconds if seconds is None else seconds
    if not 0 < seconds <= MAX_SECONDS:
        raise ValueError(f"seconds = {seconds:g} is out of range; more than 0, at most {MAX_SECONDS:g}")
    if not SAMPLE_RATE_RANGE[0] <= samplerate <= SAMPLE_RATE_RANGE[1]:
        raise ValueError(
            f"samplerate = {samplerate} is out of range; {SAMPLE_RATE_RANGE[0]} to {SAMPLE_RATE_RANGE[1]} Hz"
        )
    if cores is not None and cores < 1:
        raise ValueError(f"cores = {cores} is out of range; at least 1")
    asked = scene.accuracy.replace(**accuracy)
    model, state, layout = build(scene, samplerate * asked.oversample, asked, seconds)
    simulation = Simulation(model, state, cores or os.cpu_count() or 1)
    frames = max(1, round(seconds * samplerate)) * asked.oversample
    audio = np.zeros((frames + beyond(asked.oversample), max(p.channel for p in scene.pickup)))
    kept = _allocate_trace(model, len(audio)) if trace else None
    simulation.render_block(audio[:0], _trace_rows(kept, 0, 0))  # compile before the clock starts
    elapsed, end, size = 0.0, 0, FIRST
    while end < frames:
        begin, end = end, min(end + size, frames)
        part = _trace_rows(kept, begin, end)
        start = time.perf_counter()
        simulation.render_block(audio[begin:end], part)
        taken = time.perf_counter() - start
        elapsed += taken
        size = min(8 * size, CHUNK) if taken < QUICK else max(1, size // 8) if taken > 16 * QUICK else size
        if progress is not None:
            progress(end / frames)
    fine, found, kept_frames = samplerate * asked.oversample, statistics(simulation), _trace_rows(kept, 0, frames)
    if asked.oversample > 1:
        simulation.render_block(audio[frames:], _trace_rows(kept, frames, len(audio)))
        audio = decimated(audio, asked.oversample, frames // asked.oversample)
    stats = {
        "patch": None,
        "output": None,
        "seconds": frames / fine,
        "samplerate": samplerate,
        "channels": audio.shape[1],
        "peak": float(np.max(np.abs(audio))),
        "real_time_factor": frames / fine / elapsed,
        "ns_per_sample": elapsed / len(audio) * 1e9,
        "cores": simulation.cores if kept is None else 1,
        "islands": island_statistics(layout),
        "accuracy": asked.model_dump(),
        **found,
    }
    precision = asked.precision
    reasons = built_doubts(scene.model_copy(update={"accuracy": asked}), layout, model)
    reasons += doubts(found["newton"], found["energy"], bool(np.isfinite(audio).all()), precision)
    stats |= {"trusted": not reasons, "reasons": reasons, "warnings": warnings(scene)}
    return Take(audio, samplerate, stats, _named(kept_frames, layout, fine) if kept_frames is not None else None)


def beyond(oversample: int) -> int:
    """How many samples a filter that brings a multiple of a sample rate down needs beyond the end."""
    return FILTER * oversample if oversample > 1 else 0


def decimated(audio: np.ndarray, oversample: int, frames: int) -> np.ndarray:
    """Every so many samples of what a linear-phase filter leaves: all to 0.9 of the Nyquist frequency, to 1e-9, and
    nothing that would alias below that. audio: frames·oversample samples, and `beyond` them."""
    from scipy.signal import firwin, upfirdn

    taps = firwin(2 * FILTER * oversample + 1, 1.0 / oversample, window=("kaiser", KAISER))
    return np.asarray(upfirdn(taps, audio, 1, oversample, axis=0)[FILTER : FILTER + frames])


def filtered_down(audio: np.ndarray, fine: int, samplerate: int, frames: int) -> np.ndarray:
    """Filtered down to the sample rate asked for."""
    import soxr

    coarse = np.zeros((frames, audio.shape[1]))
    found = soxr.resample(audio, fine, samplerate, quality="VHQ")[:frames]
    coarse[: len(found)] = found
    return coarse


def _allocate_trace(model: Model, frames: int) -> Trace:
    """Memory for a trace."""
    bodies = model.bodies.mode_begin.size
    contacts = model.contact.nominal_barrier.size if model.contact is not None else 0
    return Trace(
        displacement=np.zeros((frames, bodies)),
        velocity=np.zeros((frames, bodies)),
        compression=np.zeros((frames, contacts)),
        force=np.zeros((frames, contacts)),
        iterations=np.zeros(frames, np.int64),
        **{name: np.zeros(frames) for name in ("kinetic", "potential", "contact", "dissipated", "supplied")},
    )


def _trace_rows(trace: Trace | None, begin: int, end: int) -> Trace | None:
    """Some rows of a trace."""
    return None if trace is None else Trace(*(a[begin:end] for a in trace))


def _named(trace: Trace, layout: Layout, samplerate: int) -> dict[str, np.ndarray]:
    """The arrays of a trace by their public names, columns in the order of the patch."""
    scene = layout.scene
    frames = trace.iterations.size
    body = np.argsort(layout.body_order)
    displacement = trace.displacement[:, body]
    columns = [(k, len(layout.points_of(contact))) for k, contact in enumerate(scene.contact)]
    begin = dict(zip([k for k, _ in columns], np.cumsum([0] + [n for _, n in columns]).tolist(), strict=False))
    total = sum(n for _, n in columns)
    compression, force = np.full((frames, total), np.nan), np.zeros((frames, total))  # NaN: not built
    for place, (k, _) in enumerate(layout.contact_points):
        compression[:, begin[k]], force[:, begin[k]] = trace.compression[:, place], trace.force[:, place]
        begin[k] += 1
    return {
        "time": np.arange(frames) / samplerate,
        "displacement": displacement,
        "velocity": trace.velocity[:, body],
        "compression": compression,
        "force": force,
        "iterations": trace.iterations,
        "kinetic": trace.kinetic,
        "potential": trace.potential,
        "contact": trace.contact,
        "dissipated": trace.dissipated,
        "supplied": trace.supplied,
        "total": trace.kinetic + trace.potential + trace.contact,
    }
