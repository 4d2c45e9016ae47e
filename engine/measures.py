"""How far one rendering is from another (ORACLES 10): sample by sample as long as the motion can be
predicted, and by what the ear and the books keep after that."""

import itertools
import math

import numpy as np

WINDOW = 0.005  # s, over which a horizon is looked for
LOST = 1e-3  # of the loudest: beyond, two runs that began alike are no longer alike
ENVELOPE = 0.01  # s
QUIET = 40.0  # dB below the loudest band, under which bands are not compared


def trajectory(audio: np.ndarray, reference: np.ndarray, frames: int) -> float:
    """Root mean square of the difference over the first frames, relative to that of the reference; without any
    frame, infinite."""
    if frames == 0:
        return math.inf
    size = float(np.sqrt(np.mean(reference[:frames] ** 2)))
    return float(np.sqrt(np.mean((audio[:frames] - reference[:frames]) ** 2))) / size if size > 0.0 else 0.0


def horizon(reference: np.ndarray, perturbed: np.ndarray, samplerate: float) -> int:
    """How many samples two runs stay alike that began alike to 1e-9."""
    size = max(1, round(WINDOW * samplerate))
    loudest = np.abs(reference).max(initial=0.0)
    for begin in range(0, len(reference), size):
        part = slice(begin, begin + size)
        if np.abs(reference[part] - perturbed[part]).max(initial=0.0) > LOST * loudest:
            return begin
    return len(reference)


def bands(audio: np.ndarray, samplerate: float) -> np.ndarray:
    """Power in third-octave bands from 25 Hz to 20 kHz, over all channels; only those below Nyquist."""
    centres = 1000.0 * 2.0 ** (np.arange(-16, 14) / 3)
    centres = centres[centres * 2 ** (1 / 6) < samplerate / 2]
    window = np.hanning(len(audio) + 2)[1:-1, None]
    power = np.sum(np.abs(np.fft.rfft(audio * window, axis=0)) ** 2, axis=1)
    frequency = np.fft.rfftfreq(len(audio), 1 / samplerate)
    edges = np.searchsorted(frequency, np.concatenate([centres * 2 ** (-1 / 6), centres[-1:] * 2 ** (1 / 6)]))
    return np.array([power[a:b].sum() for a, b in itertools.pairwise(edges)])


def band_error(audio: np.ndarray, reference: np.ndarray, samplerate: float) -> float:
    """Largest difference of a third-octave band, dB, among those within 40 dB of the loudest."""
    ours, theirs = bands(audio, samplerate), bands(reference, samplerate)
    loud = theirs > theirs.max(initial=0.0) * 10 ** (-QUIET / 10)
    if not loud.any():
        return 0.0
    with np.errstate(divide="ignore"):
        return float(np.max(np.abs(10 * np.log10(ours[loud] / theirs[loud]))))


def impulse(forces: np.ndarray, reference: np.ndarray) -> float:
    """Relative error of the impulse of all contacts."""
    size = float(np.abs(reference).sum())
    return abs(float(np.abs(forces).sum()) - size) / size if size > 0.0 else 0.0


def contacts(forces: np.ndarray, samplerate: float, apart: float = 0.0) -> list[tuple[float, float]]:
    """When anything touches, s: beginnings and ends; pauses up to `apart` (s) are passed over.

    forces: [frames, any number]
    """
    touching = np.concatenate([[False], np.any(forces != 0.0, axis=1), [False]])
    edges = np.flatnonzero(np.diff(touching)).reshape(-1, 2) / samplerate
    found: list[tuple[float, float]] = []
    for begin, end in edges.tolist():
        if found and begin - found[-1][1] <= apart:
            begin = found.pop()[0]
        found.append((begin, end))
    return found


def first_contact(forces: np.ndarray, samplerate: float) -> float:
    """Duration of the first contact, ms; 0 if there is none."""
    found = contacts(forces, samplerate)
    return (found[0][1] - found[0][0]) * 1e3 if found else 0.0


def rebound(forces: np.ndarray, velocities: np.ndarray) -> float:
    """Velocity of the body that touches first, when it first lets go; NaN if none does.

    forces, velocities: [frames, bodies]
    """
    ends = [contacts(force[:, None], 1.0)[:1] for force in forces.T]
    leaving = [(begin, end, body) for body, found in enumerate(ends) for begin, end in found if end < len(forces)]
    if not leaving:
        return math.nan
    _, end, body = min(leaving)
    return float(velocities[int(end), body])


def decay_error(audio: np.ndarray, reference: np.ndarray, samplerate: float) -> float:
    """Mean difference of the levels in windows of 10 ms, dB, where the reference is within 40 dB of its loudest."""
    size = max(1, round(ENVELOPE * samplerate))
    frames = len(reference) // size * size
    if frames == 0:
        return 0.0
    ours, theirs = (np.sum(x[:frames].reshape(-1, size, x.shape[1]) ** 2, axis=(1, 2)) for x in (audio, reference))
    loud = theirs > theirs.max() * 10 ** (-QUIET / 10)
    with np.errstate(divide="ignore"):
        return float(np.mean(np.abs(10 * np.log10(ours[loud] / theirs[loud])))) if loud.any() else 0.0


def detuning(audio: np.ndarray, reference: np.ndarray) -> float:
    """How far the strongest partial is off, cents."""
    ours, theirs = strongest(audio), strongest(reference)
    return 1200.0 * math.log2(ours / theirs) if ours > 0.0 and theirs > 0.0 else 0.0


def strongest(audio: np.ndarray) -> float:
    """Place of the strongest partial, in bins of the spectrum."""
    power = np.sum(np.abs(np.fft.rfft(audio * np.hanning(len(audio) + 2)[1:-1, None], axis=0)) ** 2, axis=1)
    if len(power) < 5 or not power[2:-1].any():
        return 0.0
    return vertex(power, 2 + int(np.argmax(power[2:-1])))


def vertex(power: np.ndarray, n: int) -> float:
    """Place of the peak at bin n of a spectrum, in bins: the top of a parabola through its logarithm."""
    a, b, c = np.log(power[n - 1 : n + 2] + 1e-300)
    curve = a - 2 * b + c
    return n + (0.5 * float(a - c) / float(curve) if curve < 0.0 else 0.0)
