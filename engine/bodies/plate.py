"""Thin plates."""

import math
from typing import ClassVar, Literal

from pydantic import Field

from engine.bodies.distributed import ModeSet, SheetBody
from engine.bodies.table import Positive


class Plate(SheetBody):
    """A thin rectangular plate, simply supported at its edges."""

    kind: Literal["plate"]
    size: list[Positive] = Field(min_length=2, max_length=2, description="sides, m")
    rigidity: float | None = Field(default=None, gt=0.0, le=1e15, description="flexural rigidity D, N·m")

    EXACTLY_ONE_OF: ClassVar[list[tuple[str, str, str]]] = [
        ("rigidity", "frequency", "rigidity in N·m or frequency in Hz")
    ]
    PITCH_POWERS: ClassVar[dict[str, int]] = {"frequency": 1, "rigidity": 2}

    def free_modes(self, max_omega: float) -> ModeSet:
        """ω = β²·√(D/ρ), β² = π²(m²/a² + n²/b²) (Fletcher & Rossing, sec. 3.7)."""
        lowest = (math.pi / self.size[0]) ** 2 + (math.pi / self.size[1]) ** 2
        return self.rectangle_modes(self.size, self.dispersion_constant(self.rigidity, lowest), 2, max_omega)

    def total_mass(self) -> float:
        return self.density * self.size[0] * self.size[1]
