"""Signals of a rendering as pictures need them: shortened to what can be told apart, and cut to what is looked at."""

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from engine.analysis.metrics import contact_intervals

if TYPE_CHECKING:
    from engine.offline.render import RenderedArrays
    from engine.offline.trace import TraceArrays

PLOT_COLUMNS = 1600  # to which long signals are reduced, by their extremes
FIRST_CONTACT_SECONDS = 0.05  # of the first contact that are looked at
SAME_BEGIN_SECONDS = 1e-3  # contacts that begin within it begin together: the one with the largest force is the first
CONTACT_MARGIN = 0.2  # of its length, that is looked at before and after a contact
MIN_MARGIN_SAMPLES = 4


def require_trace(rendering: "RenderedArrays") -> "TraceArrays":
    """The trace of a rendering. Raises ValueError if it has none."""
    if rendering.trace is None:
        raise ValueError("there is no trace to draw; render with trace=True")
    return rendering.trace


def trace_rate(rendering: "RenderedArrays") -> int:
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


@dataclass(frozen=True)
class FirstContact:
    """The first contact of a rendering, and a little before and after it."""

    begin: float  # s
    time: np.ndarray  # [samples], s after its begin
    force: np.ndarray  # [samples], N
    compression: np.ndarray  # [samples], m; negative while the two are apart


def first_contact(rendering: "RenderedArrays") -> FirstContact | None:
    """The first contact of a rendering; None if nothing touches. Of several that begin together, and of the points of
    one contact, it is the one with the largest force. Raises ValueError without a trace."""
    trace, rate = require_trace(rendering), trace_rate(rendering)
    touching = trace["force"] != 0.0
    (columns,) = np.nonzero(touching.any(axis=0))
    if columns.size == 0:
        return None
    begins = touching[:, columns].argmax(axis=0)
    begin = int(begins.min())
    together = columns[begins <= begin + SAME_BEGIN_SECONDS * rate]
    shown = slice(begin, begin + max(1, round(FIRST_CONTACT_SECONDS * rate)))
    column = int(together[trace["force"][shown, together].max(axis=0).argmax()])
    _, end = contact_intervals(trace["force"][:, [column]], rate)[0]
    last = min(round(end * rate), shown.stop)
    begin = int(touching[:, column].argmax())
    margin = max(MIN_MARGIN_SAMPLES, round(CONTACT_MARGIN * (last - begin)))
    after = touching[last : last + margin, column]
    pause = int(after.argmax()) if after.any() and not after[0] else margin  # up to where it touches again
    rows = slice(max(0, begin - margin), last + pause)
    force, compression = trace["force"][rows, column], trace["compression"][rows, column]
    return FirstContact(
        begin / rate, (np.arange(rows.start, rows.start + len(force)) - begin) / rate, force, compression
    )
