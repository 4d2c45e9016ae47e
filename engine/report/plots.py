"""Plots of a rendering and of a work-precision study. Matplotlib is imported when the first is drawn."""

import io
import math
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from engine.analysis.metrics import contact_intervals

if TYPE_CHECKING:
    from engine.analysis.other_methods import MethodResult
    from engine.analysis.work_precision import WorkPrecisionStudy
    from engine.offline.render import Rendering

PLOT_COLUMNS = 1600  # to which long signals are reduced, by their extremes
SPECTROGRAM_WINDOW = 0.03  # s
SPECTROGRAM_DEPTH_DB = 90.0
MAX_SHADED_INTERVALS = 400  # more contact intervals are shaded together with those near them
CONTACT_STYLE = {"color": "C1", "alpha": 0.25, "lw": 0}
GREY = "#7b7f86"  # legible on white and on black
TINTED_ITEMS = ("text.color", "axes.labelcolor", "axes.edgecolor", "xtick.color", "ytick.color")
PAGE_STYLE: dict[Any, Any] = dict.fromkeys(TINTED_ITEMS, GREY)
PAGE_STYLE |= {"savefig.transparent": True, "legend.framealpha": 0.0, "font.size": 11}


def plot_rendering(rendering: "Rendering", title: str, path: Path) -> None:
    """Write all panels of a rendering as a PNG. Raises ValueError if it has no trace."""
    with open_figure(path, 10.0, 10.0, nrows=4, sharex=True) as axes:
        for panel_axes, plot_panel in zip(axes, PANELS.values(), strict=True):
            plot_panel(panel_axes, rendering)
            panel_axes.label_outer()
        axes[0].set(title=title)


def plot_waveform(axes: Any, rendering: "Rendering") -> None:
    """Plot the audio, all channels; contact is shaded."""
    shade_contact(axes, rendering)
    for channel in range(rendering.audio.shape[1]):
        low, high, at = min_max_envelope(rendering.audio[:, channel], rendering.samplerate)
        axes.fill_between(at, low, high, lw=0.4, color=f"C{2 * channel}", alpha=0.7, label=f"channel {channel + 1}")
    if rendering.audio.shape[1] > 1:
        axes.legend(loc="upper right", fontsize="x-small")
    axes.yaxis.get_major_formatter().set_powerlimits((-2, 4))
    axes.set(ylabel="output, SI units", xlabel="time, s", xlim=(0.0, len(rendering.audio) / rendering.samplerate))


def plot_spectrogram(axes: Any, rendering: "Rendering") -> None:
    """Plot the level over time and frequency, all channels together, dB below the loudest."""
    size = max(16, 1 << round(math.log2(SPECTROGRAM_WINDOW * rendering.samplerate)))
    if len(rendering.audio) < 2 * size:
        size = max(16, 1 << int(math.log2(max(16, len(rendering.audio) // 8))))
    hop = max(1, len(rendering.audio) // PLOT_COLUMNS, size // 8)
    padded = np.pad(rendering.audio, ((size // 2, size), (0, 0)))
    begins = np.arange(0, len(rendering.audio), hop)
    window = np.hanning(size)[:, None]
    power = np.array([np.sum(np.abs(np.fft.rfft(padded[b : b + size] * window, axis=0)) ** 2, 1) for b in begins])
    frequency = np.fft.rfftfreq(size, 1 / rendering.samplerate)
    level = 10 * np.log10(power / max(power.max(), 1e-300) + 1e-30)
    axes.pcolormesh(
        begins / rendering.samplerate, frequency[1:], level.T[1:], vmin=-SPECTROGRAM_DEPTH_DB, vmax=0.0, cmap="magma"
    )
    axes.set(ylabel="frequency, Hz", yscale="log", ylim=(max(30.0, frequency[1]), min(20e3, frequency[-1])))
    axes.yaxis.set_major_formatter("{x:g}")
    axes.yaxis.set_minor_formatter("")
    axes.set(xlabel="time, s", xlim=(0.0, len(rendering.audio) / rendering.samplerate))


def plot_energies(axes: Any, rendering: "Rendering") -> None:
    """Plot the energies that are stored, dissipated and supplied, and their balance."""
    trace = require_trace(rendering)
    time = trace["time"]
    axes.plot(*decimate_for_plot(time, trace["total"]), label="stored")
    axes.plot(*decimate_for_plot(time, trace["dissipated"]), label="dissipated")
    axes.plot(*decimate_for_plot(time, trace["supplied"]), label="supplied")
    balance = trace["total"] + trace["dissipated"] - trace["supplied"]
    axes.plot(*decimate_for_plot(time, balance), ":", color="0.5", lw=1.5, label="stored + dissipated - supplied")
    axes.yaxis.get_major_formatter().set_powerlimits((-2, 4))
    axes.set(ylabel="energy, J", xlabel="time, s", xlim=(0.0, len(rendering.audio) / rendering.samplerate))
    axes.legend(fontsize="x-small")


def plot_iterations(axes: Any, rendering: "Rendering") -> None:
    """Plot the Newton iterations of every sample; contact is shaded."""
    _, high, at = min_max_envelope(require_trace(rendering)["iterations"].astype(float), trace_rate(rendering))
    axes.fill_between(at, 0.0, high, step="mid", lw=0.4)
    axes.set(xlabel="time, s", ylabel="Newton iterations", xlim=(0.0, len(rendering.audio) / rendering.samplerate))
    axes.set_ylim(0.0, max(2.0, 1.1 * high.max()))
    axes.yaxis.get_major_locator().set_params(integer=True)
    name = "contact shaded" if shade_contact(axes, rendering) else "no contact"
    axes.text(1.0, 1.02, name, transform=axes.transAxes, ha="right", va="bottom", fontsize="small")


PANELS: dict[str, Callable[[Any, "Rendering"], None]] = {
    "waveform": plot_waveform,
    "spectrogram": plot_spectrogram,
    "energies": plot_energies,
    "iterations": plot_iterations,
}


def shade_contact(axes: Any, rendering: "Rendering") -> bool:
    """Shade the time in which anything touches. Returns whether anything does."""
    seconds = len(rendering.audio) / rendering.samplerate
    forces = require_trace(rendering)["force"]
    intervals = contact_intervals(forces, trace_rate(rendering), seconds / MAX_SHADED_INTERVALS)
    for begin, end in intervals:
        axes.axvspan(begin, max(end, begin + 2 * seconds / PLOT_COLUMNS), **CONTACT_STYLE)  # never too thin to see
    return bool(intervals)


def require_trace(rendering: "Rendering") -> dict[str, np.ndarray]:
    """The trace of a rendering. Raises ValueError if it has none."""
    if rendering.trace is None:
        raise ValueError("there is no trace to draw; render with trace=True")
    return rendering.trace


def trace_rate(rendering: "Rendering") -> int:
    """Sample rate of the trace, Hz; it is higher than that of the audio if the rendering was oversampled."""
    return round(rendering.samplerate * len(require_trace(rendering)["time"]) / len(rendering.audio))


def min_max_envelope(signal: np.ndarray, samplerate: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Minimum and maximum of a signal [frames] in each of at most PLOT_COLUMNS intervals of equal length, and the time
    of each, s."""
    size = max(1, -(-len(signal) // PLOT_COLUMNS))
    filled = np.pad(signal, (0, -len(signal) % size), mode="edge").reshape(-1, size)
    return filled.min(axis=1), filled.max(axis=1), (np.arange(len(filled)) + 0.5) * size / samplerate


def decimate_for_plot(time: np.ndarray, values: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Time and values [frames] with only so many points as can be told apart in a plot."""
    step = max(1, len(time) // (4 * PLOT_COLUMNS))
    return time[::step], values[::step]


def plot_work_precision(study: "WorkPrecisionStudy", title: str, path: Path) -> None:
    """Write a plot of error against time as a PNG (engine.analysis.work_precision)."""
    with open_figure(path, 9.0, 6.0) as axes:
        draw_work_precision(axes, study)
        axes.set_title(f"{title}: {study['verdict']}", size=9, wrap=True)


def draw_work_precision(axes: Any, study: "WorkPrecisionStudy") -> None:
    """Draw error against time, of the settings and of other methods; methods that failed stand along the top."""
    if not study["rows"]:
        axes.set_axis_off()
        return
    has_errors = all(math.isfinite(row["error"]) for row in study["rows"])
    key, scale, label = (
        ("error", "log", "relative error") if has_errors else ("bands_db", "linear", "third-octave bands, dB")
    )
    if has_errors:
        _draw_methods(axes, study["others"])
    for n, row in enumerate(study["rows"]):
        colour, offset = "C0" if row["front"] else "0.6", (5, 4) if n % 2 else (5, -10)
        position = row["ns_per_sample"], row[key]
        axes.plot(*position, "o", color=colour, zorder=3)
        axes.annotate(row["setting"], position, offset, textcoords="offset points", size="small")
    if has_errors:
        front = sorted((r["ns_per_sample"], r["error"]) for r in study["rows"] if r["front"])
        axes.plot(*zip(*front, strict=True), color="C0", lw=1.5, label="this engine, where nothing of it is better")
    axes.set(xscale="log", yscale=scale, xlabel="ns per sample", ylabel=label)
    axes.grid(True, which="both", alpha=0.2)
    if has_errors and study["others"]:
        axes.legend(fontsize="x-small", loc="lower left")


def _draw_methods(axes: Any, rows: "list[MethodResult]") -> None:
    """Draw error against time of other methods, a line each."""
    methods: dict[str, list[MethodResult]] = {}
    for row in rows:
        methods.setdefault(row["setting"].rpartition(",")[0], []).append(row)
    for n, (method, runs) in enumerate(methods.items()):
        valid, colour = [r for r in runs if not r["failed"]], f"C{2 + n}"
        times, errors = [r["ns_per_sample"] for r in valid], [r["error"] for r in valid]
        axes.plot(times, errors, "x--", lw=0.8, color=colour, label=method)
        failed = [r["ns_per_sample"] for r in runs if r["failed"]]
        if failed:
            failures = sorted({r["failed"].partition(" at ")[0] for r in runs if r["failed"]})
            label = f"{method}: {', '.join(failures)}"
            height = np.full(len(failed), 0.98 - 0.03 * n)  # of the axes
            axes.plot(failed, height, "X", color=colour, label=label, transform=axes.get_xaxis_transform())


@contextmanager
def open_figure(path: Path | io.BytesIO, width: float, height: float, dpi: int = 120, **panels: Any) -> Iterator[Any]:
    """Give axes to draw on, and write them as a PNG. Sizes in inches; panels: options of pyplot.subplots"""
    import matplotlib

    matplotlib.use("Agg")
    from matplotlib import pyplot

    picture, axes = pyplot.subplots(figsize=(width, height), **{"layout": "constrained"} | panels)
    try:
        yield axes
        picture.savefig(path, dpi=dpi, format="png", metadata={"Software": None})
    finally:
        pyplot.close(picture)


def panel_png(plot_panel: Callable[[Any, Any], None], subject: Any, height: float) -> bytes:
    """A PNG of one panel, transparent, for a page of any colour. All have the same margins, so that their time axes
    line up.

    subject: the rendering or study that is drawn; height: inches
    """
    from matplotlib import rc_context

    edges = {"left": 0.135, "right": 0.98, "bottom": 0.54 / height, "top": 1 - 0.26 / height}
    picture = io.BytesIO()
    with rc_context(PAGE_STYLE), open_figure(picture, 6.4, height, 180, layout=None, gridspec_kw=edges) as axes:
        plot_panel(axes, subject)
    return picture.getvalue()
