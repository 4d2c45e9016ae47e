"""Scenes to estimate errors with: one for renderings that are finer in time, at a multiple of the sample rate where
that refines anything, with the same modes and the same rounded times; and one whose times are rounded by more."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np

from engine.assembly.build import build
from engine.assembly.layout import Layout
from engine.assembly.limits import MAX_FREQUENCY_SHARE
from engine.assembly.one_way_drive import drive_forces
from engine.assembly.residual_modes import count_contact_steps, shares_left_out
from engine.assembly.scored_changes import scored_changes
from engine.assembly.table_changes import count_steps, glide_between
from engine.bodies.air import AirBox
from engine.bodies.distributed import DistributedBody
from engine.bodies.sheet import MAX_SHEET_MODES, SheetBody
from engine.offline.render import RenderedArrays, render_arrays
from engine.patch.accuracy import Accuracy
from engine.patch.frames import SAMPLE_RATE_RANGE, nearest_frame
from engine.patch.live_parameters import value_at
from engine.patch.scene import Scene
from engine.patch.tables import ChangeEvent, DampEvent, Force, NoiseForce, SampledForce

STEPS_FACTOR = 4  # times the steps in which tables glide
EXACT_ROUNDING = 1e-3  # frames: what a time is rounded by that is a frame but for its last digits
MEANS = ("acceleration", "pressure", "force", "tension")  # over the step that ends at a sample
MAX_NAMED = 3  # bodies
LEAST_SHARE_SAID = 0.01  # of what a body gives way at a contact
ENLARGED_FRAMES = 4  # to which the largest rounding of a time is enlarged: more would be another motion

Timing = Callable[[float], float]  # of a time or a duration in seconds


class Rounding(NamedTuple):
    """A scene in which the rounding of times to frames is `factor` times as large, to measure what it changes."""

    scene: Scene
    factor: float


@dataclass(frozen=True)
class FinerScene:
    """A scene for renderings finer than one at a sample rate.

    factor:   times the sample rate at which it is rendered
    mean:     channels that are means over the step before a sample [channels], bool
    left_out: names of errors that the finer renderings have too
    """

    scene: Scene
    samplerate: int
    factor: int
    mean: np.ndarray
    left_out: list[str]

    @classmethod
    def of(cls, scene: Scene, seconds: float, samplerate: int, used: Accuracy, factor: int) -> "FinerScene":
        """Make a scene finer than at a setting. factor: times the sample rate, where that refines anything"""
        rate = samplerate * used.oversample
        layout = build(scene, rate, used, seconds).layout
        mean = mean_channels(layout)
        can_refine = mean is not None and rate * factor <= SAMPLE_RATE_RANGE[1] and used.oversample == 1
        is_refined = can_refine and is_known_in_samples(scene)
        bodies = with_same_modes(layout, rate, rate * factor, count_contact_steps(used)) if is_refined else scene.body
        finer = with_finer_glides(_timed(scene, lambda seconds: nearest_frame(seconds, rate) / rate, bodies), rate)
        known = np.zeros(scene.channels, bool) if mean is None else mean
        return cls(finer, samplerate, factor if is_refined else 1, known, name_left_out(layout, rate, is_refined))

    def render(self, seconds: float, **settings: Any) -> RenderedArrays:
        """Render so many seconds. Returns it with the samples of the coarse rate, and the statistics of the finer one.
        settings: of `render_arrays`"""
        fine = render_arrays(self.scene, seconds, self.samplerate * self.factor, **settings)
        return replace(fine, audio=self.thin_out(fine.audio), samplerate=self.samplerate)

    @property
    def is_refined(self) -> bool:
        """True if it refines what more steps do not."""
        return self.factor > 1 or any(getattr(event, "parameter", None) for event in self.scene.event)

    def thin_out(self, audio: np.ndarray) -> np.ndarray:
        """Return the samples of the coarse rate; of channels that are means over the step before a sample, the mean
        since the sample before. audio: [frames, channels]"""
        coarse = audio[:: self.factor].copy()
        if self.mean.any() and self.factor > 1:
            before = np.concatenate([np.zeros((self.factor - 1, audio.shape[1])), audio])[: audio.shape[0]]
            means = before.reshape(len(coarse), self.factor, -1).mean(axis=1)
            coarse[:, self.mean] = means[:, self.mean]
        return coarse


def is_known_in_samples(scene: Scene) -> bool:
    """True if a scene has what is known once a sample, so that only a higher rate refines it."""
    return any(_is_in_samples(force) for force in scene.force) or bool(drive_forces(scene))


def _is_in_samples(force: Force) -> bool:
    return isinstance(force, NoiseForce | SampledForce)


def mean_channels(layout: Layout) -> np.ndarray | None:
    """Tell which channels are means over the step before a sample [channels], bool; None if one is so in part."""
    kinds: list[set[bool]] = [set() for _ in range(layout.scene.channels)]
    for heard in layout.points.pickups:
        if heard.channel >= 0:
            kinds[heard.channel].add(heard.pickup.quantity in MEANS)
    if any(len(kind) > 1 for kind in kinds):
        return None
    return np.array([kind == {True} for kind in kinds])


def name_left_out(layout: Layout, samplerate: float, is_rate_refined: bool) -> list[str]:
    """Name what an estimate does not see."""
    scene, names = layout.scene, list[str]()
    pairs = zip(scene.body, layout.modal_bodies, strict=True)
    cut = [(body, modal) for body, modal in pairs if _is_cut(body, modal) or modal.residual]
    if cut:
        lowest = min(_highest_frequency(body, modal, samplerate) for body, modal in cut) / 1000
        shares = shares_left_out(scene, layout.modal_bodies, samplerate)
        listed = [f'"{body.name}"{_say_share(shares.get(body.name, 0.0))}' for body, _ in cut]
        more = f" and {len(listed) - MAX_NAMED} more" if len(listed) > MAX_NAMED else ""
        names.append(f"modes above {lowest:.3g} kHz of {', '.join(listed[:MAX_NAMED])}{more}")
    if any(heard.pickup.quantity in MEANS for heard in layout.points.pickups):
        names.append("the half sample by which forces, accelerations and pressures are late")
    if is_known_in_samples(scene) and not is_rate_refined:
        names.append("forces that are known once a sample")
    return names


def _say_share(share: float) -> str:
    """Say what share of its compliance at contacts a body lacks, if it amounts to anything."""
    return (
        f" ({100 * share:.2g}% of what it gives way at contacts within a sample)" if share >= LEAST_SHARE_SAID else ""
    )


def _is_cut(body: Any, modal: Any) -> bool:
    """True if a body has as many modes as the sample rate allows, which may be fewer than it asks for."""
    if not isinstance(body, DistributedBody) or isinstance(body, AirBox):
        return False
    return body.modes is None or _count(modal) < getattr(body, "polarisations", 1) * body.modes


def _highest_frequency(body: Any, modal: Any, samplerate: float) -> float:
    """Return up to which frequency the modes of a body are built, Hz."""
    is_full = not _is_cut(body, modal) or (isinstance(body, SheetBody) and _count(modal) == MAX_SHEET_MODES)
    return float(np.max(modal.omega[: _count(modal)])) / 2 / np.pi if is_full else MAX_FREQUENCY_SHARE * samplerate


def _count(modal: Any) -> int:
    """Count the modes of a body that are its own."""
    return int(modal.omega.size) - int(modal.residual) - int(modal.silent)


def with_same_modes(layout: Layout, rate: float, finer_rate: float, steps: float) -> list[Any]:
    """Return the bodies of a layout at a sample rate (Hz) and so many steps a sample, which have the same modes at a
    higher rate."""
    bodies = list[Any]()
    for body, modal in zip(layout.scene.body, layout.modal_bodies, strict=True):
        same: Any = body
        residual = body.residual_rate(rate, steps) if isinstance(body, DistributedBody) else rate
        if isinstance(body, DistributedBody) and _is_cut(body, modal):
            same = _with_mode_count(body, _count(modal), finer_rate)
            same = same.model_copy(update={"residual": modal.residual > 0})
        bodies.append(same.with_residual_of(residual) if modal.residual else same)
    return bodies


def _with_mode_count(body: DistributedBody, count: int, samplerate: float) -> DistributedBody:
    """Return a body that has so many modes at a sample rate (Hz)."""
    directions: int = getattr(body, "polarisations", 1)
    modes, more = count // directions, 1
    while more > 0:
        body = body.model_copy(update={"modes": modes})
        more = body.modal_body(MAX_FREQUENCY_SHARE * samplerate).omega.size - count  # rigid ones are beside `modes`
        modes -= -(-more // directions)
    return body


def enlarge_rounding(scene: Scene, samplerate: float) -> Rounding | None:
    """Return a scene in which times are rounded to frames by so many times more, to measure what that changes; None if
    all times are frames."""
    times = list[float]()

    def note(seconds: float) -> float:
        times.append(seconds)
        return seconds

    _timed(scene, note)
    roundings = [seconds * samplerate - nearest_frame(seconds, samplerate) for seconds in times]
    largest = max((abs(rounding) for rounding in roundings), default=0.0)
    if largest < EXACT_ROUNDING:
        return None
    factor = ENLARGED_FRAMES / largest

    def move(seconds: float) -> float:
        frame = nearest_frame(seconds, samplerate)
        return max(0, frame + round(factor * (seconds * samplerate - frame))) / samplerate

    return Rounding(_timed(scene, move), factor)


def _timed(scene: Scene, timing: Timing, bodies: Sequence[Any] | None = None) -> Scene:
    """Return a scene with other times of what begins and ends with a sample, and other bodies."""
    forces = [
        force.model_copy(update={"start": timing(force.start)}) if _is_in_samples(force) else force
        for force in scene.force
    ]
    events = list[Any]()
    for event in scene.event:
        changes = {"time": timing(event.time)}
        is_table = isinstance(event, ChangeEvent) and event.parameter is not None
        if isinstance(event, ChangeEvent | DampEvent) and event.duration and not is_table:
            changes["duration"] = timing(event.duration)
        events.append(event.model_copy(update=changes))
    return scene.model_copy(update={"force": forces, "event": events, "body": list(bodies or scene.body)})


def with_finer_glides(scene: Scene, samplerate: float, factor: int = STEPS_FACTOR) -> Scene:
    """Return a scene whose tables glide in so many times more steps, each an event of its own."""
    glides = dict[str, tuple[float, float, float, float]]()  # begin, duration, from and to, of each parameter
    steps = list[ChangeEvent]()
    for change in sorted(scored_changes(scene, samplerate), key=lambda change: change.frame):
        begin, count = change.frame / samplerate, count_steps(change.values, change.seconds)
        count *= factor if count > 1 else 1
        for new in change.values:
            name = new.parameter
            before = _value_of_glide(*glides[name], begin) if name in glides else value_at(scene, new.path)
            glides[name] = begin, change.seconds, before, new.value
            steps = [step for step in steps if step.parameter != name or step.time < begin]
            for n in range(1, count + 1):
                time = begin + ((n - 0.5) * change.seconds / count if count > 1 else 0.0)
                value = glide_between(before, new.value, n / count)
                steps.append(ChangeEvent(kind="change", time=time, parameter=name, value=value, duration=0.0))
    others = [event for event in scene.event if getattr(event, "parameter", None) is None]
    return scene.model_copy(update={"event": [*others, *steps]})


def _value_of_glide(begin: float, seconds: float, before: float, after: float, time: float) -> float:
    """Return the value that a glide has reached at a time."""
    return glide_between(before, after, min(1.0, (time - begin) / seconds) if seconds > 0.0 else 1.0)
