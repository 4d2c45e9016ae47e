"""Contacts in a few numbers: when they touch, for how long, and how strongly."""

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, fields

import numpy as np

from engine.analysis.metrics import contact_intervals
from engine.offline.statistics_base import Statistics
from engine.offline.trace import TraceArrays
from engine.patch.error_messages import similar_word
from engine.wording import format_value

UNITS = {
    "first_touch": "s",
    "first_duration": "s",
    "duration": "s",
    "impulse": "N·s",
    "peak_force": "N",
    "peak_compression": "m",
}


@dataclass(frozen=True, repr=False)
class ContactSummary(Statistics):
    """A contact of a rendering in plain numbers. Its repr has the units.

    first_touch:      when it first touches, s; NaN if it never does
    first_duration:   how long it touches then, s
    duration:         how long it touches in all, s
    impulse:          of its force over the whole rendering, N·s
    peak_force:       the largest force, N: a mean over one step, as in the trace
    peak_compression: the largest compression, m; positive, and 0 if it never touches
    touches:          how often it touches; a pause of a single sample divides two touches

    A touch that goes on at the end of the rendering lasts until that end.

    >>> import fdh
    >>> rendering = fdh.render(fdh.load("bouncing_ball"), seconds=0.5, trace=True)
    >>> rendering.contacts["contact.0"]
    ContactSummary(first_touch=0.201928 s, first_duration=0.0125723 s, duration=0.0125723 s, impulse=4.08515 N·s,
        peak_force=1024.17 N, peak_compression=0.01006 m, touches=1)
    >>> rendering.contacts["contact.0"].as_dict()["touches"]
    1
    """

    first_touch: float
    first_duration: float
    duration: float
    impulse: float
    peak_force: float
    peak_compression: float
    touches: int

    def __repr__(self) -> str:
        values = [(field.name, self[field.name], UNITS.get(field.name, "")) for field in fields(self)]
        return f"ContactSummary({', '.join(f'{name}={value:.6g} {unit}'.rstrip() for name, value, unit in values)})"


class ContactSummaries(Mapping[str, ContactSummary]):
    """The contacts of a rendering by their names in the patch; those without a name are `contact.0`, `contact.1`, …

    The points of a contact at several points are found as `NAME.0`, `NAME.1`, … too, as in `rendering.trace`, but not
    listed. The contact as a whole touches as long as any of its points does, and its force is the sum of theirs.

    trace: of the rendering
    names: of the contacts of its scene
    """

    def __init__(self, trace: TraceArrays, names: Iterable[str]) -> None:
        self._trace = trace
        self._names, self._columns = assign_columns(trace["contacts"].tolist(), names)
        self._known: dict[str, ContactSummary] = {}

    def __getitem__(self, name: str) -> ContactSummary:
        """The summary of a contact, or of one of its points. Raises KeyError, which names the nearest one."""
        if name not in self._columns:
            similar = similar_word(str(name), [*self._columns])
            remedy = f'did you mean "{similar}"?' if similar else f"the contacts are {', '.join(self) or 'none'}"
            raise KeyError(f"no contact {format_value(name)}; {remedy}")
        if name not in self._known:
            self._known[name] = summarise_contact(self._trace, self._columns[name])
        return self._known[name]

    def __iter__(self) -> Iterator[str]:
        return iter(self._names)

    def __len__(self) -> int:
        return len(self._names)

    def __repr__(self) -> str:
        return "{" + ",\n ".join(f"{name!r}: {summary!r}" for name, summary in self.items()) + "}"


def assign_columns(labels: list[str], names: Iterable[str]) -> tuple[list[str], dict[str, list[int]]]:
    """The names of the contacts that have columns in a trace, and the columns of each contact and of each point.

    labels: of the columns, in the order of the contacts
    """
    listed, columns, begin = list[str](), dict[str, list[int]](), 0
    for name in names:
        end = begin
        while labels[end : end + 1] in ([name], [f"{name}.{end - begin}"]):
            end += 1
        if end > begin:
            listed.append(name)
            columns[name] = list(range(begin, end))
        begin = end
    points = {label: [column] for column, label in enumerate(labels)}
    return listed, points | columns


def summarise_contact(trace: TraceArrays, columns: list[int]) -> ContactSummary:
    """The summary of a contact, whose points have these columns in a trace."""
    rate = float(trace["samplerate"])
    force = trace["force"][:, columns]
    compression = np.nan_to_num(trace["compression"][:, columns], nan=-np.inf).max(axis=1)
    touches = [touch_times(compression, int(begin), int(end)) for begin, end in contact_intervals(force, 1.0)]
    durations = [(end - begin) / rate for begin, end in touches]
    total = force.sum(axis=1)
    return ContactSummary(
        first_touch=touches[0][0] / rate if touches else float("nan"),
        first_duration=durations[0] if durations else 0.0,
        duration=sum(durations),
        impulse=float(total.sum()) / rate,
        peak_force=float(total.max(initial=0.0)),
        peak_compression=float(compression.max(initial=0.0)),
        touches=len(touches),
    )


def touch_times(compression: np.ndarray, begin: int, end: int) -> tuple[float, float]:
    """Begin and end of a touch, in samples: where the compression [frames] crosses zero, on a straight line between two
    samples. Where it does not, as when an event moves a body, the ends of the steps that have a force.

    begin, end: the first sample whose step has a force, and the one after the last
    """
    before, after = compression[begin - 1], compression[begin]
    entry_share = before / (before - after) if before <= 0.0 < after else 0.0
    before, after = compression[end - 2], compression[end - 1]
    exit_share = before / (before - after) if after <= 0.0 < before else 1.0
    return begin - 1 + float(entry_share), end - 2 + float(exit_share)
