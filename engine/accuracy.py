"""How exactly a scene is computed: the dial between error and time (DESIGN sec. 2)."""

from typing import Any, Literal

from pydantic import Field, ValidationError

from engine.parts import Part

SUBSTEPS = 64
OVERSAMPLE = 32


class Accuracy(Part):
    """What a patch says under [accuracy]; the energy balance is exact at every setting."""

    scheme: Literal["exact", "fdh"] = Field(
        default="exact", description="exact: free vibration at its own frequency and decay; fdh: the paper's scheme"
    )
    order: Literal[2, 4, 6] = Field(default=2, description="order of a step; 4 and 6 refuse contact loss")
    substeps: int = Field(default=1, ge=1, le=SUBSTEPS, description="steps per sample where contact is possible")
    tolerance: float = Field(
        default=1e-15, ge=1e-15, le=1e-2, description="relative error left in a compression by the contact solve"
    )
    oversample: int = Field(
        default=1, ge=1, le=OVERSAMPLE, description="compute all at a multiple of the sample rate, and filter down"
    )
    precision: Literal["float64", "float32"] = Field(
        default="float64", description="of the modes; float32 drifts in energy"
    )
    iterations: int = Field(
        default=6, ge=2, le=10_000, description="rounds of a coupled solve at most; then it makes do"
    )
    silence: float = Field(
        default=-120.0,
        le=0.0,
        allow_inf_nan=True,
        description="level against its peak below which an island sleeps, dB; -inf: never",
    )

    def but(self, **changes: Any) -> "Accuracy":
        """The same with some values changed, where they are not None. Raises ValueError."""
        given = {name: value for name, value in changes.items() if value is not None}
        try:
            return Accuracy.model_validate(self.model_dump() | given)
        except ValidationError as error:
            first = error.errors()[0]
            raise ValueError(f"{first['loc'][0]} = {first['input']} is out of range; {first['msg']}") from None

    def coarser(self) -> list["Accuracy"]:
        """This setting, and coarser ones down to one plain step."""
        found = [self]
        while found[-1].refined:
            last = found[-1]
            found.append(last.but(order=2) if last.order > 2 else last.but(substeps=last.substeps // 2))
        return found

    @property
    def refined(self) -> bool:
        """Whether a sample is more than one step."""
        return self.order > 2 or self.substeps > 1


# Lengths of the stages of one step of length 1; each a step of the core, which is symmetric, so that these
# products are of the order given and conserve energy like it.
FOURTH = 1 / (4 - 4 ** (1 / 3))
_STAGES: dict[int, list[float]] = {
    2: [1.0],
    4: [FOURTH, FOURTH, 1 - 4 * FOURTH, FOURTH, FOURTH],  # Suzuki 1990
    6: [0.39216144400731413928, 0.33259913678935943860, -0.70624617255763935981, 0.082213596293550800230],
}
_STAGES[6] = [*_STAGES[6], 1 - 2 * sum(_STAGES[6]), *_STAGES[6][::-1]]  # Kahan & Li 1997, nine stages


def stages(accuracy: Accuracy) -> list[float]:
    """Lengths of the stages that a sample is computed in, as shares of it."""
    return [length / accuracy.substeps for length in _STAGES[accuracy.order]] * accuracy.substeps
