"""Bodies whose modes are measured."""

import math
from collections.abc import Iterator
from typing import Annotated, Any, ClassVar, Literal

import numpy as np
from pydantic import Field
from pydantic_core import InitErrorDetails

from engine.bodies.body import TO_60_DB, BodyTable, ModalBody
from engine.bodies.distributed import ModeSet, at_rest
from engine.bodies.table import KeyPath, Name, NotNegative, Positive, make_fault
from engine.wording import format_names

MAX_POINTS = 10_000  # at which a body is measured


class MeasuredBody(BodyTable):
    """Measured modes: lists here, or a CSV file with columns frequency, sigma or t60, and one per point."""

    kind: Literal["modes"]
    file: str | None = Field(
        default=None, min_length=1, description="CSV file, relative to the patch; instead of the lists"
    )
    frequency: list[NotNegative] | None = Field(default=None, min_length=1, description="frequencies, Hz")
    sigma: list[NotNegative] | None = Field(default=None, description="decay rates, 1/s")
    t60: list[Positive] | None = Field(default=None, description="decay times to -60 dB, s; instead of sigma")
    points: dict[Name, list[Annotated[float, Field(ge=-1e9, le=1e9)]]] | None = Field(
        default=None,
        max_length=MAX_POINTS,
        description="mass-normalised mode shapes by point, 1/√kg: a list with one number per mode",
    )

    EXACTLY_ONE_OF: ClassVar[list[tuple[str, ...]]] = [
        ("file", "frequency", "a CSV file or a list of frequencies in Hz")
    ]
    AT_MOST_ONE_OF: ClassVar[list[tuple[str, str]]] = [("sigma", "t60")]
    PITCH_POWERS: ClassVar[dict[str, int]] = {"frequency": 1}

    def modal_body(self, max_frequency: float = math.inf) -> ModalBody:
        """The modes below a frequency, Hz."""
        with np.errstate(all="ignore"):  # what is not finite is refused in the end (engine.assembly.limits)
            omega = 2 * math.pi * np.array(self.frequency or [], dtype=float)
            zeros = np.zeros(omega.size)
            sigma = TO_60_DB / np.array(self.t60) if self.t60 else np.array(self.sigma or zeros, dtype=float)
            chosen = omega < 2 * math.pi * max_frequency
            points = {name: np.array(values, dtype=float)[chosen] for name, values in (self.points or {}).items()}
            return at_rest(ModeSet(omega[chosen], sigma[chosen], lambda name: points[name]))

    def total_mass(self) -> float:
        return math.inf  # only the shapes say something of it

    @classmethod
    def has_position(cls, table: dict[str, Any], item: Any) -> bool:
        points = table.get("points")
        return isinstance(points, dict) and isinstance(item, str) and item in points

    @classmethod
    def position_help(cls, table: dict[str, Any]) -> str:
        points = table.get("points")
        return f"one of its points: {format_names(points if isinstance(points, dict) else {})}"

    @classmethod
    def faults(cls, path: KeyPath, table: dict[str, Any]) -> Iterator[InitErrorDetails]:
        """The lists are equally long, and there is a point to hear it at."""
        frequency, points = table.get("frequency"), table.get("points")
        if not isinstance(frequency, list):
            return
        count = len(frequency)
        lists: list[tuple[KeyPath, Any]] = [((*path, k), table.get(k)) for k in ("sigma", "t60")]
        lists += [((*path, "points", k), v) for k, v in points.items()] if isinstance(points, dict) else []
        for where, values in lists:
            if isinstance(values, list) and len(values) != count:
                remedy = f"one for each of the {count} frequencies"
                yield make_fault(where, values, f"{len(values)} numbers for {count} modes", remedy)
        if not points:
            remedy = "give points.NAME = [one number per mode], a mode shape in 1/√kg"
            yield make_fault(path, table, "no points are given", remedy)
