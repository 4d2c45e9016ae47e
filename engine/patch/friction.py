"""Friction in a patch: the table `[[friction]]`, and its rules.

The kernels count points of friction with those of contacts (engine.kernel.contact.friction_points), so that this table
answers what assembly asks of a contact.
"""

from collections.abc import Iterator
from typing import Annotated, Any, ClassVar, Literal

from pydantic import Field
from pydantic_core import InitErrorDetails

from engine.bodies.table import KeyPath, Name, Positions, Table, is_given, is_number, make_fault
from engine.patch.positions import check_positions, count_positions
from engine.patch.tables import ANGLE, Angle
from engine.wording import format_names, format_value

Faults = Iterator[InitErrorDetails]

DAMPING_TIME = 2e-5  # s: damping of a bristle over its stiffness, if a patch gives none; it settles within 0.1 ms

Force = Annotated[float, Field(ge=0.0, le=1e6)]
Static = Annotated[float, Field(default=0.8, ge=0.0, le=10.0, description="coefficient of friction at rest")]
Dynamic = Annotated[float, Field(default=0.3, ge=0.0, le=10.0, description="coefficient of friction in fast slip")]
Speed = Annotated[
    float,
    Field(default=0.1, ge=1e-4, le=100.0, description="speed of slip at which the coefficient is half-way, m/s"),
]
Memory = Annotated[
    float,
    Field(default=0.0, ge=0.0, le=0.1, description="time in which the coefficient follows the speed, s; 0: at once"),
]
Curve = Annotated[
    Literal["hyperbolic", "exponential"],
    Field(
        default="hyperbolic",
        description="how the coefficient falls from static to dynamic with the speed v of slip: as 1/(1 + v/speed), or"
        " as e^(-(v/speed)²)",
    ),
]
Viscous = Annotated[
    float,
    Field(default=0.0, ge=0.0, le=1e3, description="rise of the coefficient by the speed of slip, s/m"),
]
Bristle = Annotated[
    float,
    Field(default=1e5, ge=1.0, le=1e12, description="stiffness at which the surfaces stick to each other, N/m"),
]
BristleDamping = Annotated[
    float | None,
    Field(
        default=None,
        ge=0.0,
        le=1e9,
        description="damping of that, kg/s; if absent, bristle times 20 µs. It follows changes of bristle",
    ),
]


class Friction(Table):
    """Friction between a body and a surface that moves by itself, such as a bow, or between two bodies."""

    name: Name | None = Field(default=None, description="name of it, which events and controls use")
    body: Name = Field(description="body that is rubbed")
    at: Positions = Field(
        default=None, description="position on the body, or a list of positions: one point of friction at each"
    )
    angle: Angle = Field(default=0.0, description=f"direction in which it rubs, rad; {ANGLE}")
    on: Name | None = Field(default=None, description="second body, instead of a surface that moves by itself")
    on_at: Positions = Field(default=None, description="position on the second body, or a list as long as `at`")
    velocity: float = Field(
        default=0.0, ge=-100.0, le=100.0, description="velocity of the surface, as of a bow, m/s; not with `on`"
    )
    force: Force | None = Field(
        default=None, description="force that presses the surfaces together, N; or give a contact"
    )
    contact: Name | None = Field(default=None, description="name of the contact whose force presses them together")
    static: Static
    dynamic: Dynamic
    speed: Speed
    memory: Memory
    curve: Curve
    viscous: Viscous
    bristle: Bristle
    bristle_damping: BristleDamping

    # what assembly asks of a contact, too
    side: ClassVar[str] = "above"
    exponent: ClassVar[float] = 1.0
    loss: ClassVar[float] = 0.0
    bridge: ClassVar[None] = None
    frets: ClassVar[None] = None
    gap: ClassVar[None] = None
    barrier: ClassVar[None] = None
    has_power_law: ClassVar[bool] = False

    @property
    def stiffness(self) -> float:
        """Stiffness of the bristle, N/m."""
        return self.bristle


def check_friction(path: KeyPath, table: dict[str, Any], bodies: dict[str, Any], contacts: dict[str, Any]) -> Faults:
    """Friction is pressed by a force or a contact, and its points are on its bodies."""
    body, on = bodies.get(str(table.get("body"))), is_given(table, "on")
    given = [key for key in ("force", "contact") if is_given(table, key)]
    if len(given) != 1:
        message = "force and contact are both given" if given else "neither force nor contact is given"
        yield make_fault(path, table, message, "give the force in N, or the name of the contact that presses")
    if on and is_given(table, "velocity"):
        message = "velocity and on are both given"
        yield make_fault((*path, "velocity"), table["velocity"], message, "a body moves by itself; give one of them")
    yield from check_positions((*path, "at"), table, body, single=False)
    if on:
        yield from check_positions((*path, "on_at"), table, bodies.get(str(table["on"])), single=False)
        if table["on"] == table.get("body") and table.get("at") == table.get("on_at"):
            message = "a body cannot rub itself at one position"
            yield make_fault((*path, "on"), table["on"], message, "name another body")
    elif is_given(table, "on_at"):
        yield make_fault((*path, "on_at"), table["on_at"], "on_at is given without on", "name the other body by on")
    count = count_positions(table, "at", body)
    other_count = count_positions(table, "on_at", bodies.get(str(table.get("on")))) if on else 1
    if count > 1 and other_count > 1 and other_count != count:
        remedy = "give as many positions on both bodies, or one on one of them"
        yield make_fault((*path, "on_at"), table["on_at"], f"{other_count} positions for {count} in at", remedy)
    yield from _check_coefficients(path, table)
    yield from _check_pressing(path, table, contacts, max(count, other_count), bodies)


def _check_coefficients(path: KeyPath, table: dict[str, Any]) -> Faults:
    """Friction is no stronger in slip than at rest."""
    static, dynamic = (table.get(key, Friction.model_fields[key].default) for key in ("static", "dynamic"))
    if is_number(static) and is_number(dynamic) and dynamic > static:
        key = "dynamic" if is_given(table, "dynamic") else "static"
        message = f"dynamic = {dynamic:g} is above static = {static:g}: it would stick harder when sliding"
        yield make_fault((*path, key), table[key], message, "give a dynamic that is at most static")


def _check_pressing(
    path: KeyPath, table: dict[str, Any], contacts: dict[str, Any], count: int, bodies: dict[str, Any]
) -> Faults:
    """The contact that presses is there, and has one point, or as many as the friction."""
    name = table.get("contact")
    if not isinstance(name, str):
        return
    contact = contacts.get(name)
    if contact is None:
        message = f"no contact is named {format_value(name)}"
        yield make_fault((*path, "contact"), name, message, f"the named contacts are {format_names(contacts)}")
        return
    if is_given(contact, "bridge") or is_given(contact, "frets"):
        points = 0
    else:
        of_body = count_positions(contact, "at", bodies.get(str(contact.get("body"))))
        points = max(of_body, count_positions(contact, "on_at", bodies.get(str(contact.get("on")))))
    if points not in (1, count):
        message = f"{format_value(name)} has {points or 'many'} points, and the friction {count}"
        yield make_fault((*path, "contact"), name, message, "give a contact with one point, or as many")


def absent_in_friction(friction: dict[str, Any]) -> dict[str, str]:
    """Return the keys that a friction lacks, and what it has instead."""
    pairs = ("force", "contact", "contact"), ("velocity", "on", "second body")
    return {key: f"has a {what}" for key, given, what in pairs if is_given(friction, given)}
