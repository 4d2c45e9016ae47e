"""The figure of an instrument beside recordings: what differs, key by key."""

import math
from typing import Any

from bench.recordings.instrument import KeyResult
from bench.recordings.keys import key_name

RENDERED, RECORDED = "C0", "0.35"
STAGES = {"early": "-", "late": "--"}
RECORDED_STAGES: dict[str, dict[str, Any]] = {
    "early": {"color": RECORDED, "ms": 4, "label": "recorded, early"},
    "late": {"color": RECORDED, "ms": 4, "mfc": "none", "label": "recorded, late"},
}


def draw(axes: Any, results: list[KeyResult], tuned: tuple[int, ...]) -> None:
    """Draw differences, inharmonicity, decays, and knock over the keys, on four axes above each other."""
    mine = [r for r in results if r.rendered]
    draw_levels(axes[0], results, mine, tuned)
    draw_inharmonicity(axes[1], results, mine)
    draw_decays(axes[2], results, mine)
    keys = [r.key for r in results]
    axes[3].plot(keys, [r.recorded.knock for r in results], "o", color=RECORDED, label="recorded")
    axes[3].plot([r.key for r in mine], [r.rendered.knock for r in mine if r.rendered], "o-", color=RENDERED, ms=4)
    axes[3].set(ylabel="knock, dB", xlabel="key")
    axes[3].set_xticks(keys[::2], [key_name(key) for key in keys[::2]])
    for panel in axes:
        panel.grid(True, alpha=0.2)


def draw_levels(axes: Any, results: list[KeyResult], mine: list[KeyResult], tuned: tuple[int, ...]) -> None:
    """Draw the difference of levels, and between recordings."""
    keys = [r.key for r in results]
    axes.plot(keys, [r.neighbour.levels for r in results], ":", color=RECORDED, label="recorded neighbour, retuned")
    axes.plot(
        keys, [r.other_velocities.levels for r in results], "-", color=RECORDED, label="recorded, other velocities"
    )
    axes.plot([r.key for r in mine], [r.off.levels for r in mine], "o-", color=RENDERED, label="rendered")
    seen = [r for r in mine if r.key in tuned]
    axes.plot([r.key for r in seen], [r.off.levels for r in seen], "s", color="C1", label="rendered, tuned on this key")
    axes.set(ylabel="levels differ by, dB", ylim=(0.0, None))
    axes.legend(fontsize="x-small", ncols=2)


def draw_inharmonicity(axes: Any, results: list[KeyResult], mine: list[KeyResult]) -> None:
    """Draw B."""
    keys = [r.key for r in results]
    axes.semilogy(keys, [r.recorded.inharmonicity for r in results], "o", color=RECORDED, label="recorded")
    rendered = [r.rendered.inharmonicity for r in mine if r.rendered]
    axes.semilogy([r.key for r in mine], rendered, "o-", color=RENDERED, ms=4, label="rendered")
    axes.set(ylabel="inharmonicity B")
    axes.legend(fontsize="x-small")


def draw_decays(axes: Any, results: list[KeyResult], mine: list[KeyResult]) -> None:
    """Draw early and late decay."""
    for stage, line in STAGES.items():
        fall = [-getattr(r.recorded, stage) for r in results]
        axes.plot([r.key for r in results], [x if x > 0 else math.nan for x in fall], "o", **RECORDED_STAGES[stage])
        fall = [-getattr(r.rendered, stage) for r in mine]
        axes.plot([r.key for r in mine], fall, f"o{line}", color=RENDERED, ms=4, label=f"rendered, {stage}")
    axes.set(ylabel="partials fall, dB/s", yscale="log")
    axes.legend(fontsize="x-small")
