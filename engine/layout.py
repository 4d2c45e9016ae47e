"""Where everything lies: the islands of a scene, and the order in which the kernels see its parts."""

import math
from collections.abc import Iterable, Sequence
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np

from engine.bodies import ModalBody
from engine.model import Islands, Modes, Rows
from engine.parts import Change, Contact, Force, PluckAgain, Strike
from engine.scene import Scene
from engine.spots import Spot, spots

PARTS = 8  # at most: as many cores can share the work
WORTH_SHARING = 200.0  # work, about 1 ns a sample each: below, waking a thread costs more than it saves
ISLAND_WORK = 15.0  # of an island, besides its modes and contacts
VECTOR = 4  # modes that the processor takes at once


class Point(NamedTuple):
    """A place on a body, with a factor on its shape there; no body: a barrier."""

    body: str | None
    place: Any
    factor: float


class Layout:
    """The parts of a scene sorted by island.

    Contacts of no stiffness, now or by an event, or that cannot close, and forces of no amplitude amount
    to absence: they join nothing, and are not built.

    scene: what to lay out
    modal: its bodies as modes
    live:  events may come that the scene does not name, so that every contact could close
    """

    def __init__(self, scene: Scene, modal: list[ModalBody], live: bool = False) -> None:
        self.scene, self.modal = scene, modal
        self.number = {body.name: i for i, body in enumerate(scene.body)}
        stiff = {e.contact for e in scene.event if isinstance(e, Change) and e.stiffness}
        contacts = [k for k, c in enumerate(scene.contact) if c.stiffness > 0.0 or c.name in stiff]
        self.forces: list[Force | PluckAgain] = [f for f in scene.force if f.amplitude != 0.0]
        self.forces += [e for e in scene.event if isinstance(e, PluckAgain) and e.amplitude != 0.0]
        self.island = self._join(contacts)
        reach = {} if live else self._reaches(contacts)
        contacts = [k for k in contacts if live or self._can_close(k, reach)]
        self.island = self._join(contacts)
        self.body = self._ordered(range(len(scene.body)), [b.name for b in scene.body])
        touching = self._ordered(contacts, [c.body for c in scene.contact])
        self.spot = [(k, spot) for k in touching for spot in self.spots(scene.contact[k])]
        self.force = self._ordered(range(len(self.forces)), [f.body for f in self.forces])
        self.pickup = self._ordered(range(len(scene.pickup)), [p.body for p in scene.pickup])

    def spots(self, contact: Contact) -> list[Spot]:
        """The points of a contact."""
        on = None if contact.on is None else self.scene.body[self.number[contact.on]]
        return spots(contact, self.scene.body[self.number[contact.body]], on)

    def ends(self, k: int, spot: Spot) -> tuple[Point, Point]:
        """The two places that a point of contact k joins, with the sign of their part in its compression."""
        contact = self.scene.contact[k]
        sign = 1.0 if contact.side == "above" else -1.0
        return Point(contact.body, spot.at, sign), Point(contact.on, spot.on_at, -sign)

    def _join(self, contacts: Iterable[int]) -> list[int]:
        """Island of each body: bodies joined by contacts share one."""
        root = list(range(len(self.scene.body)))

        def find(i: int) -> int:
            while root[i] != i:
                i = root[i]
            return i

        for k in contacts:
            contact = self.scene.contact[k]
            if contact.on is not None:
                a, b = find(self.number[contact.body]), find(self.number[contact.on])
                root[max(a, b)] = min(a, b)
        number = {first: n for n, first in enumerate(sorted({find(i) for i in range(len(root))}))}
        return [number[find(i)] for i in range(len(root))]

    def _reaches(self, contacts: Iterable[int]) -> dict[int, float]:
        """√2E of each island that has contacts, from the energy it holds at time 0, √J; infinite if it is driven."""
        scene, found = self.scene, dict[int, float]()
        inside: dict[int, list[int]] = {}
        for b in range(len(scene.body)):
            inside.setdefault(self.island[b], []).append(b)
        joined: dict[int, list[int]] = {}
        for k in contacts:
            joined.setdefault(self.island[self.number[scene.contact[k].body]], []).append(k)
        driven = {f.body for f in self.forces} | {e.body for e in scene.event if isinstance(e, Strike)}
        changed = {e.contact for e in scene.event if isinstance(e, Change)}
        for island, own in joined.items():
            weighs = scene.gravity != 0.0 and any(self.modal[b].weight.any() for b in inside[island])
            pushed = any(scene.body[b].name in driven for b in inside[island])
            if weighs or pushed or any(scene.contact[j].name in changed for j in own):
                found[island] = math.inf
                continue
            energy = sum(
                float(np.sum(m.p**2 + (m.omega * m.q) ** 2)) / 2 for m in map(self.modal.__getitem__, inside[island])
            )
            found[island] = math.sqrt(2 * (energy + sum(self._pressed(j) for j in own)))
        return found

    def _can_close(self, k: int, reaches: dict[int, float]) -> bool:
        """Whether the energy of its island could ever close contact k.

        A displacement Φq of energy E is at most √(2E·Σ Φ²/ω²), by Cauchy and Schwarz; both schemes
        keep to that, for they conserve E. What drives an island can close all its contacts.
        """
        reach = reaches[self.island[self.number[self.scene.contact[k].body]]]
        if reach == math.inf:
            return True
        for spot in self.spots(self.scene.contact[k]):
            soft = math.sqrt(sum(self._compliance(point) for point in self.ends(k, spot))) if reach else 0.0
            if not reach * soft * (1 + 1e-9) <= self.barrier(k, spot):
                return True
        return False

    def barrier(self, k: int, spot: Spot) -> float:
        """What is subtracted from the projected displacement at a point of contact k, m."""
        contact = self.scene.contact[k]
        return -spot.offset if contact.on is None and contact.side == "below" else spot.offset

    def _compliance(self, point: Point) -> float:
        """Static compliance Σ Φ²/ω² at a point, m/N; infinite for a free mass."""
        if point.body is None:
            return 0.0
        shape, omega = self.shape(point), self.modal[self.number[point.body]].omega
        moved = shape != 0.0
        with np.errstate(over="ignore"):  # of a mode that is slower than anything
            return math.inf if np.any(omega[moved] == 0.0) else float(np.sum((shape[moved] / omega[moved]) ** 2))

    def _pressed(self, k: int) -> float:
        """Energy that contact k holds at time 0, J."""
        contact, energy = self.scene.contact[k], 0.0
        for spot in self.spots(contact):
            s = -self.barrier(k, spot)
            for point in self.ends(k, spot):
                if point.body is not None:
                    s += float(self.shape(point) @ self.modal[self.number[point.body]].q)
            energy += spot.stiffness * max(0.0, s) ** (contact.exponent + 1) / (contact.exponent + 1)
        return energy

    def _ordered(self, items: Iterable[int], bodies: Sequence[str]) -> list[int]:
        """Items sorted by the island of the body each belongs to."""
        return sorted(items, key=lambda i: self.island[self.number[bodies[i]]])

    def _slices(self, bodies: Iterable[str]) -> np.ndarray:
        """Where each island's items begin, given the body of every item."""
        owners = np.array([self.island[self.number[name]] for name in bodies], dtype=np.int64)
        counts = np.bincount(owners, minlength=max(self.island) + 1)
        return np.concatenate([[0], np.cumsum(counts)]).astype(np.int64)

    @cached_property
    def islands(self) -> Islands:
        """Slices of all parts."""
        scene = self.scene
        body = self._slices(b.name for b in scene.body)
        return Islands(
            body=body,
            mode=self._mode_begins[body],
            contact=self._slices(scene.contact[k].body for k, _ in self.spot),
            force=self._slices(self.forces[j].body for j in self.force),
            event=np.zeros(body.size, dtype=np.int64),  # events are built last (engine.score)
            pickup=self._slices(scene.pickup[p].body for p in self.pickup),
            part=self._parts(),
        )

    def work(self) -> np.ndarray:
        """About what each island costs in contact, ns a sample."""
        modes = np.diff(self._mode_begins[self._slices(b.name for b in self.scene.body)])
        contacts = np.diff(self._slices(self.scene.contact[k].body for k, _ in self.spot))
        return np.asarray(ISLAND_WORK + modes * (1 + contacts / 4) + contacts**2)

    def _parts(self) -> np.ndarray:
        """Where to cut the islands into parts of about equal work: one part if there is little of it."""
        work = np.cumsum(self.work())
        if work.size < 2 or work[-1] < WORTH_SHARING:
            return np.array([0, work.size])
        parts = min(PARTS, work.size)
        cuts = np.searchsorted(work, np.arange(1, parts) * work[-1] / parts) + 1
        return np.unique(np.concatenate([[0], cuts, [work.size]]))

    @cached_property
    def _mode_begins(self) -> np.ndarray:
        """First mode of each body, in the kernels' order, and the number of all modes."""
        return np.cumsum([0] + [self.modal[b].omega.size for b in self.body]).astype(np.int64)

    def modes_of(self, number: int) -> slice:
        """The modes of one of the scene's bodies, counted from its island's first."""
        begin = int(self._mode_begins[self._place[number]] - self.islands.mode[self.island[number]])
        return slice(begin, begin + self.modal[number].omega.size)

    def place_of(self, number: int) -> slice:
        """The modes of one of the scene's bodies, counted from the first of all."""
        begin = int(self._mode_begins[self._place[number]])
        return slice(begin, begin + self.modal[number].omega.size)

    @cached_property
    def _place(self) -> dict[int, int]:
        """Where each of the scene's bodies lies in the kernels' order."""
        return {number: place for place, number in enumerate(self.body)}

    def gather(self, field: str) -> np.ndarray:
        """A field of the modal bodies, over all modes."""
        return np.concatenate([getattr(self.modal[b], field) for b in self.body])

    def rows(self, points: Sequence[Point], modes: Modes) -> Rows:
        """Shapes at points."""
        first, last, at, end = [], [], [], 0
        shape, kick, drift = [np.empty(0)], [np.empty(0)], [np.empty(0)]
        for point in points:
            own = self.shape(point)
            if point.body is None:
                first.append(0)
                last.append(0)
                at.append(end)
                continue
            number = self.number[point.body]
            begin = self._mode_begins[self._place[number]]
            first.append(self.modes_of(number).start)
            last.append(first[-1] + own.size)
            gap = (begin - end) % VECTOR if own.size > 1 else 0
            at.append(end + gap)
            end = at[-1] + own.size
            for rows, row in (
                (shape, own),
                (kick, own * modes.kick[begin : begin + own.size]),
                (drift, own * modes.drift[begin : begin + own.size]),
            ):
                rows += [np.zeros(gap), row]
        return Rows(
            first=np.array(first, dtype=np.uint32),
            last=np.array(last, dtype=np.uint32),
            at=np.array(at, dtype=np.uint32),
            shape=np.concatenate(shape),
            kick=np.concatenate(kick),
            drift=np.concatenate(drift),
        )

    def shape(self, point: Point) -> np.ndarray:
        """The shape of a body at a point, times the factor; empty without a body."""
        if point.body is None:
            return np.empty(0)
        return point.factor * self.modal[self.number[point.body]].shape(point.place)

    def spread(self, point: Point, island: int) -> np.ndarray:
        """The same over all modes of an island."""
        wide = np.zeros(int(self.islands.mode[island + 1] - self.islands.mode[island]))
        if point.body is not None:
            wide[self.modes_of(self.number[point.body])] = self.shape(point)
        return wide
