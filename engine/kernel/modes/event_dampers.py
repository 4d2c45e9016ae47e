"""Dampers of events take a share of each momentum in every sample, half of it at either end: in a step as a part of the
modes' loss, which costs nothing, and of a sample in stages by themselves."""

import math
from typing import Any

from engine.compiler.decorators import inline, noinline
from engine.compiler.overloads import overload_by_source
from engine.kernel.data.enums import DampedModes, EnergyTotal, EventCursor, EventKind
from engine.kernel.data.model import ModalLoss, StepCoefficients
from engine.kernel.modes.mode_step import apply_loss_all, forget_drift
from engine.kernel.modes.ordered_sums import accumulate


@noinline
def find_damped_loss(events, loss, refinement, state):
    """Find the loss at either end of a sample with the dampers of the events that go on.

    loss: ModalLoss of a step of a whole sample, or None
    """
    cursor, decay, dissipation = state.event_cursor, state.damped_decay_factor, state.damped_dissipation_factor
    before = state.displacement_bound  # memory that is free at this time
    for m in range(decay.shape[0]):
        before[m] = decay[m]
        decay[m], dissipation[m] = loss_without_dampers(loss, refinement, m)
    cursor[EventCursor.DAMPED] = DampedModes.NONE
    for j in range(cursor[EventCursor.FIRST_ACTIVE], cursor[EventCursor.NEXT]):
        if events.kind[j] == EventKind.DAMP:
            cursor[EventCursor.DAMPED], factor = DampedModes.SOME, math.sqrt(events.value[j])
            for m in range(events.target_begin[j], events.target_end[j]):
                decay[m] *= factor
                dissipation[m] = 0.5 * (1.0 - decay[m]) * (1.0 + decay[m])
    for m in range(decay.shape[0]):
        if decay[m] != before[m]:
            forget_drift(state)


@inline
def loss_without_dampers(loss, refinement, m):
    """Return the decay factor and the dissipation factor of mode m, to which dampers add. Stages have loss of their
    own."""
    if loss is not None:
        if refinement is None:
            return loss.decay_factor[m], loss.dissipation_factor[m]
    return 1.0, 0.0


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
    return with_loss(h, ModalLoss(decay, dissipation))


def with_loss(h: Any, loss: Any) -> Any:
    """Return the coefficients of a step with another loss at its ends; in compiled code only."""
    raise TypeError("with_loss is for compiled code")


_FIELDS = ", ".join("loss" if name == "loss" else f"h.{name}" for name in StepCoefficients._fields)
overload_by_source(with_loss, lambda *_: (f"Record({_FIELDS})", {"Record": StepCoefficients}))


@noinline
def damp_modes(state):
    """Let the dampers of events act by themselves for half a sample. The energy lost counts as dissipated."""
    loss = ModalLoss(state.damped_decay_factor, state.damped_dissipation_factor)
    accumulate(state.energy_totals, EnergyTotal.DISSIPATED, apply_loss_all(loss, state))


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
