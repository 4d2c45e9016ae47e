"""Tables and the figure of an instrument beside recordings."""

import math
from collections.abc import Callable

from bench.publish.report import figure, publish
from bench.recordings.instrument import INSTRUMENT, KeyResult
from bench.recordings.keys import key_name
from bench.recordings.plot import draw
from bench.recordings.summary import mean_of
from bench.recordings.targets import SIGNED, layer_table, number, octave_table, target_table

KEYS_HEADER = [
    "key",
    "level difference, dB",
    "level over the recorded one, dB",
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


def key_row(result: KeyResult, gain: float = 0.0) -> list[str]:
    """One key, recorded and rendered. gain: of the instrument, dB"""
    one, two, three = number(".0f"), number(".1f"), number(".2f")
    its, mine = result.recorded, result.rendered

    def both(name: str, shown: Callable[[float], str]) -> list[str]:
        return [shown(getattr(its, name)), shown(getattr(mine, name)) if mine else ""]

    return [
        key_name(result.key),
        two(result.off.levels),
        SIGNED(level_over_recorded([result]) - gain),
        *(two(d.levels) for d in (result.other_velocities, result.neighbour)),
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


def level_over_recorded(results: list[KeyResult]) -> float:
    """Level of the instrument over the recorded one, dB, the mean over layers and keys."""
    return mean_of(note.level for r in results for note in r.notes if note.source == INSTRUMENT)


def publish_instrument(name: str, results: list[KeyResult], fitted: tuple[int, ...]) -> None:
    """Print and write the tables, and draw the figure. fitted: keys"""
    rows = {"": target_table, "_layers": layer_table, "_octaves": octave_table}
    for part, table in rows.items():
        publish(f"recordings_{name}{part}", *table(results, fitted), "recordings")
    gain = level_over_recorded([r for r in results if r.key not in fitted])
    publish(f"recordings_{name}_keys", KEYS_HEADER, [key_row(r, gain) for r in results], "recordings")
    with figure(f"recordings_{name}", 10.0, 11.0, nrows=4, sharex=True) as axes:
        draw(axes, results, fitted)
