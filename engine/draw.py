"""Pictures: of a render, and of what accuracy costs. Matplotlib is imported when one is asked for."""

import math
from collections.abc import Iterator
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


def take(heard: "Take", title: str, path: Path) -> None:
    """Waveform, spectrogram, energies and Newton iterations of a render with a trace, as a PNG; contact is shaded.
    Raises ValueError without a trace."""
    if heard.trace is None:
        raise ValueError("there is no trace to draw; render with trace=True")
    time, trace = heard.trace["time"], heard.trace
    with figure(path, 10.0, 10.0, nrows=4, sharex=True) as panels:
        wave, spectrum, energy, newton = panels
        touching = contacts(trace["force"], heard.samplerate, len(time) / heard.samplerate / SHADES)
        thin = len(time) / heard.samplerate / COLUMNS
        for begin, end in touching:
            for panel in (wave, newton):
                panel.axvspan(begin, max(end, begin + 2 * thin), **CONTACT)  # never too thin to see
        for channel in range(heard.audio.shape[1]):
            low, high, at = extremes(heard.audio[:, channel], heard.samplerate)
            wave.fill_between(at, low, high, lw=0.4, color=f"C{2 * channel}", alpha=0.7, label=f"channel {channel + 1}")
        if heard.audio.shape[1] > 1:
            wave.legend(loc="upper right", fontsize=7)
        wave.set(ylabel="output, SI units", title=title)
        spectrogram(spectrum, heard)
        energy.plot(*thinned(time, trace["total"]), label="stored")
        energy.plot(*thinned(time, trace["dissipated"]), label="dissipated")
        energy.plot(*thinned(time, trace["supplied"]), label="supplied")
        balance = trace["total"] + trace["dissipated"] - trace["supplied"]
        energy.plot(*thinned(time, balance), "k:", lw=1, label="stored + dissipated - supplied")
        energy.set(ylabel="energy, J")
        energy.legend(fontsize=7)
        low, high, at = extremes(trace["iterations"].astype(float), heard.samplerate)
        newton.fill_between(at, 0.0, high, step="mid", lw=0.4)
        newton.set(xlabel="time, s", ylabel="Newton iterations", xlim=(0.0, len(time) / heard.samplerate))
        newton.set_ylim(0.0, max(2.0, 1.1 * high.max()))
        newton.yaxis.get_major_locator().set_params(integer=True)
        name = "contact shaded" if touching else "no contact"
        newton.text(0.99, 0.95, name, transform=newton.transAxes, ha="right", va="top", fontsize=8)


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
    """Error against time, ours and that of other methods, as a PNG; those that failed along the top."""
    known = all(math.isfinite(row["error"]) for row in found["rows"])
    key, scale, what = ("error", "log", "relative error") if known else ("bands_db", "linear", "third-octave bands, dB")
    with figure(path, 9.0, 6.0) as axes:
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
            axes.annotate(row["setting"], (row["ns_per_sample"], row[key]), beside, textcoords="offset points", size=8)
        if known:
            front = sorted((r["ns_per_sample"], r["error"]) for r in found["rows"] if r["front"])
            axes.plot(*zip(*front, strict=True), color="C0", lw=1.5, label="this engine, where nothing of it is better")
        axes.set(xscale="log", yscale=scale, xlabel="ns per sample", ylabel=what)
        axes.set_title(f"{title}: {found['verdict']}", size=9, wrap=True)
        axes.grid(True, which="both", alpha=0.2)
        if methods:
            axes.legend(fontsize=7, loc="lower left")


@contextmanager
def figure(path: Path, width: float, height: float, **panels: Any) -> Iterator[Any]:
    """Axes to draw on; then a PNG. Sizes in inches; panels as of plt.subplots."""
    import matplotlib

    matplotlib.use("Agg")
    from matplotlib import pyplot

    drawn, axes = pyplot.subplots(figsize=(width, height), layout="constrained", **panels)
    try:
        yield axes
        drawn.savefig(path, dpi=120, format="png", metadata={"Software": None})
    finally:
        pyplot.close(drawn)
