"""Tables of external forces: the mean force over each sample that is one step (paper, eq. 34).

Noise has a seed: each gives one sequence at one rate, so that all sample rates have the same noise.
"""

import math
import sys
from typing import Any, NamedTuple

import numpy as np

from engine.arithmetic import plain_numbers
from engine.arithmetic.elementary import cos, exp, interpolate, log, sin, square, tan
from engine.assembly.one_way_drive import DriveForce, drive_forces
from engine.output_files import soundfile_path
from engine.patch.accuracy import Accuracy
from engine.patch.frames import nearest_frame
from engine.patch.scene import Scene
from engine.patch.tables import (
    ConstantForce,
    Force,
    HalfSineForce,
    NoiseForce,
    PluckEvent,
    PluckForce,
    PulseForce,
    SampledForce,
    SineForce,
)

GAUSS_NODE = 0.5 * math.sqrt(1.0 / 3.0)  # from the middle of a step, of its length: as in the kernel
SHORT_STEPS = 16  # of a half sine
ENDS = 0.5  # from the middle of a step, of its length: where the scheme of the paper asks for the force
LOOKAHEAD_SAMPLES = 4_096  # samples that the filter of a resampler may look ahead


class PluckPoint(NamedTuple):
    """A point at which plucks of the score push; they have no table, as their shape is computed."""

    body: str
    at: Any
    angle: float


class ForceTable(NamedTuple):
    """Mean force over each step from step `start` on, N; from the end of the values on, the force is `tail`."""

    start: int
    values: np.ndarray
    tail: float


def force_table(
    force: Force, samplerate: float, seconds: float = math.inf, accuracy: Accuracy | None = None
) -> ForceTable:
    """Return the table of a force: its mean over each step. The table ends after `seconds`, when the sound is over.

    Of constants, pulses, plucks and half sines, it is exact. This keeps the impulse exact wherever the edges fall,
    and however short the force is. Of noise and files, it is that of the values at the two ends of the step (eq. 34);
    of sines and half sines too with the scheme of the paper. With the other, a sine has what moves a mode of its
    frequency as the sine itself does.

    accuracy: settings; the default ones if None
    """
    with np.errstate(over="ignore"):  # a pulse may have almost no duration
        return _table(force, samplerate, _last_step(samplerate, seconds), accuracy or Accuracy())


def _table(force: Force, samplerate: float, last: int, accuracy: Accuracy) -> ForceTable:
    """Return the table of a force up to step `last`."""
    if isinstance(force, ConstantForce):
        return _constant(force, samplerate, last)
    if isinstance(force, PulseForce):
        begin, end = force.start * samplerate, (force.start + force.duration) * samplerate
        step = np.arange(int(begin), min(int(np.ceil(end)), last))
        covered = np.minimum(step + 1, end) - np.maximum(step, begin)
        return ForceTable(int(begin), force.amplitude * covered, 0.0)
    if isinstance(force, PluckForce):
        return _pluck(force, samplerate, last)
    if isinstance(force, HalfSineForce):
        return _half_sine(force, samplerate, last, accuracy)
    if isinstance(force, SineForce):
        return _sine(force, samplerate, last, accuracy)
    begin, ends = _ends(force, samplerate, last)
    return ForceTable(int(begin), 0.5 * (ends[1:] + ends[:-1]), 0.0)


def _sine(force: SineForce, samplerate: float, last: int, accuracy: Accuracy) -> ForceTable:
    """Return the table of a sine: the mean of what is covered of each step by the rule that stages have (Gauss), which
    is then raised; with the scheme of the paper, that of its ends."""
    is_of_paper = accuracy.scheme != "exact"
    begin, end = force.start * samplerate, (force.start + force.duration) * samplerate
    edges = np.clip(np.arange(int(begin), min(int(np.ceil(end)), last) + 1), begin, end)
    middle, covered = (edges[1:] + edges[:-1]) / 2, np.diff(edges)
    reach = (ENDS if is_of_paper else GAUSS_NODE) * covered
    times = [node / samplerate - force.start for node in (middle - reach, middle + reach)]
    values = [
        sin(2 * np.pi * force.frequency * time + force.phase) * _fade(force, time) * _envelope(force.envelope, time)
        for time in times
    ]
    is_raised = not is_of_paper and accuracy.max_error is None
    amplitude = force.amplitude * (raise_sine(force.frequency / samplerate) if is_raised else 1.0)
    return ForceTable(int(begin), amplitude * covered * (values[0] + values[1]) / 2, 0.0)


def raise_sine(frequency: float) -> float:
    """Return by how much the mean of a sine over a step, by Gauss's rule, is to be raised, for a mode of its frequency
    to move as under the sine itself. frequency: periods per step, below ½

    With x = π·frequency, a sine has that mean cos(x/√3) times what it is in the middle of the step; and a force that is
    constant over each step moves a mode of its frequency by sin(x)/x of what it would without steps. For any other
    mode, what is left is of fourth order in x.
    """
    x = math.pi * frequency
    return x / (plain_numbers.sin(x) * plain_numbers.cos(2 * GAUSS_NODE * x))


def force_ends(force: NoiseForce | SampledForce, samplerate: float, seconds: float = math.inf) -> np.ndarray:
    """Return the values of a force that samples give, at both ends of each step of its table, N [steps + 1]."""
    return _ends(force, samplerate, _last_step(samplerate, seconds))[1]


def _ends(force: NoiseForce | SampledForce, samplerate: float, last: int) -> tuple[int, np.ndarray]:
    """Return the step in which a force that samples give begins, and its values at the ends of steps, N."""
    if isinstance(force, NoiseForce):
        begin, time = _sample_times(force, samplerate, last)
        values = np.zeros(time.size)
        first = nearest_frame(force.start, samplerate) - begin
        noise = read_noise(force, samplerate, time.size - first)
        values[first : first + noise.size] = noise
        values *= _fade(force, time) * _envelope(force.envelope, time)
    else:
        begin = nearest_frame(force.start, samplerate) - 1  # rises from 0 in the step before its first sample
        values = np.concatenate([[0.0], read_samples(force, samplerate, max(0, last - begin)), [0.0]])
        values *= _envelope(force.envelope, (begin + np.arange(values.size)) / samplerate - force.start)
    return begin, force.amplitude * values


def count_steps(force: Force, samplerate: float, seconds: float) -> float:
    """Estimate the number of steps in the table of a force."""
    if isinstance(force, ConstantForce):
        return 1 if force.envelope is None else max(0.0, min(force.envelope[-1][0], seconds - force.start)) * samplerate
    if isinstance(force, SampledForce):
        import soundfile

        info = soundfile.info(soundfile_path(force.file))
        start, length = force.start, float(info.frames / info.samplerate)
    elif isinstance(force, PluckForce):
        start, length = force.start, force.duration + force.release
    else:
        start, length = force.start, force.duration
    return max(0.0, min(length, seconds - start)) * samplerate


def _last_step(samplerate: float, seconds: float) -> int:
    """Return a step after the end of the sound. It is later than necessary, as the end of a rendering is rounded."""
    return sys.maxsize if seconds == math.inf else math.ceil(seconds * samplerate) + 64


def _constant(force: ConstantForce, samplerate: float, last: int) -> ForceTable:
    """Return the table of a constant, or of the straight lines of its envelope: the exact mean over each step."""
    start = int(force.start * samplerate)
    if force.envelope is None:
        return ForceTable(start, force.amplitude * np.array([start + 1 - force.start * samplerate]), force.amplitude)
    end = min(math.ceil((force.start + force.envelope[-1][0]) * samplerate) + 1, last)
    time = np.maximum(np.arange(start, max(end, start + 1) + 1) / samplerate - force.start, 0.0)
    means = np.diff(_envelope_integral(force.envelope, time)) * samplerate
    return ForceTable(start, force.amplitude * means, force.amplitude * force.envelope[-1][1])


def _envelope(envelope: list[list[float]] | None, time: np.ndarray) -> np.ndarray | float:
    """Return the factor of an envelope at some times [times], s after the start of its force."""
    if envelope is None:
        return 1.0
    times, factors = np.array(envelope, dtype=float).T
    return np.asarray(interpolate(time, times, factors))


def _envelope_integral(envelope: list[list[float]], time: np.ndarray) -> np.ndarray:
    """Return the integral of an envelope's factor from 0 to some times [times], s."""
    times, factors = np.array(envelope, dtype=float).T
    if times[0] > 0.0:
        times, factors = np.concatenate([[0.0], times]), np.concatenate([factors[:1], factors])
    widths = np.diff(times)
    sums = np.concatenate([[0.0], np.cumsum(widths * (factors[1:] + factors[:-1]) / 2)])
    piece = np.clip(np.searchsorted(times, time, "right") - 1, 0, times.size - 1)
    within = time - times[piece]
    slopes = np.append(np.diff(factors) / widths, 0.0)
    return np.asarray(sums[piece] + within * (factors[piece] + slopes[piece] * within / 2))


def _sample_times(force: NoiseForce, samplerate: float, last: int) -> tuple[int, np.ndarray]:
    """Return the step in which a force begins, and the times of the ends of its steps, s after its start."""
    begin, end = force.start * samplerate, (force.start + force.duration) * samplerate
    frames = np.arange(int(begin), min(int(np.ceil(end)), last) + 1)
    return int(begin), frames / samplerate - force.start


def _fade(force: SineForce | NoiseForce, time: np.ndarray) -> np.ndarray:
    """Return the fade of a force: ½(1 - cos) up at its start and down at its end; 0 before and after."""
    inside = (time >= 0.0) & (time <= force.duration)
    if force.fade == 0.0:
        return inside.astype(float)
    nearest = np.clip(np.minimum(time, force.duration - time) / force.fade, 0.0, 1.0)
    return np.where(inside, 0.5 * (1.0 - cos(np.pi * nearest)), 0.0)


def read_noise(force: NoiseForce, samplerate: float, most: int) -> np.ndarray:
    """Return the first `most` samples of a noise at the scene's sample rate."""
    ratio = NOISE_RATE / samplerate
    needed = math.ceil((most + LOOKAHEAD_SAMPLES) * max(1.0, ratio))
    count = min(needed, math.ceil(force.duration * NOISE_RATE) + LOOKAHEAD_SAMPLES)
    return _resample(draw_noise(force, count), NOISE_RATE, samplerate)[:most]


def _resample(values: np.ndarray, rate: float, samplerate: float) -> np.ndarray:
    """Return samples of one rate at another."""
    if rate == samplerate:
        return values
    import soxr

    return np.asarray(soxr.resample(values, rate, samplerate, "VHQ"))


def _half_sine(force: HalfSineForce, samplerate: float, last: int, accuracy: Accuracy) -> ForceTable:
    """Return the table of half a period of a sine: the exact mean over each step; with the scheme of the paper that of
    its ends, but where so few steps would miss its impulse by a third of a percent and more."""
    begin, length = force.start * samplerate, force.duration * samplerate
    edges = np.arange(int(begin), min(int(np.ceil(begin + length)), last) + 1) - begin
    share = np.clip(edges / length, 0, 1)
    if accuracy.scheme != "exact" and length >= SHORT_STEPS:
        ends = force.amplitude * np.where((share > 0.0) & (share < 1.0), sin(np.pi * share), 0.0)
        return ForceTable(int(begin), 0.5 * (ends[1:] + ends[:-1]), 0.0)
    impulse = 2 * length / np.pi * square(sin(np.pi / 2 * share))  # up to each edge
    return ForceTable(int(begin), force.amplitude * np.diff(impulse), 0.0)


def _pluck(force: PluckForce, samplerate: float, last: int) -> ForceTable:
    """Return the table of a pluck: ½(1 - cos) up, the same down. The mean over each step is exact, however short the
    release."""
    begin, rise, fall = (x * samplerate for x in (force.start, force.duration, force.release))

    def impulse(x: np.ndarray) -> np.ndarray:  # integral of the shape up to x, in samples
        up, down = np.clip(x / rise, 0, 1), np.clip((x - rise) / fall, 0, 1) if fall else np.zeros(x.size)
        climb = rise * 0.5 * (up - sin(np.pi * up) / np.pi)
        return np.asarray(climb + fall * 0.5 * (down + sin(np.pi * down) / np.pi))

    edges = np.arange(int(begin), min(int(np.ceil(begin + rise + fall)), last) + 1) - begin
    return ForceTable(int(begin), force.amplitude * np.diff(impulse(edges)), 0.0)


def read_samples(force: SampledForce, samplerate: float, most: int) -> np.ndarray:
    """Return the first `most` samples of a force file at the scene's sample rate; full scale is 1.

    Raises ValueError, or what soundfile raises, if the file is damaged.
    """
    import soundfile

    audio, rate = soundfile.read(soundfile_path(force.file), dtype="float64", always_2d=True)
    values = np.ascontiguousarray(audio[:, force.channel - 1])
    if not np.all(np.isfinite(values)):
        raise ValueError("not all of its samples are numbers")
    enough = math.ceil((most + LOOKAHEAD_SAMPLES) * max(1.0, rate / samplerate))
    return _resample(values if rate == samplerate else values[:enough], rate, samplerate)[:most]


NOISE_RATE = 48_000  # Hz, at which noise is drawn
FILTER_ORDER = 4  # of each edge of a band: 24 dB per octave
LEAD_PERIODS = 8  # of the lowest frequency of a band, which the filter has to settle
MAX_LEAD = 1 << 20  # samples of it


def draw_noise(force: NoiseForce, count: int) -> np.ndarray:
    """Return the first samples of a noise at NOISE_RATE [count], of root mean square 1.

    The generator is the one that numpy promises never to change (NEP 19). A longer noise begins with the same samples.
    """
    generator = np.random.RandomState(force.seed)
    if force.band is None:
        return np.asarray(generator.standard_normal(count))
    from scipy import signal

    low, high = force.band
    lead = min(MAX_LEAD, math.ceil(LEAD_PERIODS * NOISE_RATE / low))
    sections = np.concatenate(
        [
            signal.butter(FILTER_ORDER, low, "highpass", fs=NOISE_RATE, output="sos"),
            signal.butter(FILTER_ORDER, high, "lowpass", fs=NOISE_RATE, output="sos"),
        ]
    )
    noise = signal.sosfilt(sections, generator.standard_normal(lead + count))[lead:]
    return np.asarray(noise / _gain(low, high))


def _gain(low: float, high: float) -> float:
    """Return the root mean square of white noise of root mean square 1 after the filter, from the filter's response.

    The bilinear transform takes a Butterworth edge at ω to tan(ω/2), exactly.
    """
    low_edge, high_edge = (tan(math.pi * f / NOISE_RATE) for f in (low, high))
    # in u = ln tan(ω/2), where both edges are as wide: dω = 2·x/(1 + x²) du
    u = np.linspace(log(low_edge) - 8, log(high_edge) + 8, 20_001)
    x = exp(u)
    passed = (
        1
        / (1 + plain_numbers.whole_power(low_edge / x, 2 * FILTER_ORDER))
        / (1 + plain_numbers.whole_power(x / high_edge, 2 * FILTER_ORDER))
    )
    return math.sqrt(np.trapezoid(passed * 2 * x / (1 + square(x)), u) / math.pi)


ExternalForces = list[Force | PluckPoint | DriveForce]


def acting_forces(scene: Scene) -> ExternalForces:
    """Return the external forces of a scene: forces that have an amplitude, the points that its score plucks, and
    strings that drive bodies."""
    forces: ExternalForces = [f for f in scene.force if f.amplitude != 0.0]
    points = {repr(point): point for event in scene.event if isinstance(event, PluckEvent) for point in [_point(event)]}
    return [*forces, *points.values(), *drive_forces(scene)]


def _point(pluck: PluckEvent | PluckForce | PluckPoint) -> PluckPoint:
    return PluckPoint(pluck.body, pluck.at, pluck.angle)


def find_pluck_point(forces: ExternalForces, event: PluckEvent) -> int:
    """Return the number of the point that an event plucks: that of the score, or of a pluck that waits there. Raises
    ValueError if there is none."""
    point = _point(event)
    for n, force in enumerate(forces):
        if isinstance(force, PluckPoint | PluckForce) and _point(force) == point:
            return n
    raise ValueError(f"no pluck waits where {event.body} is plucked; give the same `at` for each velocity")
