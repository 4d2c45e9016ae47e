"""Sleep: an island whose vibration and sound have died is not computed until something is due, or a
body that still flies comes near another.

It is decided on the scene's own grid of samples, so that blocks of any size give the same. What
vibrates is left as it is and its pickups are silent, which changes the output by less than
`Model.sleep_threshold` of its peak; free masses fly on.
"""

from engine.compiler.decorators import INT64_0, inline, noinline
from engine.kernel.codes import EnergyTotal, Sleep, SleepMonitor
from engine.kernel.energy import accumulate
from engine.kernel.events import next_due
from engine.kernel.modes import begin_step_mode, end_step_mode


@inline
def track_peak(state, value):
    """Keep the peak of what the pickups of an island give."""
    state.sleep_monitor[SleepMonitor.PEAK] = max(state.sleep_monitor[SleepMonitor.PEAK], abs(value))


@inline
def extend_sleep(force, events, state, frame, most):
    """Stay asleep from this frame on until something is due, for so many samples at most. Nothing flies."""
    due = next_due(force, events, state, frame - 1)
    if due > frame:
        state.sleep[Sleep.WAKE_FRAME] = state.sleep[Sleep.STATIC_UNTIL] = min(due, frame + most)


@inline
def audible_free_mass_moves(weight, free_masses, state):
    """Whether a pickup hears a free mass that moves."""
    if free_masses is None:
        return False
    return free_masses.is_audible[0] and free_mass_moves(weight, free_masses, state)


@inline
def try_sleep(threshold, weight, free_masses, state, until, energy):
    """With nothing in reach, sleep until a frame if all has died; returns whether. `energy` is that of vibration, J."""
    monitor = state.sleep_monitor
    monitor[SleepMonitor.ENERGY_EVER] = max(monitor[SleepMonitor.ENERGY_EVER], energy)
    monitor[SleepMonitor.PEAK_EVER] = max(monitor[SleepMonitor.PEAK_EVER], monitor[SleepMonitor.PEAK])
    still = energy <= threshold * threshold * monitor[SleepMonitor.ENERGY_EVER]
    silent = monitor[SleepMonitor.PEAK] <= threshold * monitor[SleepMonitor.PEAK_EVER]
    sleeps = still and silent and not audible_free_mass_moves(weight, free_masses, state)
    if sleeps:
        state.sleep[Sleep.WAKE_FRAME] = until
        state.sleep[Sleep.STATIC_UNTIL] = INT64_0 if free_mass_moves(weight, free_masses, state) else until
    monitor[SleepMonitor.PEAK] = 0.0
    return sleeps


@inline
def free_mass_moves(weight, free_masses, state):
    """Whether a free mass moves, or is about to; in an island that was put to sleep it waits."""
    if free_masses is None:
        return False
    if state.sleep[Sleep.FORCED] != 0:
        return False
    for j in range(free_masses.mode.shape[0]):
        m = free_masses.mode[j]
        if state.p[m] != 0.0:
            return True
        if has_weight(weight, m):
            return True
    return False


@inline
def has_weight(weight, m):
    """Whether mode m has weight."""
    if weight is None:
        return False
    return weight[m] != 0.0


@noinline
def advance_free_masses(h, weight, free_masses, state, count):
    """Let free masses move on for so many samples."""
    if free_masses is not None:
        for j in range(free_masses.mode.shape[0]):
            m = free_masses.mode[j]
            lost = 0.0
            for _ in range(count):
                half, first = begin_step_mode(h, weight, state.kick_compensation, m, state.q[m], state.p[m])
                state.q[m], state.p[m], second = end_step_mode(h, weight, state.kick_compensation, m, state.q[m], half)
                lost += first + second
            accumulate(state.energy_totals, EnergyTotal.DISSIPATED, lost)


@inline
def skip_chunk(sleep, n, frame, count):
    """Whether island n of the scene, of which nothing is to be recorded, sleeps for so many samples and nothing
    in it flies: then it need not even be looked at."""
    if sleep[n, Sleep.STATIC_UNTIL] >= frame + count:
        sleep[n, Sleep.SAMPLES_SLEPT] += count
        return True
    return False


@inline
def samples_to_sleep(state, frame, most):
    """How many of at most so many samples the island sleeps through."""
    count = min(most, state.sleep[Sleep.WAKE_FRAME] - frame)
    if count <= 0:
        return 0
    state.sleep[Sleep.SAMPLES_SLEPT] += count
    return count
