"""The motion of a scene by the measured step alone: every sample part by part, with each force measured from the
momenta that the bodies have by then. Nothing is flown or slept through, and no two passes are joined."""

from types import FunctionType
from typing import NamedTuple

import numpy as np
from measured_step import measured_step

import engine
from engine.assembly.build import build
from engine.compiler.array_view import row_view
from engine.compiler.decorators import INT64_0, INT64_1, inline, kernel
from engine.compiler.struct_handle import StructHandle
from engine.compiler.struct_types import load_struct
from engine.kernel.data.enums import CHUNK_FRAMES, FLIGHT_FRAMES, Energies, EventKind, ForceNumber, Ledger, StepKind
from engine.kernel.data.island_view import island_bounds, island_model, island_state
from engine.kernel.data.model import Model, StepSettings
from engine.kernel.data.state import State, Trace
from engine.kernel.interactions.contacts import reset_open_contacts, reset_solve_budget
from engine.kernel.interactions.one_way_drive import clear_drive
from engine.kernel.modes.event_dampers import step_with_dampers
from engine.kernel.run.events import run_score
from engine.kernel.run.pickups import add_pickups
from engine.kernel.run.refinement import composed_step
from engine.kernel.run.step import SAMPLE
from engine.kernel.run.trace_rows import Block, write_trace
from engine.offline.trace import allocate_trace
from engine.runtime.job_memory import block_output

_NAMES = composed_step.py_func.__globals__ | {"step": measured_step}
measured_sample_in_stages = inline(FunctionType(composed_step.py_func.__code__, _NAMES, "measured_sample_in_stages"))


@inline
def advance(refinement, model, state, frame):
    """A sample by measured steps. Returns a StepOutcome."""
    if refinement is None:
        h = step_with_dampers(model.step, state)
        return measured_step(model, StepSettings(h, StepKind.SAMPLE, False, frame, SAMPLE), state)
    else:
        return measured_sample_in_stages(model, refinement, state, frame)


@kernel
def render_measured(model_handle, state_handle, output_handle, frames):
    """Render the first frames of all islands."""
    model, state, output = load_struct(model_handle), load_struct(state_handle), load_struct(output_handle)
    audio, islands = row_view(output.audio, INT64_0), model.islands
    last = islands.mode.shape[0] - 1
    for begin in range(0, frames, CHUNK_FRAMES):
        end = min(begin + CHUNK_FRAMES, frames)
        clear_drive(model.drive, state.drive, (INT64_0, last), begin, end - begin)
        for n in range(last):
            bounds = island_bounds(islands, INT64_0, n)
            part, part_state = island_model(model, bounds), island_state(state, bounds)
            for frame in range(begin, end):
                if frame % FLIGHT_FRAMES == 1:
                    reset_solve_budget(part_state)
                    if part_state.in_contact[0] == 0:  # or the rounding of steps between contacts would add up
                        reset_open_contacts(part.contact, part_state)
                add_pickups(part, part_state, audio[frame], frame)
                write_trace(part, part_state, Block(output, bounds, INT64_0), frame, INT64_1)
                run_score(part, part.events, part_state, frame)
                outcome = advance(part.refinement, part, part_state, frame)
                part_state.in_contact[0] = outcome.in_contact
                part_state.law_evaluations[0] = outcome.evaluations


class Motion(NamedTuple):
    """Every sample of a scene."""

    audio: np.ndarray  # [frames, channels]
    trace: Trace  # its bodies in the order of the arrays
    order: np.ndarray  # of these, by the order of the patch


def disturb(model: Model, state: State, disturbance: float) -> None:
    """Change each displacement and momentum at time 0 by this share, of either sign; and forces and strikes."""
    rng = np.random.default_rng(0)
    for start in (state.q, state.p):
        start[:] *= 1.0 + disturbance * rng.choice([-1.0, 1.0], start.size)
    model.force.table[:] *= 1.0 + disturbance
    model.force.tail[:] *= 1.0 + disturbance
    if model.refinement is not None:  # the same in stages
        model.refinement.force.number[:, ForceNumber.AMPLITUDE] *= 1.0 + disturbance
        model.refinement.force.line[:] *= 1.0 + disturbance
    model.events.value2[model.events.kind == EventKind.STRIKE] *= 1.0 + disturbance
    model.events.value[model.events.kind == EventKind.PLUCK] *= 1.0 + disturbance


def measured_motion(scene: engine.Scene, seconds: float, samplerate: int = 44_100, disturbance: float = 0.0) -> Motion:
    """Compute a scene by measured steps.

    disturbance: relative change of the start, of external forces and of strikes
    """
    model, state, layout = build(scene, samplerate, scene.accuracy, seconds)
    if disturbance:
        disturb(model, state, disturbance)
    frames = round(seconds * samplerate)
    audio, trace = np.zeros((frames, scene.channels)), allocate_trace(model, frames)
    output = block_output(audio, np.zeros((len(Ledger), 0)), Energies.NEVER, trace)
    render_measured(StructHandle(model), StructHandle(state), StructHandle(output), frames)
    return Motion(audio, trace, np.array(layout.islands.body_order))
