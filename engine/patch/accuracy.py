"""Accuracy settings of a scene: smaller errors for more time (docs/design.md, sec. 2)."""

from typing import Any, Literal

from pydantic import Field, ValidationError

from engine.bodies.table import Table
from engine.wording import describe_violation

MAX_SUBSTEPS = 64
MAX_OVERSAMPLE = 32


class Accuracy(Table):
    """The table [accuracy] of a patch; the energy balance is exact at every setting."""

    scheme: Literal["exact", "fdh"] = Field(
        default="exact",
        description="exact: exact-modal, linear motion is exact at any sample rate; fdh: the scheme of the paper",
    )
    order: Literal[2, 4, 6] = Field(
        default=2, description="order of accuracy; with 4 and 6, contact damping remains of second order"
    )
    substeps: int = Field(default=1, ge=1, le=MAX_SUBSTEPS, description="steps per sample where contact is possible")
    tolerance: float = Field(
        default=1e-15, ge=1e-15, le=1e-2, description="relative tolerance of the compression in the contact solve"
    )
    oversample: int = Field(
        default=1,
        ge=1,
        le=MAX_OVERSAMPLE,
        description="oversampling factor: everything is computed at this multiple of the sample rate",
    )
    precision: Literal["float64", "float32"] = Field(
        default="float64", description="precision of the modes; with float32, the energy drifts"
    )
    iterations: int = Field(
        default=6,
        ge=2,
        le=10_000,
        description="maximum number of iterations of a coupled contact solve; an approximate solution is then accepted",
    )
    silence: float = Field(
        default=-120.0,
        le=0.0,
        allow_inf_nan=True,
        description="level relative to its peak below which a coupled subsystem becomes inactive, dB; -inf: never",
    )

    def replace(self, **changes: Any) -> "Accuracy":
        """A copy with the values that are not None in place of its own. Raises ValueError if one is out of range."""
        values = {name: value for name, value in changes.items() if value is not None}
        try:
            return Accuracy.model_validate(self.model_dump() | values)
        except ValidationError as error:
            first = error.errors()[0]
            raise ValueError(
                f"{first['loc'][0]} = {first['input']} is out of range; {describe_violation(first)}"
            ) from None

    def coarser(self) -> list["Accuracy"]:
        """This setting, and coarser ones down to one step of order 2 per sample."""
        values = [self]
        while values[-1].is_refined:
            last = values[-1]
            values.append(last.replace(order=2) if last.order > 2 else last.replace(substeps=last.substeps // 2))
        return values

    @property
    def is_refined(self) -> bool:
        """True if a sample is more than one step."""
        return self.order > 2 or self.substeps > 1


# Lengths of the stages of a step of length 1. Each stage is a step of order 2 that is symmetric and conserves energy,
# and so these products are of the order given, and conserve energy too.
SUZUKI_LENGTH = 1 / (4 - 4 ** (1 / 3))
_STAGE_LENGTHS: dict[int, list[float]] = {
    2: [1.0],
    4: [SUZUKI_LENGTH, SUZUKI_LENGTH, 1 - 4 * SUZUKI_LENGTH, SUZUKI_LENGTH, SUZUKI_LENGTH],  # Suzuki 1990
    6: [0.39216144400731413928, 0.33259913678935943860, -0.70624617255763935981, 0.082213596293550800230],
}
_STAGE_LENGTHS[6] = [*_STAGE_LENGTHS[6], 1 - 2 * sum(_STAGE_LENGTHS[6]), *_STAGE_LENGTHS[6][::-1]]  # Kahan & Li 1997


def stage_lengths(accuracy: Accuracy) -> list[float]:
    """Lengths of the stages that a sample is computed in, as fractions of the sample's duration; their sum is 1."""
    return [length / accuracy.substeps for length in _STAGE_LENGTHS[accuracy.order]] * accuracy.substeps
