"""The plot of a work-precision study: error against time, of its settings."""

import math
from itertools import product
from pathlib import Path
from typing import TYPE_CHECKING, Any

from engine.report.figures import BLUE, PLOT_STYLES, new_figure, note_size, set_title

if TYPE_CHECKING:
    from engine.analysis.work_precision import SettingResult, WorkPrecisionStudy

GREY = "0.55"
LABEL_OFFSETS = [  # points from the middle of a label's side to the point it names, the nearest first
    (dx * distance, dy * distance)
    for distance in (5, 12, 20, 30, 42)
    for dy, dx in product((1, -1, 0), (1, -1, 0))
    if (dx, dy) != (0, 0)
]
LABEL_MARGIN = 1.5  # pixels between two labels


def plot_work_precision(study: "WorkPrecisionStudy", title: str, path: Path, style: str = "screen") -> None:
    """Write a plot of error against time to a picture (engine.analysis.work_precision). style: one of PLOT_STYLES"""
    look = PLOT_STYLES[style]
    with new_figure(path, 9.0, 6.0, look) as figure:
        axes = figure.subplots()
        set_title(axes, f"{title}: {study['verdict']}", look.title and 9)
        draw_work_precision(axes, study)


def draw_work_precision(axes: Any, study: "WorkPrecisionStudy") -> None:
    """Draw error against time of the settings, or the error of bands where that of the motion is unknown."""
    if not study["rows"]:
        axes.set_axis_off()
        return
    has_errors = all(math.isfinite(row["error"]) for row in study["rows"])
    key, scale, label = (
        ("error", "log", "relative error") if has_errors else ("bands_db", "linear", "third-octave bands, dB")
    )
    if has_errors:
        front = sorted((r["ns_per_sample"], r["error"]) for r in study["rows"] if r["front"])
        axes.plot(*zip(*front, strict=True), color=BLUE, lw=1.5, label="this engine, Pareto-optimal settings")
    for row in study["rows"]:
        colour = BLUE if row["front"] else GREY
        axes.plot(row["ns_per_sample"], row[key], "o", color=colour, zorder=3)
    axes.set(xscale="log", yscale=scale, xlabel="ns per sample", ylabel=label)
    axes.xaxis.set_major_formatter("{x:g}")
    axes.xaxis.set_minor_formatter("{x:g}" if _is_short(axes.get_xlim()) else "")
    axes.grid(True, which="both", alpha=0.2)
    _label_settings(axes, study["rows"], key)


def _is_short(limits: tuple[float, float]) -> bool:
    """True if an axis is so short that labels at decades alone would be few."""
    return limits[1] / limits[0] < 10.0


def _label_settings(axes: Any, rows: "list[SettingResult]", key: str) -> None:
    """Write the name of each setting beside its point: where it lies within the axes, and on no other name or point."""
    figure = axes.figure
    figure.draw_without_rendering()  # a layout is made, and sizes of texts are known
    inside = axes.get_window_extent()
    points = axes.transData.transform([(row["ns_per_sample"], row[key]) for row in rows])
    taken: list[Any] = []

    def place(label: Any, offset: tuple[int, int]) -> Any:
        dx, dy = offset
        label.set(position=offset, ha=_align(dx, "left", "right"), va=_align(dy, "bottom", "top"))
        return label.get_window_extent().padded(LABEL_MARGIN)

    def badness(box: Any) -> int:
        is_inside = inside.x0 <= box.x0 and box.x1 <= inside.x1 and inside.y0 <= box.y0 and box.y1 <= inside.y1
        points_covered = sum(box.contains(*point) for point in points)
        return int(10 * (not is_inside) + 3 * sum(box.overlaps(other) for other in taken) + points_covered)

    for row in rows:
        position = row["ns_per_sample"], row[key]
        label = axes.annotate(row["setting"], position, (0, 0), textcoords="offset points", size=note_size())
        best = min(LABEL_OFFSETS, key=lambda offset: badness(place(label, offset)))
        taken.append(place(label, best))


def _align(offset: float, positive: str, negative: str) -> str:
    """Return the alignment of a label at an offset from its point."""
    return positive if offset > 0 else negative if offset < 0 else "center"
