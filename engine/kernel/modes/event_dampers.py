"""Dampers of events take a share of each momentum in every step, half of it at either end: of a sample in one step as a
part of the modes' loss, which costs nothing; of stages by themselves. In steps of order 4 and 6 they act where
connections and contacts lose (engine.assembly.refinement.loss_times)."""

import math
from typing import Any

from engine.compiler.decorators import inline, noinline
from engine.compiler.elementary import power_of
from engine.compiler.overloads import overload_by_source
from engine.kernel.data.effects import EFFECTS, EVENTS
from engine.kernel.data.enums import DampedModes, EnergyTotal, EventCursor, EventKind
from engine.kernel.data.model import ModalLoss, StepCoefficients
from engine.kernel.modes.mode_step import forget_drift
from engine.kernel.modes.ordered_sums import accumulate


@inline
def find_damped_loss(events, loss, refinement, state):
    """Find the loss with the dampers of the events that go on; of several on one body, with the newest.

    loss: ModalLoss of a step of a whole sample; refinement: None without stages
    """
    cursor = state.event_cursor
    cursor[EventCursor.DAMPED] = DampedModes.NONE
    for j in range(cursor[EventCursor.FIRST_ACTIVE], cursor[EventCursor.NEXT]):
        if events.kind[j] == EventKind.DAMP:
            cursor[EventCursor.DAMPED] = DampedModes.SOME
    if refinement is None:
        find_loss_of_sample(events, loss, state)
    else:
        find_loss_in_stages(events, refinement.damper_share, state)


@noinline
def find_loss_of_sample(events, loss, state):
    """Find the loss at either end of a sample in one step."""
    decay, dissipation = state.damped_decay_factor, state.damped_dissipation_factor
    before = state.displacement_bound  # memory that is free at this time
    for m in range(decay.shape[0]):
        before[m] = decay[m]
        decay[m], dissipation[m] = loss.decay_factor[m], loss.dissipation_factor[m]
    for j in range(state.event_cursor[EventCursor.FIRST_ACTIVE], state.event_cursor[EventCursor.NEXT]):
        if events.kind[j] == EventKind.DAMP:
            factor = math.sqrt(events.value[j])
            for m in range(events.target_begin[j], events.target_end[j]):
                decay[m] = loss.decay_factor[m] * factor
                dissipation[m] = 0.5 * (1.0 - decay[m]) * (1.0 + decay[m])
    for m in range(decay.shape[0]):
        if decay[m] != before[m]:
            forget_drift(state)


@inline
def step_with_dampers(h, state):
    """Return the coefficients of a step of a whole sample, with the dampers of events that act. h: StepCoefficients"""
    if EFFECTS & EVENTS:
        decay, dissipation = h.loss.decay_factor, h.loss.dissipation_factor
        if is_damping(state):
            decay, dissipation = state.damped_decay_factor, state.damped_dissipation_factor
        return with_loss(h, ModalLoss(decay, dissipation))
    return h


def with_loss(h: Any, loss: Any) -> Any:
    """Return the coefficients of a step with another loss at its ends; in compiled code only."""
    raise TypeError("with_loss is for compiled code")


_FIELDS = ", ".join("loss" if name == "loss" else f"h.{name}" for name in StepCoefficients._fields)
overload_by_source(with_loss, lambda *_: (f"Record({_FIELDS})", {"Record": StepCoefficients}))


# --- in stages


@noinline
def find_loss_in_stages(events, share, state):
    """Find what momenta keep at either end of a step in stages, and within it. share: Refinement.damper_share"""
    ends, inside = state.refinement.damped_at_ends, state.refinement.damped_inside
    for m in range(ends.shape[0]):
        ends[m] = inside[m] = 1.0
    for j in range(state.event_cursor[EventCursor.FIRST_ACTIVE], state.event_cursor[EventCursor.NEXT]):
        if events.kind[j] == EventKind.DAMP:
            at_ends, within = keep_for(events.value[j], share[0]), keep_for(events.value[j], share[1])
            for m in range(events.target_begin[j], events.target_end[j]):
                ends[m], inside[m] = at_ends, within


@inline
def keep_for(keep, share):
    """Return what momenta keep in a share of a sample. keep: in all of it"""
    return power_of(keep, share) if share > 0.0 else 1.0


@inline
def damp_stage(refinement, of_stage, state):
    """Let the dampers of events act before a stage, or after it.

    of_stage: its number and that of the stages of a step; how often steps are doubled before the finest ones; and
              whether this is before the stage
    """
    if is_damping(state):
        (i, stages, doublings, is_before), of = of_stage, state.refinement
        begin, end = (0, stages - 1) if is_before else (stages - 1, 0)
        if i == begin:
            damp_longer(of.damped_at_ends, doublings, state)
        if i == end and refinement.damper_share[1] > 0.0:
            damp_longer(of.damped_inside, doublings, state)


@noinline
def damp_longer(decay, doublings, state):
    """Let dampers act for 2^doublings times as long as they do where momenta keep `decay` of themselves. The energy
    lost counts as dissipated."""
    lost = 0.0
    for m in range(decay.shape[0]):
        keep, p = decay[m], state.p[m]
        if keep != 1.0:
            for _ in range(doublings):
                keep *= keep
            lost += 0.5 * p * p * (1.0 - keep) * (1.0 + keep)
            state.p[m] = p * keep
    accumulate(state.energy_totals, EnergyTotal.DISSIPATED, lost)
    forget_drift(state)


@inline
def is_event_active(state):
    """True if an event has begun and is not over."""
    return state.event_cursor[EventCursor.FIRST_ACTIVE] < state.event_cursor[EventCursor.NEXT]


@inline
def is_damping(state):
    """True if dampers of events act."""
    if EFFECTS & EVENTS:
        return is_event_active(state) and state.event_cursor[EventCursor.DAMPED] == DampedModes.SOME
    return False
