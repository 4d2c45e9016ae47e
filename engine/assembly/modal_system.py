"""A scene with its bodies as modes."""

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from engine.arithmetic.elementary import cos, sin
from engine.assembly.contact_points import BodyPoint, ContactPoint, contact_points
from engine.bodies.body import ModalBody
from engine.patch.friction import Friction
from engine.patch.scene import Scene
from engine.patch.tables import Contact


@dataclass(frozen=True)
class ModalSystem:
    """A scene with its bodies as modes."""

    scene: Scene
    modal_bodies: list[ModalBody]
    body_index: dict[str, int]  # the number of each body, by its name

    @cached_property
    def touching(self) -> list[Contact | Friction]:
        """Contacts, and after them friction: the kernels number their points together."""
        return [*self.scene.contact, *self.scene.friction]

    def shape(self, name: str, at: Any) -> np.ndarray:
        """Return the mode shapes of a body at the one position that a key gives [modes], 1/√kg."""
        number = self.body_index[name]
        return self.modal_bodies[number].shape(self.scene.body[number].split_positions(at)[0])

    def shape_at(self, point: BodyPoint) -> np.ndarray:
        """Return the mode shapes of a body at a point, times the factor of the point [modes], 1/√kg; empty without a
        body."""
        if point.body is None:
            return np.empty(0)
        if point.phi is not None:
            return point.phi
        shape = self.modal_bodies[self.body_index[point.body]].shape(point.position)
        return point.factor * self.turn_shape(point.body, shape, point.angle)

    def turn_shape(self, name: str, shape: np.ndarray, angle: float) -> np.ndarray:
        """Return the mode shapes of a string in another direction than its first polarisation [modes], 1/√kg.

        shape: in its first polarisation, whose modes alternate with those of the second (engine.bodies.string)
        angle: between the two directions, rad
        """
        if angle == 0.0:
            return shape
        modal, across = self.modal_bodies[self.body_index[name]], np.zeros(shape.size)
        built = shape.size - modal.residual - modal.silent
        across[1:built:2] = shape[0:built:2]
        return np.asarray(cos(angle) * shape + sin(angle) * across)

    def same_bodies(self, scene: Scene) -> dict[int, ModalBody]:
        """Return the modal bodies that another scene has too, by their numbers. Contacts at other places change the
        residual modes of all."""
        if scene.contact is not self.scene.contact:
            return {}
        pairs = enumerate(zip(self.scene.body, scene.body, strict=True))
        return {number: self.modal_bodies[number] for number, (ours, theirs) in pairs if ours is theirs}

    def points_of(self, contact: Contact | Friction) -> list[ContactPoint]:
        """Return the points of a contact, or of friction."""
        on = None if contact.on is None else self.scene.body[self.body_index[contact.on]]
        return contact_points(contact, self.scene.body[self.body_index[contact.body]], on)

    def point_of(self, table: Any) -> BodyPoint:
        """Return the point of a body at which a force or a pickup acts."""
        body = self.scene.body[self.body_index[table.body]]
        return BodyPoint(table.body, body.split_positions(table.at)[0], 1.0, angle=getattr(table, "angle", 0.0))
