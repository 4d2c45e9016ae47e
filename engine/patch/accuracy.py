"""Accuracy settings of a scene: smaller errors for more time (docs/design.md, sec. 2)."""

from enum import Enum, auto
from typing import Any, Literal, NamedTuple

from pydantic import Field, ValidationError, model_validator

from engine.argument_checks import plain_value
from engine.bodies.table import Table
from engine.faults import BuildError, Fault
from engine.patch.precision_key import drop_precision
from engine.wording import describe_violation

MAX_SUBSTEPS = 8192
MAX_OVERSAMPLE = 32
ORDER_4_ERROR = 1e-3  # as small an error needs less time at order 4 than at order 2 (docs/accuracy.md)
STEPS_WITH_FRICTION = 2  # per sample, if a patch gives none: the pitch of a bowed string is right (docs/accuracy.md)
SMALLEST_ERROR, LARGEST_ERROR = 1e-12, 0.1  # that can be asked for


class Accuracy(Table):
    """The table [accuracy] of a patch; the energy balance is exact at every setting."""

    scheme: Literal["exact", "fdh"] = Field(
        default="exact",
        description="exact: exact-modal, linear motion is exact at any sample rate; fdh: the scheme of the paper",
    )
    order: Literal[2, 4, 6] = Field(
        default=2, description="order of accuracy; with 6, what loss adds to the error is of order 4"
    )
    substeps: int = Field(
        default=1,
        ge=1,
        le=MAX_SUBSTEPS,
        description=f"steps per sample where contact is possible; if absent, 1, or {STEPS_WITH_FRICTION} with friction",
    )
    max_error: float | None = Field(
        default=None,
        ge=SMALLEST_ERROR,
        le=LARGEST_ERROR,
        description="relative error of the motion to aim at: steps per sample are chosen by it, substeps at least",
    )
    max_substeps: int = Field(
        default=1024, ge=1, le=MAX_SUBSTEPS, description="steps per sample at most, where they are chosen by max_error"
    )
    least_detuning: float = Field(
        default=0.1,
        ge=0.0,
        le=1200.0,
        description="a body that stretches is computed as linear while this raises its partials by less, cents",
    )
    tolerance: float = Field(
        default=1e-15, ge=1e-15, le=1e-2, description="relative tolerance of the compression in the contact solve"
    )
    oversample: int = Field(
        default=1,
        ge=1,
        le=MAX_OVERSAMPLE,
        description="oversampling factor: everything is computed at this multiple of the sample rate",
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

    @model_validator(mode="before")
    @classmethod
    def _drop_precision(cls, settings: Any) -> Any:
        """The settings without one that has no effect any more, of which a warning says so."""
        return drop_precision(settings)

    def replace(self, **changes: Any) -> "Accuracy":
        """A copy with the values that are not None in place of its own. Raises ValueError if one is out of range, or
        BuildError, which is one, if max_substeps is without max_error."""
        values = {name: plain_value(value) for name, value in changes.items() if value is not None}
        try:
            changed = Accuracy.model_validate(self.model_dump() | values)
        except ValidationError as error:
            first = error.errors()[0]
            raise ValueError(
                f"{first['loc'][0]} = {first['input']} is out of range; {describe_violation(first)}"
            ) from None
        if changed.max_substeps != self.max_substeps and changed.max_error is None:
            raise BuildError(Fault("accuracy.max_substeps", "has no effect without max_error; give that too"))
        return changed

    def beside_friction(self) -> "Accuracy":
        """This setting in a scene with friction: if it says nothing of steps, they are those that friction needs."""
        if "substeps" in self.model_fields_set or self.max_error is not None:
            return self
        changed = self.model_copy(update={"substeps": STEPS_WITH_FRICTION})
        changed.model_fields_set.discard("substeps")  # a patch that is written from this one does not give it
        return changed

    def coarser(self) -> list["Accuracy"]:
        """This setting, and coarser ones down to one step of order 2 per sample."""
        values = [self]
        while values[-1].is_refined:
            last = values[-1]
            if last.max_error is not None:
                coarse = 10 * last.max_error
                values.append(last.model_copy(update={"max_error": coarse if coarse <= LARGEST_ERROR else None}))
            else:
                values.append(last.replace(order=2) if last.order > 2 else last.replace(substeps=last.substeps // 2))
        return values

    @property
    def is_refined(self) -> bool:
        """True if a sample may be more than one step."""
        return self.order > 2 or self.substeps > 1 or self.max_error is not None

    @property
    def levels(self) -> int:
        """The number of times that the steps of a sample may be doubled."""
        return 0 if self.max_error is None else max(1, self.max_substeps // self.substeps).bit_length() - 1


class StageLoss(Enum):
    """The loss of modes in a stage."""

    NONE = auto()
    FIRST = auto()  # at both ends, a share that stages of this kind have in common
    SECOND = auto()  # what is left of the loss of the step
    ALL = auto()  # what they lose in its time


class Stage(NamedTuple):
    """A stage of a step: a step of order 2 that is symmetric and conserves energy. So their product is of the order of
    its lengths, and conserves energy too."""

    length: float  # as a share of the step; negative back in time
    loss: StageLoss


def _stages(lengths: list[float]) -> list[Stage]:
    """The stages of a symmetric step whose lengths before the middle are these. Modes lose at the first two and at the
    last two: there is an odd number of stages between two losses, as each turns the velocity of a rigid joint."""
    losses = [StageLoss.FIRST, StageLoss.SECOND, *[StageLoss.NONE] * (len(lengths) - 2)]
    half = [Stage(*stage) for stage in zip(lengths, losses, strict=True)]
    return [*half, Stage(1 - 2 * sum(lengths), StageLoss.NONE), *half[::-1]]


SUZUKI_LENGTH = 1 / (4 - 1.5874010519681994)  # the third root of 4
KAHAN_LENGTHS = [0.39216144400731413928, 0.33259913678935943860, -0.70624617255763935981, 0.082213596293550800230]
STAGES: dict[int, list[Stage]] = {
    2: [Stage(1.0, StageLoss.ALL)],
    4: _stages([SUZUKI_LENGTH, SUZUKI_LENGTH]),  # Suzuki 1990
    6: _stages(KAHAN_LENGTHS),  # Kahan & Li 1997
}


def step_stages(accuracy: Accuracy, level: int = 0) -> list[Stage]:
    """The stages of a step, with lengths as shares of a sample. level: how often the steps of a sample are doubled"""
    steps = accuracy.substeps << level
    return [stage._replace(length=stage.length / steps) for stage in STAGES[accuracy.order]]
