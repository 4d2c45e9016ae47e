"""External forces as functions of time: their means over stages of a sample, so that more stages find the motion that
the force itself would make. A sample in one step has the mean of its table (paper, eq. 34).

Means are exact for constants, pulses, half sines and plucks, and of fourth order in the length of the stage for sines
and envelopes (Gauss).
"""

import math

from engine.compiler.decorators import inline, noinline
from engine.compiler.elementary import rise, rise_integral, sine_of_turns, sine_to_quarter
from engine.kernel.data.enums import ForceKind, ForceNumber

GAUSS_NODE = 0.5 * math.sqrt(1.0 / 3.0)  # from the middle of an interval, of its length


@inline
def is_whole(span):
    """True if a step is that of a whole sample. span: its begin and end, frames"""
    return span[0] == 0.0 and span[1] == 1.0


@inline
def has_shape(shapes, j, span):
    """True if external force j is computed from its shape in a step."""
    return shapes.kind[j] != ForceKind.TABLE and not is_whole(span)


@noinline
def mean_of_shape(shapes, j, step, span):
    """Return the mean of external force j over an interval, N. step: of its table; span: begin and end, frames after
    the start of that step"""
    kind, number = shapes.kind[j], shapes.number[j]
    if kind == ForceKind.LINES:
        return value_of_lines(shapes, j, step, 0.5 * (span[0] + span[1]))
    offset = step + math.floor(number[ForceNumber.START]) - number[ForceNumber.START]
    low, high = offset + min(span[0], span[1]), offset + max(span[0], span[1])
    length = number[ForceNumber.DURATION]
    if kind == ForceKind.PLUCK:
        length += number[ForceNumber.FADE]
    begin, end = max(low, 0.0), min(high, length)
    if not begin < end:
        return 0.0
    share, amplitude = (end - begin) / (high - low), number[ForceNumber.AMPLITUDE]
    if kind == ForceKind.HALF_SINE:
        return amplitude * share * mean_of_half_sine(length, begin, end)
    if kind == ForceKind.PLUCK:
        rises, falls = number[ForceNumber.DURATION], number[ForceNumber.FADE]
        impulse = pluck_impulse(rises, falls, end) - pluck_impulse(rises, falls, begin)
        return amplitude * impulse / (high - low)
    middle, reach = 0.5 * (begin + end), GAUSS_NODE * (end - begin)
    values = value_at(shapes, j, kind, middle - reach) + value_at(shapes, j, kind, middle + reach)
    return amplitude * share * 0.5 * values


@inline
def value_of_lines(shapes, j, step, time):
    """Return external force j, which is straight from frame to frame, at a time after the start of a step of its
    table, N."""
    at = shapes.line_begin[j] + step
    return shapes.line[at] + (shapes.line[at + 1] - shapes.line[at]) * time


@inline
def mean_of_half_sine(length, begin, end):
    """Return the mean of half a period of a sine between two times within it."""
    turn = 0.5 * (end - begin) / length
    half = sine_to_quarter(math.pi * turn) / (math.pi * turn) if turn > 1e-9 else 1.0
    return sine_of_turns(0.25 * (begin + end) / length) * half


@inline
def value_at(shapes, j, kind, time):
    """Return external force j, a level or a sine, at a time after its start, frames; as a share of its amplitude."""
    value, number = envelope_at(shapes, j, time), shapes.number[j]
    if kind == ForceKind.SINE:
        value *= sine_of_turns(number[ForceNumber.FREQUENCY] * time + number[ForceNumber.PHASE])
        if number[ForceNumber.FADE] > 0.0:
            nearest = min(time, number[ForceNumber.DURATION] - time)
            value *= rise(min(max(nearest / number[ForceNumber.FADE], 0.0), 1.0))
    return value


@inline
def envelope_at(shapes, j, time):
    """Return the factor of the envelope of force j at a time after its start, frames; 1 without one."""
    begin, end = shapes.envelope_begin[j], shapes.envelope_end[j]
    if begin == end:
        return 1.0
    times, factors = shapes.envelope_time, shapes.envelope_factor
    if time <= times[begin]:
        return factors[begin]
    for n in range(begin + 1, end):
        if time <= times[n]:
            return factors[n - 1] + (factors[n] - factors[n - 1]) * (time - times[n - 1]) / (times[n] - times[n - 1])
    return factors[end - 1]


@inline
def pluck_impulse(rises, falls, time):
    """Return the integral of the shape of a pluck from its start to a time, all in frames."""
    impulse = rises * rise_integral(min(max(time / rises, 0.0), 1.0))
    if falls > 0.0:
        u = min(max((time - rises) / falls, 0.0), 1.0)
        impulse += falls * (u - rise_integral(u))
    return impulse
