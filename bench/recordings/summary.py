"""Means over notes of how far a source is from recordings, by layer and by octave."""

import math
from collections.abc import Callable, Iterable
from typing import NamedTuple

import numpy as np

from bench.recordings.distances import NoteResult

LEAST_NOTES = 5  # that have an octave, for its mean to say something


class Octave(NamedTuple):
    """One octave, over notes; not numbers if too few have it."""

    notes: int  # that have a late decay there
    factor: float  # geometric mean, 1 or more, by which it falls faster or slower
    ratio: float  # geometric mean of decays over the recorded ones: above 1, it dies sooner
    correlation: float  # of left and right, the mean
    recorded: float
    apart: float  # mean of the absolute differences of correlations, note by note


def mean_of(values: Iterable[float], mean: Callable[[list[float]], float] = np.mean) -> float:
    """Mean, or median, of what is a number."""
    finite = [value for value in values if math.isfinite(value)]
    return float(mean(finite)) if finite else math.nan


def at_layer(results: list[NoteResult], layer: int) -> list[NoteResult]:
    """Those of one layer."""
    return [r for r in results if r.layer == layer]


def level_errors(results: list[NoteResult], layers: Iterable[int]) -> list[float]:
    """By how much each layer is too loud, dB, mean over keys; one gain for all makes their mean zero."""
    means = np.array([mean_of(r.level for r in at_layer(results, layer)) for layer in layers])
    return list(means - np.nanmean(means)) if np.isfinite(means).any() else list(means)


def brightness_errors(results: list[NoteResult], layers: Iterable[int]) -> list[float]:
    """By how much each layer is too bright, dB, mean over keys."""
    return [mean_of(r.brightness for r in at_layer(results, layer)) for layer in layers]


def unevenness(results: list[NoteResult]) -> float:
    """RMS over keys of errors in level less their mean over the keys, all layers, dB."""
    by_layer = [[r.level for r in at_layer(results, layer)] for layer in {r.layer for r in results}]
    return math.sqrt(mean_of(float(np.var(levels)) for levels in by_layer if len(levels) > 1))


def octave_means(results: list[NoteResult]) -> list[Octave]:
    """Late decay and correlation by octave."""
    if not results:
        return []
    decays, mine, its = (
        np.array([getattr(r, name) for r in results]) for name in ("decays", "correlations", "recorded_correlations")
    )
    return [octave_mean(decays[:, n], mine[:, n], its[:, n]) for n in range(decays.shape[1])]


def octave_mean(decays: np.ndarray, correlations: np.ndarray, recorded: np.ndarray) -> Octave:
    """One octave. decays: natural logarithms of ratios [notes]; correlations [notes]"""
    known = decays[np.isfinite(decays)]
    both = np.isfinite(correlations) & np.isfinite(recorded)
    factor, ratio = math.nan, math.nan
    if len(known) >= LEAST_NOTES:
        factor, ratio = float(np.exp(np.mean(np.abs(known)))), float(np.exp(np.mean(known)))
    if both.sum() < LEAST_NOTES:
        return Octave(len(known), factor, ratio, math.nan, math.nan, math.nan)
    a, b = correlations[both], recorded[both]
    return Octave(len(known), factor, ratio, float(a.mean()), float(b.mean()), float(np.abs(a - b).mean()))


def largest(values: Iterable[float]) -> float:
    """The largest absolute value of those that are numbers; not a number of none."""
    return max((abs(value) for value in values if math.isfinite(value)), default=math.nan)
