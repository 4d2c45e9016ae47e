"""Bodies, a file each: their keys in a patch, modes, positions and tuning. A new one is a file and a line here."""

from typing import Annotated, get_args

from pydantic import Field

from engine.bodies.air import AirBox, Tube
from engine.bodies.bar import Bar
from engine.bodies.body import BodyTable
from engine.bodies.lumped import Mass, Oscillator
from engine.bodies.measured import MeasuredBody
from engine.bodies.membrane import Membrane
from engine.bodies.plate import Plate
from engine.bodies.shell import CylindricalShell
from engine.bodies.soundboard import Soundboard
from engine.bodies.string import String

Body = Annotated[
    Mass | Oscillator | String | Bar | Membrane | Plate | Soundboard | CylindricalShell | AirBox | Tube | MeasuredBody,
    Field(discriminator="kind"),
]
__all__ = [
    "BODIES",
    "AirBox",
    "Bar",
    "Body",
    "CylindricalShell",
    "Mass",
    "MeasuredBody",
    "Membrane",
    "Oscillator",
    "Plate",
    "Soundboard",
    "String",
    "Tube",
]


# the same by kind
BODIES: dict[str, type[BodyTable]] = {
    get_args(body.model_fields["kind"].annotation)[0]: body for body in get_args(get_args(Body)[0])
}
