"""Tables of an instrument beside natural variation and peers: targets, layers, octaves."""

import math
from collections.abc import Callable
from typing import NamedTuple

from bench.recordings.distances import ANOTHER_LAYER, NEIGHBOUR, NoteResult
from bench.recordings.instrument import INSTRUMENT, Distance, KeyResult, mean_distance
from bench.recordings.keys import layer_velocity
from bench.recordings.octaves import OCTAVES
from bench.recordings.summary import (
    at_layer,
    brightness_errors,
    largest,
    level_errors,
    mean_of,
    octave_means,
    unevenness,
)

Table = tuple[list[str], list[list[str]]]  # its header and its rows
FITTED = "keys used for tuning"


class Group(NamedTuple):
    """What means are taken over."""

    notes: list[NoteResult]
    strings: Distance  # the mean over keys

    @property
    def layers(self) -> list[int]:
        """Those that there are."""
        return sorted({note.layer for note in self.notes})


class Target(NamedTuple):
    """A measure of a group, and a requirement on it, if there is one."""

    name: str
    value: Callable[[Group], float]
    shown: Callable[[float], str]
    most: float = math.nan  # of the value, or of its ratio to that of the neighbouring key
    text: str = ""
    is_ratio: bool = False

    def judge(self, value: float, neighbour: float) -> str:
        """Say if the target is met; "" if there is no value."""
        most = self.most * (neighbour if self.is_ratio else 1.0)
        return "" if not math.isfinite(value - most) else "met" if value <= most else "not met"


def percent(value: float) -> str:
    """A share, or nothing if it is not a number."""
    return f"{100 * value:.0f} %" if math.isfinite(value) else ""


def number(pattern: str) -> Callable[[float], str]:
    """Writes a number; nothing if it is not one."""
    return lambda value: format(value, pattern) if math.isfinite(value) else ""


def mean_over(measure: str) -> Callable[[Group], float]:
    """Takes the mean of a distance over keys and layers."""
    return lambda group: mean_of(getattr(note, measure) for note in group.notes)


def softest_bands(group: Group) -> float:
    """Mean distance of spectra at the softest layer, dB."""
    return mean_of(note.bands for note in at_layer(group.notes, min(group.layers, default=0)))


def worst_level(group: Group) -> float:
    """The largest error in level of a layer, dB."""
    return largest(level_errors(group.notes, group.layers))


def worst_brightness(group: Group) -> float:
    """The largest error in brightness of a layer, dB."""
    return largest(brightness_errors(group.notes, group.layers))


def mean_decay(group: Group) -> float:
    """Factor by which late decays are off, the mean over octaves."""
    return math.exp(mean_of(math.log(octave.factor) for octave in octave_means(group.notes)))


def worst_decay(group: Group) -> float:
    """Factor by which the late decay of an octave is off where that is most."""
    return largest(octave.factor for octave in octave_means(group.notes))


def worst_correlation(group: Group) -> float:
    """Error of the mean correlation of left and right in the octave where that is most."""
    return largest(octave.correlation - octave.recorded for octave in octave_means(group.notes))


ONE, TWO = number(".1f"), number(".2f")
SIGNED = number("+.1f")
TARGETS = (
    Target("third octaves, dB", mean_over("bands"), TWO, 1.05, "≤ 1.05 × neighbour", True),
    Target("third octaves, softest layer, dB", softest_bands, TWO, 1.15, "≤ 1.15 × neighbour", True),
    Target("third octaves in three windows, dB", mean_over("windows"), TWO, 1.1, "≤ 1.1 × neighbour", True),
    Target("third octaves of the attack, dB", mean_over("attack"), TWO, 1.05, "≤ 1.05 × neighbour", True),
    Target("level of a layer, worst, dB", worst_level, ONE, 1.5, "≤ 1.5 dB"),
    Target("brightness of a layer, worst, dB", worst_brightness, ONE),
    Target("level from key to key, RMS, dB", lambda group: unevenness(group.notes), ONE, 2.2, "≤ 2.2 dB"),
    Target("late decay by octave, factor, mean", mean_decay, TWO),
    Target("late decay by octave, factor, worst octave", worst_decay, TWO, 2.0, "≤ 2"),
    Target("correlation of left and right, worst octave", worst_correlation, TWO, 0.3, "within 0.3"),
    Target("inharmonicity", lambda group: group.strings.stiffness, percent, 0.10, "within 10 %"),
    Target("early decay of partials, factor", lambda group: group.strings.early, TWO, 1.5, "≤ 1.5"),
    Target("late decay of partials, factor", lambda group: group.strings.late, TWO, 1.5, "≤ 1.5"),
    Target("change of brightness with level", lambda group: group.strings.brightness, percent, 0.20, "within 20 %"),
)


def group_results(results: list[KeyResult], fitted: tuple[int, ...]) -> dict[str, Group]:
    """Groups by name: the instrument first, then at fitted keys, natural variation, and peers; all but the second at
    the keys that were not fitted."""
    new, old = ([r for r in results if (r.key in fitted) is seen] for seen in (False, True))
    strings = {
        INSTRUMENT: mean_distance([r.off for r in new]),
        ANOTHER_LAYER: mean_distance([r.other_velocities for r in new]),
        NEIGHBOUR: mean_distance([r.neighbour for r in new]),
    }
    sources = dict.fromkeys([*strings, *(note.source for r in new for note in r.notes)])

    def group(results: list[KeyResult], source: str, strings: Distance) -> Group:
        return Group([note for r in results for note in r.notes if note.source == source], strings)

    groups = {source: group(new, source, strings.get(source, Distance())) for source in sources}
    at_fitted = group(old, INSTRUMENT, mean_distance([r.off for r in old]))
    return {INSTRUMENT: groups.pop(INSTRUMENT), FITTED: at_fitted} | groups


def target_table(results: list[KeyResult], fitted: tuple[int, ...]) -> Table:
    """Means over notes, and which targets are met."""
    groups = group_results(results, fitted)
    others = list(groups)[1:]
    header = ["measure", "target", INSTRUMENT, "target met", "ratio to the neighbour", *others]
    rows = [["number of notes", "", str(len(groups[INSTRUMENT].notes)), "", ""]]
    rows[0] += [str(len(groups[name].notes)) for name in others]
    for target in TARGETS:
        values = {name: target.value(group) for name, group in groups.items()}
        if target.value in (worst_level, worst_brightness):  # a layer beside another shows no error
            values[ANOTHER_LAYER] = math.nan
        mine, its = values[INSTRUMENT], values[NEIGHBOUR]
        ratio = TWO(mine / its) if target.is_ratio else ""
        rows.append([target.name, target.text, target.shown(mine), target.judge(mine, its), ratio])
        rows[-1] += [target.shown(values[name]) for name in others]
    return header, rows


def layer_table(results: list[KeyResult], fitted: tuple[int, ...]) -> Table:
    """Means over keys at each layer."""
    groups = group_results(results, fitted)
    layers = groups[NEIGHBOUR].layers
    spectra = {
        "third octaves": "bands",
        "third octaves in three windows": "windows",
        "third octaves of the attack": "attack",
    }
    rows = []
    for name, measure in spectra.items():
        for layer in layers:
            means = [mean_of(getattr(n, measure) for n in at_layer(group.notes, layer)) for group in groups.values()]
            rows.append([f"{name}, layer {layer}", *map(ONE, means)])
    for name, errors in {"level": level_errors, "brightness": brightness_errors}.items():
        by_group = [
            errors(group.notes, layers) if source != ANOTHER_LAYER else [math.nan] * len(layers)
            for source, group in groups.items()
        ]
        for layer, *values in zip(layers, *by_group, strict=True):
            rows.append([f"{name} over the recorded one, layer {layer}", *map(SIGNED, values)])
    velocities = ", ".join(f"{layer}: {layer_velocity(layer)}" for layer in layers)
    return [f"dB, mean over keys (MIDI velocity of layer {velocities})", *groups], rows


def octave_table(results: list[KeyResult], fitted: tuple[int, ...]) -> Table:
    """Late decay, and correlation of left and right, by octave."""
    groups = {name: octave_means(group.notes) for name, group in group_results(results, fitted).items()}
    mine, its = groups[INSTRUMENT], groups[NEIGHBOUR]
    peers = [name for name in groups if name not in (INSTRUMENT, FITTED, NEIGHBOUR, ANOTHER_LAYER)]
    header = ["octave, Hz", "notes that decay there", "late decay, factor", "late decay / recorded"]
    header += [f"late decay, factor: {name}" for name in (NEIGHBOUR, *peers)]
    header += ["correlation, recorded", "correlation", f"correlation, {NEIGHBOUR}"]
    header += ["correlations differ by", f"correlations differ by: {NEIGHBOUR}"]
    rows = []
    for n in range(len(mine)):
        one, other = mine[n], its[n]
        row = [f"{OCTAVES[n]:.0f}", str(one.notes), TWO(one.factor), TWO(one.ratio), TWO(other.factor)]
        row += [TWO(groups[name][n].factor) for name in peers]
        row += map(TWO, (one.recorded, one.correlation, other.correlation, one.apart, other.apart))
        rows.append(row)
    return header, rows
