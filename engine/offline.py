"""Render a scene to an array: the engine at full speed, with its statistics."""

import os
import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from engine import rest, solve
from engine.build import build
from engine.doubts import built_doubts, doubts, warnings
from engine.layout import Layout
from engine.model import Model, State, Trace
from engine.parts import SECONDS
from engine.runner import Runner
from engine.scene import SAMPLERATES, Scene

FILTER = 140  # samples to either side that the filter of an oversampled render takes …
KAISER = 20.5  # … and the β of its window: 190 dB
FIRST = 64  # samples that are rendered first, to see how long they take
QUICK = 0.02  # s: what takes less is followed by eight times as many
CHUNK = 16_384  # samples between two looks at the clock and at Ctrl-C

# what a scene may call for, and the slot of the Model that holds it
EFFECTS = {
    "loss": "loss",
    "heavy damping": "drag",
    "restoring force": "spring",
    "gravity": "gravity",
    "external force": "force",
    "contact": "contact",
    "contact between bodies": "partner",
    "contact loss": "contact_loss",
    "coupled contacts": "coupling",
    "refinement": "refinement",
    "events": "events",
}


@dataclass(frozen=True)
class Take:
    """A rendered scene.

    audio: float64 [frames, channels], in the SI units of the pickups; never normalised
    stats: the names of `render.py --json` (DESIGN sec. 6)
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
                the scene says if absent or None (engine.accuracy)

    Raises ValueError if an argument is out of range, BuildError (a ValueError) if the scene
    cannot be built at this sample rate.
    """
    seconds = scene.seconds if seconds is None else seconds
    if not 0 < seconds <= SECONDS:
        raise ValueError(f"seconds = {seconds:g} is out of range; more than 0, at most {SECONDS:g}")
    if not SAMPLERATES[0] <= samplerate <= SAMPLERATES[1]:
        raise ValueError(f"samplerate = {samplerate} is out of range; {SAMPLERATES[0]} to {SAMPLERATES[1]} Hz")
    if cores is not None and cores < 1:
        raise ValueError(f"cores = {cores} is out of range; at least 1")
    asked = scene.accuracy.but(**accuracy)
    model, state, layout = build(scene, samplerate * asked.oversample, asked, seconds)
    runner = Runner(model, state, cores or os.cpu_count() or 1)
    frames = max(1, round(seconds * samplerate)) * asked.oversample
    audio = np.zeros((frames + beyond(asked.oversample), max(p.channel for p in scene.pickup)))
    kept = _room(model, len(audio)) if trace else None
    runner.block(audio[:0], _part(kept, 0, 0))  # compile before the clock starts
    elapsed, end, size = 0.0, 0, FIRST
    while end < frames:
        begin, end = end, min(end + size, frames)
        part = _part(kept, begin, end)
        start = time.perf_counter()
        runner.block(audio[begin:end], part)
        taken = time.perf_counter() - start
        elapsed += taken
        size = min(8 * size, CHUNK) if taken < QUICK else max(1, size // 8) if taken > 16 * QUICK else size
        if progress is not None:
            progress(end / frames)
    fine, found, kept_frames = samplerate * asked.oversample, statistics(runner), _part(kept, 0, frames)
    if asked.oversample > 1:
        runner.block(audio[frames:], _part(kept, frames, len(audio)))
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
        "cores": runner.cores if kept is None else 1,
        "islands": _islands(layout),
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


def statistics(runner: Runner) -> dict[str, Any]:
    """Newton iterations, energy, effects and activity of a scene up to now."""
    model, state = runner.model, runner.state
    frames = max(1, int(state.frame[0]))
    contact, asleep = float(np.mean(state.contacts / frames)), float(np.mean(state.asleep[:, rest.SLEPT] / frames))
    return {
        "newton": newton(model, state),
        "energy": runner.energies(),
        "effects": {
            "compiled": [name for name, slot in EFFECTS.items() if getattr(model, slot) is not None],
            "left_out": [name for name, slot in EFFECTS.items() if getattr(model, slot) is None],
        },
        "activity": {"free": 1 - contact - asleep, "contact": contact, "asleep": asleep},
    }


def _islands(layout: Layout) -> dict[str, Any]:
    """How many islands there are, and the largest."""
    modes = np.diff(layout.islands.mode)
    largest = int(np.argmax(modes * (1 + np.diff(layout.islands.contact))))
    names = [b.name for b in layout.scene.body if layout.island[layout.number[b.name]] == largest]
    contacts = int(np.diff(layout.islands.contact)[largest])
    return {"count": modes.size, "largest": {"bodies": names, "modes": int(modes[largest]), "contacts": contacts}}


def newton(model: Model, state: State) -> dict[str, Any]:
    """Evaluations of the contact law per iterative solve, and how each sample of each island with
    contacts was solved; "capped" are the samples that made do with unfinished forces, "failed" those
    where the motion was turned back instead."""
    histogram, regimes = state.iterations.sum(axis=0), state.regimes.sum(axis=0)
    with_contacts = np.diff(model.islands.contact) > 0
    solves = int(histogram.sum())
    reached = np.cumsum(histogram)
    return {
        "solves": solves,
        "mean": float(histogram @ np.arange(histogram.size) / solves) if solves else 0.0,
        "p99": int(np.searchsorted(reached, 0.99 * solves)) if solves else 0,
        "max": int(np.flatnonzero(histogram)[-1]) if solves else 0,
        "unconverged": int(regimes[solve.FAILED]),
        "histogram": np.trim_zeros(histogram, "b").tolist(),
        "regimes": {
            "free": int(np.sum((state.frame[0] - state.contacts - state.asleep[:, rest.SLEPT])[with_contacts])),
            "separation": int(regimes[solve.SEPARATION]),
            "closed_form": int(regimes[solve.CLOSED]),
            "newton": int(regimes[solve.NEWTON]),
            "capped": int(regimes[solve.CAPPED]),
            "failed": int(regimes[solve.FAILED]),
        },
    }


def _room(model: Model, frames: int) -> Trace:
    """Room for a trace."""
    bodies = model.bodies.first.size
    contacts = model.contact.barrier.size if model.contact is not None else 0
    return Trace(
        displacement=np.zeros((frames, bodies)),
        velocity=np.zeros((frames, bodies)),
        compression=np.zeros((frames, contacts)),
        force=np.zeros((frames, contacts)),
        iterations=np.zeros(frames, np.int64),
        **{name: np.zeros(frames) for name in ("kinetic", "potential", "contact", "dissipated", "supplied")},
    )


def _part(trace: Trace | None, begin: int, end: int) -> Trace | None:
    """Some rows of a trace."""
    return None if trace is None else Trace(*(a[begin:end] for a in trace))


def _named(trace: Trace, layout: Layout, samplerate: int) -> dict[str, np.ndarray]:
    """The arrays of a trace by their public names, columns in the order of the patch."""
    scene = layout.scene
    frames = trace.iterations.size
    body = np.argsort(layout.body)
    displacement = trace.displacement[:, body]
    columns = [(k, len(layout.spots(contact))) for k, contact in enumerate(scene.contact)]
    begin = dict(zip([k for k, _ in columns], np.cumsum([0] + [n for _, n in columns]).tolist(), strict=False))
    total = sum(n for _, n in columns)
    compression, force = np.full((frames, total), np.nan), np.zeros((frames, total))  # NaN: not built
    for place, (k, _) in enumerate(layout.spot):
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
