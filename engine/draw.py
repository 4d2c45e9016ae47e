"""Pictures: of a render, and of what accuracy costs. Matplotlib is imported when one is asked for."""

import io
import math
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from engine.measures import contacts

if TYPE_CHECKING:
    from engine.offline import Take

COLUMNS = 1600  # to which long signals are brought, by their extremes
WINDOW = 0.03  # s, of the spectrogram
DEPTH = 90.0  # dB, of the spectrogram
SHADES = 400  # contact intervals at most; beyond, those near each other are shaded as one
CONTACT = {"color": "C1", "alpha": 0.25, "lw": 0}
GREY = "#7b7f86"  # is read on white as on black
TINTED = ("text.color", "axes.labelcolor", "axes.edgecolor", "xtick.color", "ytick.color")
PAGE: dict[Any, Any] = dict.fromkeys(TINTED, GREY)
PAGE |= {"savefig.transparent": True, "legend.framealpha": 0.0, "font.size": 11}


def take(heard: "Take", title: str, path: Path) -> None:
    """All panels of a render with a trace, as a PNG. Raises ValueError without a trace."""
    with figure(path, 10.0, 10.0, nrows=4, sharex=True) as axes:
        for place, panel in zip(axes, PANELS.values(), strict=True):
            panel(place, heard)
            place.label_outer()
        axes[0].set(title=title)


def waveform(axes: Any, heard: "Take") -> None:
    """What the pickups hear, all channels; contact is shaded."""
    shade(axes, heard)
    for channel in range(heard.audio.shape[1]):
        low, high, at = extremes(heard.audio[:, channel], heard.samplerate)
        axes.fill_between(at, low, high, lw=0.4, color=f"C{2 * channel}", alpha=0.7, label=f"channel {channel + 1}")
    if heard.audio.shape[1] > 1:
        axes.legend(loc="upper right", fontsize="x-small")
    axes.yaxis.get_major_formatter().set_powerlimits((-2, 4))
    axes.set(ylabel="output, SI units", xlabel="time, s", xlim=(0.0, len(heard.audio) / heard.samplerate))


def spectrogram(axes: Any, heard: "Take") -> None:
    """Level over time and frequency, all channels together, dB below the loudest."""
    size = max(16, 1 << round(math.log2(WINDOW * heard.samplerate)))
    if len(heard.audio) < 2 * size:
        size = max(16, 1 << int(math.log2(max(16, len(heard.audio) // 8))))
    hop = max(1, len(heard.audio) // COLUMNS, size // 8)
    padded = np.pad(heard.audio, ((size // 2, size), (0, 0)))
    begins = np.arange(0, len(heard.audio), hop)
    window = np.hanning(size)[:, None]
    power = np.array([np.sum(np.abs(np.fft.rfft(padded[b : b + size] * window, axis=0)) ** 2, 1) for b in begins])
    frequency = np.fft.rfftfreq(size, 1 / heard.samplerate)
    level = 10 * np.log10(power / max(power.max(), 1e-300) + 1e-30)
    axes.pcolormesh(begins / heard.samplerate, frequency[1:], level.T[1:], vmin=-DEPTH, vmax=0.0, cmap="magma")
    axes.set(ylabel="frequency, Hz", yscale="log", ylim=(max(30.0, frequency[1]), min(20e3, frequency[-1])))
    axes.yaxis.set_major_formatter("{x:g}")
    axes.yaxis.set_minor_formatter("")
    axes.set(xlabel="time, s", xlim=(0.0, len(heard.audio) / heard.samplerate))


def energies(axes: Any, heard: "Take") -> None:
    """What is stored, dissipated and supplied, and their balance; of a render with a trace."""
    trace = traced(heard)
    time = trace["time"]
    axes.plot(*thinned(time, trace["total"]), label="stored")
    axes.plot(*thinned(time, trace["dissipated"]), label="dissipated")
    axes.plot(*thinned(time, trace["supplied"]), label="supplied")
    balance = trace["total"] + trace["dissipated"] - trace["supplied"]
    axes.plot(*thinned(time, balance), ":", color="0.5", lw=1.5, label="stored + dissipated - supplied")
    axes.yaxis.get_major_formatter().set_powerlimits((-2, 4))
    axes.set(ylabel="energy, J", xlabel="time, s", xlim=(0.0, len(heard.audio) / heard.samplerate))
    axes.legend(fontsize="x-small")


def iterations(axes: Any, heard: "Take") -> None:
    """Newton iterations of every sample of a render with a trace; contact is shaded."""
    _, high, at = extremes(traced(heard)["iterations"].astype(float), traced_at(heard))
    axes.fill_between(at, 0.0, high, step="mid", lw=0.4)
    axes.set(xlabel="time, s", ylabel="Newton iterations", xlim=(0.0, len(heard.audio) / heard.samplerate))
    axes.set_ylim(0.0, max(2.0, 1.1 * high.max()))
    axes.yaxis.get_major_locator().set_params(integer=True)
    name = "contact shaded" if shade(axes, heard) else "no contact"
    axes.text(1.0, 1.02, name, transform=axes.transAxes, ha="right", va="bottom", fontsize="small")


PANELS: dict[str, Callable[[Any, "Take"], None]] = {
    "waveform": waveform,
    "spectrogram": spectrogram,
    "energies": energies,
    "iterations": iterations,
}


def shade(axes: Any, heard: "Take") -> bool:
    """Shade when anything touches; whether anything does."""
    seconds = len(heard.audio) / heard.samplerate
    touching = contacts(traced(heard)["force"], traced_at(heard), seconds / SHADES)
    for begin, end in touching:
        axes.axvspan(begin, max(end, begin + 2 * seconds / COLUMNS), **CONTACT)  # never too thin to see
    return bool(touching)


def traced(heard: "Take") -> dict[str, np.ndarray]:
    """The trace of a render. Raises ValueError if it has none."""
    if heard.trace is None:
        raise ValueError("there is no trace to draw; render with trace=True")
    return heard.trace


def traced_at(heard: "Take") -> int:
    """Samples a second of the trace; more than of the sound where that was oversampled."""
    return round(heard.samplerate * len(traced(heard)["time"]) / len(heard.audio))


def extremes(signal: np.ndarray, samplerate: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Least and largest of a signal over each of at most COLUMNS stretches, and the time of each."""
    size = max(1, -(-len(signal) // COLUMNS))
    filled = np.pad(signal, (0, -len(signal) % size), mode="edge").reshape(-1, size)
    return filled.min(axis=1), filled.max(axis=1), (np.arange(len(filled)) + 0.5) * size / samplerate


def thinned(time: np.ndarray, values: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Few enough points to draw."""
    step = max(1, len(time) // (4 * COLUMNS))
    return time[::step], values[::step]


def price(found: dict[str, Any], title: str, path: Path) -> None:
    """Error against time, as a PNG."""
    with figure(path, 9.0, 6.0) as axes:
        prices(axes, found)
        axes.set_title(f"{title}: {found['verdict']}", size=9, wrap=True)


def prices(axes: Any, found: dict[str, Any]) -> None:
    """Error against time, ours and that of other methods; those that failed along the top."""
    if not found["rows"]:
        axes.set_axis_off()
        return
    known = all(math.isfinite(row["error"]) for row in found["rows"])
    key, scale, what = ("error", "log", "relative error") if known else ("bands_db", "linear", "third-octave bands, dB")
    methods: dict[str, list[dict[str, Any]]] = {}
    for row in found["others"] if known else []:
        methods.setdefault(row["setting"].rpartition(",")[0], []).append(row)
    for n, (method, rows) in enumerate(methods.items()):
        good, colour = [r for r in rows if not r["failed"]], f"C{2 + n}"
        points = [r["ns_per_sample"] for r in good], [r["error"] for r in good]
        axes.plot(*points, "x--", lw=0.8, color=colour, label=method)
        failed = [r["ns_per_sample"] for r in rows if r["failed"]]
        how = sorted({r["failed"].partition(" at ")[0] for r in rows if r["failed"]})
        height = np.full(len(failed), 0.98 - 0.03 * n)
        label = f"{method}: {', '.join(how)}"
        if failed:
            axes.plot(failed, height, "X", color=colour, label=label, transform=axes.get_xaxis_transform())
    for n, row in enumerate(found["rows"]):
        colour, beside = "C0" if row["front"] else "0.6", (5, 4) if n % 2 else (5, -10)
        axes.plot(row["ns_per_sample"], row[key], "o", color=colour, zorder=3)
        axes.annotate(
            row["setting"], (row["ns_per_sample"], row[key]), beside, textcoords="offset points", size="small"
        )
    if known:
        front = sorted((r["ns_per_sample"], r["error"]) for r in found["rows"] if r["front"])
        axes.plot(*zip(*front, strict=True), color="C0", lw=1.5, label="this engine, where nothing of it is better")
    axes.set(xscale="log", yscale=scale, xlabel="ns per sample", ylabel=what)
    axes.grid(True, which="both", alpha=0.2)
    if methods:
        axes.legend(fontsize="x-small", loc="lower left")


@contextmanager
def figure(path: Path | io.BytesIO, width: float, height: float, dpi: int = 120, **panels: Any) -> Iterator[Any]:
    """Axes to draw on; then a PNG. Sizes in inches; panels as of plt.subplots."""
    import matplotlib

    matplotlib.use("Agg")
    from matplotlib import pyplot

    drawn, axes = pyplot.subplots(figsize=(width, height), **{"layout": "constrained"} | panels)
    try:
        yield axes
        drawn.savefig(path, dpi=dpi, format="png", metadata={"Software": None})
    finally:
        pyplot.close(drawn)


def inline(panel: Callable[[Any, Any], None], drawn: Any, height: float) -> bytes:
    """A panel by itself, as a PNG to be put in a page, whatever the colour of that; height in inches. Panels of
    the same time stand one above another."""
    from matplotlib import rc_context

    edges = {"left": 0.135, "right": 0.98, "bottom": 0.54 / height, "top": 1 - 0.26 / height}
    picture = io.BytesIO()
    with rc_context(PAGE), figure(picture, 6.4, height, 180, layout=None, gridspec_kw=edges) as axes:
        panel(axes, drawn)
    return picture.getvalue()
