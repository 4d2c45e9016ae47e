"""Fades: an island that reduced quality drops fades out, and its vibration is gone; if something begins on it
meanwhile, it rises again."""

from engine.compiler.decorators import INT64_0, inline, noinline
from engine.kernel.data.enums import Quantity, Sleep, SleepMonitor
from engine.kernel.interactions.connections import reset_connections
from engine.kernel.interactions.contacts import reset_compressions
from engine.kernel.modes.point_rows import project
from engine.kernel.run.step import begin_change, end_change

FADE_SECONDS = 0.02


@inline
def fade_frames(samplerate):
    """Return how long a fade takes, frames."""
    return int(FADE_SECONDS * samplerate)


@inline
def is_fading(sleep):
    """True if an island fades out, or rises again. sleep: its State.sleep"""
    return sleep[Sleep.FADE_END] != 0


@inline
def fade_gain(sleep, samplerate, frame):
    """Return the gain of an island that fades, at a frame."""
    left = (abs(sleep[Sleep.FADE_END]) - frame) / fade_frames(samplerate)
    gain = left if sleep[Sleep.FADE_END] > 0 else 1.0 - left
    return max(0.0, min(1.0, gain))


@inline
def turn_fade(sleep, samplerate, frame):
    """Let an island that fades out rise again from this frame on, as something begins on it."""
    end = sleep[Sleep.FADE_END]
    if end > 0:
        sleep[Sleep.FADE_END] = -(2 * frame - end + fade_frames(samplerate)) if frame < end else INT64_0


@inline
def end_fade(model, state, frame):
    """End a fade that is over at this frame, which is one of a check: what has faded out is gone, and the island may
    fall asleep at once."""
    end = state.sleep[Sleep.FADE_END]
    if end != 0 and frame >= abs(end):
        state.sleep[Sleep.FADE_END] = 0
        if end > 0:
            drop_vibration(model, state, frame)
            state.sleep[Sleep.WAKE_FRAME], state.sleep_monitor[SleepMonitor.PEAK] = frame, 0.0


@noinline
def drop_vibration(model, state, frame):
    """Let all modes with a spring be at rest; free masses go on. The energy that this takes counts as supplied, with a
    negative sign."""
    before = begin_change(model, state, frame + 0.0)
    for m in range(state.q.shape[0]):
        if model.omega_squared[m] > 0.0:
            state.q[m] = model.weight[m] / model.omega_squared[m]
            state.p[m] = 0.0
            if state.kick_compensation.shape[0] > 0:
                state.kick_compensation[m] = 0.0
    reset_compressions(model.contact, state)
    reset_connections(model.connection, state)
    for n in range(model.pickups.quantity.shape[0]):
        if model.pickups.quantity[n] == Quantity.ACCELERATION:
            state.previous_velocity[n] = project(model.pickups.rows, n, state.p)
    end_change(model, state, before)
