"""Figures as PNG, PDF and SVG files, and what all of them share: styles, colours, units and margins. Matplotlib is
imported when the first is drawn.

Lines differ in style as well as in colour, and colour maps run from light to dark, so that all can be told apart in
print and by those who do not see colours.
"""

import io
import math
import textwrap
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from engine.output_files import atomic_write

LEVEL_MAP = "magma_r"  # perceptually uniform, from light to dark: of levels, where nothing is light
SIGNED_MAP = "cividis"  # perceptually uniform, from dark to light: of displacements, where zero is the middle
BLUE, ORANGE, GREEN = "#0072b2", "#d55e00", "#009e73"  # of Okabe and Ito, which everyone can tell apart
TITLE_WIDTH = 100  # characters times their size in points: what fits into an inch of the figure
MAX_TITLE_LINES = 3
GREY = "#7b7f86"  # legible on white and on black
TINTED_ITEMS = ("text.color", "axes.labelcolor", "axes.edgecolor", "xtick.color", "ytick.color")
PAGE_STYLE: dict[Any, Any] = dict.fromkeys(TINTED_ITEMS, GREY)
PAGE_STYLE |= {"savefig.transparent": True, "legend.framealpha": 0.0, "font.size": 11, "legend.fontsize": "x-small"}
SI_PREFIXES = {-12: "p", -9: "n", -6: "µ", -3: "m", 0: "", 3: "k", 6: "M", 9: "G"}


PICTURE_ENDINGS = (".png", ".pdf", ".svg")
METADATA: dict[str, dict[str, Any]] = {  # the same picture is the same file, whenever it is drawn
    "png": {"Software": None},
    "pdf": {"CreationDate": None},
    "svg": {"Date": None},
}
FILE_SETTINGS: dict[Any, Any] = {"pdf.fonttype": 42, "svg.hashsalt": "fdh"}  # publishers want fonts as TrueType
VECTOR_DPI = 300  # of what is an image within a PDF or SVG, at least
NARROW = 5.0  # inches; in narrower figures legends have two columns, and panels do not stand side by side


@dataclass(frozen=True)
class PlotStyle:
    """The size of a picture and of what is written in it.

    dpi:      of a PNG
    width:    inches; that of the picture on a screen if None
    height:   factor on heights
    title:    size, points; no title if None
    settings: of matplotlib
    """

    dpi: int
    width: float | None
    height: float
    title: float | None
    settings: dict[Any, Any] = field(default_factory=dict)

    def size(self, width: float, height: float) -> tuple[float, float]:
        """Width and height of a picture, inches, that has these on a screen."""
        return self.width or width, height * self.height


PAPER_FONT = 8  # points
PAPER_TEXTS = ("font.size", "axes.titlesize", "axes.labelsize", "xtick.labelsize", "ytick.labelsize", "legend.fontsize")
PAPER_SETTINGS: dict[Any, Any] = dict.fromkeys(PAPER_TEXTS, PAPER_FONT)
PAPER_SETTINGS |= {"axes.linewidth": 0.6, "lines.linewidth": 0.9, "lines.markersize": 4, "axes.labelpad": 3}
PAPER_SETTINGS |= {f"{axis}tick.major.{key}": size for axis in "xy" for key, size in (("width", 0.6), ("size", 2.5))}
PAPER_SETTINGS |= {f"{axis}tick.minor.{key}": size for axis in "xy" for key, size in (("width", 0.4), ("size", 1.5))}
PLOT_PANELS = "waveform", "spectrogram", "energies", "iterations", "contact", "shape"  # of a rendering, downwards
PLOT_STYLES = {
    "screen": PlotStyle(120, None, 1.0, 12, {"legend.fontsize": "x-small"}),
    "paper": PlotStyle(600, 3.4, 0.62, None, PAPER_SETTINGS),  # a column of a journal is 86 mm wide
}


@contextmanager
def new_figure(
    path: Path | io.BytesIO, width: float, height: float, style: PlotStyle, layout: str | None = "constrained"
) -> Iterator[Any]:
    """Give an empty figure to draw on, and write it to a file, in the format of its name, or as a PNG. Sizes in inches,
    of the picture on a screen. Raises OSError."""
    import matplotlib

    matplotlib.use("Agg")
    from matplotlib import pyplot, rc_context

    with rc_context(style.settings):
        figure = pyplot.figure(figsize=style.size(width, height), layout=layout)
        try:
            yield figure
            if isinstance(path, Path):
                with atomic_write(path) as part:
                    save_figure(figure, part, path.suffix, style.dpi)
            else:
                save_figure(figure, path, ".png", style.dpi)
        finally:
            pyplot.close(figure)


@contextmanager
def open_figure(path: Path, width: float, height: float, dpi: int = 120, **panels: Any) -> Iterator[Any]:
    """Give axes to draw on, and write them to a file. Sizes in inches; panels: options of Figure.subplots"""
    with new_figure(path, width, height, replace(PLOT_STYLES["screen"], dpi=dpi)) as figure:
        yield figure.subplots(**panels)


def save_figure(figure: Any, target: Path | io.BytesIO, ending: str, dpi: int) -> None:
    """Write a figure in the format of an ending, one of PICTURE_ENDINGS. Raises OSError."""
    from matplotlib import rc_context

    kind = ending.lower().removeprefix(".")
    with rc_context(FILE_SETTINGS):
        dpi = dpi if kind == "png" else max(dpi, VECTOR_DPI)
        figure.savefig(target, dpi=dpi, format=kind, metadata=METADATA[kind])


def panel_png(plot_panel: Callable[[Any, Any], None], subject: Any, height: float) -> bytes:
    """A PNG of one panel, transparent, for a page of any colour. All have the same margins, so that their time axes
    line up.

    subject: the rendering or study that is drawn; height: inches
    """
    edges = {"left": 0.125, "right": 0.85, "bottom": 0.54 / height, "top": 1 - 0.3 / height}
    picture = io.BytesIO()
    with new_figure(picture, 6.4, height, PlotStyle(180, None, 1.0, None, PAGE_STYLE), layout=None) as figure:
        plot_panel(figure.subplots(gridspec_kw=edges), subject)
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
    """Put a legend of lines above axes, where it covers nothing: in one row, if the figure has the width."""
    axes.legend(
        handles=lines,
        loc="lower right",
        bbox_to_anchor=(1.0, 1.0),
        ncols=2 if is_narrow(axes.figure) else len(lines),
        frameon=False,
        borderaxespad=0.1,
        columnspacing=1.2,
        labelspacing=0.2,
    )


def is_narrow(figure: Any) -> bool:
    """True if a figure is about as wide as a column of a journal."""
    return bool(figure.get_figwidth() < NARROW)


def put_colour_bar(axes: Any, mesh: Any, label: str) -> None:
    """Put the colour bar of an image beside its axes, which keep their width."""
    axes.figure.colorbar(mesh, cax=axes.inset_axes((1.015, 0.0, 0.02, 1.0)), label=label)


def note_size() -> Any:
    """The size of words beside a panel, as matplotlib takes it: that of legends."""
    from matplotlib import rcParams

    return rcParams["legend.fontsize"]


def set_title(axes: Any, title: str, size: float | None) -> None:
    """Put a title over axes, as it is: a dollar sign begins no formula, and a long one has several lines. size: points;
    no title if None"""
    if size is None:
        return
    characters = int(TITLE_WIDTH * axes.figure.get_figwidth() / size)
    lines = textwrap.wrap(title, characters, max_lines=MAX_TITLE_LINES, placeholder=" …")
    axes.set_title("\n".join(lines), size=size, parse_math=False)
