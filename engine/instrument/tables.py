"""The tables of an instrument: the keyboard, what each key has, and the score of notes and pedals."""

from typing import Annotated, Any

from pydantic import AfterValidator, BaseModel, ConfigDict, Field
from pydantic_core import PydanticCustomError

from engine.bodies.table import Table
from engine.instrument.key_names import parse_key, parse_keys
from engine.wording import format_value

MAX_SCORE_SECONDS = 3_600.0  # as a rendering
DEFAULT_VELOCITY = 80


def _check_key(value: str) -> str:
    """A key by name. Raises PydanticCustomError."""
    try:
        parse_key(value)
    except ValueError as error:
        raise PydanticCustomError("scene", "{reason}", {"reason": str(error)}) from None
    return value


def _check_keys(value: Any) -> Any:
    """A range of keys, or a list of keys and ranges. Raises PydanticCustomError."""
    items = value if isinstance(value, list) else [value]
    if not items:
        raise PydanticCustomError("scene", 'no key; text such as "A0..C8", or a list of keys')
    for item in items:
        if not isinstance(item, str):
            message = '{value} is not a range of keys; text such as "A0..C8", or a list of keys'
            raise PydanticCustomError("scene", message, {"value": format_value(item)})
        try:
            parse_keys(item)
        except ValueError as error:
            raise PydanticCustomError("scene", "{reason}", {"reason": str(error)}) from None
    return value


KeyName = Annotated[str, AfterValidator(_check_key)]
KeyRange = Annotated[str | list[str], AfterValidator(_check_keys)]
Time = Annotated[float, Field(ge=0.0, le=MAX_SCORE_SECONDS)]
Pressed = Annotated[float, Field(ge=0.0, le=1.0)]


class Keyboard(Table):
    """The keys of an instrument."""

    keys: KeyRange = Field(description='its keys: "A0..C8", or a list of keys')
    a4: float = Field(default=440.0, ge=100.0, le=1000.0, description="frequency of A4, Hz, from which f is reckoned")
    sympathetic: bool = Field(
        default=False,
        description="while the sustain pedal is used, the bodies of all keys are there; else of those played",
    )
    mono: str | None = Field(
        default=None, description="the name of a value: of keys with the same value, one sounds at a time"
    )
    polyphony: int | None = Field(
        default=None, ge=1, le=128, description="how many keys sound at a time; more take the place of others"
    )
    values: dict[str, Any] = Field(
        default={}, description="numbers of each key by name, for formulas: formulas, tables by key, or numbers"
    )


class KeyTables(Table):
    """What each key has. Values may be formulas, "= 0.01*n", or tables by key, {A0 = 2.0, C8 = 0.1}."""

    body: list[dict[str, Any]] = Field(default=[], description="its bodies, as [[body]]; `copies` of each may be given")
    contact: list[dict[str, Any]] = Field(default=[], description="its contacts, as [[contact]]")
    connection: list[dict[str, Any]] = Field(default=[], description="its connections, as [[connection]]")
    pickup: list[dict[str, Any]] = Field(default=[], description="its pickups, as [[pickup]]")
    on: list[dict[str, Any]] = Field(
        default=[], description="what happens when it is pressed, as [[event]]; `time` after that, s"
    )
    off: list[dict[str, Any]] = Field(default=[], description="what happens when it is let go, likewise")
    damper: list[dict[str, Any]] = Field(
        default=[], description="what is damped while neither key nor sustain pedal is down: `body`, `sigma` 1/s"
    )


class Note(Table):
    """A key is pressed, and let go."""

    time: Time = Field(description="when it is pressed, s")
    key: KeyName = Field(description='which key: "C4", "F#3"')
    velocity: int = Field(default=DEFAULT_VELOCITY, ge=1, le=127, description="how fast, as in MIDI")
    duration: float = Field(default=1.0, gt=0.0, le=MAX_SCORE_SECONDS, description="how long it is held, s")
    release: int = Field(default=64, ge=0, le=127, description="how fast it is let go, as in MIDI")


class Pedal(Table):
    """A pedal is moved."""

    time: Time = Field(description="when, s")
    sustain: Pressed | None = Field(default=None, description="how far the dampers are lifted; half pedal is 0.5")
    soft: Pressed | None = Field(default=None, description="una corda: what formulas call soft")
    sostenuto: Pressed | None = Field(
        default=None, description="from 0.5 on, it keeps the dampers of those keys that are down then"
    )


class InstrumentDocument(BaseModel):
    """The structure of a document that can be written out; what is in its plain sections is checked later."""

    model_config = ConfigDict(extra="ignore", strict=True, allow_inf_nan=False)

    seconds: float | None = None
    keyboard: Keyboard
    key: KeyTables | None = None
    note: list[Note] | None = None
    pedal: list[Pedal] | None = None
    body: list[dict[str, Any]] | None = None
    contact: list[dict[str, Any]] | None = None
    connection: list[dict[str, Any]] | None = None
    pickup: list[dict[str, Any]] | None = None
    event: list[dict[str, Any]] | None = None
    force: list[dict[str, Any]] | None = None
