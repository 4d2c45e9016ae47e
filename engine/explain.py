"""What was built from a scene, what was left out and why, and what each island of it costs."""

import hashlib
import time
from collections.abc import Callable
from typing import Any

import numpy as np

from engine import energy, rest
from engine.block import block
from engine.build import build
from engine.held import Held
from engine.layout import Layout
from engine.model import Model, Room, State
from engine.offline import EFFECTS
from engine.parts import Modes
from engine.scene import Scene

PIECE = 4096  # samples timed at once

SOLVERS = {0: "none", 1: "scalar"}
WHY = {
    "loss": "no body loses energy",
    "heavy damping": "no body loses much within a step",
    "restoring force": "no body has one",
    "gravity": "there is none, or it moves nothing",
    "external force": "no force of any strength acts",
    "contact": "there is no contact that could close",
    "contact between bodies": "no two bodies can touch",
    "contact loss": "no contact loses energy",
    "coupled contacts": "no island has several points of contact",
    "refinement": "a sample is one step",
    "events": "the score is empty",
}


def explain(
    scene: Scene,
    seconds: float,
    samplerate: int = 44_100,
    compiled: Callable[[float], None] | None = None,
    **accuracy: Any,
) -> dict[str, Any]:
    """Islands, effects and costs of a scene, measured over its first `seconds`.

    compiled: called with 1.0 when the kernel is there, before the clock starts
    Raises BuildError as `engine.build.build` does. Times are in ns per sample, on one core, with the
    energies measured, as in a render; accuracy as there.
    """
    model, state, layout = build(scene, samplerate, scene.accuracy.but(**accuracy), apart=True, seconds=seconds)
    channels = max(p.channel for p in scene.pickup)
    mean, busiest = _costs(model, state, round(seconds * samplerate), channels, compiled)
    return {
        "kernel": kernel(model, state),
        "islands": [_island(layout, model, state, n, mean[n], busiest[n]) for n in range(mean.size)],
        "effects": {
            name: "compiled in" if getattr(model, slot) is not None else f"left out: {WHY[name]}"
            for name, slot in EFFECTS.items()
        },
        "contacts_left_out": _pruned(layout),
    }


def kernel(model: Model, state: State) -> str:
    """A short name for the kernel that runs a model: scenes with the same one share its compiled code."""
    from numba import typeof

    kinds = typeof((model, state))  # type: ignore[no-untyped-call]
    return hashlib.sha256(f"{kinds}".encode()).hexdigest()[:8]


def _costs(
    model: Model, state: State, frames: int, channels: int, compiled: Callable[[float], None] | None
) -> tuple[np.ndarray, np.ndarray]:
    """Mean of each island over all pieces, and its busiest piece, ns per sample."""
    count = model.islands.part.size - 1
    held = Held(model), Held(state), Held(Room(np.zeros((PIECE, channels)), np.zeros((PIECE, energy.COLUMNS)), None))
    block(*held, 0, 0)  # compile before the clock starts
    if compiled is not None:
        compiled(1.0)
    total, busiest = np.zeros(count), np.zeros(count)
    for begin in range(0, frames, PIECE):
        length = min(PIECE, frames - begin)
        for n in range(count):
            start = time.perf_counter()
            block(*held, n, length)
            elapsed = (time.perf_counter() - start) * 1e9
            total[n] += elapsed
            busiest[n] = max(busiest[n], elapsed / length)
    return total / max(1, frames), busiest


def _island(layout: Layout, model: Model, state: State, n: int, mean: float, busiest: float) -> dict[str, Any]:
    frames = max(1, int(state.frame[n]))
    bodies = [b for b in range(len(layout.scene.body)) if layout.island[b] == n]
    contacts = int(model.islands.contact[n + 1] - model.islands.contact[n])
    touching, asleep = state.contacts[n] / frames, state.asleep[n, rest.SLEPT] / frames
    return {
        "bodies": [layout.scene.body[b].name for b in bodies],
        "modes": int(model.islands.mode[n + 1] - model.islands.mode[n]),
        "modes_dropped": sum(_dropped(layout, b) for b in bodies),
        "contacts": contacts,
        "solver": SOLVERS.get(contacts, "vector"),
        "activity": {"free": float(1 - touching - asleep), "contact": float(touching), "asleep": float(asleep)},
        "ns_expected": float(layout.work()[n]),
        "ns_mean": float(mean),
        "ns_busiest": float(busiest),
    }


def _dropped(layout: Layout, number: int) -> int:
    """How many of the modes that a body was given are above what the sample rate carries."""
    body = layout.scene.body[number]
    asked = len(body.frequency or []) if isinstance(body, Modes) else getattr(body, "modes", None) or 0
    return max(0, asked - layout.modal[number].omega.size)


def _pruned(layout: Layout) -> list[str]:
    """Contacts that were not built."""
    built = {k for k, _ in layout.spot}
    names = []
    for k, contact in enumerate(layout.scene.contact):
        if k not in built:
            name = contact.name or f"contact[{k}]"
            names.append(f"{name}: {'no stiffness' if contact.stiffness == 0.0 else 'too little energy to close it'}")
    return names
