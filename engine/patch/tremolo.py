"""Tremolo in a patch."""

from pydantic import Field

from engine.bodies.table import Table


class Tremolo(Table):
    """The output becomes softer and louder in turn, as with the motor of a vibraphone."""

    rate: float = Field(gt=0.0, le=1000.0, description="how often it is softest in a second, Hz")
    depth: float = Field(
        default=0.5, ge=0.0, le=1.0, description="share of the amplitude that is missing where it is softest"
    )
    spread: float = Field(
        default=0.0,
        ge=-1.0,
        le=1.0,
        description="turns by which a channel is ahead of the one before: at 0.5, left is loud where right is soft",
    )
