"""The parts of a patch: bodies, contacts, forces, events, pickups, each validated on its own.

Field descriptions carry unit and meaning; ranges are part of the fields.
"""

from typing import Annotated, Any, Literal

from pydantic import AfterValidator, BaseModel, ConfigDict, Field, WithJsonSchema
from pydantic_core import PydanticCustomError

from engine.wording import shown

SECONDS = 3_600.0  # longest render
CHANNELS = 16
POINTS = 256  # of a bridge, or of frets
PLACES = 512  # in a list
SUPPORTS = 256  # of a body
MEASURED = 10_000  # points of a body whose modes are measured
SHEET = 1_000  # modes of a membrane or a plate that does not say how many
STEEPEST = 12.0  # exponent
HARDEST = 1e15  # N, at 1 mm of compression: far beyond any material

Name = Annotated[str, Field(pattern=r"^[A-Za-z][A-Za-z0-9_-]*$", max_length=64)]
Metres = Annotated[float, Field(ge=-1e6, le=1e6)]
Displacement = Annotated[float, Field(ge=-1e3, le=1e3)]
Speed = Annotated[float, Field(ge=-1e4, le=1e4)]
Newtons = Annotated[float, Field(ge=-1e6, le=1e6)]
Stiffness = Annotated[float, Field(ge=0.0, le=HARDEST * 1e3**STEEPEST)]  # and at most what `hardest` says
Exponent = Annotated[float, Field(ge=1.0, le=STEEPEST)]
Seconds = Annotated[float, Field(ge=0.0, le=SECONDS)]
Positive = Annotated[float, Field(gt=0.0, le=1e6)]
NotNegative = Annotated[float, Field(ge=0.0, le=1e6)]
Fraction = Annotated[float, Field(ge=0.0, le=1.0)]


def hardest(exponent: float) -> float:
    """The largest stiffness of a contact of that exponent, N/m^α. Beyond, one step of rounding of a compression is
    more force than any sound has, and no energy can be kept account of."""
    return float(HARDEST * 1e3**exponent)


def number(value: Any) -> bool:
    """Whether a value is a number."""
    return isinstance(value, int | float) and not isinstance(value, bool)


def _places(value: Any) -> Any:
    """A place, or a list of places; or none."""
    if value is None:
        return None
    items = value if isinstance(value, list) else [value]
    if len(items) > PLACES:
        raise PydanticCustomError("scene", "{count} places; at most {most}", {"count": len(items), "most": PLACES})
    items = [x for item in items for x in (item if isinstance(item, list) else [item])]
    if not items or not all(isinstance(x, str) or (number(x) and 0.0 <= x <= 1.0) for x in items):
        what = "{value} is no place on a body; a fraction of its length from 0 to 1, [x, y] fractions, a point's name, "
        raise PydanticCustomError("scene", what + "or a list of these", {"value": shown(value)})
    return value


def _floats(value: Any) -> Any:
    """A number, or a list of numbers; or none."""
    if value is None:
        return None
    items = value if isinstance(value, list) else [value]
    if len(items) > PLACES:
        raise PydanticCustomError("scene", "{count} positions; at most {most}", {"count": len(items), "most": PLACES})
    if not items or not all(number(x) and abs(x) <= 1e6 for x in items):
        what = "{value} is no position; a number in m, or a list of them"
        raise PydanticCustomError("scene", what, {"value": shown(value)})
    return value


# the same for editors (engine.describe)
_FRACTION = {"type": "number", "minimum": 0.0, "maximum": 1.0}
_PAIR = {"type": "array", "items": _FRACTION, "minItems": 2, "maxItems": 2}
_PLACE: list[dict[str, Any]] = [_FRACTION, {"type": "string"}, _PAIR]
_METRES = {"type": "number", "minimum": -1e6, "maximum": 1e6}
_SOME = {"type": "array", "minItems": 1, "maxItems": PLACES}
Places = Annotated[
    Any, AfterValidator(_places), WithJsonSchema({"anyOf": [*_PLACE, _SOME | {"items": {"anyOf": _PLACE}}]})
]
Positions = Annotated[Any, AfterValidator(_floats), WithJsonSchema({"anyOf": [_METRES, _SOME | {"items": _METRES}]})]


class Part(BaseModel):
    """Common to all parts: unknown keys, NaN and infinity are refused; nothing changes later."""

    model_config = ConfigDict(extra="forbid", strict=True, allow_inf_nan=False, frozen=True)


# --- bodies


class _Body(Part):
    name: Name = Field(description="name, by which contacts, forces and pickups refer to the body")


class _Lumped(_Body):
    mass: float = Field(ge=1e-12, le=1e9, description="mass, kg")
    damping: float = Field(default=0.0, ge=0.0, le=1e6, description="viscous damping γ, 1/s: force -mass·γ·velocity")
    displacement: Displacement = Field(default=0.0, description="displacement at time 0, m")
    velocity: Speed = Field(default=0.0, description="velocity at time 0, m/s")


class Mass(_Lumped):
    """A free point mass."""

    kind: Literal["mass"]


class Oscillator(_Lumped):
    """A point mass on a spring."""

    kind: Literal["oscillator"]
    stiffness: float | None = Field(default=None, ge=0.0, le=1e25, description="spring stiffness, N/m")
    frequency: float | None = Field(
        default=None, ge=0.0, le=1e6, description="frequency without damping, Hz; instead of the stiffness"
    )


class Support(Part):
    """A spring and damper that hold a body to the ground, such as a thread, a felt or a soft rest."""

    at: Places = Field(description="where: a place, or a list of places that share it")
    stiffness: float = Field(default=0.0, ge=0.0, le=1e15, description="stiffness, N/m")
    damping: float = Field(default=0.0, ge=0.0, le=1e9, description="damping, kg/s")


class _Spread(_Body):
    """A body with many modes. At time 0 it is at rest; gravity does not move it from there.

    Its decay rate is σ = sigma0 + sigma1·β + sigma3·β³ + b3·ω² for a mode of wave number β and angular
    frequency ω; or `t60` gives it.
    """

    modes: int | None = Field(
        default=None,
        ge=1,
        le=20_000,
        description="how many to build, the lowest; if absent, all below 0.49 of the sample rate",
    )
    support: list[Support] = Field(
        default=[], max_length=SUPPORTS, description="springs and dampers that hold it to the ground"
    )
    sigma0: float = Field(default=0.0, ge=0.0, le=1e6, description="decay rate of all modes, 1/s")
    sigma1: float = Field(default=0.0, ge=0.0, le=1e6, description="decay rate per wave number, m/s")
    sigma3: float = Field(default=0.0, ge=0.0, le=1e6, description="decay rate per wave number³, m³/s")
    b3: float = Field(default=0.0, ge=0.0, le=1.0, description="decay rate per angular frequency², s")
    t60: list[Positive] | None = Field(
        default=None,
        min_length=1,
        max_length=2,
        description="time to fall by 60 dB at the frequencies of t60_at, s; instead of decay rates",
    )
    t60_at: list[Positive] | None = Field(
        default=None, min_length=2, max_length=2, description="two frequencies, Hz; between them σ goes as frequency²"
    )


class _Line(_Spread):
    length: float = Field(gt=0.0, le=1e4, description="length, m")
    density: float | None = Field(default=None, gt=0.0, le=1e9, description="mass per length, kg/m")
    mass: float | None = Field(default=None, gt=0.0, le=1e9, description="mass, kg; instead of the density")
    frequency: float | None = Field(default=None, gt=0.0, le=1e6, description="frequency of the first partial, Hz")


class String(_Line):
    """A stiff string, simply supported at both ends."""

    kind: Literal["string"]
    tension: float | None = Field(default=None, gt=0.0, le=1e9, description="tension, N")
    bending: float | None = Field(default=None, ge=0.0, le=1e9, description="bending stiffness EI, N·m²")
    inharmonicity: float | None = Field(
        default=None, ge=0.0, le=10.0, description="B of f_n = n·f0·√(1 + B·n²); instead of the bending stiffness"
    )


class Bar(_Line):
    """A thin bar (Euler-Bernoulli)."""

    kind: Literal["bar"]
    ends: Literal["free", "clamped", "cantilever"] = Field(
        default="free", description="both ends free (held at its nodes), both clamped, or the first clamped"
    )
    bending: float | None = Field(default=None, gt=0.0, le=1e12, description="bending stiffness EI, N·m²")
    ratios: list[Positive] | None = Field(
        default=None,
        min_length=1,
        max_length=50,
        description="partials over the first, as makers tune them; only these are built",
    )


class _Sheet(_Spread):
    modes: int | None = Field(
        default=None,
        ge=1,
        le=20_000,
        description=f"how many to build, the lowest; if absent, those below 0.49 of the sample rate, {SHEET} at most",
    )
    density: float = Field(gt=0.0, le=1e9, description="mass per area, kg/m²")
    frequency: float | None = Field(default=None, gt=0.0, le=1e6, description="frequency of the first partial, Hz")


class Membrane(_Sheet):
    """A membrane fixed at its rim: a circle of `radius`, or a rectangle of `size`."""

    kind: Literal["membrane"]
    radius: float | None = Field(
        default=None, gt=0.0, le=1e3, description="radius of a circle, m; [x, y] are fractions of the square around it"
    )
    size: list[Positive] | None = Field(default=None, min_length=2, max_length=2, description="sides of a rectangle, m")
    tension: float | None = Field(default=None, gt=0.0, le=1e9, description="tension, N/m")


class Plate(_Sheet):
    """A thin rectangular plate, simply supported at its edges."""

    kind: Literal["plate"]
    size: list[Positive] = Field(min_length=2, max_length=2, description="sides, m")
    rigidity: float | None = Field(default=None, gt=0.0, le=1e15, description="flexural rigidity D, N·m")


class Modes(_Body):
    """Measured modes: lists here, or a CSV file with columns frequency, sigma or t60, and one per point."""

    kind: Literal["modes"]
    file: str | None = Field(
        default=None, min_length=1, description="CSV file, relative to the patch; instead of the lists"
    )
    frequency: list[NotNegative] | None = Field(default=None, min_length=1, description="frequencies, Hz")
    sigma: list[NotNegative] | None = Field(default=None, description="decay rates, 1/s")
    t60: list[Positive] | None = Field(default=None, description="times to fall by 60 dB, s; instead of sigma")
    points: dict[Name, list[Annotated[float, Field(ge=-1e9, le=1e9)]]] | None = Field(
        default=None,
        max_length=MEASURED,
        description="mass-normalised mode shapes by point, 1/√kg: a list of one number per mode",
    )


Body = Annotated[Mass | Oscillator | String | Bar | Membrane | Plate | Modes, Field(discriminator="kind")]


# --- contacts


class Bridge(Part):
    """A parabolic bridge under a string or bar: points evenly spread over its width."""

    at: float = Field(ge=0.0, le=1.0, description="where its top is, fraction of the length")
    width: float = Field(gt=0.0, le=1e3, description="width, m")
    points: int = Field(default=30, ge=2, le=POINTS, description="points of contact, which share the stiffness")
    height: Metres = Field(default=0.0, description="of its top, m")
    depth: float = Field(default=0.0, ge=0.0, le=1e3, description="how much lower its edges are than its top, m")


class Frets(Part):
    """Frets under a string in equal temperament, or at given places."""

    count: int | None = Field(
        default=None, ge=1, le=POINTS, description="frets at 1 - 2^(-n/12) of the length from the far end"
    )
    at: list[Fraction] | None = Field(
        default=None,
        min_length=1,
        max_length=POINTS,
        description="places, fractions of the length; instead of the count",
    )
    height: Positions = Field(description="of each, m; or of all; or of the first and last of a straight row")


class Contact(Part):
    """A one-sided power law between a body and a barrier, or between two bodies."""

    name: Name | None = Field(default=None, description="name, by which events refer to it")
    body: Name = Field(description="the body that touches")
    at: Places = Field(default=None, description="where on it: a place, or a list of places that each touch")
    on: Name | None = Field(default=None, description="the body it touches; without it, a fixed barrier")
    on_at: Places = Field(default=None, description="where on that body: a place, or a list as long as `at`")
    barrier: Positions | None = Field(
        default=None, description="position of the fixed barrier, m; or a list as long as `at`"
    )
    gap: Positions | None = Field(
        default=None, description="distance between two bodies when both are at 0, m; 0 if absent; or a list"
    )
    bridge: Bridge | None = Field(default=None, description="a bridge under the body, instead of at and barrier")
    frets: Frets | None = Field(default=None, description="frets under the body, instead of at and barrier")
    side: Literal["above", "below"] = Field(
        default="above", description="where the barrier, or the other body, lies seen from the body"
    )
    stiffness: Stiffness = Field(description="stiffness kc, N/m^exponent; at 1 mm of compression at most 1e15 N")
    exponent: Exponent = Field(description="exponent α of the power law, at least 1")
    loss: float = Field(default=0.0, ge=0.0, le=1e9, description="Hunt-Crossley loss μ, s/m")


# --- forces and events


class _Force(Part):
    body: Name = Field(description="the body it acts on")
    at: Places = Field(default=None, description="where on it")
    start: Seconds = Field(default=0.0, description="when it begins, s")
    amplitude: Newtons = Field(description="force at its largest, N; positive pushes upwards")


class Constant(_Force):
    """A force that stays from its start on."""

    kind: Literal["constant"]


class Pulse(_Force):
    """A rectangular pulse."""

    kind: Literal["pulse"]
    duration: float = Field(gt=0.0, le=SECONDS, description="how long it lasts, s")


class HalfSine(_Force):
    """Half a period of a sine."""

    kind: Literal["half_sine"]
    duration: float = Field(gt=0.0, le=SECONDS, description="how long it lasts, s")


class Pluck(_Force):
    """A finger or plectrum: the force rises as ½(1 - cos), and lets go."""

    kind: Literal["pluck"]
    duration: float = Field(gt=0.0, le=SECONDS, description="how long it rises, s")
    release: float = Field(default=0.0, ge=0.0, le=SECONDS, description="how long it takes to let go, s")


class Samples(_Force):
    """Force from an audio file; full scale is the amplitude."""

    kind: Literal["file"]
    file: str = Field(min_length=1, description="WAV or other audio file, relative to the patch")
    channel: int = Field(default=1, ge=1, description="channel of the file")


Force = Annotated[Constant | Pulse | HalfSine | Pluck | Samples, Field(discriminator="kind")]


class _Event(Part):
    time: Seconds = Field(description="when it happens, s")


class Strike(_Event):
    """A mass or oscillator is put at a displacement, with a velocity: a hammer thrown (again)."""

    kind: Literal["strike"]
    body: Name = Field(description="the hammer")
    velocity: Speed = Field(description="velocity, m/s")
    displacement: Displacement | None = Field(default=None, description="displacement, m; that at time 0 if absent")


class PluckAgain(_Event):
    """A pluck as in [[force]], at a time of the score."""

    kind: Literal["pluck"]
    body: Name = Field(description="the body it acts on")
    at: Places = Field(default=None, description="where on it")
    amplitude: Newtons = Field(description="force at its largest, N")
    duration: float = Field(gt=0.0, le=SECONDS, description="how long it rises, s")
    release: float = Field(default=0.0, ge=0.0, le=SECONDS, description="how long it takes to let go, s")


class Damp(_Event):
    """Extra loss on all modes of a body, for a while or for good."""

    kind: Literal["damp"]
    body: Name = Field(description="the body that is damped")
    sigma: float = Field(gt=0.0, le=1e6, description="extra decay rate, 1/s")
    duration: float | None = Field(default=None, gt=0.0, le=SECONDS, description="how long, s; for good if absent")


class Change(_Event):
    """A contact's stiffness, exponent, or the place of its barrier, glides to a new value."""

    kind: Literal["change"]
    contact: Name = Field(description="the contact")
    stiffness: Stiffness | None = Field(default=None, description="new stiffness, N/m^exponent")
    exponent: Exponent | None = Field(default=None, description="new exponent")
    barrier: Metres | None = Field(
        default=None, description="new position of its barrier, m; a list moves by as much as its first"
    )
    gap: Metres | None = Field(default=None, description="new gap, m")
    duration: float = Field(default=0.005, ge=0.0, le=SECONDS, description="how long it glides, s")


Event = Annotated[Strike | PluckAgain | Damp | Change, Field(discriminator="kind")]


class Pickup(Part):
    """What is heard."""

    body: Name = Field(description="the body that is heard")
    at: Places = Field(default=None, description="where on it; no matter for its force")
    quantity: Literal["displacement", "velocity", "acceleration", "force"] = Field(
        default="velocity", description="what of it is heard, in SI units; force: all contact forces on the body"
    )
    channel: int = Field(default=1, ge=1, le=CHANNELS, description="channel of the output, 1 is left")
    gain: float = Field(default=1.0, ge=-1e12, le=1e12, description="factor")
