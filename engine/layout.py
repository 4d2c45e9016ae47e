"""Where everything lies: the islands of a scene, and the order in which the kernels see its parts."""

from collections.abc import Iterable, Sequence
from functools import cached_property

import numpy as np

from engine.bodies import ModalBody, modal
from engine.model import Islands, Modes, Rows
from engine.scene import Scene

Point = tuple[str | None, float]  # a body's name, or None for no body; and a factor on its shape


class Layout:
    """The parts of a scene sorted by island.

    Contacts of no stiffness and forces of no amplitude amount to absence: they join nothing, and
    are not built.
    """

    def __init__(self, scene: Scene) -> None:
        self.scene = scene
        self.modal: list[ModalBody] = [modal(b) for b in scene.body]
        self.number = {body.name: i for i, body in enumerate(scene.body)}
        contacts = [k for k, c in enumerate(scene.contact) if c.stiffness > 0.0]
        self.island = self._join(contacts)
        self.body = self._ordered(range(len(scene.body)), [b.name for b in scene.body])
        self.contact = self._ordered(contacts, [c.body for c in scene.contact])
        self.force = self._ordered(
            (i for i, f in enumerate(scene.force) if f.amplitude != 0.0), [f.body for f in scene.force]
        )
        self.pickup = self._ordered(range(len(scene.pickup)), [p.body for p in scene.pickup])

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
        found = sorted({find(i) for i in range(len(root))})
        return [found.index(find(i)) for i in range(len(root))]

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
            contact=self._slices(scene.contact[k].body for k in self.contact),
            force=self._slices(scene.force[j].body for j in self.force),
            pickup=self._slices(scene.pickup[p].body for p in self.pickup),
        )

    @cached_property
    def _mode_begins(self) -> np.ndarray:
        """First mode of each body, in the kernels' order, and the number of all modes."""
        return np.cumsum([0] + [self.modal[b].omega.size for b in self.body]).astype(np.int64)

    @cached_property
    def _first(self) -> list[int]:
        """First mode of each of the scene's bodies, counted from its island's first."""
        first = [0] * len(self.body)
        for place, b in enumerate(self.body):
            first[b] = int(self._mode_begins[place] - self.islands.mode[self.island[b]])
        return first

    def gather(self, field: str) -> np.ndarray:
        """A field of the modal bodies, over all modes."""
        return np.concatenate([getattr(self.modal[b], field) for b in self.body])

    def rows(self, points: Sequence[Point], modes: Modes) -> Rows:
        """Shapes at points."""
        first, last, shape, kick, drift = [], [], [np.empty(0)], [np.empty(0)], [np.empty(0)]
        for name, factor in points:
            if name is None:
                first.append(0)
                last.append(0)
                continue
            number = self.number[name]
            own = factor * self.modal[number].shape
            begin = self._mode_begins[self.body.index(number)]
            first.append(self._first[number])
            last.append(self._first[number] + own.size)
            shape.append(own)
            kick.append(own * modes.kick[begin : begin + own.size])
            drift.append(own * modes.drift[begin : begin + own.size])
        sizes = np.subtract(last, first)
        return Rows(
            first=np.array(first, dtype=np.uint32),
            last=np.array(last, dtype=np.uint32),
            at=np.array(np.cumsum(sizes) - sizes, dtype=np.uint32),
            shape=np.concatenate(shape),
            kick=np.concatenate(kick),
            drift=np.concatenate(drift),
        )

    def shape(self, point: Point) -> np.ndarray:
        """The shape of a body at a point, times the factor; empty without a body."""
        name, factor = point
        return np.empty(0) if name is None else factor * self.modal[self.number[name]].shape

    def spread(self, point: Point, island: int) -> np.ndarray:
        """The same over all modes of an island."""
        wide = np.zeros(int(self.islands.mode[island + 1] - self.islands.mode[island]))
        name, _ = point
        if name is not None:
            shape = self.shape(point)
            first = self._first[self.number[name]]
            wide[first : first + shape.size] = shape
        return wide
