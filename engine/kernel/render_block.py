"""The only sample loop. Offline rendering, live sound, bench and tests all run it.

Any block size gives the same samples, bit for bit: nothing here depends on where a block
begins. Sample i is what the scene is like before step i; sample 0 is the initial state.
"""

from typing import Any

import numpy as np

from engine.compiler.decorators import FALSE, INT64_0, INT64_1, inline, kernel
from engine.compiler.overloads import overload_by_type
from engine.compiler.struct_handle import load_struct
from engine.kernel.codes import EnergyTotal, Quantity, Sleep
from engine.kernel.contacts import (
    cannot_close,
    compression_from_modes,
    contact_energy,
    invalidate_margins,
    reset_line_search_budget,
    resync_open_contacts,
)
from engine.kernel.energy import accumulate, kinetic_and_potential, write_ledger
from engine.kernel.events import finish_score, no_event_within, run_score
from engine.kernel.external_forces import no_force_within
from engine.kernel.island_view import island_bounds, island_model, island_state
from engine.kernel.model import Refinement
from engine.kernel.modes import bound_modal_displacements, flush_denormals, free_step, project
from engine.kernel.refinement import refined_step
from engine.kernel.sleep import (
    advance_free_masses,
    extend_sleep,
    free_mass_moves,
    samples_to_sleep,
    skip_chunk,
    track_peak,
    try_sleep,
)
from engine.kernel.step import StepOutcome, step

CHUNK_FRAMES = 256  # samples an island runs before the next one does: small enough for the fast cache
LONG_SLEEP_FRAMES = np.int64(64 * 64)  # samples an island sleeps at a time if nothing in it moves
CHECK_PERIOD = np.int64(64)  # samples; out of contact, compressions are read anew from the modes this often


# --- a step


@inline
def advance(model, contact, force, state, frame, in_contact):
    """One step of one island, the short way where nothing can act on it. Returns a StepOutcome.

    in_contact: whether the step before had a contact in reach
    """
    if contact is None:
        if force is None:
            return advance_free(model, state)
    if frame < state.contact_free_until[0]:
        return advance_free(model, state)
    return advance_forced(model.refinement, model, state, frame, in_contact)


def advance_forced(refinement: Any, model: Any, state: Any, frame: int, in_contact: bool) -> StepOutcome:
    """One step in which forces may act: in stages, if there is refinement. In compiled code only."""
    raise TypeError("advance_forced is for compiled code")


overload_by_type(
    advance_forced,
    {  # chosen by type, so that the other is not compiled
        type(None): lambda refinement, model, state, frame, in_contact: step(
            model.contact, model.force, model.weight, model.step, state, frame
        ),
        Refinement: lambda refinement, model, state, frame, in_contact: refined_step(
            model, model.force, refinement, state, frame, in_contact
        ),
    },
)


@inline
def advance_free(model, state):
    """One step in which no force can act. Returns a StepOutcome."""
    lost = free_step(model.step, model.weight, state.kick_compensation, state.q, state.p)
    return StepOutcome(FALSE, INT64_0, lost, 0.0)


@inline
def count_energy(outcome, state, ledger):
    """Add what a step dissipated and was supplied with to the totals of the island, where energies are measured."""
    if ledger is not None:
        accumulate(state.energy_totals, EnergyTotal.DISSIPATED, outcome.dissipated)
        if outcome.supplied != 0.0:
            accumulate(state.energy_totals, EnergyTotal.SUPPLIED, outcome.supplied)


# --- periodic checks, and sleep


@inline
def plan_free_flight(model, state, frame):
    """Find out whether anything can act on the island in the steps up to the next check.

    If not, they need no test for contact and go through the modes once instead of twice; and if
    nothing vibrates either, the island sleeps.
    """
    quiet = no_force_within(model.force, frame + 1, CHECK_PERIOD)
    if quiet and no_event_within(model.events, state, frame + 1, CHECK_PERIOD):
        span = CHECK_PERIOD / model.samplerate
        invalidate_margins(state.refinement)  # falling masses are faster by now
        energy = bound_modal_displacements(
            model.omega_squared, model.weight, state.q, state.p, span, state.displacement_bound
        )
        if cannot_close(model.contact, state):
            state.contact_free_until[0] = frame + CHECK_PERIOD + 1
            try_sleep(model.sleep_threshold, model.weight, model.free_masses, state, frame, CHECK_PERIOD, energy)


@inline
def check_periodically(model, state, frame, in_contact, was_in_contact):
    """After a step: count samples in contact, and out of contact, on the scene's own grid of samples, read
    the compressions anew and plan ahead."""
    if in_contact:
        state.contact_samples[0] += 1
    elif was_in_contact or frame % CHECK_PERIOD == 0:
        resync_open_contacts(model.contact, state)
        flush_denormals(model.step.loss, state.q, state.p)
        if frame % CHECK_PERIOD == 0:
            plan_free_flight(model, state, frame)
    if frame % CHECK_PERIOD == 0:
        reset_line_search_budget(state.scratch, state)


@inline
def max_sleep(model, state, ledger, trace, remaining):
    """How many samples may be slept through at once: one, if the flight of a mass is to be recorded."""
    if ledger is None:
        if trace is None:
            return remaining
    return 1 if free_mass_moves(model.weight, model.free_masses, state) else remaining


@inline
def finish_sleep(model, state, frame, slept):
    """After samples slept through: free masses have moved on and may be near; else, once the sleep is over,
    see whether anything is due."""
    last = frame + slept - 1
    if free_mass_moves(model.weight, model.free_masses, state):
        advance_free_masses(model.step, model.weight, model.free_masses, state, slept)
        if last % CHECK_PERIOD == 0:
            check_periodically(model, state, last, FALSE, FALSE)
    elif state.sleep[Sleep.WAKE_FRAME] == last + 1:
        if state.sleep[Sleep.FORCED] != 0:  # what it was put to sleep until is due
            state.sleep[Sleep.FORCED] = 0
            return
        extend_sleep(model.force, model.events, state, last + 1, LONG_SLEEP_FRAMES)
        if state.sleep[Sleep.WAKE_FRAME] <= last + 1:
            extend_sleep(model.force, model.events, state, last + 1, CHECK_PERIOD)


# --- what is heard and recorded


@inline
def pickup_value(pickups, state, samplerate, n):
    """What pickup n gives at this sample."""
    quantity = pickups.quantity[n]
    if quantity == Quantity.VELOCITY:
        return project(pickups.rows, n, state.p)
    if quantity == Quantity.DISPLACEMENT:
        return project(pickups.rows, n, state.q)
    if quantity == Quantity.ACCELERATION:  # its mean over the step that ends here
        velocity = project(pickups.rows, n, state.p)
        change = (velocity - state.previous_velocity[n]) * samplerate
        state.previous_velocity[n] = velocity
        return change
    value = 0.0
    for i in range(pickups.contact_begin[n], pickups.contact_end[n]):
        value += pickups.contact_sign[i] * state.contact_force[pickups.contact[i]]
    return value


@inline
def add_pickups(pickups, state, samplerate, audio, i):
    """Add what the pickups hear to row i of the audio."""
    for n in range(pickups.quantity.shape[0]):
        value = pickup_value(pickups, state, samplerate, n) * pickups.gain[n]
        track_peak(state, value)
        audio[i, pickups.channel[n]] += value


@inline
def write_trace(trace, begin, count, bounds, model, state, frame):
    """Write `count` rows of the trace from `begin` on for an island."""
    for i in range(begin, begin + count):
        for b in range(model.bodies.mode_begin.shape[0]):
            trace.displacement[i, bounds.body_begin + b] = project(model.bodies, b, state.q)
            trace.velocity[i, bounds.body_begin + b] = project(model.bodies, b, state.p)
        for k in range(state.compression.shape[0]):
            column = bounds.contact_begin + k
            trace.compression[i, column] = traced_compression(model.contact, state, k, frame)
            trace.force[i, column] = state.contact_force[k]
        trace.iterations[i] += state.law_evaluations[0]
        kinetic, potential, _ = kinetic_and_potential(model.omega_squared, model.weight, state.q, state.p)
        trace.kinetic[i] += kinetic
        trace.potential[i] += potential
        trace.contact[i] += contact_energy(model.contact, state)
        trace.dissipated[i] += state.energy_totals[EnergyTotal.DISSIPATED]
        trace.supplied[i] += state.energy_totals[EnergyTotal.SUPPLIED]


@inline
def traced_compression(contact, state, k, frame):
    """Compression k, m; where contacts are known to stay open it is read from the modes, for it is not kept."""
    if contact is not None:
        if frame < state.contact_free_until[0]:
            return compression_from_modes(contact, contact.other_rows, state, k)
    return state.compression[k]


@inline
def record(output, i, count, bounds, model, state, frame):
    """Write `count` rows of the ledger and of the trace from i on, where these are asked for."""
    write_energies(output.ledger, i, count, bounds.is_first, model, state)
    write_motion(output.trace, i, count, bounds, model, state, frame)


@inline
def write_energies(ledger, i, count, is_first, model, state):
    """Write rows of the ledger, if there is one."""
    if ledger is not None:
        write_ledger(ledger, i, count, is_first, model, state)


@inline
def write_motion(trace, i, count, bounds, model, state, frame):
    """Write rows of the trace, if there is one."""
    if trace is not None:
        write_trace(trace, i, count, bounds, model, state, frame)


# --- the loop


@kernel
def render_block(model, state, output, partition, frames):
    """Render the next samples of one partition of the scene; engine.offline.simulation adds the partitions.

    model, state, output: StructHandle of a Model, a State and a BlockOutput
    partition: its number; partitions have nothing in common, and may run at the same time
    frames:    how many samples; they fill the first rows of the output
    """
    render_partition(load_struct(model), load_struct(state), load_struct(output), partition, frames)


@inline
def render_partition(model, state, output, partition, frames):
    """As `render_block`, of what the handles point to."""
    output.audio[:frames] = 0.0
    islands = model.islands
    first, last = islands.partition[partition], islands.partition[partition + 1]
    for begin in range(0, frames, CHUNK_FRAMES):
        end = min(begin + CHUNK_FRAMES, frames)
        start = state.frame[partition] - begin  # of the block
        for n in range(first, last):
            if skip_chunk(state.sleep, n, start + begin, end - begin, output.ledger, output.trace):
                continue
            bounds = island_bounds(islands, partition, n)
            part, part_state = island_model(model, state, bounds), island_state(state, bounds)
            render_chunk(part, part_state, output, bounds, start, begin, end)
        state.frame[partition] += end - begin


@inline
def render_chunk(model, state, output, bounds, start, begin, end):
    """Render rows begin:end of a block for one island; sample i has frame start + i."""
    in_contact = state.in_contact[0] != 0
    i = begin
    while i < end:
        frame = start + i
        slept = samples_to_sleep(state, frame, max_sleep(model, state, output.ledger, output.trace, end - i))
        if slept > 0:
            record(output, i, slept, bounds, model, state, frame)
            finish_sleep(model, state, frame, slept)
            i += slept
            continue
        add_pickups(model.pickups, state, model.samplerate, output.audio, i)
        record(output, i, INT64_1, bounds, model, state, frame)
        run_score(model, model.events, state, frame)
        was_in_contact = in_contact
        outcome = advance(model, model.contact, model.force, state, frame, was_in_contact)
        count_energy(outcome, state, output.ledger)
        in_contact = outcome.in_contact
        finish_score(model.events, state, frame)
        check_periodically(model, state, frame, in_contact, was_in_contact)
        keep_evaluations(output.trace, state, outcome)
        i += 1
    state.in_contact[0] = in_contact


@inline
def keep_evaluations(trace, state, outcome):
    """Keep the evaluations of a step for the row of the trace that the step ends at."""
    if trace is not None:
        state.law_evaluations[0] = outcome.evaluations
