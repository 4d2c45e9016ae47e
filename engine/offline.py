"""Render a scene to an array: the engine at full speed, with its statistics."""

import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from engine import energy, solve
from engine.block import PIECE, block
from engine.build import build
from engine.layout import Layout
from engine.model import Model, State, Trace
from engine.scene import SAMPLERATES, SECONDS, Scene

CHUNK = 16_384  # samples between two looks at the clock and at Ctrl-C

# what a scene may call for, and the slot of the Model that holds it
EFFECTS = {
    "loss": "loss",
    "restoring force": "spring",
    "gravity": "gravity",
    "external force": "force",
    "contact": "contact",
    "contact between bodies": "partner",
    "contact loss": "contact_loss",
    "coupled contacts": "coupling",
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
    scheme: str = "exact",
    trace: bool = False,
    progress: Callable[[float], None] | None = None,
) -> Take:
    """Render a scene.

    seconds:    length; the scene's own if None
    samplerate: Hz
    scheme:     "exact", or "fdh", the paper's own coefficients (engine.modes)
    trace:      keep every sample's displacements, forces and energies
    progress:   called now and then with the share rendered, 0 to 1

    Raises ValueError if an argument is out of range, BuildError (a ValueError) if the scene
    cannot be built at this sample rate.
    """
    seconds = scene.seconds if seconds is None else seconds
    if not 0 < seconds <= SECONDS:
        raise ValueError(f"seconds = {seconds:g} is out of range; more than 0, at most {SECONDS:g}")
    if not SAMPLERATES[0] <= samplerate <= SAMPLERATES[1]:
        raise ValueError(f"samplerate = {samplerate} is out of range; {SAMPLERATES[0]} to {SAMPLERATES[1]} Hz")
    model, state, layout = build(scene, samplerate, scheme)
    frames = max(1, round(seconds * samplerate))
    audio = np.zeros((frames, max(p.channel for p in scene.pickup)))
    kept = _room(model, frames) if trace else None
    ledger, tally = np.zeros((PIECE, energy.COLUMNS)), np.zeros(energy.TALLY)
    block(model, state, audio[:0], ledger, tally, _part(kept, 0, 0))  # compile before the clock starts
    elapsed = 0.0
    for begin in range(0, frames, CHUNK):
        end = min(begin + CHUNK, frames)
        part = _part(kept, begin, end)
        start = time.perf_counter()
        block(model, state, audio[begin:end], ledger, tally, part)
        elapsed += time.perf_counter() - start
        if progress is not None:
            progress(end / frames)
    stats = {
        "patch": None,
        "output": None,
        "seconds": frames / samplerate,
        "samplerate": samplerate,
        "channels": audio.shape[1],
        "peak": float(np.max(np.abs(audio))),
        "real_time_factor": frames / samplerate / elapsed,
        "ns_per_sample": elapsed / frames * 1e9,
        **statistics(model, state, tally),
    }
    return Take(audio, samplerate, stats, _named(kept, layout, samplerate) if kept is not None else None)


def statistics(model: Model, state: State, tally: np.ndarray) -> dict[str, Any]:
    """Newton iterations, energy, effects and activity of a scene up to now."""
    share = state.contacts / max(1, int(state.frame[0]))
    return {
        "newton": newton(model, state),
        "energy": energy.summary(tally, state.account),
        "effects": {
            "compiled": [name for name, slot in EFFECTS.items() if getattr(model, slot) is not None],
            "left_out": [name for name, slot in EFFECTS.items() if getattr(model, slot) is None],
        },
        "activity": {"free": float(np.mean(1 - share)), "contact": float(np.mean(share)), "asleep": 0.0},
    }


def newton(model: Model, state: State) -> dict[str, Any]:
    """Evaluations of the contact law per iterative solve, and how each sample of each island with
    contacts was solved; "capped" are the samples that made do with unfinished forces, "failed" those
    where the motion was turned back instead."""
    histogram = state.iterations
    with_contacts = np.diff(model.islands.contact) > 0
    solves = int(histogram.sum())
    reached = np.cumsum(histogram)
    return {
        "solves": solves,
        "mean": float(histogram @ np.arange(histogram.size) / solves) if solves else 0.0,
        "p99": int(np.searchsorted(reached, 0.99 * solves)) if solves else 0,
        "max": int(np.flatnonzero(histogram)[-1]) if solves else 0,
        "unconverged": int(state.regimes[solve.FAILED]),
        "histogram": np.trim_zeros(histogram, "b").tolist(),
        "regimes": {
            "free": int(np.sum(state.frame[0] - state.contacts[with_contacts])),
            "separation": int(state.regimes[solve.SEPARATION]),
            "closed_form": int(state.regimes[solve.CLOSED]),
            "newton": int(state.regimes[solve.NEWTON]),
            "capped": int(state.regimes[solve.CAPPED]),
            "failed": int(state.regimes[solve.FAILED]),
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
    compression, force = np.zeros((frames, len(scene.contact))), np.zeros((frames, len(scene.contact)))
    for k, contact in enumerate(scene.contact):  # a contact that was not built still has a compression
        sign = 1.0 if contact.side == "above" else -1.0
        other = displacement[:, layout.number[contact.on]] if contact.on else (contact.barrier or 0.0)
        compression[:, k] = sign * (displacement[:, layout.number[contact.body]] - other) - (contact.gap or 0.0)
    compression[:, layout.contact] = trace.compression
    force[:, layout.contact] = trace.force
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
