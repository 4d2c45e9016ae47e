"""The tables `[[control]]` and `[midi]` of a patch: which moves of a controller change which numbers of it."""

from typing import Annotated, Literal

from pydantic import Field

from engine.bodies.table import Table

MAX_CHANNEL = 16  # of MIDI
MAX_SMOOTHING = 60.0  # s
MAX_LIFT = 1.0  # s
MAX_BEND_RANGE = 96.0  # semitones

Value = Annotated[float, Field(ge=-1e60, le=1e60)]


class _ControlTable(Table):
    parameter: str = Field(
        min_length=1,
        description="path of a number that `fdh params` marks as live, such as"
        " `contact.felt.stiffness`, `body.string.tension` or `pickup.0.gain`",
    )
    range: list[Value] = Field(
        min_length=2, max_length=2, description="values of the parameter at the low and the high end of the control"
    )
    curve: Literal["linear", "exponential"] = Field(
        default="linear", description="interpolation between the two values; exponential: in equal ratios"
    )
    smoothing: float = Field(default=0.02, ge=0.0, le=MAX_SMOOTHING, description="time constant of smoothing, s")


class _MidiTable(_ControlTable):
    channel: int | None = Field(default=None, ge=1, le=MAX_CHANNEL, description="channel; any if absent")


class CcControl(_MidiTable):
    """A MIDI controller: a knob, a fader, the modulation wheel."""

    kind: Literal["cc"]
    number: int = Field(ge=0, le=119, description="number of the controller; 1 is the modulation wheel")


class BendControl(_MidiTable):
    """The pitch wheel. As a control, it does not bend notes."""

    kind: Literal["bend"]


class PressureControl(_MidiTable):
    """Channel pressure (aftertouch). In an MPE zone, the pressure of each note acts on that note alone."""

    kind: Literal["pressure"]


class PolyPressureControl(_MidiTable):
    """Pressure of each key (polyphonic aftertouch), which acts on the note of that key."""

    kind: Literal["poly_pressure"]


class OscControl(_ControlTable):
    """A message of Open Sound Control with one number."""

    kind: Literal["osc"]
    address: str = Field(pattern=r"^/[!-~]*$", max_length=200, description="OSC address, such as `/felt`")
    input: list[Value] = Field(
        default=[0.0, 1.0], min_length=2, max_length=2, description="received numbers at the low and the high end"
    )


Control = Annotated[
    CcControl | BendControl | PressureControl | PolyPressureControl | OscControl, Field(discriminator="kind")
]


class Midi(Table):
    """MIDI settings. A controller can also set MPE zones itself (MPE Configuration Message)."""

    channels: Literal["auto", "apart", "together"] = Field(
        default="auto",
        description="at a port, whether wheel, pedals and controllers act on the notes of their own channel (apart) or"
        " on all (together); auto: apart as soon as notes come on a second channel. In a file, they are always apart",
    )
    shortest_lift: float = Field(
        default=0.1,
        ge=0.0,
        le=MAX_LIFT,
        description="in a file, the shortest time for which a sustain pedal that was down is up, s: one that goes down"
        " again sooner does so later. 0: as the file has it",
    )

    bend_range: float = Field(
        default=2.0, ge=0.0, le=MAX_BEND_RANGE, description="range of the pitch wheel, in semitones up and down"
    )
    mpe_lower: int = Field(default=0, ge=0, le=15, description="member channels of the lower MPE zone, from 2 on")
    mpe_upper: int = Field(default=0, ge=0, le=15, description="member channels of the upper MPE zone, from 15 down")
    mpe_bend_range: float = Field(
        default=48.0, ge=0.0, le=MAX_BEND_RANGE, description="bend range of member channels, in semitones up and down"
    )
