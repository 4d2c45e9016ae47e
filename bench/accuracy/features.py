"""Errors of the features of sounds, for two hundred synthetic ones whose features are known."""

import math
from collections.abc import Callable
from dataclasses import dataclass

from bench.publish import cli
from bench.publish.report import publish
from bench.scenes.known_sounds import Bounds, KnownSound, known_sounds
from engine.analysis.features import features

HEADER = [
    "sounds",
    "number",
    "fundamental, cents",
    "strongest, cents",
    "centroid, %",
    "T60, %",
    "no T60",
]
MADE = "Largest errors; made by `uv run python -m bench features`."


@dataclass(frozen=True)
class FeatureErrors:
    """Errors of the features of a sound; None where one is rightly not defined, or not asked for, and infinite where it
    is missing, or should be."""

    sound: KnownSound
    fundamental: float | None  # cents
    strongest: float | None  # cents
    centroid: float | None  # share
    t60: float | None  # share
    reason: str | None  # why there is no T60


def feature_errors(sound: KnownSound) -> FeatureErrors:
    """Measure the features of a sound, and compare them."""
    found = features(sound.audio, sound.rate)
    t60 = found["t60_s"]
    errors = [t60 / right - 1 for right in sound.t60] if t60 is not None else [math.inf] * sound.has_t60
    if t60 is not None and not errors:
        errors = [math.inf]
    centroid = None
    if sound.centroid is not None:
        centroid = math.inf if found["centroid_hz"] is None else found["centroid_hz"] / sound.centroid - 1
    return FeatureErrors(
        sound,
        cents_from(found["fundamental_hz"], sound.fundamental),
        cents_from(found["strongest_hz"], sound.strongest),
        centroid,
        min(errors, key=abs, default=None),
        found["t60_reason"],
    )


def cents_from(frequency: float | None, bounds: Bounds | None) -> float | None:
    """How far a frequency is from the nearest within bounds, cents."""
    if frequency is None or bounds is None:
        return None if frequency is bounds is None else math.inf
    return 1200 * math.log2(frequency / min(max(frequency, bounds[0]), bounds[1]))


def run() -> None:
    """Measure all sounds, and publish the largest errors of each kind in docs/cli.md."""
    kinds: dict[str, list[FeatureErrors]] = {}
    for sound in known_sounds():
        kinds.setdefault(sound.kind, []).append(feature_errors(sound))
    kinds["all"] = [errors for kind in kinds.values() for errors in kind]

    def worst(found: list[FeatureErrors], error: Callable[[FeatureErrors], float | None], unit: float) -> str:
        sizes = [abs(size) for one in found if (size := error(one)) is not None]
        return f"{unit * max(sizes):.2g}" if sizes else "none"

    rows = [
        [
            kind,
            str(len(found)),
            worst(found, lambda one: one.fundamental, 1.0),
            worst(found, lambda one: one.strongest, 1.0),
            worst(found, lambda one: one.centroid, 100.0),
            worst(found, lambda one: one.t60, 100.0),
            str(sum(one.reason is not None for one in found)),
        ]
        for kind, found in kinds.items()
    ]
    publish("features", HEADER, rows, made=MADE)
    cli.run()  # the page of the table
