"""Points of a contact, each with its position on either body, offset and stiffness."""

from typing import Any, NamedTuple

from engine.bodies import Body
from engine.bodies.distributed import LineBody
from engine.patch.tables import Bridge, Contact, Frets


class ContactPoint(NamedTuple):
    """One point of a contact."""

    at: Any  # position on the body
    on_at: Any  # position on the other body
    offset: float  # m: position of the barrier, or the gap
    stiffness: float  # N/m^exponent


def contact_points(contact: Contact, body: Body, on: Body | None) -> list[ContactPoint]:
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
    return [ContactPoint(a, b, float(c), contact.stiffness) for a, b, c in zip(touching, touched, offsets, strict=True)]


def count_points(contact: Contact) -> int:
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
        ContactPoint(bridge.at + half * x, None, bridge.height - bridge.depth * x**2, stiffness / bridge.points)
        for x in across
    ]


def _frets(frets: Frets, stiffness: float) -> list[ContactPoint]:
    """Return a point for each fret; each has the whole stiffness. Two heights for several frets are those of the first
    and the last; the others lie on a line between them."""
    at = frets.at or [1 - 2 ** (-n / 12) for n in range(1, (frets.count or 0) + 1)]
    height = frets.height if isinstance(frets.height, list) else [frets.height] * len(at)
    if len(height) == 2 and len(at) > 2:
        low, high = height
        height = [low + (high - low) * (x - at[0]) / (at[-1] - at[0]) for x in at]
    return [ContactPoint(x, None, float(h), stiffness) for x, h in zip(at, height, strict=True)]
