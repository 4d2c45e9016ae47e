"""Dampers of events take a share of each momentum in every sample: half of it at either end of the step, as a part of
the modes' loss, or all of it at the end of a sample in stages."""

import math

from engine.compiler.decorators import inline, noinline
from engine.compiler.lanes import number_at, put_number, splat
from engine.kernel.data.enums import DampedModes, EnergyTotal, EventCursor, EventKind
from engine.kernel.data.model import ModalLoss, StepCoefficients
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
    forget_drift(state)


# --- as a part of the loss at the ends of a step


@inline
def add_dampers_to_loss(loss, state):
    """Find the loss at either end of a step with half of what the dampers of events take: `momentum_kept`.

    loss: ModalLoss of a step, or None
    """
    if loss is not None:
        decay, dissipation = state.damped_decay_factor, state.damped_dissipation_factor
        for m in range(decay.shape[0]):
            decay[m], dissipation[m] = loss.decay_factor[m], loss.dissipation_factor[m]
            if state.momentum_kept[m] != 1.0:
                decay[m] *= math.sqrt(state.momentum_kept[m])
                dissipation[m] = 0.5 * (1.0 - decay[m]) * (1.0 + decay[m])


@inline
def acts_in_steps(refinement, loss):
    """True if the dampers of events are a part of the loss of steps: at no cost while they act. Samples in stages have
    loss of their own, and a scene may have none."""
    if refinement is None:
        return loss is not None
    return False


@inline
def step_with_dampers(h, loss, events, state):
    """Return the coefficients of a step of a whole sample, with the dampers of events that act. h: StepCoefficients"""
    if events is None:
        return h
    if loss is None:
        return h
    decay, dissipation = loss.decay_factor, loss.dissipation_factor
    if is_damping(events, state):
        decay, dissipation = state.damped_decay_factor, state.damped_dissipation_factor
    damped = ModalLoss(decay, dissipation)
    return StepCoefficients(
        h.kick, h.drift, h.spring_kick, h.weight_kick, damped, h.drag, h.connection, h.contact, h.force
    )


# --- by themselves


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
