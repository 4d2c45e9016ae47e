"""Plots of a rendering: panels over its time, and below them its details."""

import math
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from engine.analysis.metrics import contact_intervals
from engine.patch.pickup_rules import QUANTITY_UNITS
from engine.report.detail_plots import plot_first_contact, plot_string_shape
from engine.report.figures import (
    BLUE,
    GREEN,
    GREY,
    LEVEL_MAP,
    ORANGE,
    PLOT_STYLES,
    is_narrow,
    new_figure,
    note_size,
    put_colour_bar,
    put_legend_above,
    set_title,
    si_scale,
    si_text,
)
from engine.report.trace_signals import (
    PLOT_COLUMNS,
    decimate_for_plot,
    first_contact,
    min_max_envelope,
    require_trace,
    trace_rate,
)

if TYPE_CHECKING:
    from engine.analysis.string_shape import StringShape
    from engine.offline.render import RenderedArrays

SPECTROGRAM_WINDOW = 0.05  # s
SPECTROGRAM_DEPTH_DB = 90.0
SPECTROGRAM_ROWS = 400  # frequencies, evenly spread on a logarithmic axis
SPECTROGRAM_RANGE = 30.0, 20e3  # Hz
MAX_SHADED_INTERVALS = 400  # more contact intervals are shaded together with those near them
MIN_CONTACT_SPREAD = 0.02  # of the time, from the first contact to the end of the last, for a panel of iterations
MAX_SCALED_CHANNELS = 4  # of more channels, the scale of each is no longer labelled
LANE = 1.15  # half the height of a channel's lane, in peaks
PANEL_HEIGHTS = {"waveform": 2.2, "spectrogram": 2.6, "energies": 2.3, "iterations": 1.7}  # inches
LANE_HEIGHT = 0.9  # inches, of every channel but the first
DETAIL_HEIGHT = 2.7  # inches


def plot_rendering(
    rendering: "RenderedArrays",
    title: str,
    path: Path,
    shape: "StringShape | None" = None,
    style: str = "screen",
    panels: Sequence[str] = (),
) -> None:
    """Write all panels of a rendering to a picture (engine.report.figures.PICTURE_ENDINGS), and below them its first
    contact and the shape of a string, if there is one.

    style:  one of PLOT_STYLES
    panels: of PLOT_PANELS, those to draw, in place of all

    Raises ValueError if it has no trace, OSError if it cannot be written.
    """
    contact = first_contact(rendering)
    shown = [name for name in PANELS if name in panels or not panels]
    heights = {name: PANEL_HEIGHTS[name] for name in shown if name != "iterations" or can_show_contacts(rendering)}
    if "waveform" in heights:
        heights["waveform"] = waveform_height(rendering)
    details: dict[str, Callable[[Any], None]] = {}
    if contact is not None and ("contact" in panels or not panels):
        details["contact"] = lambda axes: plot_first_contact(axes, contact)
    if shape is not None and ("shape" in panels or not panels):
        details["shape"] = lambda axes: plot_string_shape(axes, shape)
    if not heights and not details:  # no contact, or no string
        heights["waveform"] = waveform_height(rendering)
    look = PLOT_STYLES[style]
    columns = 1 if look.width is not None else max(1, len(details))
    below = [[*details][n : n + columns] for n in range(0, len(details), columns)]
    rows = [[name] * columns for name in heights] + below
    ratios = [*heights.values()] + [DETAIL_HEIGHT] * len(below)
    with new_figure(path, 10.0, sum(ratios) + 0.4, look) as figure:
        axes = figure.subplot_mosaic(rows, height_ratios=ratios)
        for name in heights:
            if name != rows[0][0]:
                axes[name].sharex(axes[rows[0][0]])
            PANELS[name](axes[name], rendering)
            if name != [*heights][-1]:
                axes[name].tick_params(labelbottom=False)
                axes[name].set_xlabel("")
        for name, draw in details.items():
            draw(axes[name])
        figure.get_layout_engine().set(wspace=0.04)
        figure.align_ylabels([axes[name] for name in heights])
        set_title(axes[rows[0][0]], title, look.title)


def waveform_height(rendering: "RenderedArrays") -> float:
    """Return the height of the panel of the waveform, inches."""
    lanes = min(rendering.audio.shape[1], MAX_SCALED_CHANNELS)
    return float(PANEL_HEIGHTS["waveform"] + LANE_HEIGHT * (lanes - 1))


def plot_waveform(axes: Any, rendering: "RenderedArrays") -> None:
    """Plot the audio, a lane for each channel, all at one scale; contact is shaded."""
    shade_contact(axes, rendering)
    channels = rendering.audio.shape[1]
    with np.errstate(invalid="ignore"):
        peak = float(np.abs(rendering.audio).max())
    peak = peak if 0.0 < peak < math.inf else 1.0
    exponent = math.floor(math.log10(peak))
    tick = next(step for step in (5.0, 2.0, 1.0, 0.5) if step * 10.0**exponent <= peak) * 10.0**exponent
    ticks, labels = [], []
    for channel in range(channels):
        middle = -2 * LANE * peak * channel
        low, high, at = min_max_envelope(rendering.audio[:, channel], rendering.samplerate)
        dense = len(at) < len(rendering.audio)  # an image within a PDF
        axes.fill_between(at, middle + low, middle + high, lw=0.4, color=BLUE, rasterized=dense)
        values = (tick, 0.0, -tick) if channels <= MAX_SCALED_CHANNELS else (0.0,)
        ticks += [middle + value for value in values]
        labels += [value / 10.0**exponent if not -3 < exponent < 4 else value for value in values]
        if channel > 0:
            axes.axhline(middle + LANE * peak, lw=0.8, color=GREY)
        if channels > 1:
            name = ("left", "right")[channel] if channels == 2 else f"channel {channel + 1}"
            place = {"transform": axes.get_yaxis_transform(), "fontsize": note_size(), "va": "center"}
            axes.text(1.01, middle, name, **place)
    axes.set_yticks(ticks, [f"{label:g}".replace("-", "−") for label in labels])
    power = "" if -3 < exponent < 4 else f"$10^{{{exponent}}}$ "
    quantity, unit = heard_quantity(rendering)
    axes.set(ylabel=f"{quantity}, {power}{unit}", xlabel="time, s", xlim=(0.0, _seconds(rendering)))
    axes.set_ylim(-2 * LANE * peak * (channels - 1) - LANE * peak, LANE * peak)


def heard_quantity(rendering: "RenderedArrays") -> tuple[str, str]:
    """Return the name and the unit of what the pickups of a rendering register, if it is one thing."""
    scene = getattr(rendering, "scene", None)
    heard = set() if scene is None else {(pickup.quantity, pickup.gain) for pickup in scene.pickup}
    if len(heard) == 1:
        ((quantity, gain),) = heard
        if gain == 1.0 and quantity in QUANTITY_UNITS:
            return quantity.replace("_", " "), QUANTITY_UNITS[quantity]
    return "output", "SI units"


def plot_spectrogram(axes: Any, rendering: "RenderedArrays") -> None:
    """Plot the level over time and frequency, all channels together, dB below the loudest."""
    begins, frequency, level = spectrogram(rendering.audio, rendering.samplerate)
    seconds = begins / rendering.samplerate
    levels: dict[str, Any] = {"vmin": -SPECTROGRAM_DEPTH_DB, "vmax": 0.0, "cmap": LEVEL_MAP}
    mesh = axes.pcolormesh(seconds, frequency, level.T, **levels, rasterized=True)
    put_colour_bar(axes, mesh, "level, dB")
    axes.set(ylabel="frequency, Hz", yscale="log", ylim=(frequency[0], frequency[-1]))
    axes.yaxis.set_major_formatter(lambda x, _: si_text(x, "").replace(" ", ""))
    axes.yaxis.set_minor_formatter("")
    axes.set(xlabel="time, s", xlim=(0.0, _seconds(rendering)))


def spectrogram(audio: np.ndarray, samplerate: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """The level of audio [frames, channels], all channels together, in dB below the loudest.

    Returns the middle of each window, in samples [times]; frequencies on a logarithmic axis, Hz [rows]; and the level
    [times, rows]. Where several bins lie in a row, it has the loudest of them.
    """
    size = max(16, 1 << round(math.log2(SPECTROGRAM_WINDOW * samplerate)))
    if len(audio) < 2 * size:
        size = max(16, 1 << int(math.log2(max(16, len(audio) // 8))))
    hop = max(1, len(audio) // PLOT_COLUMNS, size // 8)
    padded = np.pad(audio, ((size // 2, size), (0, 0)), mode="edge")  # a step would sound at all frequencies
    begins = np.arange(0, len(audio), hop)
    window = np.hanning(size)[:, None]
    power = np.array([np.sum(np.abs(np.fft.rfft(padded[b : b + size] * window, axis=0)) ** 2, 1) for b in begins])
    bins = np.fft.rfftfreq(size, 1 / samplerate)
    low, high = max(SPECTROGRAM_RANGE[0], bins[1]), min(SPECTROGRAM_RANGE[1], bins[-1])
    rows = np.geomspace(low, high, SPECTROGRAM_ROWS)
    edges = np.searchsorted(bins, np.geomspace(low, high, SPECTROGRAM_ROWS + 1)).clip(1, bins.size - 1)
    loudest = np.maximum.reduceat(power, edges[:-1], axis=1)
    level = 10 * np.log10(power / max(power.max(), 1e-300) + 1e-30)
    between = np.array([np.interp(rows, bins, row) for row in level])
    several = np.diff(edges) > 1
    between[:, several] = 10 * np.log10(loudest[:, several] / max(power.max(), 1e-300) + 1e-30)
    return begins, rows, between


def plot_energies(axes: Any, rendering: "RenderedArrays") -> None:
    """Plot the energies that are stored, dissipated and supplied, and their balance."""
    trace = require_trace(rendering)
    balance = trace["total"] + trace["dissipated"] - trace["supplied"]
    curves = {
        "stored": (trace["total"], "-", BLUE),
        "dissipated": (trace["dissipated"], "--", ORANGE),
        "supplied": (trace["supplied"], "-.", GREEN),
        "balance" if is_narrow(axes.figure) else "stored + dissipated − supplied": (balance, ":", GREY),
    }
    factor, unit = si_scale(max(float(np.abs(values).max()) for values, *_ in curves.values()), "J")
    lines = []
    for name, (values, style, colour) in curves.items():
        time, shown = decimate_for_plot(trace["time"], values)
        lines += axes.plot(time, shown * factor, style, color=colour, label=name)
    axes.set(ylabel=f"energy, {unit}", xlabel="time, s", xlim=(0.0, _seconds(rendering)))
    put_legend_above(axes, lines)


def plot_iterations(axes: Any, rendering: "RenderedArrays") -> None:
    """Plot the Newton iterations of every sample; contact is shaded."""
    _, high, at = min_max_envelope(require_trace(rendering)["iterations"].astype(float), trace_rate(rendering))
    axes.fill_between(at, 0.0, high, step="mid", lw=0.4, color=BLUE, rasterized=True)
    axes.set(xlabel="time, s", ylabel="Newton iterations", xlim=(0.0, _seconds(rendering)))
    axes.set_ylim(0.0, max(2.0, 1.1 * high.max()))
    axes.yaxis.get_major_locator().set_params(integer=True)
    name = "contact shaded" if shade_contact(axes, rendering) else "no contact"
    axes.text(1.0, 1.02, name, transform=axes.transAxes, ha="right", va="bottom", fontsize=note_size())


PANELS: dict[str, Callable[[Any, "RenderedArrays"], None]] = {
    "waveform": plot_waveform,
    "spectrogram": plot_spectrogram,
    "energies": plot_energies,
    "iterations": plot_iterations,
}


def can_show_contacts(rendering: "RenderedArrays") -> bool:
    """True if contacts are spread over enough of the time that a panel over all of it shows them apart."""
    intervals = contact_intervals(require_trace(rendering)["force"], trace_rate(rendering))
    return bool(intervals) and intervals[-1][1] - intervals[0][0] >= MIN_CONTACT_SPREAD * _seconds(rendering)


def shade_contact(axes: Any, rendering: "RenderedArrays") -> bool:
    """Shade the time in which anything touches. Returns whether anything does."""
    forces = require_trace(rendering)["force"]
    intervals = contact_intervals(forces, trace_rate(rendering), _seconds(rendering) / MAX_SHADED_INTERVALS)
    if intervals:
        from engine.report.contact_shading import ContactShading  # which imports matplotlib

        axes.add_collection(ContactShading(axes, intervals), autolim=False)
    return bool(intervals)


def _seconds(rendering: "RenderedArrays") -> float:
    """The length of a rendering, s."""
    return len(rendering.audio) / rendering.samplerate
