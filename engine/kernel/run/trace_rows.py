"""Records of an island: rows of the ledger and of the trace."""

from typing import Any, NamedTuple

from engine.compiler.decorators import INT64_1, inline, noinline
from engine.kernel.data.enums import FLIGHT_FRAMES, Energies, EnergyTotal, Ledger, Wanted
from engine.kernel.interactions.connections import connection_energy, has_connections
from engine.kernel.interactions.contacts import contact_energy
from engine.kernel.interactions.island_energy import island_energies, write_ledger
from engine.kernel.interactions.near_contacts import compression_now
from engine.kernel.interactions.tension import stretching_energy
from engine.kernel.modes.free_flight import exchange_motion, step_saved_motion
from engine.kernel.modes.mode_energies import kinetic_and_potential
from engine.kernel.modes.point_rows import project


@inline
def wants_energies(output):
    """True if the ledger of a block is wanted."""
    return output.wanted[Wanted.ENERGIES] != 0


@inline
def wants_motion(output):
    """True if the trace of a block is wanted."""
    return output.wanted[Wanted.MOTION] != 0


class Block(NamedTuple):
    """A block of samples, to which one island adds its sound."""

    output: Any  # BlockOutput
    bounds: Any  # IslandBounds
    start: int  # frame of row 0


@noinline
def write_trace(model, state, block, begin, count):
    """Write `count` rows of the trace from `begin` on for an island."""
    trace, bounds, frame = block.output.trace, block.bounds, block.start + begin
    for i in range(begin, begin + count):
        for b in range(model.bodies.mode_begin.shape[0]):
            trace.displacement[i, bounds.body_begin + b] = project(model.bodies, b, state.q)
            trace.velocity[i, bounds.body_begin + b] = project(model.bodies, b, state.p)
        for k in range(state.compression.shape[0]):
            column = bounds.contact_begin + k
            trace.compression[i, column] = compression_now(model.contact, state, k, frame)
            trace.force[i, column] = state.contact_force[k]
        trace.iterations[i] += state.law_evaluations[0]
        kinetic, potential, _ = kinetic_and_potential(model, state)
        trace.kinetic[i] += kinetic
        trace.potential[i] += potential + connection_energy(model.connection, state)
        trace.potential[i] += stretching_energy(model, state)
        trace.contact[i] += contact_energy(state)
        trace.dissipated[i] += state.energy_totals[EnergyTotal.DISSIPATED]
        trace.supplied[i] += state.energy_totals[EnergyTotal.SUPPLIED]


@inline
def record_step(model, state, block, i, is_free):
    """Write row i of the ledger and of the trace, where these are wanted, before a step. Where nothing but connections
    acts, and in live sound, energies are those at the last check, as in a free flight: to measure them takes half a
    step."""
    output, is_first, frame = block.output, block.bounds.is_first, block.start + i
    if wants_energies(output):
        is_seldom = output.wanted[Wanted.ENERGIES] == Energies.AT_CHECKS
        if is_seldom or (is_free and has_connections(state)):
            if (frame - 1) % FLIGHT_FRAMES == 0 or frame == 0:
                keep_energies(model, state)
            write_kept_energies(output.ledger, i, INT64_1, is_first, state.flight.ledger)
        else:
            write_ledger(output.ledger, i, INT64_1, is_first, island_energies(model, state))
    if wants_motion(output):
        write_trace(model, state, block, i, INT64_1)


@inline
def record_sleep(model, state, block, i, count):
    """Write `count` rows from i on of samples that are slept through, where these are wanted. Energies are those at the
    begin of the sleep, or at the last check."""
    output = block.output
    if wants_energies(output):
        if (block.start + i - 1) % FLIGHT_FRAMES == 0:
            keep_energies(model, state)
        write_kept_energies(output.ledger, i, count, block.bounds.is_first, state.flight.ledger)
    if wants_motion(output):
        write_trace(model, state, block, i, count)


@inline
def keep_energies(model, state):
    """Keep the energies of an island for samples to come."""
    row = state.flight.ledger
    row[Ledger.BALANCE], row[Ledger.ABSOLUTE] = island_energies(model, state)


@inline
def record_flight(model, state, block, i, count):
    """Write `count` rows from i on of samples of a free flight, where these are wanted."""
    output = block.output
    if wants_energies(output):
        write_kept_energies(output.ledger, i, count, block.bounds.is_first, state.flight.ledger)
    if wants_motion(output):
        write_flown_motion(model, state, block, i, count)


@inline
def write_kept_energies(ledger, i, count, is_first, row):
    """Write the kept energies of an island to `count` samples of the ledger."""
    write_ledger(ledger, i, count, is_first, (row[Ledger.BALANCE], row[Ledger.ABSOLUTE]))


@inline
def write_flown_motion(model, state, block, begin, count):
    """Write rows of the trace in a free flight; single steps advance the saved motion."""
    for i in range(begin, begin + count):
        step_saved_motion(model.step, state.flight, block.start + i)
        exchange_motion(state)
        write_trace(model, state, block, i, INT64_1)
        exchange_motion(state)
        state.law_evaluations[0] = 0


@inline
def keep_evaluations(state, outcome):
    """Keep the evaluations of a step for the row of the trace at which the step ends."""
    state.law_evaluations[0] = outcome.evaluations
