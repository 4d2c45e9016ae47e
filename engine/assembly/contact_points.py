"""Points of contacts: where they are on either body."""

from typing import Any, NamedTuple

import numpy as np

from engine.arithmetic.elementary import square
from engine.arithmetic.plain_numbers import power
from engine.bodies import Body
from engine.bodies.distributed import LineBody
from engine.bodies.tips import place_of
from engine.patch.friction import Friction
from engine.patch.tables import Bridge, Contact, Frets


class BodyPoint(NamedTuple):
    """A position on a body, and the factor that multiplies the mode shape there. A barrier has no body."""

    body: str | None
    position: Any  # or a Tip
    factor: float
    phi: np.ndarray | None = None  # the mode shapes there [modes], 1/√kg, if they are not those of the body
    angle: float = 0.0  # rad: direction of motion, of a string with two polarisations


NOWHERE = BodyPoint(None, None, 0.0)


class ContactPoint(NamedTuple):
    """One point of a contact."""

    at: Any  # position on the body
    on_at: Any  # position on the other body
    offset: float  # m: position of the barrier, or the gap
    stiffness: float  # N/m^exponent
    radius: float = 0.0  # m: of what touches the body …
    on_radius: float = 0.0  # … and the other body


def contact_points(contact: Contact | Friction, body: Body, on: Body | None) -> list[ContactPoint]:
    """Return the points of a contact; `body` is the one that touches."""
    if contact.bridge is not None and isinstance(body, LineBody):
        return _bridge(contact.bridge, contact.stiffness, body.length)
    if contact.frets is not None:
        return _frets(contact.frets, contact.stiffness)
    touching, touched = body.split_positions(contact.at), [None] if on is None else on.split_positions(contact.on_at)
    offset = contact.gap if contact.on is not None else contact.barrier
    offsets = offset if isinstance(offset, list) else [offset or 0.0]
    count = max(len(touching), len(touched), len(offsets))
    touching, touched, offsets = (items * count if len(items) == 1 else items for items in (touching, touched, offsets))
    radius, on_radius = _radius(contact, body), _radius(contact, on)
    return [
        ContactPoint(a, b, float(c), contact.stiffness, radius, on_radius)
        for a, b, c in zip(touching, touched, offsets, strict=True)
    ]


def _radius(contact: Contact | Friction, body: Body | None) -> float:
    """Return the radius of what touches a body in a contact, m."""
    if not isinstance(contact, Contact) or body is None:
        return 0.0
    return body.CONTACT_RADIUS if contact.radius is None else contact.radius


def count_points(contact: Contact | Friction) -> int:
    """Return the number of points of a contact, or an upper bound of it, without computing the points."""
    if contact.bridge is not None:
        return contact.bridge.points
    if contact.frets is not None:
        return contact.frets.count or len(contact.frets.at or [])
    lists = (contact.at, contact.on_at, contact.gap if contact.on is not None else contact.barrier)
    return max(len(items) if isinstance(items, list) else 1 for items in lists)


def _bridge(bridge: Bridge, stiffness: float, length: float) -> list[ContactPoint]:
    """Return the points of a bridge, which is a parabola through its top. The points share its stiffness."""
    across = [2 * i / (bridge.points - 1) - 1 for i in range(bridge.points)]  # -1 to 1
    half = bridge.width / length / 2
    return [
        ContactPoint(bridge.at + half * x, None, bridge.height - bridge.depth * square(x), stiffness / bridge.points)
        for x in across
    ]


def _frets(frets: Frets, stiffness: float) -> list[ContactPoint]:
    """Return a point for each fret; each has the whole stiffness. Two heights for several frets are those of the first
    and the last; the others lie on a line between them."""
    at = frets.at or [1 - power(2.0, -n / 12) for n in range(1, (frets.count or 0) + 1)]
    height = frets.height if isinstance(frets.height, list) else [frets.height] * len(at)
    if len(height) == 2 and len(at) > 2:
        low, high = height
        height = [low + (high - low) * (x - at[0]) / (at[-1] - at[0]) for x in at]
    return [ContactPoint(x, None, float(h), stiffness) for x, h in zip(at, height, strict=True)]


def contact_sides(contact: Contact | Friction, point: ContactPoint) -> tuple[BodyPoint, BodyPoint]:
    """Return the two body points that a contact point joins, each with the sign of its part in the compression."""
    sign = 1.0 if contact.side == "above" else -1.0
    angle = contact.angle if isinstance(contact, Friction) else 0.0
    own, other = place_of(point.at, point.radius), place_of(point.on_at, point.on_radius)
    return BodyPoint(contact.body, own, sign, angle=angle), BodyPoint(contact.on, other, -sign)


def offset(contact: Contact | Friction, point: ContactPoint) -> float:
    """Return the offset that is subtracted from the projected displacement at a point of a contact, m."""
    return -point.offset if contact.on is None and contact.side == "below" else point.offset
