"""Seeded noise: each seed gives one sequence at one rate, so that all sample rates have the same noise."""

import math

import numpy as np

from engine.patch.tables import NoiseForce

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
    low_edge, high_edge = (math.tan(math.pi * f / NOISE_RATE) for f in (low, high))
    # in u = ln tan(ω/2), where both edges are as wide: dω = 2·x/(1 + x²) du
    u = np.linspace(math.log(low_edge) - 8, math.log(high_edge) + 8, 20_001)
    x = np.exp(u)
    power = 1 / (1 + (low_edge / x) ** (2 * FILTER_ORDER)) / (1 + (x / high_edge) ** (2 * FILTER_ORDER))
    return math.sqrt(np.trapezoid(power * 2 * x / (1 + x**2), u) / math.pi)
