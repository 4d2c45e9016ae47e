"""Pickups: what they add to the audio of an island."""

from engine.compiler.decorators import inline
from engine.compiler.lanes import greater, lane_maximum, load_lanes, magnitude, splat
from engine.kernel.data.enums import FLIGHT_FRAMES, LANES, Quantity, SleepMonitor, Stretch
from engine.kernel.interactions.one_way_drive import put_sample
from engine.kernel.interactions.tension import stretches
from engine.kernel.modes.point_rows import project
from engine.kernel.run.fade import fade_gain, is_fading


@inline
def track_peak(state, value):
    """Raise the peak of the pickups of an island to this value, if it is larger."""
    state.sleep_monitor[SleepMonitor.PEAK] = max(state.sleep_monitor[SleepMonitor.PEAK], abs(value))


@inline
def heard_rise(tension, state, n):
    """Return what pickup n hears of the rise of a tension, the mean over the step that ends here; 0 of others."""
    if stretches(state):
        if tension.heard[n] >= 0:
            rise = state.tension.body[tension.heard[n]][Stretch.LAST]
            return rise * (tension.heard_share[n] + project(tension.pull, n, state.q))
    return 0.0


@inline
def pickup_value(model, state, n):
    """Return the value of pickup n at this sample."""
    pickups, quantity = model.pickups, model.pickups.quantity[n]
    if quantity == Quantity.VELOCITY:
        return project(pickups.rows, n, state.p)
    if quantity == Quantity.DISPLACEMENT:
        return project(pickups.rows, n, state.q)
    if quantity == Quantity.ACCELERATION:  # its mean over the step that ends here
        velocity = project(pickups.rows, n, state.p)
        change = (velocity - state.previous_velocity[n]) * model.samplerate
        state.previous_velocity[n] = velocity
        return change
    value = heard_rise(model.tension, state, n)
    for i in range(pickups.contact_begin[n], pickups.contact_end[n]):
        value += pickups.contact_sign[i] * state.contact_force[pickups.contact[i]]
    return value


@inline
def add_pickups(model, state, row, frame):
    """Add the values of the pickups to a row of the audio, that of a frame."""
    pickups = model.pickups
    for n in range(pickups.quantity.shape[0]):
        value = pickups.gain[n] * pickup_value(model, state, n)
        track_peak(state, value)
        if is_fading(state.sleep):
            value *= fade_gain(state.sleep, model.samplerate, frame)
        put_sample(state.drive, row, pickups.channel[n], frame, value)


@inline
def add_flown_pickups(model, state, audio, i, span, frame):
    """Add the values of the pickups in a free flight to rows of the audio from row i on. No contact pushes in it.

    span: samples of the flight, first and last + 1; frame: of the first
    """
    (first, last), pickups = span, model.pickups
    for n in range(pickups.quantity.shape[0]):
        quantity, gain, channel = pickups.quantity[n], pickups.gain[n], pickups.channel[n]
        if quantity != Quantity.FORCE:
            values = state.flight.pickup_values[n]
            if quantity == Quantity.ACCELERATION:
                velocities_to_accelerations(values, first, last, model.samplerate, state.previous_velocity, n)
            track_peak(state, gain * largest_size(values, first, last))
            if is_fading(state.sleep):
                for k in range(first, last):
                    values[k] *= fade_gain(state.sleep, model.samplerate, frame + (k - first))
            for k in range(first, last):
                row = audio[i + (k - first)]
                put_sample(state.drive, row, channel, frame + (k - first), values[k] * gain)


@inline
def velocities_to_accelerations(values, first, last, samplerate, previous, n):
    """Replace velocities of pickup n by accelerations, each the mean over the step that ends at its sample."""
    for k in range(first, last):
        velocity = values[k]
        values[k] = (velocity - previous[n]) * samplerate
        previous[n] = velocity


@inline
def largest_size(values, first, last):
    """Return the largest absolute value of some samples of a flight."""
    peak, k = 0.0, first
    if last - first == FLIGHT_FRAMES:
        lanes = splat(0.0)
        while k < last:
            lanes = greater(magnitude(load_lanes(values, k)), lanes)
            k += LANES
        return lane_maximum(lanes)
    while k < last:
        peak = max(peak, abs(values[k]))
        k += 1
    return peak
