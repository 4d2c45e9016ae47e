"""The only sample loop. Offline rendering, live sound, bench and tests all run it.

Any block size gives the same samples, bit for bit: nothing here depends on where a block begins. Sample i shows the
scene before step i; sample 0 is the initial state.
"""

import numpy as np

from engine.compiler.array_view import row_view, slice_view
from engine.compiler.decorators import INT64_0, TRUE, inline, kernel
from engine.compiler.struct_types import load_struct
from engine.kernel.data.enums import CHUNK_FRAMES, FLIGHT_FRAMES, EnergyTotal, FlightFrame, Sleep, StepKind
from engine.kernel.data.island_view import island_bounds, island_model, island_state
from engine.kernel.data.model import StepSettings
from engine.kernel.data.state import BlockOutput
from engine.kernel.interactions.contacts import (
    has_contacts,
    invalidate_margins,
    reset_open_contacts,
    reset_solve_budget,
)
from engine.kernel.interactions.external_forces import has_external_forces
from engine.kernel.interactions.island_energy import energy_of_vibration
from engine.kernel.interactions.near_contacts import find_if_all_open
from engine.kernel.interactions.one_way_drive import clear_drive
from engine.kernel.interactions.stretching_choice import let_stretch, update_stretching, update_touched
from engine.kernel.interactions.tension import stretches
from engine.kernel.modes.event_dampers import is_event_active, step_with_dampers
from engine.kernel.modes.free_flight import begin_flight, end_flight
from engine.kernel.modes.mode_step import flush_denormals, forget_drift
from engine.kernel.modes.ordered_sums import accumulate
from engine.kernel.run.events import next_due, run_score
from engine.kernel.run.fade import end_fade
from engine.kernel.run.pickups import add_flown_pickups, add_pickups
from engine.kernel.run.refinement import refined_step
from engine.kernel.run.sleep import (
    advance_free_masses,
    extend_sleep,
    free_mass_moves,
    samples_to_sleep,
    skip_chunk,
    try_sleep,
)
from engine.kernel.run.step import SAMPLE, are_modes_independent, step
from engine.kernel.run.trace_rows import (
    Block,
    keep_evaluations,
    record_flight,
    record_sleep,
    record_step,
    wants_energies,
    wants_motion,
)

SLEEP_CHECK_PERIOD = np.int64(8 * FLIGHT_FRAMES)
LONG_SLEEP_FRAMES = np.int64(64 * 64)  # samples an island sleeps at a time if nothing in it moves
CHECK_PERIOD = np.int64(FLIGHT_FRAMES)  # samples; out of contact, compressions are read from the modes this often


# --- a step


@inline
def advance(refinement, model, state, frame, is_free, in_contact):
    """Advance a sample of one island: in stages where forces may act, if the scene has stages. Returns a StepOutcome.

    refinement: None without stages
    is_free:    True if nothing but its connections can act on it
    in_contact: True if the step before had a contact in reach
    """
    is_free = is_free or not (has_contacts(state) or has_external_forces(model.force))
    if refinement is not None:
        if is_free and are_modes_independent(state):
            return step(model, StepSettings(model.step, StepKind.SAMPLE, TRUE, frame, SAMPLE), state)
        return refined_step(model, state, frame, in_contact)
    h = step_with_dampers(model.step, state)
    return step(model, StepSettings(h, StepKind.SAMPLE, is_free, frame, SAMPLE), state)


@inline
def count_energy(outcome, state):
    """Add the energy that a step dissipated, and that it was supplied with, to the totals of the island."""
    accumulate(state.energy_totals, EnergyTotal.DISSIPATED, outcome.dissipated)
    if outcome.supplied != 0.0:
        accumulate(state.energy_totals, EnergyTotal.SUPPLIED, outcome.supplied)


# --- periodic checks, and sleep


@inline
def plan_free_flight(model, state, frame):
    """Find out, after the step of this frame, whether anything can act on the island up to the next check.

    If not, its steps need no test for contact until something is due. The island flies free, or sleeps if nothing
    vibrates either. Whatever is due makes no difference before its frame, because it may become known no sooner.
    """
    due = next_due(model.force, model.events, state, frame)
    if due > frame:
        invalidate_margins(state.refinement)  # falling masses are faster by now
        update_stretching(model, state)
        if stays_open(model, state):
            until = min(due, frame + 1 + CHECK_PERIOD)
            state.contact_free_until[0] = until
            may_fly = not is_event_active(state) and are_modes_independent(state)
            if not let_sleep(model, state, frame, until) and may_fly:
                state.flight.frame[FlightFrame.END] = frame + 1 + CHECK_PERIOD


@inline
def let_sleep(model, state, frame, until):
    """Let the island, whose contacts cannot close, sleep up to a frame if its vibration and sound have died out. An
    island that is awake is examined only now and then. Returns True if it sleeps."""
    slept = state.sleep[Sleep.WAKE_FRAME] == frame + 1
    if frame % SLEEP_CHECK_PERIOD != 0 and not slept:
        return False
    flush_denormals(state.q, state.p)
    forget_drift(state)
    return try_sleep(model, state, until, energy_of_vibration(model, state))


@inline
def stays_open(model, state):
    """True if no contact can close before the next check."""
    if has_contacts(state):
        return not stretches(state) and find_if_all_open(model, is_event_active(state), state)
    return True


@inline
def update_before_sample(model, state, frame):
    """Update the island before the sample of a frame. Out of contact, read compressions from the modes and end a
    flight: at every check, and where something is due or bodies have separated. At a check, also plan ahead."""
    is_check = frame % CHECK_PERIOD == 1
    if is_check:
        reset_solve_budget(state)
    wakes_at = state.sleep[Sleep.WAKE_FRAME]
    if frame >= wakes_at and state.in_contact[0] == 0 and frame > 0:
        is_planned = frame == state.contact_free_until[0]
        if is_check or is_planned:
            end_flight(model, state, frame)
            reset_open_contacts(model.contact, state)
            if is_check:
                end_fade(model, state, frame)
                plan_free_flight(model, state, frame - 1)
                if frame >= state.contact_free_until[0]:
                    update_touched(model, state, frame)
        if not is_check and (is_planned or frame == wakes_at):
            if next_due(model.force, model.events, state, frame - 1) <= frame:
                let_stretch(model, state)
    elif is_check and state.in_contact[0] != 0:
        end_fade(model, state, frame)
        update_touched(model, state, frame)


@inline
def finish_sleep(model, state, frame, slept):
    """Update the island after samples slept through. Free masses have moved on and may be near; if none moves and the
    sleep is over, find out whether anything is due."""
    last = frame + slept - 1
    if free_mass_moves(model, state):
        advance_free_masses(model.step, model.free_masses, state, slept)
    elif state.sleep[Sleep.WAKE_FRAME] == last + 1:
        extend_sleep(model.force, model.events, state, last + 1, LONG_SLEEP_FRAMES)


# --- the loop


@kernel
def render_block(model, state, output, partition, frames):
    """Render the next samples of one partition of the scene; engine.runtime.partitions adds up the partitions.

    model, state, output: StructHandle of a Model, a State and a BlockOutput
    partition: its number; partitions have nothing in common, and may run at the same time
    frames:    number of samples; they fill the first rows of the output
    """
    render_partition(load_struct(model), load_struct(state), output_view(load_struct(output)), partition, frames)


@inline
def output_view(output):
    """Return a BlockOutput of views, whose indices are not tested for negative ones."""
    ledger, wanted = row_view(output.ledger, INT64_0), slice_view(output.wanted, INT64_0, output.wanted.shape[0])
    return BlockOutput(row_view(output.audio, INT64_0), ledger, output.trace, wanted)


@inline
def render_partition(model, state, output, partition, frames):
    """Render the next samples of one partition of the scene. model, state, output: records, `output` one of views"""
    clear_audio(output.audio, frames)
    islands, is_recorded = model.islands, wants_energies(output) or wants_motion(output)
    first, last = islands.partition[partition], islands.partition[partition + 1]
    for begin in range(0, frames, CHUNK_FRAMES):
        end = min(begin + CHUNK_FRAMES, frames)
        start = state.frame[partition] - begin  # of the block
        clear_drive(model.drive, state.drive, (first, last), start + begin, end - begin)
        for n in range(first, last):
            if not is_recorded and skip_chunk(state.sleep, n, start + begin, end - begin):
                continue
            bounds = island_bounds(islands, partition, n)
            part, part_state = island_model(model, bounds), island_state(state, bounds)
            render_chunk(part, part_state, Block(output, bounds, start), begin, end)
        state.frame[partition] += end - begin


@inline
def clear_audio(audio, frames):
    """Set the rows of a block to zero."""
    for i in range(frames):
        row = audio[i]
        for channel in range(row.shape[0]):
            row[channel] = 0.0


@inline
def render_chunk(model, state, block, begin, end):
    """Render rows begin:end of a block for one island."""
    i = begin
    while i < end:
        frame = block.start + i
        update_before_sample(model, state, frame)
        is_flight_traced = wants_motion(block.output) and free_mass_moves(model, state)
        count = samples_to_sleep(state, frame, 1 if is_flight_traced else end - i)
        if count > 0:
            record_sleep(model, state, block, i, count)
            finish_sleep(model, state, frame, count)
        else:
            count = samples_to_fly(state, frame, end - i)
            if count > 0:
                render_flight(model, state, block, i, count)
            else:
                count = samples_to_step(state, frame, end - i)
                count = render_steps(model, state, block, i, count)
        i += count


@inline
def samples_to_step(state, frame, most):
    """Return how many samples, `most` at most, are stepped through in the same way: up to the next check, or to where
    forces may act again."""
    count = min(most, CHECK_PERIOD - (frame - 1) % CHECK_PERIOD)
    until = state.contact_free_until[0]
    return min(count, until - frame) if frame < until else count


@inline
def render_steps(model, state, block, i, count):
    """Render up to `count` rows of a block from row i on, step by step, until bodies separate. Returns the number of
    rows."""
    output, frame = block.output, block.start + i
    is_free, was_in_contact = frame < state.contact_free_until[0], state.in_contact[0] != 0
    for n in range(count):
        add_pickups(model, state, output.audio[i + n], frame + n)
        record_step(model, state, block, i + n, is_free)
        run_score(model, model.events, state, frame + n)
        outcome = advance(model.refinement, model, state, frame + n, is_free, was_in_contact)
        if wants_energies(output):
            count_energy(outcome, state)
        keep_evaluations(state, outcome)
        if outcome.in_contact:
            state.contact_samples[0] += 1
        elif was_in_contact:
            state.in_contact[0] = 0
            state.contact_free_until[0] = frame + n + 1
            return n + 1
        was_in_contact = outcome.in_contact
    state.in_contact[0] = was_in_contact
    return count


@inline
def samples_to_fly(state, frame, most):
    """Return how many samples, `most` at most, the island flies free from this frame on."""
    if frame >= state.flight.frame[FlightFrame.END]:
        return INT64_0
    return min(most, state.contact_free_until[0] - frame)


@inline
def render_flight(model, state, block, i, count):
    """Render `count` rows of a block from row i on for an island that flies free."""
    output, frame = block.output, block.start + i
    end = state.flight.frame[FlightFrame.END]
    first = frame - (end - CHECK_PERIOD)
    if first == 0:
        begin_flight(model, state, wants_energies(output), frame)
    span = (first, first + count)
    add_flown_pickups(model, state, output.audio, i, span, frame)
    record_flight(model, state, block, i, count)
