"""The tables of a patch beside its bodies: contacts, connections, forces, events, pickups, each validated on its own.

Field descriptions carry unit and meaning; ranges are part of the fields.
"""

from typing import Annotated, Literal

from pydantic import Discriminator, Field, Tag

from engine.bodies.table import Displacement, Fraction, Metres, Name, Offsets, Positions, Positive, Table, Velocity

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

Newtons = Annotated[float, Field(ge=-1e6, le=1e6)]
Stiffness = Annotated[float, Field(ge=0.0, le=MAX_FORCE_AT_1_MM * 1e3**MAX_EXPONENT)]  # see also max_stiffness
Exponent = Annotated[float, Field(ge=1.0, le=MAX_EXPONENT)]
Seconds = Annotated[float, Field(ge=0.0, le=MAX_SECONDS)]
EnvelopePoint = Annotated[list[Annotated[float, Field(ge=-1e6, le=1e6)]], Field(min_length=2, max_length=2)]


def max_stiffness(exponent: float) -> float:
    """The largest stiffness of a contact with an exponent α, N/m^α. Beyond it, rounding a compression changes the force
    by more than any sound has, and energy cannot be accounted for."""
    return float(MAX_FORCE_AT_1_MM * 1e3**exponent)


# --- contacts


class Bridge(Table):
    """A parabolic bridge under a string or bar: points evenly spread over its width."""

    at: float = Field(ge=0.0, le=1.0, description="where its top is, fraction of the length")
    width: float = Field(gt=0.0, le=1e3, description="width, m")
    points: int = Field(
        default=30, ge=2, le=MAX_CONTACT_POINTS, description="points of contact, which share the stiffness"
    )
    height: Metres = Field(default=0.0, description="of its top, m")
    depth: float = Field(default=0.0, ge=0.0, le=1e3, description="how much lower its edges are than its top, m")


class Frets(Table):
    """Frets under a string in equal temperament, or at given places."""

    count: int | None = Field(
        default=None, ge=1, le=MAX_CONTACT_POINTS, description="frets at 1 - 2^(-n/12) of the length from the far end"
    )
    at: list[Fraction] | None = Field(
        default=None,
        min_length=1,
        max_length=MAX_CONTACT_POINTS,
        description="places, fractions of the length; instead of the count",
    )
    height: Offsets = Field(description="of each, m; or of all; or of the first and last of a straight row")


class Contact(Table):
    """A one-sided power law between a body and a barrier, or between two bodies."""

    name: Name | None = Field(default=None, description="name, by which events refer to it")
    body: Name = Field(description="the body that touches")
    at: Positions = Field(default=None, description="where on it: a place, or a list of places that each touch")
    on: Name | None = Field(default=None, description="the body it touches; without it, a fixed barrier")
    on_at: Positions = Field(default=None, description="where on that body: a place, or a list as long as `at`")
    barrier: Offsets | None = Field(
        default=None, description="position of the fixed barrier, m; or a list as long as `at`"
    )
    gap: Offsets | None = Field(
        default=None, description="distance between two bodies when both are at 0, m; 0 if absent; or a list"
    )
    bridge: Bridge | None = Field(default=None, description="a bridge under the body, instead of at and barrier")
    frets: Frets | None = Field(default=None, description="frets under the body, instead of at and barrier")
    side: Literal["above", "below"] = Field(
        default="above", description="where the barrier, or the other body, lies seen from the body"
    )
    stiffness: Stiffness = Field(description="stiffness kc, N/m^exponent; at 1 mm of compression at most 1e15 N")
    exponent: Exponent = Field(description="exponent α of the power law, at least 1")
    loss: float = Field(default=0.0, ge=0.0, le=1e9, description="Hunt-Crossley damping μ, s/m")


# --- connections


class _ConnectionTable(Table):
    name: Name | None = Field(default=None, description="name, by which events refer to it")


class SpringConnection(_ConnectionTable):
    """A spring and a damper that hold two places together both ways, or a rigid joint."""

    kind: Literal["spring"] = "spring"
    body: Name = Field(description="the body it holds")
    at: Positions = Field(default=None, description="where on it: a place")
    on: Name | None = Field(default=None, description="the body that it is held to; without it, the ground")
    on_at: Positions = Field(default=None, description="where on that body: a place")
    stiffness: float = Field(default=0.0, ge=0.0, le=MAX_CONNECTION_STIFFNESS, description="stiffness, N/m")
    damping_coefficient: float = Field(
        default=0.0, ge=0.0, le=MAX_CONNECTION_DAMPING, description="damping coefficient, kg/s"
    )
    rigid: bool = Field(default=False, description="nothing gives: the two move as one; instead of stiffness")
    rest: Metres = Field(
        default=0.0, description="how far the body is above the other where no force acts, m: body minus other"
    )


class EndConnection(_ConnectionTable):
    """The end of a string rides on another body, instead of being fixed."""

    kind: Literal["end"]
    body: Name = Field(description="the string")
    at: float = Field(ge=0.0, le=1.0, description="which end: 0 or 1")
    on: Name = Field(description="the body that carries the end, such as a board")
    on_at: Positions = Field(default=None, description="where on that body: a place")
    one_way: bool = Field(
        default=False, description="the string drives the body, which does not act back: cheaper, for many strings"
    )


class AirConnection(_ConnectionTable):
    """Air that a sheet presses on: of a box, or between it and another sheet, or in a closed space of a volume."""

    kind: Literal["air"]
    body: Name = Field(description="the membrane, plate or soundboard; above the air, unless it is the bottom of a box")
    on: Name | None = Field(
        default=None, description="the air of a box, or the sheet below; without it, the air is closed by rigid walls"
    )
    wall: Literal["top", "bottom"] | None = Field(
        default=None, description="which wall of the box the sheet is, with its sides along x and y; top if absent"
    )
    volume: float | None = Field(
        default=None, gt=0.0, le=1e6, description="volume of the air, m³; that of a box is its own"
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
    body: Name = Field(description="the body it acts on")
    at: Positions = Field(default=None, description="where on it")
    start: Seconds = Field(default=0.0, description="when it begins, s")
    amplitude: Newtons = Field(description="force at its largest, N; positive pushes upwards")


class _ShapedForce(_ForceTable):
    envelope: list[EnvelopePoint] | None = Field(
        default=None,
        min_length=1,
        max_length=MAX_ENVELOPE_POINTS,
        description="[[seconds after its start, factor of the amplitude], …]: straight lines between them, and the last"
        " factor holds; 1 throughout if absent",
    )


class ConstantForce(_ShapedForce):
    """A force that stays from its start on; with an envelope, one that rises and falls in straight lines."""

    kind: Literal["constant"]


class PulseForce(_ForceTable):
    """A rectangular pulse."""

    kind: Literal["pulse"]
    duration: float = Field(gt=0.0, le=MAX_SECONDS, description="how long it lasts, s")


class HalfSineForce(_ForceTable):
    """Half a period of a sine."""

    kind: Literal["half_sine"]
    duration: float = Field(gt=0.0, le=MAX_SECONDS, description="how long it lasts, s")


class PluckForce(_ForceTable):
    """A finger or plectrum: the force rises as ½(1 - cos), and lets go."""

    kind: Literal["pluck"]
    duration: float = Field(gt=0.0, le=MAX_SECONDS, description="how long it rises, s")
    release: float = Field(default=0.0, ge=0.0, le=MAX_SECONDS, description="how long it takes to let go, s")


class SineForce(_ShapedForce):
    """A sine, such as that of a shaker or an electromagnet."""

    kind: Literal["sine"]
    frequency: float = Field(gt=0.0, le=1e6, description="frequency, Hz")
    phase: float = Field(default=0.0, ge=-100.0, le=100.0, description="phase at its start, rad")
    duration: float = Field(gt=0.0, le=MAX_SECONDS, description="how long it lasts, s")
    fade: Seconds = Field(default=0.0, description="how long it rises as ½(1 - cos), and as long falls at its end, s")


class NoiseForce(_ShapedForce):
    """Gaussian noise, such as that of breath or of a rough surface: the same for the same seed, at any sample rate."""

    kind: Literal["noise"]
    amplitude: Newtons = Field(description="root mean square of the force, N")
    band: list[Positive] | None = Field(
        default=None,
        min_length=2,
        max_length=2,
        description="lowest and highest frequency, Hz: 24 dB per octave beyond them; if absent white, up to 24 kHz",
    )
    seed: int = Field(default=0, ge=0, le=MAX_SEED, description="another seed is another noise")
    duration: float = Field(gt=0.0, le=MAX_SECONDS, description="how long it lasts, s")
    fade: Seconds = Field(default=0.0, description="how long it rises as ½(1 - cos), and as long falls at its end, s")


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
    time: Seconds = Field(description="when it happens, s")


class StrikeEvent(_EventTable):
    """A mass or oscillator is put at a displacement, with a velocity: a hammer thrown (again)."""

    kind: Literal["strike"]
    body: Name = Field(description="the hammer")
    velocity: Velocity = Field(description="velocity, m/s")
    displacement: Displacement | None = Field(default=None, description="displacement, m; that at time 0 if absent")


class PluckEvent(_EventTable):
    """A pluck as in [[force]], at a time of the score."""

    kind: Literal["pluck"]
    body: Name = Field(description="the body it acts on")
    at: Positions = Field(default=None, description="where on it")
    amplitude: Newtons = Field(description="force at its largest, N")
    duration: float = Field(gt=0.0, le=MAX_SECONDS, description="how long it rises, s")
    release: float = Field(default=0.0, ge=0.0, le=MAX_SECONDS, description="how long it takes to let go, s")


class DampEvent(_EventTable):
    """Extra loss on all modes of a body, for a while or for good."""

    kind: Literal["damp"]
    body: Name = Field(description="the body that is damped")
    sigma: float = Field(gt=0.0, le=1e6, description="extra decay rate, 1/s")
    duration: float | None = Field(default=None, gt=0.0, le=MAX_SECONDS, description="how long, s; for good if absent")


class ChangeEvent(_EventTable):
    """What a contact or a connection is like glides to a new value: a stiffness, an exponent, the place of a barrier; a
    damping, or a rest. Or any number that can change while it sounds does, by its path."""

    kind: Literal["change"]
    contact: Name | None = Field(default=None, description="the contact; or give a connection, or a parameter")
    connection: Name | None = Field(default=None, description="the connection, a spring")
    parameter: str | None = Field(
        default=None,
        min_length=1,
        description="a number that `fdh params` marks as live, such as `body.string.tension`; it glides to the value",
    )
    value: float | None = Field(default=None, description="new value of the parameter")
    stiffness: Stiffness | None = Field(default=None, description="new stiffness, N/m^exponent; of a connection N/m")
    exponent: Exponent | None = Field(default=None, description="new exponent")
    barrier: Metres | None = Field(
        default=None, description="new position of its barrier, m; a list moves by as much as its first"
    )
    gap: Metres | None = Field(default=None, description="new gap, m")
    damping_coefficient: float | None = Field(
        default=None, ge=0.0, le=MAX_CONNECTION_DAMPING, description="new damping coefficient of a connection, kg/s"
    )
    rest: Metres | None = Field(default=None, description="new rest of a connection, m")
    duration: float = Field(default=0.005, ge=0.0, le=MAX_SECONDS, description="how long it glides, s")


Event = Annotated[StrikeEvent | PluckEvent | DampEvent | ChangeEvent, Field(discriminator="kind")]


class Pickup(Table):
    """What is heard."""

    name: Name | None = Field(default=None, description="name, by which controls and changes refer to it")
    body: Name = Field(description="the body that is heard")
    at: Positions = Field(
        default=None,
        description="where on it: a place, or a list whose mean is heard; no matter for its force",
    )
    quantity: Literal["displacement", "velocity", "acceleration", "pressure", "force", "end_force"] | None = Field(
        default=None,
        description="what of it is heard, in SI units; if absent velocity, of a membrane or plate acceleration;"
        " pressure: that of a baffled sheet in air, far off; force: all contact forces on the body; end_force: that of"
        " a string on its end, at 0 or 1",
    )
    distance: float | None = Field(
        default=None, ge=1e-3, le=1e6, description="of a pressure: how far off it is heard, m; 1 if absent"
    )
    channel: int = Field(default=1, ge=1, le=MAX_CHANNELS, description="channel of the output, 1 is left")
    pan: float | None = Field(
        default=None,
        ge=-1.0,
        le=1.0,
        description="between channels 1 and 2, from -1, left, to 1, right, at constant power; instead of a channel",
    )
    gain: float = Field(default=1.0, ge=-1e12, le=1e12, description="factor")
