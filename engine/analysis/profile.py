"""Profile of a scene: what was built of it, what was left out and why, and what each island costs."""

import hashlib
import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from engine.analysis.bowing import describe_friction
from engine.assembly.build import build
from engine.assembly.layout import Layout
from engine.assembly.subsystems import estimate_cost
from engine.assembly.table_changes import scored_exchanges
from engine.bodies import MeasuredBody
from engine.compiler.kinds import kind_of
from engine.compiler.struct_handle import StructHandle
from engine.kernel.data.enums import FLIGHT_FRAMES, Energies, Ledger, Sleep
from engine.kernel.data.model import Model
from engine.kernel.data.state import State
from engine.offline.effects import EFFECTS
from engine.offline.simulation import Simulation
from engine.offline.statistics import Activity
from engine.offline.statistics_base import Statistics
from engine.offline.stretching_record import StretchingRecord, StretchingStatistics
from engine.patch.accuracy import Accuracy
from engine.patch.frames import frame_count
from engine.patch.scene import Scene
from engine.runtime.job_memory import RENDER_USE, block_output
from engine.runtime.kernel_choice import prepare

TIMED_CHUNK_FRAMES = 4096

SOLVER_NAMES = {0: "none", 1: "scalar"}  # by contact points of an island; more have a vector solver
REASONS_LEFT_OUT = {
    "loss": "no body loses energy",
    "loss within the step": "no mode needs it",
    "restoring force": "no body has one",
    "gravity": "there is no gravity, or it acts on no body",
    "external force": "there is no external force",
    "one-way drive": "no string drives a body in one direction only",
    "contact": "no contact can close",
    "contact between bodies": "no two bodies can touch",
    "contact loss": "no contact has damping",
    "coupled contacts": "no island has several contact points",
    "friction": "nothing rubs",
    "connections": "no bodies are connected",
    "stretching": "no body stretches",
    "refinement": "each sample is one step",
    "events": "there are no events",
}


@dataclass(frozen=True)
class IslandProfile(Statistics):
    """An island, and what it costs; times in ns per sample."""

    bodies: list[str]
    modes: int
    modes_dropped: int  # too high for the sample rate
    modes_residual: int  # that stand for modes left out (engine.assembly.mode_counts)
    contacts: int  # points of contact
    solver: str
    energy: float  # J, that its bodies begin with
    activity: Activity
    ns_expected: float  # in contact
    ns_mean: float
    ns_busiest: float  # mean of the slowest chunk


@dataclass(frozen=True)
class Profile(Statistics):
    """The islands, effects and cost of a scene, by the names of `fdh inspect --json`."""

    kernel: str  # scenes with the same one share compiled code
    islands: list[IslandProfile]
    effects: dict[str, str]  # by name: compiled in, or why not
    contacts_left_out: list[str]  # each with the reason
    stretching: list[StretchingStatistics]  # of bodies that stretch
    warnings: list[str]  # of bodies that move further than their model holds
    friction: list[str]  # forces of bows beside their limits, and where forces come from


def profile_scene(
    scene: Scene,
    seconds: float,
    samplerate: int = 44_100,
    progress: Callable[[float], None] | None = None,
    **accuracy: Any,
) -> Profile:
    """Islands, effects and costs of a scene, measured over its first `seconds`.

    progress: called with the share measured, 0 to 1; first with 0, when the kernel is compiled
    accuracy: values of the scene's Accuracy to be replaced

    Times are in ns per sample, on one core, with the energies measured, as in a rendering. Raises BuildError.
    """
    settings = scene.accuracy.replace(**accuracy)
    model, state, layout = build(scene, samplerate, settings, seconds, one_partition_per_island=True)
    channels = scene.channels
    mean, worst = _measure_costs(model, state, frame_count(seconds, samplerate), channels, progress)
    record = None if model.tension is None else _record_stretching(scene, settings, seconds, samplerate)
    return Profile(
        kernel=kernel_id(model, state),
        islands=[_profile_island(layout, model, state, n, mean[n], worst[n]) for n in range(mean.size)],
        effects={
            name: "compiled in" if find(model) is not None else f"left out: {REASONS_LEFT_OUT[name]}"
            for name, find in EFFECTS.items()
        },
        contacts_left_out=_contacts_left_out(layout),
        stretching=[] if record is None else record.statistics(samplerate),
        warnings=[] if record is None else record.warnings(samplerate),
        friction=describe_friction(layout, model),
    )


def kernel_id(model: Model, state: State) -> str:
    """8 hexadecimal digits that name the kernel of a model: scenes with the same ones share its compiled code."""
    return hashlib.sha256(repr(kind_of((model, state))).encode()).hexdigest()[:8]


def _measure_costs(
    model: Model, state: State, frames: int, channels: int, progress: Callable[[float], None] | None
) -> tuple[np.ndarray, np.ndarray]:
    """Time of each island, ns per sample [islands]: its mean, and that of its slowest chunk."""
    count = model.islands.partition.size - 1
    audio, ledger = np.zeros((TIMED_CHUNK_FRAMES, channels)), np.zeros((len(Ledger), TIMED_CHUNK_FRAMES))
    (model_handle,), state_handle = prepare([model], state, [RENDER_USE]).handles()
    handles = model_handle, state_handle, StructHandle(block_output(audio, ledger, Energies.AT_EACH_SAMPLE))
    render_block = RENDER_USE.kernel.callable(handles[0].kind, handles[1].kind, *RENDER_USE.others)
    addresses = [handle.address for handle in handles]
    total, worst = np.zeros(count), np.zeros(count)
    for begin in range(0, frames, TIMED_CHUNK_FRAMES):
        if progress is not None:
            progress(begin / frames)
        length = min(TIMED_CHUNK_FRAMES, frames - begin)
        for n in range(count):
            start = time.perf_counter()
            render_block(*addresses, n, length)
            elapsed = (time.perf_counter() - start) * 1e9
            total[n] += elapsed
            worst[n] = max(worst[n], elapsed / length)
    return total / max(1, frames), worst


def _record_stretching(scene: Scene, settings: Accuracy, seconds: float, samplerate: int) -> StretchingRecord:
    """Render a scene once more, in short blocks, to see when its bodies stretch."""
    model, state, layout = built = build(scene, samplerate, settings, seconds)
    exchanges = scored_exchanges(scene, built, accuracy=settings, seconds=seconds)
    simulation = Simulation(model, state, measure_energy=False, exchanges=exchanges)
    record = StretchingRecord(simulation, state, layout, FLIGHT_FRAMES)
    audio = np.zeros((TIMED_CHUNK_FRAMES, scene.channels))
    frames = frame_count(seconds, samplerate)
    for begin in range(0, frames, TIMED_CHUNK_FRAMES):
        record.render_block(audio[: frames - begin])
    return record


def _profile_island(layout: Layout, model: Model, state: State, n: int, mean: float, worst: float) -> IslandProfile:
    """The profile of island n. mean, worst: its time, ns per sample"""
    frames = max(1, int(state.frame[n]))
    bodies = layout.islands.bodies[n]
    modal = [layout.modal_bodies[b] for b in bodies]
    contacts = int(model.islands.contact[n + 1] - model.islands.contact[n])
    touching, asleep = state.contact_samples[n] / frames, state.sleep[n, Sleep.SAMPLES_SLEPT] / frames
    return IslandProfile(
        bodies=[layout.scene.body[b].name for b in bodies],
        modes=int(layout.islands.mode_counts[n]),
        modes_dropped=sum(_modes_dropped(layout, b) for b in bodies),
        modes_residual=sum(body.residual for body in modal),
        contacts=contacts,
        solver=SOLVER_NAMES.get(contacts, "vector"),
        energy=float(sum(np.sum(body.p**2 + (body.omega * body.q) ** 2) / 2 for body in modal)),
        activity=Activity(float(1 - touching - asleep), float(touching), float(asleep)),
        ns_expected=float(estimate_cost(layout.islands.mode_counts, np.diff(layout.islands.contact_begins))[n]),
        ns_mean=float(mean),
        ns_busiest=float(worst),
    )


def _modes_dropped(layout: Layout, number: int) -> int:
    """Count the modes requested for a body that are left out, because they are too high for the sample rate."""
    body = layout.scene.body[number]
    requested = len(body.frequency or []) if isinstance(body, MeasuredBody) else getattr(body, "modes", None) or 0
    return max(0, requested - layout.modal_bodies[number].omega.size + layout.modal_bodies[number].residual)


def _contacts_left_out(layout: Layout) -> list[str]:
    """Contacts that were not built, each with the reason."""
    built = {k for k, _ in layout.islands.contact_points}
    names = []
    for k, contact in enumerate(layout.scene.contact):
        if k not in built:
            name = contact.name or f"contact[{k}]"
            names.append(f"{name}: {'no stiffness' if contact.stiffness == 0.0 else 'too little energy to close it'}")
    return names
