"""Contacts that last only a few steps: energy is exact there, but how momentum is shared, and what contact loss takes,
is not. Warnings name them.

A contact that could be so brief has a pickup of its own, which hears its force on a channel beside those of the scene.
The gain of that pickup is so small that it decides nothing. From the impulse of each touch follows how long it lasts:
as long as the collision of its effective mass with its spring, in closed form.
"""

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from engine.assembly.build import BuildResult, build
from engine.faults import BuildError
from engine.kernel.data.state import State, Trace
from engine.offline.recorder import Renderer
from engine.offline.statistics_base import Statistics
from engine.offline.trace import contact_names
from engine.patch.accuracy import MAX_SUBSTEPS, Accuracy
from engine.patch.scene import Scene
from engine.patch.tables import ChangeEvent, Contact, Pickup

FEW_STEPS = {2: 4.0, 4: 2.0, 6: 1.0}  # by order: there, three balls in a row err by 4 % of their speed, 1 % and 1 % …
ENOUGH = 2.5  # times as many steps: … and here by 0.5 % and less
MAX_SPEED = 20.0  # m/s, at which bodies meet, if none is given that is half as fast: no instrument is struck faster
LEAST_SHARE = 0.01  # of the impulse of a contact, by brief touches: less is not worth a word
MAX_WATCHED = 32  # contacts, those that may be the briefest: each takes memory
UNHEARD = 2.0**-100  # gain of their pickups: sleep depends on the peaks of pickups, and none is as small


@dataclass(frozen=True)
class BriefContact(Statistics):
    """A contact of a rendering that lasts only a few steps."""

    contact: str  # as a trace names it
    bodies: list[str]  # one, or the two that touch
    duration: float  # s, of the shortest touch, without what loss adds
    steps: float  # the same in steps, the shortest that are allowed
    touches: int  # that are brief
    substeps: int  # that resolve it


class WatchedContact(NamedTuple):
    """A contact that may be brief."""

    number: int  # of the scene's contacts
    slots: list[int]  # of its points
    mass: float  # kg: the effective mass, the largest of its points

    def durations(self, state: State, speeds: np.ndarray) -> np.ndarray:
        """Return how long bodies touch that meet at some speeds, m/s, in s."""
        exponent = float(state.exponent[self.slots[0]])
        stiffness = float(state.potential_coefficient[self.slots].min()) * (exponent + 1)
        return touch_durations(self.mass, stiffness, exponent, speeds)


class WatchedBuild(NamedTuple):
    """A scene with pickups for the contacts that may be brief."""

    scene: Scene
    built: BuildResult
    contacts: list[WatchedContact]


def touch_durations(mass: float, stiffness: float, exponent: float, speeds: np.ndarray) -> np.ndarray:
    """Return how long a mass touches a spring with the force k·x^α that it meets at some speeds, in s: 2·∫ dx/v over
    the way in, where m·v²/2 falls by k·x^(α+1)/(α+1) (Hertz 1882 for α = 3/2). It is infinite without a spring."""
    n = exponent + 1
    quotient = math.sqrt(math.pi) * math.gamma(1 + 1 / n) / math.gamma(0.5 + 1 / n)
    with np.errstate(over="ignore", divide="ignore", invalid="ignore"):
        depth = (n * mass / np.float64(2 * stiffness)) ** (1 / n) * speeds ** (2 / n)
        return np.asarray(2 * quotient * depth / speeds)


def step_length(samplerate: float, accuracy: Accuracy) -> float:
    """Return the length of the shortest steps that a setting allows, s. samplerate: of the samples computed"""
    return 1 / (samplerate * (accuracy.substeps << accuracy.levels))


# --- the contacts to watch


def watch_contacts(scene: Scene, built: BuildResult, accuracy: Accuracy, seconds: float) -> WatchedBuild:
    """Build a scene again with pickups for the contacts that may be brief; what was built is returned if there is none.

    built, accuracy, seconds: of the scene
    """
    contacts = find_contacts(built, accuracy)
    if not contacts:
        return WatchedBuild(scene, built, [])
    tables, layout = [*scene.pickup], built.layout
    for channel, contact in enumerate(contacts, scene.channels + 1):
        pickup = Pickup(body=scene.contact[contact.number].body, quantity="force", gain=UNHEARD)
        tables.append(pickup.model_copy(update={"channel": channel}))
    watched = scene.model_copy(update={"pickup": tables})
    try:
        rebuilt = build(
            watched, built.model.samplerate, accuracy, seconds, like=layout.modal_bodies, before=layout
        )  # of the same modes: each sample is the same
    except BuildError:  # too large with more pickups
        return WatchedBuild(scene, built, [])
    let_hear_one_contact(rebuilt, contacts, scene.channels)
    return WatchedBuild(watched, rebuilt, contacts)


def find_contacts(built: BuildResult, accuracy: Accuracy) -> list[WatchedContact]:
    """Return the contacts that may last only a few steps, the briefest first."""
    model, state, layout = built
    steps, shares = model.step, np.ones(1)
    if model.refinement is not None:
        steps, shares = model.refinement.stages, model.refinement.length
    stage = int(np.argmax(np.abs(shares)))
    compliance = np.atleast_2d(steps.contact.compliance)[stage].astype(float)
    slots_of: dict[int, list[int]] = {}
    for slot, (k, _) in enumerate(layout.islands.contact_points):
        if isinstance(layout.touching[k], Contact) and compliance[slot] > 0.0:
            slots_of.setdefault(k, []).append(slot)
    length, speed = shares[stage] / model.samplerate, np.array([largest_speed(layout.scene)])
    by_duration = list[tuple[float, WatchedContact]]()
    for k, slots in slots_of.items():
        contact = WatchedContact(k, slots, length**2 / (2 * float(compliance[slots].min())))
        durations = [contact.durations(state, speed)[0]]
        for stiffness, exponent in later_laws(layout.scene, k):
            durations.append(touch_durations(contact.mass, stiffness, exponent, speed)[0])
        limit = FEW_STEPS[2 if layout.scene.contact[k].loss else accuracy.order]
        if min(durations) < limit * step_length(model.samplerate, accuracy):
            by_duration.append((float(min(durations)), contact))
    return [contact for _, contact in sorted(by_duration, key=lambda item: item[0])[:MAX_WATCHED]]


def largest_speed(scene: Scene) -> float:
    """Return a speed that bodies of a scene are unlikely to exceed where they meet, m/s."""
    given = [getattr(table, "velocity", None) for table in (*scene.body, *scene.event)]
    return max([MAX_SPEED, *(2 * abs(speed) for speed in given if isinstance(speed, float))])


def later_laws(scene: Scene, k: int) -> Iterator[tuple[float, float]]:
    """Yield the stiffness, N/m^α, and the exponent of contact k after each event that changes either."""
    contact = scene.contact[k]
    for event in scene.event:
        if isinstance(event, ChangeEvent) and contact.name is not None:
            values = {"stiffness": event.stiffness, "exponent": event.exponent} if event.contact == contact.name else {}
            if event.parameter and event.parameter.startswith(f"contact.{contact.name}."):
                values = {event.parameter.rpartition(".")[2]: event.value}
            stiffness, exponent = values.get("stiffness"), values.get("exponent")
            if stiffness or exponent:
                yield stiffness or contact.stiffness, exponent or contact.exponent


def let_hear_one_contact(built: BuildResult, contacts: Sequence[WatchedContact], channels: int) -> None:
    """Let each pickup beyond the channels of a scene hear one contact, and not all of its body."""
    pickups, layout = built.model.pickups, built.layout
    for n, heard in enumerate(layout.points.pickups):
        if heard.channel >= channels:
            inside = slice(int(pickups.contact_begin[n]), int(pickups.contact_end[n]))
            begin = layout.islands.contact_begins[layout.islands.of_body[layout.body_index[heard.pickup.body]]]
            slots = contacts[heard.channel - channels].slots
            pickups.contact_sign[inside] = np.isin(pickups.contact[inside] + begin, slots)


# --- how long they last


class BriefContactRecord:
    """A renderer that finds which of the watched contacts are brief. Their forces do not reach the sound.

    accuracy, channels: of the scene without their pickups
    """

    def __init__(self, renderer: Renderer, watched: WatchedBuild, accuracy: Accuracy, channels: int) -> None:
        self._renderer, self._state, self._contacts = renderer, watched.built.state, watched.contacts
        self._scene, self._accuracy, self._channels = watched.scene, accuracy, channels
        self._rate = watched.built.model.samplerate
        self._step = step_length(self._rate, accuracy)
        count = len(self._contacts)
        self._open_samples = np.zeros(count, np.int64)  # of the touch that goes on
        self._open_sum, self._impulse, self._brief_impulse = np.zeros(count), np.zeros(count), np.zeros(count)
        self._brief_touches = np.zeros(count, np.int64)
        self._shortest = np.full(count, math.inf)

    def render_block(self, audio: np.ndarray, trace: Trace | None = None) -> None:
        """Render len(audio) samples into audio [frames, channels], and fill the trace; of none, compile."""
        heard = np.zeros((len(audio), self._channels + len(self._contacts)))
        self._renderer.render_block(heard, trace)
        audio[:] = heard[:, : self._channels]
        forces = heard[:, self._channels :]
        if len(audio):
            for n in np.flatnonzero(forces.any(axis=0) | (self._open_samples > 0)).tolist():
                self._count_touches(n, forces[:, n] / UNHEARD)

    def _count_touches(self, n: int, force: np.ndarray) -> None:
        """Count the touches of a watched contact that end within a block. force: [frames], N"""
        before, goes_on = self._open_samples[n], self._open_samples[n] > 0
        values = np.concatenate([[self._open_sum[n]], force])
        touching = np.concatenate([[goes_on], force != 0.0])
        begins, ends = np.flatnonzero(np.diff(touching, prepend=False, append=False)).reshape(-1, 2).T
        samples, numbers = ends - begins, np.repeat(np.arange(begins.size), ends - begins)
        sums = np.bincount(numbers, values[touching])  # one by one: the same in blocks of any size
        samples[0] += max(0, before - 1)
        is_open = ends[-1] == len(values)
        self._open_samples[n], self._open_sum[n] = (samples[-1], sums[-1]) if is_open else (0, 0.0)
        samples, impulse = samples[: samples.size - is_open], sums[: sums.size - is_open] / self._rate
        contact, limit = self._contacts[n], FEW_STEPS[self._order(n)] * self._step
        durations = contact.durations(self._state, impulse / (2 * contact.mass))
        is_brief = (durations < limit) & (samples <= 1 + math.ceil(2 * limit * self._rate))
        self._impulse[n] += impulse.sum()
        self._brief_impulse[n] += impulse[is_brief].sum()
        self._brief_touches[n] += np.count_nonzero(is_brief)
        self._shortest[n] = durations[is_brief].min(initial=self._shortest[n])

    def _order(self, n: int) -> int:
        """Return the order of a watched contact: 2 of one with loss, which is too strong for others where it parts."""
        return 2 if self._scene.contact[self._contacts[n].number].loss > 0.0 else self._accuracy.order

    def statistics(self) -> list[BriefContact]:
        """Return the contacts that are brief, in the order of the scene."""
        is_brief = (self._brief_touches > 0) & (self._brief_impulse >= LEAST_SHARE * self._impulse)
        return [
            self._statistics_of(n)
            for n in sorted(np.flatnonzero(is_brief).tolist(), key=lambda n: self._contacts[n].number)
        ]

    def _statistics_of(self, n: int) -> BriefContact:
        number, steps = self._contacts[n].number, float(self._shortest[n] / self._step)
        table, finest = self._scene.contact[number], self._accuracy.substeps << self._accuracy.levels
        return BriefContact(
            contact=contact_names(self._scene)[number],
            bodies=[table.body, *([table.on] if table.on is not None else [])],
            duration=float(self._shortest[n]),
            steps=steps,
            touches=int(self._brief_touches[n]),
            substeps=math.ceil(ENOUGH * FEW_STEPS[self._order(n)] / steps * finest),
        )


def warn_of_brief_contacts(contacts: Sequence[BriefContact], accuracy: Accuracy) -> list[str]:
    """Warn of contacts that last only a few steps, and say what resolves them."""
    if not contacts:
        return []
    texts = [f"{_label(c)} lasts {c.steps:.2g} steps ({1e3 * c.duration:.2g} ms)" for c in contacts]
    needed = max(contact.substeps for contact in contacts)
    key = "substeps" if accuracy.max_error is None else "max_substeps"
    remedy = f"{key} = {needed}" if needed <= MAX_SUBSTEPS else "a lower stiffness, or a higher sample rate"
    remedy += ", or max_error" if accuracy.max_error is None and needed <= MAX_SUBSTEPS else ""
    law = "its law says" if len(contacts) == 1 else "their laws say"
    return [f"{', '.join(texts)}: too short to share momentum and to lose energy as {law}; give {remedy}"]


def _label(contact: BriefContact) -> str:
    bodies = " on ".join(f'"{name}"' for name in contact.bodies)
    return f"{contact.contact} ({bodies})"
