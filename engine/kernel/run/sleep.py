"""Sleep: an island whose vibration and sound have died out is not computed until an event or force is due, or a body
that still flies comes near another.

Islands are put to sleep at fixed samples of the scene, so that blocks of any size give the same. Modes that vibrate are
left as they are and their pickups are silent, which changes the output by less than `Model.sleep_threshold` of its
peak; free masses fly on.
"""

from engine.compiler.decorators import INT64_0, inline, noinline
from engine.kernel.data.enums import EnergyTotal, Sleep, SleepMonitor
from engine.kernel.modes.mode_step import add_free_step, forget_drift, motion_of
from engine.kernel.modes.ordered_sums import accumulate
from engine.kernel.run.events import next_due


@inline
def extend_sleep(force, events, state, frame, most):
    """Extend the sleep of an island in which nothing flies: from this frame until something is due, for `most` samples
    at most."""
    due = next_due(force, events, state, frame - 1)
    if due > frame:
        state.sleep[Sleep.WAKE_FRAME] = state.sleep[Sleep.STATIC_UNTIL] = min(due, frame + most)


@inline
def try_sleep(model, state, until, energy):
    """Let an island whose contacts cannot close sleep until a frame, if its vibration and sound have died out. Returns
    True if it sleeps. `energy` is that of vibration, J."""
    monitor, threshold = state.sleep_monitor, model.sleep_threshold
    monitor[SleepMonitor.ENERGY_EVER] = max(monitor[SleepMonitor.ENERGY_EVER], energy)
    monitor[SleepMonitor.PEAK_EVER] = max(monitor[SleepMonitor.PEAK_EVER], monitor[SleepMonitor.PEAK])
    still = energy <= threshold * threshold * monitor[SleepMonitor.ENERGY_EVER]
    silent = monitor[SleepMonitor.PEAK] <= threshold * monitor[SleepMonitor.PEAK_EVER]
    sleeps = still and silent and not (model.free_masses.is_audible[0] and free_mass_moves(model, state))
    if sleeps:
        state.sleep[Sleep.WAKE_FRAME] = until
        state.sleep[Sleep.STATIC_UNTIL] = INT64_0 if free_mass_moves(model, state) else until
    monitor[SleepMonitor.PEAK] = 0.0
    return sleeps


@inline
def free_mass_moves(model, state):
    """True if a free mass moves, or is about to."""
    for j in range(model.free_masses.mode.shape[0]):
        m = model.free_masses.mode[j]
        if state.p[m] != 0.0 or model.weight[m] != 0.0:
            return True
    return False


@noinline
def advance_free_masses(h, free_masses, state, count):
    """Step the free masses by `count` samples."""
    forget_drift(state)
    for j in range(free_masses.mode.shape[0]):
        lost = 0.0
        for _ in range(count):
            lost += add_free_step((h, motion_of(state)), free_masses.mode[j], (0.0,))[0]
        accumulate(state.energy_totals, EnergyTotal.DISSIPATED, lost)


@inline
def skip_chunk(sleep, n, frame, count):
    """Count samples of island n of the scene, of which nothing is to be recorded, as slept through. Returns False if it
    is awake, or something in it flies."""
    if sleep[n, Sleep.STATIC_UNTIL] >= frame + count:
        sleep[n, Sleep.SAMPLES_SLEPT] += count
        return True
    return False


@inline
def samples_to_sleep(state, frame, most):
    """Return how many samples, `most` at most, the island sleeps through from this frame on, and count them."""
    count = min(most, state.sleep[Sleep.WAKE_FRAME] - frame)
    if count <= 0:
        return 0
    state.sleep[Sleep.SAMPLES_SLEPT] += count
    return count
