"""Points of pickups: each pickup has one or several points on bodies, with a quantity, a channel and a gain."""

import math
from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from engine.arithmetic.elementary import cos, sin
from engine.assembly.connection_coordinates import end_force_parts, end_pull_parts
from engine.assembly.contact_points import NOWHERE, BodyPoint
from engine.assembly.islands import Islands
from engine.assembly.modal_system import ModalSystem
from engine.assembly.mode_shape_rows import ShapeRow
from engine.assembly.modes import Modes, find_row
from engine.assembly.one_way_drive import find_drives
from engine.bodies.air import AIR_DENSITY, AirBody
from engine.bodies.body import ModalBody
from engine.bodies.sheet import FlatSheet
from engine.kernel.data.enums import Quantity
from engine.patch.tables import Pickup

QUANTITIES = {
    "displacement": Quantity.DISPLACEMENT,
    "velocity": Quantity.VELOCITY,
    "acceleration": Quantity.ACCELERATION,
    "pressure": Quantity.ACCELERATION,  # a sum of accelerations
    "force": Quantity.FORCE,
    "end_force": Quantity.DISPLACEMENT,  # a sum of displacements
    "tension": Quantity.FORCE,
}


class DrivePickup(NamedTuple):
    """The force of a string on its end, which drives a body and goes to no output channel."""

    body: str
    at: float
    share: float  # of the force that drives the body
    point: int  # number of the point that it drives
    quantity: str = "end_force"


class HeardPoint(NamedTuple):
    """One term of a pickup's signal."""

    pickup: Pickup | DrivePickup
    row: ShapeRow
    quantity: Quantity
    channel: int  # from 0; -1 - n: it drives point n
    gain: float
    pull: ShapeRow | None = None  # what the rise of the tension of the body adds to it, per N


def heard_points(system: ModalSystem, islands: Islands, modes: Modes) -> list[HeardPoint]:
    """Return the terms of the signals of all pickups, and of the forces by which strings drive bodies, by island."""
    pickups: list[Pickup | DrivePickup] = list(system.scene.pickup)
    pickups += [DrivePickup(drive.string, drive.end, drive.share, drive.point) for drive in find_drives(system.scene)]
    pickups.sort(key=lambda pickup: islands.of_body[system.body_index[pickup.body]])
    return [
        HeardPoint(pickup, row, quantity, channel, gain * system.scene.output_gain(channel), pull)
        for pickup in pickups
        for row, quantity, pull in _terms(system, modes, pickup)
        for channel, gain in channel_gains(pickup)
    ]


def _terms(
    system: ModalSystem, modes: Modes, pickup: Pickup | DrivePickup
) -> Iterator[tuple[ShapeRow, Quantity, ShapeRow | None]]:
    """Yield the terms of the signal of a pickup."""
    for point in _points(system, pickup):
        yield find_row(system, modes, point), QUANTITIES[pickup.quantity or "velocity"], None
    if pickup.quantity == "end_force":
        for name, row in end_pull_parts(system, pickup.body, pickup.at):
            pull = find_row(system, modes, BodyPoint(name, None, 1.0, row))
            yield find_row(system, modes, NOWHERE), Quantity.FORCE, pull


def channel_gains(pickup: Pickup | DrivePickup) -> list[tuple[int, float]]:
    """Return the channels of a pickup, from 0, with its gain on each. A pan shares its power between two."""
    if isinstance(pickup, DrivePickup):
        return [(-1 - pickup.point, pickup.share)]
    if pickup.pan is None:
        return [(channel - 1, pickup.gain) for channel in pickup.channels]
    angle = (pickup.pan + 1) * math.pi / 4
    return [(0, pickup.gain * cos(angle)), (1, pickup.gain * sin(angle))]


def _points(system: ModalSystem, pickup: Pickup | DrivePickup) -> list[BodyPoint]:
    """Return the points of a pickup; NOWHERE if its signal is all contact forces of its body, or its tension."""
    if pickup.quantity in ("force", "tension"):
        return [NOWHERE]
    if pickup.quantity == "end_force":
        return [BodyPoint(name, None, 1.0, row) for name, row in end_force_parts(system, pickup.body, pickup.at)]
    assert isinstance(pickup, Pickup)
    number = system.body_index[pickup.body]
    body, modal = system.scene.body[number], system.modal_bodies[number]
    places = body.split_positions(pickup.at)
    if pickup.quantity == "pressure":
        assert isinstance(body, FlatSheet | AirBody)
        if pickup.at is None or not isinstance(body, FlatSheet):
            row = body.volume_row(modal)
        else:
            row = body.area() * _mean_shape(modal, places)
        return [BodyPoint(pickup.body, None, 1.0, AIR_DENSITY / (2 * math.pi * (pickup.distance or 1.0)) * row)]
    if len(places) == 1:
        return [BodyPoint(pickup.body, places[0], 1.0, angle=pickup.angle)]
    mean = system.turn_shape(pickup.body, _mean_shape(modal, places), pickup.angle)
    return [BodyPoint(pickup.body, None, 1.0, mean)]


def _mean_shape(body: ModalBody, places: list[object]) -> np.ndarray:
    """Return the mean of the mode shapes at some positions [modes], 1/√kg."""
    return np.asarray(np.mean([body.shape(place) for place in places], axis=0))
