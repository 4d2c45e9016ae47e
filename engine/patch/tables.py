"""The tables of a patch beside its bodies: contacts, connections, forces, events, pickups, each validated on its own.

Field descriptions carry unit and meaning; ranges are part of the fields.
"""

from typing import Annotated, Any, Literal

from pydantic import AfterValidator, Discriminator, Field, Tag, WithJsonSchema, model_validator
from pydantic_core import PydanticCustomError

from engine.bodies.table import (
    Displacement,
    Fraction,
    Metres,
    Name,
    Offsets,
    Positions,
    Positive,
    Table,
    Velocity,
    is_given,
)
from engine.patch.relaxation import Relaxation
from engine.patch.restitution import Restitution, loss_of_restitution
from engine.wording import format_value

MAX_SECONDS = 3_600.0  # of a rendering
MAX_CHANNELS = 16
MAX_GRAVITY = 1e4  # m/s²
MAX_CONTACT_POINTS = 256  # of a bridge, or of frets
MAX_EXPONENT = 12.0
MAX_CONNECTION_STIFFNESS = 1e15  # N/m
MAX_CONNECTION_DAMPING = 1e9  # kg/s
MAX_FORCE_AT_1_MM = 1e15  # N, of a contact: far beyond any material

MAX_ENVELOPE_POINTS = 1_000  # of a force
MAX_SEED = (1 << 32) - 1
ANGLE = "of a string with two polarisations: 0 is the first, π/2 the second"

Newtons = Annotated[float, Field(ge=-1e6, le=1e6)]
Angle = Annotated[float, Field(ge=-100.0, le=100.0)]
Stiffness = Annotated[float, Field(ge=0.0, le=MAX_FORCE_AT_1_MM * 1e3**MAX_EXPONENT)]  # see also max_stiffness
Exponent = Annotated[float, Field(ge=1.0, le=MAX_EXPONENT)]
Seconds = Annotated[float, Field(ge=0.0, le=MAX_SECONDS)]
EnvelopePoint = Annotated[list[Annotated[float, Field(ge=-1e6, le=1e6)]], Field(min_length=2, max_length=2)]


def validate_channels(value: Any) -> Any:
    """A channel, or a list of different channels. Raises PydanticCustomError."""
    items = value if isinstance(value, list) else [value]
    good = all(isinstance(n, int) and not isinstance(n, bool) and 1 <= n <= MAX_CHANNELS for n in items)
    if not items or not good or len(set(items)) < len(items):
        message = "{value} is no channel; give a whole number from 1 to {most}, or a list of different ones"
        raise PydanticCustomError("scene", message, {"value": format_value(value), "most": MAX_CHANNELS})
    return value


_CHANNEL = {"type": "integer", "minimum": 1, "maximum": MAX_CHANNELS}
_CHANNEL_LIST = {"type": "array", "items": _CHANNEL, "minItems": 1, "maxItems": MAX_CHANNELS, "uniqueItems": True}
Channels = Annotated[Any, AfterValidator(validate_channels), WithJsonSchema({"anyOf": [_CHANNEL, _CHANNEL_LIST]})]


def max_stiffness(exponent: float) -> float:
    """The largest stiffness of a contact with an exponent α, N/m^α. Beyond it, rounding a compression changes the force
    by more than any sound has, and energy cannot be accounted for."""
    return float(MAX_FORCE_AT_1_MM * 1e3**exponent)


# --- contacts


class Bridge(Table):
    """A parabolic bridge under a string or bar: contact points are evenly spaced over its width."""

    at: float = Field(ge=0.0, le=1.0, description="position of its top, fraction of the length")
    width: float = Field(gt=0.0, le=1e3, description="width, m")
    points: int = Field(
        default=30, ge=2, le=MAX_CONTACT_POINTS, description="number of contact points, which share the stiffness"
    )
    height: Metres = Field(default=0.0, description="height of its top, m")
    depth: float = Field(default=0.0, ge=0.0, le=1e3, description="height of its top above its edges, m")


class Frets(Table):
    """Frets under a string, in equal temperament or at given positions."""

    count: int | None = Field(
        default=None,
        ge=1,
        le=MAX_CONTACT_POINTS,
        description="number of frets, at 1 - 2^(-n/12) of the length from the far end",
    )
    at: list[Fraction] | None = Field(
        default=None,
        min_length=1,
        max_length=MAX_CONTACT_POINTS,
        description="positions of the frets, fractions of the length; instead of the count",
    )
    height: Offsets = Field(
        description="height of each fret, m; or of all; or of the first and last fret of a straight row"
    )


class Contact(Table):
    """A one-sided power law between a body and a barrier, or between two bodies."""

    name: Name | None = Field(default=None, description="name of it, which events use")
    body: Name = Field(description="first body of the contact")
    at: Positions = Field(
        default=None, description="position on the body, or a list of positions: one contact point at each"
    )
    on: Name | None = Field(
        default=None, description="second body of the contact; if absent, the contact is with a fixed barrier"
    )
    on_at: Positions = Field(default=None, description="position on the second body, or a list as long as `at`")
    barrier: Offsets | None = Field(
        default=None, description="position of the fixed barrier, m; or a list as long as `at`"
    )
    gap: Offsets | None = Field(
        default=None, description="distance between the two bodies when both are at 0, m; 0 if absent; or a list"
    )
    bridge: Bridge | None = Field(default=None, description="a bridge under the body, instead of at and barrier")
    frets: Frets | None = Field(default=None, description="frets under the body, instead of at and barrier")
    side: Literal["above", "below"] = Field(
        default="above",
        description="side of the body on which the barrier, or the second body, lies; below for a bridge and frets, if"
        " absent",
    )
    stiffness: Stiffness = Field(description="stiffness kc, N/m^exponent; at 1 mm of compression at most 1e15 N")
    exponent: Exponent = Field(description="exponent α of the power law, at least 1")
    loss: float = Field(default=0.0, ge=0.0, le=1e9, description="Hunt-Crossley damping μ, s/m")
    restitution: Restitution | None = Field(
        default=None, description="the share of its speed that a mass keeps at a fixed barrier: instead of a loss"
    )
    relaxation: Relaxation | None = Field(
        default=None, description="felt with memory: a share of the stiffness relaxes while it is pressed; without loss"
    )
    radius: float | None = Field(
        default=None,
        ge=0.0,
        le=10.0,
        description="radius of what touches, m: of a sheet it feels the mean motion of the disc that it covers, of a"
        " string or bar that of a piece of twice this length, of either up to the rim; 0.005 on membranes if absent,"
        " and a point elsewhere",
    )

    @property
    def has_power_law(self) -> bool:
        """True if its force follows from the compression alone: then steps back in time keep its energy, too."""
        return self.relaxation is None

    @model_validator(mode="before")
    @classmethod
    def _put_bridge_and_frets_below(cls, table: Any) -> Any:
        """They lie under the body, if nothing else is said."""
        is_below = (
            isinstance(table, dict) and "side" not in table and (is_given(table, "bridge") or is_given(table, "frets"))
        )
        return table | {"side": "below"} if is_below else table

    @model_validator(mode="after")
    def _take_loss_of_restitution(self) -> "Contact":
        if self.restitution is not None and "loss" not in self.model_fields_set:
            self.__dict__["loss"] = loss_of_restitution(self.restitution.e, self.restitution.speed)  # and is not given
        return self


# --- connections


class _ConnectionTable(Table):
    name: Name | None = Field(default=None, description="name of it, which events use")


class SpringConnection(_ConnectionTable):
    """A spring and a damper between two positions, which pull and push, or a rigid joint."""

    kind: Literal["spring"] = "spring"
    body: Name = Field(description="first body of the connection")
    at: Positions = Field(default=None, description="position on the body")
    on: Name | None = Field(default=None, description="second body of the connection; if absent, the ground")
    on_at: Positions = Field(default=None, description="position on the second body")
    stiffness: float = Field(default=0.0, ge=0.0, le=MAX_CONNECTION_STIFFNESS, description="stiffness, N/m")
    damping_coefficient: float = Field(
        default=0.0, ge=0.0, le=MAX_CONNECTION_DAMPING, description="damping coefficient, kg/s"
    )
    rigid: bool = Field(default=False, description="whether the two positions move as one; instead of a stiffness")
    rest: Metres = Field(
        default=0.0, description="displacement of the first body relative to the second at which the force is zero, m"
    )


class EndConnection(_ConnectionTable):
    """The end of a string is attached to another body, instead of being fixed."""

    kind: Literal["end"]
    body: Name = Field(description="the string")
    at: float = Field(ge=0.0, le=1.0, description="which end: 0 or 1")
    on: Name = Field(description="body to which the end is attached, such as a soundboard")
    on_at: Positions = Field(default=None, description="position on the second body")
    share: float = Field(
        default=1.0,
        ge=-1.0,
        le=1.0,
        description="share of the displacement of the second body that the end follows; the body gets that share of the"
        " string's force",
    )
    one_way: bool = Field(
        default=False, description="whether the string drives the body without reaction: cheaper, for many strings"
    )


class AirConnection(_ConnectionTable):
    """Air next to a membrane or plate: in a box, between two membranes or plates, or in a closed volume."""

    kind: Literal["air"]
    body: Name = Field(
        description="membrane, plate or soundboard; it lies above the air, unless it is the bottom of a box"
    )
    on: Name | None = Field(
        default=None, description="air of a box, or the membrane or plate below; if absent, rigid walls enclose the air"
    )
    wall: Literal["top", "bottom"] | None = Field(
        default=None,
        description="wall of the box that the membrane or plate forms, with its sides along x and y; top if absent",
    )
    volume: float | None = Field(
        default=None, gt=0.0, le=1e6, description="volume of the air, m³; not with a box, which has its own"
    )


def _connection_kind(value: object) -> str | None:
    """The kind of a connection: a spring, unless it says otherwise."""
    kind = value.get("kind", "spring") if isinstance(value, dict) else getattr(value, "kind", "spring")
    return kind if isinstance(kind, str) else None


Connection = Annotated[
    Annotated[SpringConnection, Tag("spring")]
    | Annotated[EndConnection, Tag("end")]
    | Annotated[AirConnection, Tag("air")],
    Discriminator(_connection_kind),
]


# --- forces and events


class _ForceTable(Table):
    body: Name = Field(description="body that it acts on")
    at: Positions = Field(default=None, description="position on the body")
    start: Seconds = Field(default=0.0, description="start time, s")
    angle: Angle = Field(default=0.0, description=f"direction of the force, rad; {ANGLE}")
    amplitude: Newtons = Field(description="maximum force, N; a positive force pushes upwards")


class _ShapedForce(_ForceTable):
    envelope: list[EnvelopePoint] | None = Field(
        default=None,
        min_length=1,
        max_length=MAX_ENVELOPE_POINTS,
        description="[[seconds after its start, factor of the amplitude], …]: linear between them, and constant"
        " after the last; 1 if absent",
    )


class ConstantForce(_ShapedForce):
    """A force that is constant after its start; with an envelope, it is piecewise linear."""

    kind: Literal["constant"]


class PulseForce(_ForceTable):
    """A rectangular pulse."""

    kind: Literal["pulse"]
    duration: float = Field(gt=0.0, le=MAX_SECONDS, description="duration, s")


class HalfSineForce(_ForceTable):
    """Half a period of a sine."""

    kind: Literal["half_sine"]
    duration: float = Field(gt=0.0, le=MAX_SECONDS, description="duration, s")


class PluckForce(_ForceTable):
    """A finger or plectrum: the force rises as ½(1 - cos), and is then released."""

    kind: Literal["pluck"]
    duration: float = Field(gt=0.0, le=MAX_SECONDS, description="rise time, s")
    release: float = Field(default=0.0, ge=0.0, le=MAX_SECONDS, description="release time, s")


class SineForce(_ShapedForce):
    """A sine, such as that of a shaker or an electromagnet."""

    kind: Literal["sine"]
    frequency: float = Field(gt=0.0, le=1e6, description="frequency, Hz")
    phase: float = Field(default=0.0, ge=-100.0, le=100.0, description="phase at its start, rad")
    duration: float = Field(gt=0.0, le=MAX_SECONDS, description="duration, s")
    fade: Seconds = Field(default=0.0, description="time of its rise as ½(1 - cos) and of its fall at the end, s")


class NoiseForce(_ShapedForce):
    """Gaussian noise, such as that of breath. The same seed gives the same noise at any sample rate."""

    kind: Literal["noise"]
    amplitude: Newtons = Field(description="root mean square of the force, N")
    band: list[Positive] | None = Field(
        default=None,
        min_length=2,
        max_length=2,
        description="lowest and highest frequency, Hz: 24 dB per octave outside them; white up to 24 kHz if absent",
    )
    seed: int = Field(default=0, ge=0, le=MAX_SEED, description="random seed")
    duration: float = Field(gt=0.0, le=MAX_SECONDS, description="duration, s")
    fade: Seconds = Field(default=0.0, description="time of its rise as ½(1 - cos) and of its fall at the end, s")


class SampledForce(_ShapedForce):
    """Force from an audio file; full scale is the amplitude."""

    kind: Literal["file"]
    file: str = Field(min_length=1, description="WAV or other audio file, relative to the patch")
    channel: int = Field(default=1, ge=1, description="channel of the file")


LastingForce = ConstantForce | SineForce | NoiseForce | SampledForce  # those that no key plucks again
Force = Annotated[
    ConstantForce | PulseForce | HalfSineForce | PluckForce | SineForce | NoiseForce | SampledForce,
    Field(discriminator="kind"),
]


class _EventTable(Table):
    time: Seconds = Field(description="time of the event, s")


class StrikeEvent(_EventTable):
    """A mass or oscillator is launched from a displacement with a velocity, as a hammer is."""

    kind: Literal["strike"]
    body: Name = Field(description="mass or oscillator, such as a hammer")
    velocity: Velocity = Field(description="velocity, m/s")
    displacement: Displacement | None = Field(default=None, description="displacement, m; that at time 0 if absent")


class PluckEvent(_EventTable):
    """A pluck as in [[force]], at a time of the score."""

    kind: Literal["pluck"]
    body: Name = Field(description="body that it acts on")
    at: Positions = Field(default=None, description="position on the body")
    angle: Angle = Field(default=0.0, description=f"direction of the force, rad; {ANGLE}")
    amplitude: Newtons = Field(description="maximum force, N")
    duration: float = Field(gt=0.0, le=MAX_SECONDS, description="rise time, s")
    release: float = Field(default=0.0, ge=0.0, le=MAX_SECONDS, description="release time, s")


class DampEvent(_EventTable):
    """Additional damping of all modes of a body, for a duration or permanently."""

    kind: Literal["damp"]
    body: Name = Field(description="body that is damped")
    sigma: float = Field(gt=0.0, le=1e6, description="additional decay rate, 1/s")
    duration: float | None = Field(default=None, gt=0.0, le=MAX_SECONDS, description="duration, s; permanent if absent")


class LiftEvent(_EventTable):
    """The dampers of a body are lifted: `damp` events that have begun end."""

    kind: Literal["lift"]
    body: Name = Field(description="body whose dampers are lifted")


class ChangeEvent(_EventTable):
    """A live parameter glides to a new value: a number of a contact or a connection, such as a stiffness, or any other
    live parameter, by its path."""

    kind: Literal["change"]
    contact: Name | None = Field(
        default=None, description="name of the contact; or give a connection, a friction, or a parameter"
    )
    friction: Name | None = Field(default=None, description="name of the friction")
    connection: Name | None = Field(default=None, description="name of the connection, a spring")
    parameter: str | None = Field(
        default=None,
        min_length=1,
        description="path of a live parameter (see `fdh params`), such as `body.string.tension`; give its value too",
    )
    value: float | None = Field(default=None, description="new value of the parameter")
    stiffness: Stiffness | None = Field(default=None, description="new stiffness, N/m^exponent; of a connection N/m")
    exponent: Exponent | None = Field(default=None, description="new exponent")
    barrier: Metres | None = Field(
        default=None, description="new position of its barrier, m; a list moves by as much as its first item"
    )
    gap: Metres | None = Field(default=None, description="new gap, m")
    damping_coefficient: float | None = Field(
        default=None, ge=0.0, le=MAX_CONNECTION_DAMPING, description="new damping coefficient of a connection, kg/s"
    )
    rest: Metres | None = Field(default=None, description="new rest of a connection, m")
    velocity: float | None = Field(
        default=None, ge=-100.0, le=100.0, description="new velocity of a surface that rubs, m/s"
    )
    force: float | None = Field(default=None, ge=0.0, le=1e6, description="new force that presses surfaces, N")
    static: float | None = Field(default=None, ge=0.0, le=10.0, description="new coefficient of friction at rest")
    dynamic: float | None = Field(default=None, ge=0.0, le=10.0, description="new coefficient of friction in fast slip")
    speed: float | None = Field(
        default=None, ge=1e-4, le=100.0, description="new speed of slip at which the coefficient is half-way, m/s"
    )
    memory: float | None = Field(default=None, ge=0.0, le=0.1, description="new memory of friction, s")
    bristle: float | None = Field(default=None, ge=1.0, le=1e12, description="new stiffness of the bristle, N/m")
    duration: float = Field(default=0.005, ge=0.0, le=MAX_SECONDS, description="duration of the glide, s")


Event = Annotated[StrikeEvent | PluckEvent | DampEvent | LiftEvent | ChangeEvent, Field(discriminator="kind")]


class Pickup(Table):
    """An output of the scene: the motion, pressure or force at a position of a body."""

    name: Name | None = Field(default=None, description="name of it, which controls and events use")
    body: Name = Field(description="body that it measures")
    at: Positions = Field(
        default=None,
        description="position on the body, or a list of positions, whose mean it gives; not needed for the force",
    )
    quantity: (
        Literal["displacement", "velocity", "acceleration", "pressure", "force", "end_force", "tension"] | None
    ) = Field(
        default=None,
        description="quantity, in SI units; if absent, the velocity, or the acceleration of a membrane or plate;"
        " pressure: far field in air, of a baffled membrane or plate, a hole or a tube; force: sum of the forces"
        " on the body by its contacts and its friction; end_force: force of a string on its end, at 0 or 1; tension:"
        " rise of that of a body that stretches (N, or N/m of a membrane or plate)",
    )
    angle: Angle = Field(default=0.0, description=f"direction in which it measures the motion, rad; {ANGLE}")
    distance: float | None = Field(
        default=None, ge=1e-3, le=1e6, description="distance of a pressure from the body, m; 1 if absent"
    )
    channel: Channels = Field(
        default=1, description="output channel, or a list of channels with the same signal; 1 is left"
    )
    pan: float | None = Field(
        default=None,
        ge=-1.0,
        le=1.0,
        description="position between channels 1 and 2: -1 is left, 1 is right; constant power; instead of a channel",
    )
    gain: float = Field(default=1.0, ge=-1e12, le=1e12, description="gain, a factor")

    @property
    def channels(self) -> list[int]:
        """Its output channels, from 1."""
        if self.pan is not None:
            return [1, 2]
        return self.channel if isinstance(self.channel, list) else [self.channel]
