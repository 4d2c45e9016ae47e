"""The tables of an instrument: the keyboard, what each key has, and the score of notes and pedals."""

from typing import Annotated, Any, Self

from pydantic import AfterValidator, BaseModel, ConfigDict, Field, ValidationInfo, model_validator
from pydantic_core import PydanticCustomError

from engine.bodies.table import Table
from engine.instrument.key_names import HIGHEST_KEY, describe_keys, parse_key, parse_keys
from engine.wording import format_value

MAX_SCORE_SECONDS = 3_600.0  # as a rendering
DEFAULT_VELOCITY = 80
MAX_BEND_POINTS, MAX_BEND = 256, 24.0  # of a note, and semitones


def _check_key(value: str) -> str:
    """A key by name. Raises PydanticCustomError."""
    try:
        parse_key(value)
    except ValueError as error:
        raise PydanticCustomError("scene", "{reason}", {"reason": str(error)}) from None
    return value


def _check_key_names(frequencies: dict[str, float]) -> dict[str, float]:
    """Frequencies by the names of keys. Raises PydanticCustomError."""
    for name in frequencies:
        _check_key(name)
    return frequencies


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


def _check_drums(drums: dict[str, str], info: ValidationInfo) -> dict[str, str]:
    """Keys by those of General MIDI's drums. Raises PydanticCustomError."""
    keys = info.data.get("keys", [])
    known = {key for text in ([keys] if isinstance(keys, str) else keys) for key in parse_keys(text)}
    for drum, key in drums.items():
        if not (drum.isdecimal() and int(drum) <= HIGHEST_KEY):
            message = "{value} is not the key of a drum; a whole number, such as 38 for the acoustic snare"
            raise PydanticCustomError("scene", message, {"value": format_value(drum)})
        if known and parse_key(key) not in known:
            names = {"key": key, "known": describe_keys(sorted(known))}
            raise PydanticCustomError("scene", "the instrument has no key {key}; {known}", names)
    return drums


KeyName = Annotated[str, AfterValidator(_check_key)]
KeyRange = Annotated[str | list[str], AfterValidator(_check_keys)]
Time = Annotated[float, Field(ge=0.0, le=MAX_SCORE_SECONDS)]
Frequency = Annotated[float, Field(gt=0.0, le=1e6)]
Pressed = Annotated[float, Field(ge=0.0, le=1.0)]


class Keyboard(Table):
    """The keys of an instrument."""

    keys: KeyRange = Field(description='keys of the instrument: "A0..C8", or a list of keys')
    a4: float = Field(
        default=440.0,
        ge=100.0,
        le=1000.0,
        description="frequency of A4, Hz; the frequencies f of all keys follow from it",
    )
    tuning: str | None = Field(
        default=None,
        min_length=1,
        max_length=4096,
        description="Scala file of a scale (.scl), which gives the frequencies f of all keys",
    )
    keyboard_map: str | None = Field(
        default=None,
        min_length=1,
        max_length=4096,
        description="Scala file of the degree of each key (.kbm); keys that it leaves out are silent; if absent, each"
        " key is a degree, and C4 the first",
    )
    frequencies: Annotated[dict[str, Frequency], AfterValidator(_check_key_names)] | None = Field(
        default=None,
        description="frequencies f of all keys that sound, {C4 = 261.6}, Hz; instead of a tuning and a4",
    )
    sympathetic: bool = Field(
        default=False,
        description="whether the bodies of all keys are included, not only of played keys, if the score uses the pedal",
    )
    mono: str | None = Field(
        default=None, description="name of a value; of keys with the same value, only one is down at a time"
    )
    polyphony: int | None = Field(
        default=None,
        ge=1,
        le=128,
        description="maximum number of keys that sound at a time; a new key replaces an old one",
    )
    drums: Annotated[dict[str, KeyName], AfterValidator(_check_drums)] = Field(
        default={},
        description='keys by the drums of General MIDI that they play, {38 = "D2"}: notes of MIDI channel 10',
    )
    values: dict[str, Any] = Field(
        default={}, description="named numbers of each key, for use in formulas: formulas, tables by key, or numbers"
    )


class KeyTables(Table):
    """Tables of each key. Values may be formulas, "= 0.01*n", or tables by key, {A0 = 2.0, C8 = 0.1}."""

    body: list[dict[str, Any]] = Field(default=[], description="bodies, as [[body]]; each may have `copies`")
    contact: list[dict[str, Any]] = Field(default=[], description="contacts, as [[contact]]")
    connection: list[dict[str, Any]] = Field(default=[], description="connections, as [[connection]]")
    friction: list[dict[str, Any]] = Field(default=[], description="friction, as [[friction]]")
    bow: list[dict[str, Any]] = Field(default=[], description="bows, as [[bow]], without strokes")
    pickup: list[dict[str, Any]] = Field(default=[], description="pickups, as [[pickup]]")
    on: list[dict[str, Any]] = Field(
        default=[], description="events when the key is pressed, as [[event]]; `time` counts from the press"
    )
    off: list[dict[str, Any]] = Field(
        default=[], description="events when the key is released, as [[event]]; `time` counts from the release"
    )
    damper: list[dict[str, Any]] = Field(
        default=[],
        description="bodies that are damped while the key and the sustain pedal are up: `body`, and `sigma` in 1/s",
    )


def _check_bend(bend: list[list[float]]) -> list[list[float]]:
    """Points of a bend, one after another. Raises PydanticCustomError."""
    times = [time for time, _ in bend]
    if not all(0.0 <= time <= MAX_SCORE_SECONDS for time in times) or times != sorted(set(times)):
        raise PydanticCustomError(
            "scene", "the times of the bend do not increase; each is later than the one before, from 0 on"
        )
    if any(not abs(semitones) <= MAX_BEND for _, semitones in bend):
        raise PydanticCustomError(
            "scene", "a bend of more than {most} semitones; {most} at most", {"most": f"{MAX_BEND:g}"}
        )
    return bend


BendPoint = Annotated[list[float], Field(min_length=2, max_length=2)]
Bend = Annotated[list[BendPoint], Field(max_length=MAX_BEND_POINTS), AfterValidator(_check_bend)]


class Note(Table):
    """A note: a key is pressed and released."""

    time: Time = Field(description="time of the press, s")
    key: KeyName = Field(description='key, such as "C4" or "F#3"')
    velocity: int = Field(default=DEFAULT_VELOCITY, ge=1, le=127, description="MIDI velocity")
    duration: float = Field(
        default=1.0, gt=0.0, le=MAX_SCORE_SECONDS, description="duration for which the key is held, s"
    )
    release: int = Field(default=64, ge=0, le=127, description="MIDI release velocity")
    bend: Bend = Field(
        default=[],
        description="bend of its pitch: [[seconds after the press, semitones above the key], …], between which it"
        " glides; the first holds from the press on, the last until the key is pressed again",
    )


class Pedal(Table):
    """A movement of a pedal."""

    time: Time = Field(description="time of the movement, s")
    sustain: Pressed | None = Field(
        default=None, description="sustain pedal: how far it lifts the dampers; half pedal is 0.5"
    )
    soft: Pressed | None = Field(default=None, description="soft pedal (una corda): the value of `soft` in formulas")
    sostenuto: Pressed | None = Field(
        default=None,
        description="sostenuto pedal: from 0.5 on, it keeps the dampers lifted of the keys that are down at that time",
    )

    @model_validator(mode="after")
    def _moves(self) -> Self:
        if self.sustain is None and self.soft is None and self.sostenuto is None:
            raise PydanticCustomError("scene", "no pedal is moved; give sustain, soft or sostenuto, from 0 to 1")
        return self


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
    friction: list[dict[str, Any]] | None = None
    bow: list[dict[str, Any]] | None = None
    pickup: list[dict[str, Any]] | None = None
    event: list[dict[str, Any]] | None = None
    force: list[dict[str, Any]] | None = None


def drum_keys(document: dict[str, Any] | None) -> dict[int, int] | None:
    """The keys of an instrument by the drums of General MIDI that they play; None if it is not one of drums."""
    drums = (document or {}).get("keyboard", {}).get("drums", {})
    return {int(drum): parse_key(key) for drum, key in drums.items()} or None
