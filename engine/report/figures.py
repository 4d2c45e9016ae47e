"""Figures as PNG files, and what all of them share: colours, units and margins. Matplotlib is imported when the first
is drawn.

Lines differ in style as well as in colour, and colour maps run from light to dark, so that all can be told apart in
print and by those who do not see colours.
"""

import io
import math
import textwrap
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

LEVEL_MAP = "magma_r"  # perceptually uniform, from light to dark: of levels, where nothing is light
SIGNED_MAP = "cividis"  # perceptually uniform, from dark to light: of displacements, where zero is the middle
BLUE, ORANGE, GREEN = "#0072b2", "#d55e00", "#009e73"  # of Okabe and Ito, which everyone can tell apart
TITLE_WIDTH = 1000  # characters times their size in points: what fits into 8 inches
MAX_TITLE_LINES = 3
GREY = "#7b7f86"  # legible on white and on black
TINTED_ITEMS = ("text.color", "axes.labelcolor", "axes.edgecolor", "xtick.color", "ytick.color")
PAGE_STYLE: dict[Any, Any] = dict.fromkeys(TINTED_ITEMS, GREY)
PAGE_STYLE |= {"savefig.transparent": True, "legend.framealpha": 0.0, "font.size": 11}
SI_PREFIXES = {-12: "p", -9: "n", -6: "µ", -3: "m", 0: "", 3: "k", 6: "M", 9: "G"}


@contextmanager
def new_figure(path: Path | io.BytesIO, width: float, height: float, dpi: int, layout: str | None) -> Iterator[Any]:
    """Give an empty figure to draw on, and write it as a PNG. Sizes in inches."""
    import matplotlib

    matplotlib.use("Agg")
    from matplotlib import pyplot

    figure = pyplot.figure(figsize=(width, height), layout=layout)
    try:
        yield figure
        figure.savefig(path, dpi=dpi, format="png", metadata={"Software": None})
    finally:
        pyplot.close(figure)


@contextmanager
def open_figure(
    path: Path | io.BytesIO,
    width: float,
    height: float,
    dpi: int = 120,
    layout: str | None = "constrained",
    **panels: Any,
) -> Iterator[Any]:
    """Give axes to draw on, and write them as a PNG. Sizes in inches; panels: options of Figure.subplots"""
    with new_figure(path, width, height, dpi, layout) as figure:
        yield figure.subplots(**panels)


def panel_png(plot_panel: Callable[[Any, Any], None], subject: Any, height: float) -> bytes:
    """A PNG of one panel, transparent, for a page of any colour. All have the same margins, so that their time axes
    line up.

    subject: the rendering or study that is drawn; height: inches
    """
    from matplotlib import rc_context

    edges = {"left": 0.125, "right": 0.85, "bottom": 0.54 / height, "top": 1 - 0.3 / height}
    picture = io.BytesIO()
    with rc_context(PAGE_STYLE), open_figure(picture, 6.4, height, 180, layout=None, gridspec_kw=edges) as axes:
        plot_panel(axes, subject)
    return picture.getvalue()


def si_scale(peak: float, unit: str) -> tuple[float, str]:
    """By what to multiply values of a unit so that the largest has one to three digits before the point, and the unit
    with its prefix: 0.04 in "J" gives 1000 and "mJ". peak: the largest absolute value"""
    exponent = 3 * math.floor(math.log10(peak) / 3 + 1e-9) if 0.0 < peak < math.inf else 0
    exponent = min(max(exponent, min(SI_PREFIXES)), max(SI_PREFIXES))
    return 10.0**-exponent, SI_PREFIXES[exponent] + unit


def si_text(value: float, unit: str) -> str:
    """A value in words, with three digits and a prefix: 0.0008163 in "s" gives "816 µs"."""
    factor, prefixed = si_scale(abs(value), unit)
    return f"{value * factor:.3g} {prefixed}"


def put_legend_above(axes: Any, lines: list[Any]) -> None:
    """Put a legend of lines above axes, in one row, where it covers nothing."""
    axes.legend(
        handles=lines,
        loc="lower right",
        bbox_to_anchor=(1.0, 1.0),
        ncols=len(lines),
        frameon=False,
        fontsize="x-small",
        borderaxespad=0.1,
        columnspacing=1.2,
    )


def put_colour_bar(axes: Any, mesh: Any, label: str) -> None:
    """Put the colour bar of an image beside its axes, which keep their width."""
    axes.figure.colorbar(mesh, cax=axes.inset_axes((1.015, 0.0, 0.02, 1.0)), label=label)


def set_title(axes: Any, title: str, size: int = 12) -> None:
    """Put a title over axes, as it is: a dollar sign begins no formula, and a long one has several lines. size: points,
    for axes of 8 inches"""
    lines = textwrap.wrap(title, TITLE_WIDTH // size, max_lines=MAX_TITLE_LINES, placeholder=" …")
    axes.set_title("\n".join(lines), size=size, parse_math=False)
