"""Metrics of how far one rendering is from another: sample by sample as long as the motion can be predicted, and by
spectrum, decay, pitch and contact after that, which chaos leaves alone."""

import itertools
import math

import numpy as np

HORIZON_WINDOW = 0.005  # s
DIVERGENCE_LIMIT = 1e-3  # of the peak: beyond, two runs that began alike count as different
ENVELOPE_WINDOW = 0.01  # s
COMPARED_RANGE_DB = 40.0  # below the loudest band or window; softer ones are not compared


def relative_rms_error(audio: np.ndarray, reference: np.ndarray, frames: int) -> float:
    """Root mean square of the difference over the first frames, relative to that of the reference; infinite without
    any frame.

    audio, reference: [frames, channels]
    """
    if frames == 0:
        return math.inf
    size = float(np.sqrt(np.mean(reference[:frames] ** 2)))
    return float(np.sqrt(np.mean((audio[:frames] - reference[:frames]) ** 2))) / size if size > 0.0 else 0.0


def horizon(reference: np.ndarray, perturbed: np.ndarray, samplerate: float) -> int:
    """The number of frames for which two runs, begun almost alike, stay alike to a thousandth of the peak.

    reference, perturbed: [frames, channels]
    """
    size = max(1, round(HORIZON_WINDOW * samplerate))
    peak = np.abs(reference).max(initial=0.0)
    for begin in range(0, len(reference), size):
        window = slice(begin, begin + size)
        if np.abs(reference[window] - perturbed[window]).max(initial=0.0) > DIVERGENCE_LIMIT * peak:
            return begin
    return len(reference)


def third_octave_bands(audio: np.ndarray, samplerate: float) -> np.ndarray:
    """Power [bands] in third-octave bands from 25 Hz to 20 kHz, over all channels; only bands below Nyquist.

    audio: [frames, channels]
    """
    centres = 1000.0 * 2.0 ** (np.arange(-16, 14) / 3)
    centres = centres[centres * 2 ** (1 / 6) < samplerate / 2]
    window = np.hanning(len(audio) + 2)[1:-1, None]
    power = np.sum(np.abs(np.fft.rfft(audio * window, axis=0)) ** 2, axis=1)
    frequency = np.fft.rfftfreq(len(audio), 1 / samplerate)
    edges = np.searchsorted(frequency, np.concatenate([centres * 2 ** (-1 / 6), centres[-1:] * 2 ** (1 / 6)]))
    return np.array([power[a:b].sum() for a, b in itertools.pairwise(edges)])


def band_error(audio: np.ndarray, reference: np.ndarray, samplerate: float) -> float:
    """Largest difference of a third-octave band, dB, among those within 40 dB of the loudest.

    audio, reference: [frames, channels]
    """
    power, reference_power = third_octave_bands(audio, samplerate), third_octave_bands(reference, samplerate)
    loud = reference_power > reference_power.max(initial=0.0) * 10 ** (-COMPARED_RANGE_DB / 10)
    if not loud.any():
        return 0.0
    with np.errstate(divide="ignore"):
        return float(np.max(np.abs(10 * np.log10(power[loud] / reference_power[loud]))))


def impulse_error(forces: np.ndarray, reference: np.ndarray) -> float:
    """Relative error of the impulse of all contacts. forces, reference: [frames, contacts]"""
    impulse = float(np.abs(reference).sum())
    return abs(float(np.abs(forces).sum()) - impulse) / impulse if impulse > 0.0 else 0.0


def contact_intervals(forces: np.ndarray, samplerate: float, max_pause: float = 0.0) -> list[tuple[float, float]]:
    """Begin and end, s, of every interval in which anything touches.

    forces:    [frames, contacts]
    max_pause: s; pauses up to it do not divide an interval
    """
    touching = np.concatenate([[False], np.any(forces != 0.0, axis=1), [False]])
    edges = np.flatnonzero(np.diff(touching)).reshape(-1, 2) / samplerate
    intervals: list[tuple[float, float]] = []
    for begin, end in edges.tolist():
        if intervals and begin - intervals[-1][1] <= max_pause:
            begin = intervals.pop()[0]
        intervals.append((begin, end))
    return intervals


def first_contact_ms(forces: np.ndarray, samplerate: float) -> float:
    """Duration of the first contact, ms; 0 if there is none. forces: [frames, contacts]"""
    intervals = contact_intervals(forces, samplerate)
    return (intervals[0][1] - intervals[0][0]) * 1e3 if intervals else 0.0


def rebound_velocity(forces: np.ndarray, velocities: np.ndarray) -> float:
    """Velocity of the body whose first contact is the first to begin, when that contact ends; NaN if none ends.

    forces, velocities: [frames, bodies]
    """
    first = [contact_intervals(force[:, None], 1.0)[:1] for force in forces.T]  # in frames
    ended = [(begin, end, body) for body, values in enumerate(first) for begin, end in values if end < len(forces)]
    if not ended:
        return math.nan
    _, end, body = min(ended)
    return float(velocities[int(end), body])


def decay_error(audio: np.ndarray, reference: np.ndarray, samplerate: float) -> float:
    """Mean difference of the levels in windows of 10 ms, dB, where the reference is within 40 dB of its loudest.

    audio, reference: [frames, channels]
    """
    size = max(1, round(ENVELOPE_WINDOW * samplerate))
    frames = len(reference) // size * size
    if frames == 0:
        return 0.0
    power, reference_power = (
        np.sum(x[:frames].reshape(-1, size, x.shape[1]) ** 2, axis=(1, 2)) for x in (audio, reference)
    )
    loud = reference_power > reference_power.max() * 10 ** (-COMPARED_RANGE_DB / 10)
    with np.errstate(divide="ignore"):
        return float(np.mean(np.abs(10 * np.log10(power[loud] / reference_power[loud])))) if loud.any() else 0.0


def detuning_cents(audio: np.ndarray, reference: np.ndarray) -> float:
    """Interval from the strongest partial of the reference to that of the audio, cents; both [frames, channels]."""
    partial, reference_partial = strongest_partial(audio), strongest_partial(reference)
    return 1200.0 * math.log2(partial / reference_partial) if partial > 0.0 and reference_partial > 0.0 else 0.0


def strongest_partial(audio: np.ndarray) -> float:
    """Frequency of the strongest partial, in bins of the spectrum of all frames; 0 if there is none.

    audio: [frames, channels]
    """
    power = np.sum(np.abs(np.fft.rfft(audio * np.hanning(len(audio) + 2)[1:-1, None], axis=0)) ** 2, axis=1)
    if len(power) < 5 or not power[2:-1].any():
        return 0.0
    return parabolic_peak(power, 2 + int(np.argmax(power[2:-1])))


def parabolic_peak(power: np.ndarray, n: int) -> float:
    """Frequency, in bins, of the peak at bin n of a power spectrum: the top of a parabola through its logarithm."""
    a, b, c = np.log(power[n - 1 : n + 2] + 1e-300)
    curvature = a - 2 * b + c
    return n + (0.5 * float(a - c) / float(curvature) if curvature < 0.0 else 0.0)
