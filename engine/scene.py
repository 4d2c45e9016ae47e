"""What a patch says: bodies, contacts, forces and pickups, validated.

`Scene.model_validate({...})` reports every fault at once, structure and references
together. Field descriptions carry unit and meaning; ranges are part of the fields.
"""

from collections.abc import Iterator
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import (
    BaseModel,
    ConfigDict,
    Field,
    ModelWrapValidatorHandler,
    ValidationError,
    ValidationInfo,
    model_validator,
)
from pydantic_core import InitErrorDetails, PydanticCustomError

Name = Annotated[str, Field(pattern=r"^[A-Za-z][A-Za-z0-9_-]*$", max_length=64)]
Metres = Annotated[float, Field(ge=-1e6, le=1e6)]

SAMPLERATES = (4_000, 768_000)  # Hz
SECONDS = 3_600.0  # longest render
CHANNELS = 16


class Part(BaseModel):
    """Common to all parts: unknown keys, NaN and infinity are refused; nothing changes later."""

    model_config = ConfigDict(extra="forbid", strict=True, allow_inf_nan=False, frozen=True)


class _Body(Part):
    name: Name = Field(description="name, by which contacts, forces and pickups refer to the body")
    mass: float = Field(ge=1e-15, le=1e15, description="mass, kg")
    damping: float = Field(default=0.0, ge=0.0, le=1e6, description="viscous damping γ, 1/s: force -mass·γ·velocity")
    displacement: Metres = Field(default=0.0, description="displacement at time 0, m")
    velocity: Metres = Field(default=0.0, description="velocity at time 0, m/s")


class Mass(_Body):
    """A free point mass."""

    kind: Literal["mass"]


class Oscillator(_Body):
    """A point mass on a spring."""

    kind: Literal["oscillator"]
    stiffness: float | None = Field(default=None, ge=0.0, le=1e25, description="spring stiffness, N/m")
    frequency: float | None = Field(
        default=None, ge=0.0, le=1e6, description="frequency without damping, Hz; instead of the stiffness"
    )


Body = Annotated[Mass | Oscillator, Field(discriminator="kind")]


class Contact(Part):
    """A one-sided power law between a body and a barrier, or between two bodies."""

    name: Name | None = Field(default=None, description="name, optional")
    body: Name = Field(description="the body that touches")
    on: Name | None = Field(default=None, description="the body it touches; without it, a fixed barrier")
    barrier: Metres | None = Field(default=None, description="position of the fixed barrier, m")
    gap: Metres | None = Field(
        default=None, description="distance between two bodies when both are at 0, m; 0 if absent"
    )
    side: Literal["above", "below"] = Field(
        default="above", description="where the barrier, or the other body, lies seen from the body"
    )
    stiffness: float = Field(ge=0.0, le=1e60, description="stiffness kc, N/m^exponent")
    exponent: float = Field(ge=1.0, le=30.0, description="exponent α of the power law, at least 1")
    loss: float = Field(default=0.0, ge=0.0, le=1e12, description="Hunt-Crossley loss μ, s/m")


class _Force(Part):
    body: Name = Field(description="the body it acts on")
    start: float = Field(default=0.0, ge=0.0, le=SECONDS, description="when it begins, s")
    amplitude: float = Field(ge=-1e12, le=1e12, description="force at its largest, N; positive pushes upwards")


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


class Samples(_Force):
    """Force from an audio file; full scale is the amplitude."""

    kind: Literal["file"]
    file: str = Field(min_length=1, description="WAV or other audio file, relative to the patch")
    channel: int = Field(default=1, ge=1, description="channel of the file")


Force = Annotated[Constant | Pulse | HalfSine | Samples, Field(discriminator="kind")]


class Pickup(Part):
    """What is heard."""

    body: Name = Field(description="the body that is heard")
    quantity: Literal["displacement", "velocity", "acceleration", "force"] = Field(
        default="velocity", description="what of it is heard, in SI units; force: all contact forces on the body"
    )
    channel: int = Field(default=1, ge=1, le=CHANNELS, description="channel of the output, 1 is left")
    gain: float = Field(default=1.0, ge=-1e12, le=1e12, description="factor")


class Scene(Part):
    """A patch, validated. Everything in SI units; at rest at 0 unless said otherwise."""

    title: str = Field(default="", description="what it is")
    seconds: float = Field(default=2.0, gt=0.0, le=SECONDS, description="how long it sounds, s")
    gravity: float = Field(default=0.0, ge=-1e6, le=1e6, description="gravity, m/s², downwards")
    body: list[Body] = Field(min_length=1, description="the bodies")
    contact: list[Contact] = Field(default=[], description="where bodies collide")
    force: list[Force] = Field(default=[], description="external forces")
    pickup: list[Pickup] = Field(min_length=1, description="what is heard")

    @model_validator(mode="wrap")
    @classmethod
    def _all_faults(cls, data: Any, handler: ModelWrapValidatorHandler["Scene"], info: ValidationInfo) -> "Scene":
        """Report faults of reference together with those of structure."""
        faults: list[InitErrorDetails] = []
        scene = None
        try:
            scene = handler(data)
        except ValidationError as error:
            faults = [_again(e) for e in error.errors(include_url=False)]
        folder = Path((info.context or {}).get("folder", "."))
        if isinstance(data, dict):
            faults += list(_references(data)) + list(_files(data, folder))
        if faults or scene is None:
            raise ValidationError.from_exception_data(cls.__name__, faults)
        if not folder.samefile(".") and any(isinstance(f, Samples) for f in scene.force):
            force = [
                f.model_copy(update={"file": str(folder / f.file)}) if isinstance(f, Samples) else f
                for f in scene.force
            ]
            scene = scene.model_copy(update={"force": force})
        return scene


Where = tuple[str | int, ...]


def _again(error: Any) -> InitErrorDetails:
    """A fault found by pydantic, to be raised once more beside ours."""
    again = InitErrorDetails(type=error["type"], loc=error["loc"], input=error["input"])
    if "ctx" in error:
        again["ctx"] = error["ctx"]
    return again


def _fault(where: Where, value: Any, what: str, right: str) -> InitErrorDetails:
    return InitErrorDetails(
        type=PydanticCustomError("scene", "{what}; {right}", {"what": what, "right": right}), loc=where, input=value
    )


def _tables(data: dict[str, Any], key: str) -> Iterator[tuple[int, dict[str, Any]]]:
    """The tables under `key` that are tables; what is not is reported as a fault of structure."""
    tables = data.get(key)
    if isinstance(tables, list):
        yield from ((i, t) for i, t in enumerate(tables) if isinstance(t, dict))


def _references(data: dict[str, Any]) -> Iterator[InitErrorDetails]:
    """Faults that only the whole patch shows: names, and keys that exclude or need each other."""
    names = [b["name"] for _, b in _tables(data, "body") if isinstance(b.get("name"), str)]
    listed = ", ".join(f'"{n}"' for n in dict.fromkeys(names)) or "none"
    for key in ("body", "contact"):
        seen: set[str] = set()
        for i, table in _tables(data, key):
            name = table.get("name")
            if isinstance(name, str) and name in seen:
                yield _fault((key, i, "name"), name, f'the name "{name}" is taken', f"give each {key} its own name")
            elif isinstance(name, str):
                seen.add(name)
    for key, field in (("contact", "body"), ("contact", "on"), ("force", "body"), ("pickup", "body")):
        for i, table in _tables(data, key):
            name = table.get(field)
            if isinstance(name, str) and name not in names:
                yield _fault((key, i, field), name, f'no body is named "{name}"', f"the bodies are {listed}")
    for i, body in _tables(data, "body"):
        stiffness, frequency = _given(body, "stiffness"), _given(body, "frequency")
        if body.get("kind") == "oscillator" and stiffness == frequency:
            what = "both stiffness and frequency" if stiffness else "neither stiffness nor frequency"
            yield _fault(("body", i), body, f"{what} given", "give one of them: stiffness in N/m or frequency in Hz")
    for i, contact in _tables(data, "contact"):
        here = ("contact", i)
        on, barrier, gap = _given(contact, "on"), _given(contact, "barrier"), _given(contact, "gap")
        if on and contact["on"] == contact.get("body"):
            yield _fault((*here, "on"), contact["on"], "a body cannot touch itself", "name another body")
        if on and barrier:
            right = "a contact between two bodies has a gap, not a barrier"
            yield _fault((*here, "barrier"), contact["barrier"], "on and barrier given", right)
        if gap and not on:
            yield _fault((*here, "gap"), contact["gap"], "gap without on", "a fixed barrier is placed by barrier, in m")
        if not on and not barrier:
            right = "give the barrier's position in m, or the other body's name"
            yield _fault(here, contact, "neither barrier nor on given", right)


def _given(table: dict[str, Any], key: str) -> bool:
    return table.get(key) is not None


def _files(data: dict[str, Any], folder: Path) -> Iterator[InitErrorDetails]:
    """Force files that cannot be read."""
    for i, force in _tables(data, "force"):
        file, channel = force.get("file"), force.get("channel", 1)
        if force.get("kind") != "file" or not isinstance(file, str) or not file:
            continue
        path = folder / file
        if not path.is_file():
            yield _fault(("force", i, "file"), file, f"no such file: {path}", "a path relative to the patch")
            continue
        import soundfile

        try:
            channels = soundfile.info(str(path)).channels
        except (OSError, RuntimeError) as error:  # soundfile's own error is a RuntimeError
            yield _fault(("force", i, "file"), file, f"cannot be read as audio ({error})", "a WAV, FLAC or OGG file")
            continue
        if isinstance(channel, int) and channel > channels:
            yield _fault(("force", i, "channel"), channel, f"the file has {channels} channel(s)", f"1 to {channels}")
