"""Dampers of events: they take a share of each momentum at the end of every sample."""

import math

from engine.compiler.decorators import inline, noinline
from engine.compiler.lanes import number_at, put_number, splat
from engine.kernel.data.enums import DampedModes, EnergyTotal, EventCursor, EventKind
from engine.kernel.modes.mode_step import forget_drift
from engine.kernel.modes.ordered_sums import accumulate, fold


@noinline
def find_momentum_kept(events, state):
    """Find the share of each momentum that the dampers of the events that go on leave in a step."""
    cursor, kept = state.event_cursor, state.momentum_kept
    for m in range(kept.shape[0]):
        kept[m] = 1.0
    cursor[EventCursor.DAMPED] = DampedModes.NONE
    for j in range(cursor[EventCursor.FIRST_ACTIVE], cursor[EventCursor.NEXT]):
        if events.kind[j] == EventKind.DAMP:
            cursor[EventCursor.DAMPED] = DampedModes.SOME
            for m in range(events.target_begin[j], events.target_end[j]):
                kept[m] *= events.value[j]


@inline
def damp_mode(m, kept, p):
    """Leave this share of the momentum of mode m. Returns the energy lost, J."""
    before = number_at(p, m)
    put_number(p, m, kept * before)
    return 0.5 * (1.0 - kept) * (1.0 + kept) * before * before


@inline
def add_damped(of, m, sums):
    """Damp mode m for a sample, and add the energy lost to the sums."""
    kept, p = of
    return (sums[0] + damp_mode(m, number_at(kept, m), p),)


@inline
def add_half_damped(of, m, sums):
    """Damp mode m for half a sample, and add the energy lost to the sums."""
    kept, p = of
    return (sums[0] + damp_mode(m, math.sqrt(number_at(kept, m)), p),)


@noinline
def damp_modes(state):
    """Let the dampers of events act for a whole sample at its end: the half of it that belongs to the next sample would
    come at the same place. The energy lost counts as dissipated."""
    lost = fold(add_damped, (state.momentum_kept, state.p), state.p.shape[0], (splat(0.0),))[0]
    forget_drift(state)
    accumulate(state.energy_totals, EnergyTotal.DISSIPATED, lost)


@noinline
def damp_modes_by_half(state):
    """Let the dampers of events act for half a sample. The energy lost counts as dissipated."""
    lost = fold(add_half_damped, (state.momentum_kept, state.p), state.p.shape[0], (splat(0.0),))[0]
    forget_drift(state)
    accumulate(state.energy_totals, EnergyTotal.DISSIPATED, lost)


@inline
def is_event_active(state):
    """True if an event has begun and is not over."""
    return state.event_cursor[EventCursor.FIRST_ACTIVE] < state.event_cursor[EventCursor.NEXT]


@inline
def is_damping(events, state):
    """True if dampers of events act."""
    if events is None:
        return False
    return is_event_active(state) and state.event_cursor[EventCursor.DAMPED] == DampedModes.SOME
