"""Partials of a sound: their frequencies and energies, whenever they sound.

A spectrum of the whole would split the line of a mode that is struck twice, and a window over the whole would be deaf
at its ends. So the spectrum is the sum of those of short windows that overlap, in which each sample counts alike: a
peak in it is as high as its partial has energy. The frequency is that of the oscillation, from one instant to the next.
"""

import itertools
import math
from dataclasses import dataclass

import numpy as np

from engine.analysis.metrics import parabolic_peak

MIN_PITCH_HZ = 20.0  # what is lower is no pitch, but bouncing or drift
FUNDAMENTAL_RANGE_DB = 20.0  # of energy below the strongest partial, within which a lower one may be the fundamental
SEEN_RANGE_DB = 50.0  # below the highest peak, within which others are told from a partial
PROMINENCE_DB = 10.0  # by which a partial stands above the valleys beside it
TONALITY_DB = 25.0  # of the strongest partial over the median of the spectrum; noise reaches 14
MIRRORED_SECONDS = 0.025  # before the begin of a sound
WINDOW_SECONDS = 0.4  # long enough for partials 10 Hz apart
WINDOW_TERMS = 0.35875, -0.48829, 0.14128, -0.01168  # Blackman-Harris: side lobes of -92 dB, also beside an offset
OVERLAP = 4  # windows over each sample, whose squares sum to a constant
BAND = 4.0  # half the width of the band of a partial, over its standard deviation
MAX_BAND_SHARE, MAX_BAND_HZ = 0.25, 400.0  # for the standard deviation: of its frequency, and in all
ONSET = 3.0  # standard deviations of what a band makes of a blow, in time: so much of the beginning is left out
MAX_ONSET_SHARE = 0.3  # of the sound
ROUNDS = 30  # of the fit of a frequency


@dataclass(frozen=True)
class Spectrum:
    """A spectrum of all of a sound: values [bins, channels] of its Fourier transform; the width of a bin, Hz; and the
    length of the sound, s."""

    values: np.ndarray
    bin_width: float
    seconds: float

    def frequency_near(self, frequency: float, width: float) -> float:
        """Frequency of the oscillation in a band around a frequency, Hz.

        width: standard deviation of the band, a Gaussian, Hz

        The complex amplitude z of the band turns by one angle from each sample to the next, but where it is struck. So
        ρ = z[n + 1]/z[n] is the one with the least Σ |z[n + 1] - ρ·z[n]|, found by weighted least squares.
        """
        reach = BAND * width
        first, last = (round((frequency + way * reach) / self.bin_width) for way in (-1, 1))
        first, last = max(first, 1), min(last, len(self.values) - 1)
        bins = np.arange(first, last + 1)
        band = np.exp(-0.5 * ((bins * self.bin_width - frequency) / width) ** 2)[:, None] * self.values[bins]
        z = np.fft.ifft(band, 2 ** math.ceil(math.log2(2 * len(bins))), axis=0)  # less the frequency of the first bin
        seconds = 1 / (self.bin_width * len(z))  # from one sample to the next
        skipped = min(ONSET / (2 * math.pi * width), MAX_ONSET_SHARE * self.seconds)
        z = z[round(skipped / seconds) : max(round(self.seconds / seconds), round(skipped / seconds) + 2)]
        before, after = z[:-1], z[1:]
        weight = np.ones(len(before))
        floor = 1e-9 * float(np.abs(z).max())
        cross, square = np.sum(after * before.conj(), axis=1), np.sum(np.abs(before) ** 2, axis=1)
        ratio = 0.0j
        for _ in range(ROUNDS):
            previous, ratio = ratio, (weight @ cross) / (weight @ square)
            if abs(ratio - previous) < 1e-10:
                break
            weight = 1 / (np.sqrt(np.sum(np.abs(after - ratio * before) ** 2, axis=1)) + floor)
        turns = math.atan2(ratio.imag, ratio.real) / (2 * math.pi) % 1.0
        return first * self.bin_width + turns / seconds


def centroid_of(sound: np.ndarray, samplerate: float) -> float | None:
    """Mean frequency of a sound [frames, channels] from 20 Hz up, weighted by power, Hz; None if there is none.

    sound: from its first sample on that is not silent

    A sound that begins at once has the spectrum of a step beside its own, which would count, and grow with the sample
    rate. So it is continued before its begin by its mirror image, of one sign or the other, whichever leaves less above
    (the smaller mean cube of the frequency); the two are faded into each other such that each sample counts once.
    """
    frames = min(round(MIRRORED_SECONDS * samplerate), len(sound) - 1)
    rise = np.sin(0.25 * math.pi * (1 + np.arange(-frames, frames + 1) / (frames + 1)))[:, None] ** 2
    rise = np.sin(0.5 * math.pi * rise)  # smooth, and the squares of two that meet sum to 1
    moments = []  # Σ of power, of power times frequency, and times its cube, which a step and a bend raise
    for mirrored, sign in ((sound, 1.0), (np.concatenate([np.zeros((1, sound.shape[1])), sound]), -1.0)):
        both = np.concatenate([sign * mirrored[frames:0:-1], mirrored])
        both[: len(rise)] *= rise
        spectrum = spectrum_of(both.astype(np.float32), samplerate)
        power = np.abs(spectrum.values) ** 2
        frequency = spectrum.bin_width * np.arange(len(power))
        power[: math.ceil(MIN_PITCH_HZ / spectrum.bin_width)] = 0.0
        moments.append(np.array([frequency**n @ power for n in (0, 1, 3)]))
    even, odd = moments
    total, first = np.where(even[2] * odd[0] <= odd[2] * even[0], even, odd)[:2].sum(axis=1)
    return float(first / total) if total > 0.0 else None


def spectrum_of(sound: np.ndarray, samplerate: float) -> Spectrum:
    """Return the spectrum of a sound [frames, channels] that begins and ends at zero."""
    from scipy.fft import next_fast_len, rfft

    size = next_fast_len(len(sound) + round(0.1 * samplerate), real=True)
    return Spectrum(rfft(sound, size, axis=0), samplerate / size, len(sound) / samplerate)


def power_in_windows(sound: np.ndarray, samplerate: float) -> tuple[np.ndarray, float]:
    """Sum of the power spectra [bins] of windows over a sound [frames, channels], and the width of a bin, Hz."""
    from scipy.fft import next_fast_len, rfft

    length = min(round(WINDOW_SECONDS * samplerate), len(sound))
    length = max(OVERLAP, -(-length // OVERLAP) * OVERLAP)
    hop, size = length // OVERLAP, next_fast_len(max(length, round(WINDOW_SECONDS * samplerate)), real=True)
    phase = 2 * math.pi * np.arange(length) / length
    window = np.array(WINDOW_TERMS) @ np.cos(np.arange(len(WINDOW_TERMS))[:, None] * phase)
    power = np.zeros(size // 2 + 1)
    padded = np.pad(sound.T, ((0, 0), (length, length))).astype(np.float32)  # peaks are found, no more
    window = window.astype(np.float32)
    for begin in range(hop, len(sound) + length, hop):
        part = rfft(padded[:, begin : begin + length] * window, size)
        power += np.sum(part.real**2 + part.imag**2, axis=0)
    return power, samplerate / size


def find_partials(sound: np.ndarray, samplerate: float) -> tuple[float | None, float | None]:
    """Frequencies of the fundamental and of the strongest partial of a sound, Hz; None if none stands out.

    sound: [frames, channels]
    """
    from scipy.signal import find_peaks

    power, bin_width = power_in_windows(sound, samplerate)
    lowest = math.ceil(MIN_PITCH_HZ / bin_width)
    if len(power) < lowest + 3 or not power[lowest:].any():
        return None, None
    level = 10 * np.log10(power + 1e-30 * power[lowest:].max())
    top = float(level[lowest:].max())
    if top - float(np.median(level[lowest:])) < TONALITY_DB:
        return None, None
    peaks = find_peaks(level, height=top - SEEN_RANGE_DB, prominence=PROMINENCE_DB)[0]
    peaks = peaks[peaks >= lowest]
    if len(peaks) == 0:
        return None, None
    energies = peak_energies(power, peaks)
    strongest = int(np.argmax(energies))
    fundamental = int(np.argmax(energies > energies[strongest] * 10 ** (-FUNDAMENTAL_RANGE_DB / 10)))

    spectrum = spectrum_of(sound, samplerate)

    def refined(n: int) -> float:
        frequency = parabolic_peak(power, int(peaks[n])) * bin_width
        gaps = [abs(frequency - bin_width * peaks[m]) for m in (n - 1, n + 1) if 0 <= m < len(peaks)]
        width = min([MAX_BAND_HZ, MAX_BAND_SHARE * frequency, *(gap / BAND for gap in gaps)])
        return spectrum.frequency_near(frequency, width)

    return refined(fundamental), refined(strongest)


def peak_energies(power: np.ndarray, peaks: np.ndarray) -> np.ndarray:
    """Energy of each peak of a power spectrum: what lies between the valleys beside it."""
    valleys = [int(a) + int(np.argmin(power[a:b])) for a, b in itertools.pairwise(peaks)]
    sums = np.concatenate([[0.0], np.cumsum(power)])
    bounds = [0, *valleys, len(power)]
    return np.array([sums[b] - sums[a] for a, b in itertools.pairwise(bounds)])
