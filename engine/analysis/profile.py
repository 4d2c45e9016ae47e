"""Profile of a scene: what was built of it, what was left out and why, and what each island costs."""

import hashlib
import math
import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from engine.analysis.bowing import describe_friction
from engine.assembly.build import build
from engine.assembly.layout import Layout
from engine.assembly.scored_changes import scored_tables
from engine.assembly.subsystems import estimate_cost
from engine.bodies import MeasuredBody
from engine.compiler.kernel_name import KernelName
from engine.compiler.struct_handle import StructHandle
from engine.kernel.data.axes import map_arrays
from engine.kernel.data.effects import STRETCHING
from engine.kernel.data.enums import FLIGHT_FRAMES, Energies, Ledger, Sleep
from engine.kernel.data.model import Model
from engine.kernel.data.state import State
from engine.offline.effects import effects_of
from engine.offline.large_motion import LargeMotion, MotionRecord
from engine.offline.recorder import Recorder
from engine.offline.simulation import Simulation
from engine.offline.statistics import Activity
from engine.offline.statistics_base import Statistics
from engine.offline.stretching_record import StretchingRecord, StretchingStatistics
from engine.patch.accuracy import Accuracy
from engine.patch.frames import frame_count
from engine.patch.scene import Scene
from engine.runtime.job_memory import RENDER_USE, block_output
from engine.runtime.kernel_choice import prepare

TIMED_BLOCK_FRAMES = 256  # of which the slowest is the worst case: a usual block of live sound
TIMED_RUNS = 2  # of each block: what else the machine does seldom slows both
TIMED_EMPTY_CALLS = 10  # of which the fastest is what a call costs
BLOCKS_PER_REPORT = 16  # of progress
MOTION_BLOCK_FRAMES = 4096

SOLVER_NAMES = {0: "none", 1: "scalar"}  # by contact points of an island; more have a vector solver
NOT_THERE = "the scene has none"
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
    ns_expected: float  # a rough number by modes and contacts, which islands are shared out among cores by
    ns_mean: float
    ns_busiest: float  # of the slowest block of TIMED_BLOCK_FRAMES


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
    mean, worst, energy = _measure_costs(model, state, frame_count(seconds, samplerate), channels, progress)
    motion, stretching, effects = None, None, effects_of(model)
    if model.effects & STRETCHING or LargeMotion(model, state, layout).may_be_large(energy):
        motion, stretching = _record_motion(scene, settings, seconds, samplerate)
    return Profile(
        kernel=kernel_id(model, state),
        islands=[_profile_island(layout, model, state, n, mean[n], worst[n]) for n in range(mean.size)],
        effects=dict.fromkeys(effects.compiled, "compiled in")
        | {name: f"left out: {REASONS_LEFT_OUT.get(name, NOT_THERE)}" for name in effects.left_out},
        contacts_left_out=_contacts_left_out(layout),
        stretching=[] if stretching is None else stretching.statistics(samplerate),
        warnings=[] if motion is None else motion.warnings(samplerate),
        friction=describe_friction(layout, model),
    )


def kernel_id(model: Model, state: State) -> str:
    """8 hexadecimal digits that name the special kernel of a model: scenes with the same effects share it."""
    return hashlib.sha256(repr(prepare([model], state, KernelName.SPECIAL).kinds).encode()).hexdigest()[:8]


def _measure_costs(
    model: Model, state: State, frames: int, channels: int, progress: Callable[[float], None] | None
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Time of each island, ns per sample [islands]: its mean, and that of its slowest block; and its largest energy, J,
    each part of it without sign. Of each block, the faster of TIMED_RUNS counts, without the cost of its call."""
    count = model.islands.partition.size - 1
    times, energy = np.full((math.ceil(frames / TIMED_BLOCK_FRAMES), count), np.inf), np.zeros(count)
    for run in range(TIMED_RUNS):
        begun = state if run == TIMED_RUNS - 1 else map_arrays(lambda array, items: array.copy(), state)
        share = None if progress is None else lambda done, run=run: progress((run + done) / TIMED_RUNS)
        taken, energy = _time_blocks(model, begun, frames, channels, share)
        times = np.minimum(times, taken)
    lengths = np.full(len(times), TIMED_BLOCK_FRAMES)
    lengths[-1] = frames - TIMED_BLOCK_FRAMES * (len(times) - 1)
    return times.sum(axis=0) / frames, (times / lengths[:, None]).max(axis=0), energy


def _time_blocks(
    model: Model, state: State, frames: int, channels: int, progress: Callable[[float], None] | None
) -> tuple[np.ndarray, np.ndarray]:
    """Time of each block of each island, ns [blocks, islands], and the largest energy of each island, J [islands]."""
    count = model.islands.partition.size - 1
    audio, ledger = np.zeros((TIMED_BLOCK_FRAMES, channels)), np.zeros((len(Ledger), TIMED_BLOCK_FRAMES))
    (model_handle,), state_handle = prepare([model], state).handles()
    handles = model_handle, state_handle, StructHandle(block_output(audio, ledger, Energies.AT_EACH_SAMPLE))
    render_block = RENDER_USE.kernel.callable(handles[0].kind, handles[1].kind, *RENDER_USE.others)
    addresses = [handle.address for handle in handles]

    def time_block(n: int, length: int) -> float:
        start = time.perf_counter()
        render_block(*addresses, n, length)
        return (time.perf_counter() - start) * 1e9

    if progress is not None:
        progress(0.0)
    call = min(time_block(0, 0) for _ in range(TIMED_EMPTY_CALLS))
    times, energy = np.zeros((math.ceil(frames / TIMED_BLOCK_FRAMES), count)), np.zeros(count)
    for row, begin in enumerate(range(0, frames, TIMED_BLOCK_FRAMES)):
        length = min(TIMED_BLOCK_FRAMES, frames - begin)
        for n in range(count):
            times[row, n] = max(1.0, time_block(n, length) - call)
            energy[n] = max(energy[n], float(ledger[Ledger.ABSOLUTE, :length].max()))
        if progress is not None and row % BLOCKS_PER_REPORT == 0:
            progress(begin / frames)
    return times, energy


def _record_motion(
    scene: Scene, settings: Accuracy, seconds: float, samplerate: int
) -> tuple[LargeMotion, StretchingRecord | None]:
    """Render a scene once more, in short blocks, to see how far its bodies move, and when they stretch."""
    model, state, layout = built = build(scene, samplerate, settings, seconds)
    tables = scored_tables(scene, built, accuracy=settings, seconds=seconds)
    simulation = Simulation(model, state, measure_energy=False, tables=tables)
    motion = LargeMotion(model, state, layout)
    record: Recorder = MotionRecord(simulation, motion)
    stretching = None
    if model.effects & STRETCHING:
        record = stretching = StretchingRecord(record, state, layout, FLIGHT_FRAMES)
    audio = np.zeros((MOTION_BLOCK_FRAMES, scene.channels))
    frames = frame_count(seconds, samplerate)
    for begin in range(0, frames, MOTION_BLOCK_FRAMES):
        record.render_block(audio[: frames - begin])
    return motion, stretching


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
