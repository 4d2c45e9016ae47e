"""Tables and the figure of an instrument beside recordings."""

import math
from collections.abc import Callable
from dataclasses import astuple
from typing import NamedTuple

from bench.publish.report import figure, publish
from bench.recordings.instrument import KeyResult, mean_distance
from bench.recordings.keys import key_name
from bench.recordings.plot import draw

KEYS_HEADER = [
    "key",
    "level difference, dB",
    "difference from other velocities, dB",
    "difference from the neighbouring key, dB",
    "pitch, cents: recorded",
    "pitch, cents: rendered",
    "B: recorded",
    "partials read",
    "B: rendered / recorded",
    "early decay, dB/s: recorded",
    "early decay, dB/s: rendered",
    "late decay, dB/s: recorded",
    "late decay, dB/s: rendered",
    "early decay: error factor",
    "late decay: error factor",
    "knock, dB: recorded",
    "knock, dB: rendered",
    "brightness, dB per dB: recorded",
    "brightness, dB per dB: rendered",
]


class Target(NamedTuple):
    """A requirement on the mean over keys."""

    name: str
    most: float
    text: str
    shown: Callable[[float], str]


def percent(value: float) -> str:
    """A share, or nothing if it is not a number."""
    return f"{100 * value:.0f} %" if math.isfinite(value) else ""


def number(pattern: str) -> Callable[[float], str]:
    """Writes a number; nothing if it is not one."""
    return lambda value: format(value, pattern) if math.isfinite(value) else ""


TARGETS = (  # as in Distance
    Target("levels in third-octave bands", 8.0, "≤ 8 dB", lambda x: f"{number('.1f')(x)} dB" if x == x else ""),
    Target("inharmonicity", 0.10, "within 10 %", percent),
    Target("early decay", 1.5, "within a factor of 1.5", number(".2f")),
    Target("late decay", 1.5, "within a factor of 1.5", number(".2f")),
    Target("change of brightness with level", 0.20, "within 20 %", percent),
)


def key_row(result: KeyResult) -> list[str]:
    """One key, recorded and rendered."""
    one, two, three = number(".0f"), number(".1f"), number(".2f")
    its, mine = result.recorded, result.rendered

    def both(name: str, shown: Callable[[float], str]) -> list[str]:
        return [shown(getattr(its, name)), shown(getattr(mine, name)) if mine else ""]

    return [
        key_name(result.key),
        *(two(d.levels) for d in (result.off, result.other_velocities, result.neighbour)),
        *both("cents", two),
        f"{its.inharmonicity:.2e}" if math.isfinite(its.inharmonicity) else "",
        str(its.partials),
        three(mine.inharmonicity / its.inharmonicity) if mine else "",
        *both("early", one),
        *both("late", two),
        three(result.off.early),
        three(result.off.late),
        *both("knock", one),
        *both("brightness", three),
    ]


def summary_rows(results: list[KeyResult], tuned: tuple[int, ...]) -> list[list[str]]:
    """Means over the keys not tuned on, over those tuned on, and of the recordings among themselves."""
    mine = [r for r in results if r.rendered]
    new, old = ([r.off for r in mine if (r.key in tuned) is seen] for seen in (False, True))
    means = [mean_distance(d) for d in (new, old)]
    means += [mean_distance([r.other_velocities for r in results]), mean_distance([r.neighbour for r in results])]
    rows = [["number of keys", "", str(len(new)), "", str(len(old)), "", str(len(results)), str(len(results))]]
    for target, *values in zip(TARGETS, *map(astuple, means), strict=True):
        shown = [target.shown(value) for value in values]
        rows.append([target.name, target.text, shown[0], met(values[0], target), shown[1], met(values[1], target)])
        rows[-1] += shown[2:]
    return rows


SUMMARY_HEADER = [
    "mean over keys",
    "target",
    "other keys",
    "other keys: target",
    "keys used for tuning",
    "keys used for tuning: target",
    "recordings: other velocities",
    "recordings: neighbouring key, retuned",
]


def met(value: float, target: Target) -> str:
    """Say if a target is met; "" if there is no value."""
    return "" if math.isnan(value) else "met" if value <= target.most else "not met"


def publish_instrument(name: str, results: list[KeyResult], tuned: tuple[int, ...]) -> None:
    """Print and write both tables, and draw the figure."""
    publish(f"recordings_{name}", SUMMARY_HEADER, summary_rows(results, tuned), "recordings")
    publish(f"recordings_{name}_keys", KEYS_HEADER, [key_row(r) for r in results], "recordings")
    with figure(f"recordings_{name}", 10.0, 11.0, nrows=4, sharex=True) as axes:
        draw(axes, results, tuned)
