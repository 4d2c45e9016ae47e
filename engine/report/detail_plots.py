"""Plots of a moment of a rendering: its first contact, and the shape of a string."""

from typing import TYPE_CHECKING, Any

import numpy as np

from engine.report.figures import BLUE, ORANGE, SIGNED_MAP, put_colour_bar, put_legend_above, si_scale, si_text
from engine.wording import format_value

if TYPE_CHECKING:
    from engine.analysis.string_shape import StringShape
    from engine.report.trace_signals import FirstContact

MAX_MARKED_SAMPLES = 60  # of which each has a dot
MAX_NAME = 20  # characters of a name beside an axis
APART = 0.3  # of the largest compression: how much of the way before and after is shown


def plot_first_contact(axes: Any, contact: "FirstContact") -> None:
    """Plot force, and on an axis at the right compression, over the time of the first contact. Both axes have their
    zero at the same height."""
    other = axes.twinx()
    time_factor, time_unit = si_scale(float(np.abs(contact.time).max()), "s")
    marker = "." if len(contact.time) <= MAX_MARKED_SAMPLES else ""
    lines = []
    for panel, name, values, unit, colour, style in (
        (axes, "force", contact.force, "N", BLUE, "-"),
        (other, "compression", contact.compression, "m", ORANGE, "--"),
    ):
        factor, label = si_scale(float(values.max()), unit)
        top = float(values.max()) * factor
        lines += panel.plot(
            contact.time * time_factor, values * factor, style, color=colour, marker=marker, ms=4, label=name
        )
        panel.set_ylabel(f"{name}, {label}")
        if top > 0.0:
            panel.set_ylim(-APART * top, 1.1 * top)
    axes.axhline(0.0, lw=0.6, color="0.6", zorder=0)
    axes.set(xlabel=f"time after first contact ({si_text(contact.begin, 's')}), {time_unit}")
    axes.margins(x=0.0)
    put_legend_above(other, lines)


def plot_string_shape(axes: Any, shape: "StringShape") -> None:
    """Draw the displacement of a string over time and place as an image; zero is the middle of the colours."""
    peak = float(np.abs(shape.displacement).max()) or 1.0
    factor, unit = si_scale(peak, "m")
    time_factor, time_unit = si_scale(float(shape.time[-1] - shape.time[0]), "s")
    after = (shape.time - shape.time[0]) * time_factor
    mesh = axes.pcolormesh(
        after,
        shape.places,
        shape.displacement.T * factor,
        vmin=-peak * factor,
        vmax=peak * factor,
        cmap=SIGNED_MAP,
        shading="gouraud",
        rasterized=True,
    )
    put_colour_bar(axes, mesh, f"displacement, {unit}")
    axes.set(
        xlabel=f"time after {si_text(shape.time[0], 's')}, {time_unit}",
        ylabel=f"position on {format_value(shape.body, MAX_NAME)}",
    )
