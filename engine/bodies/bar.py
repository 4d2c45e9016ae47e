"""Thin bars."""

import math
from collections.abc import Iterator
from typing import Any, ClassVar, Literal

import numpy as np
from pydantic import Field
from pydantic_core import InitErrorDetails

from engine.bodies.distributed import LineBody, ModeSet, are_positive, mode_numbers, rise_from_one
from engine.bodies.table import KeyPath, Positive, make_fault


class Bar(LineBody):
    """A thin bar (Euler-Bernoulli)."""

    kind: Literal["bar"]
    ends: Literal["free", "clamped", "cantilever"] = Field(
        default="free", description="both ends free (held at its nodes), both clamped, or the first clamped"
    )
    bending: float | None = Field(default=None, gt=0.0, le=1e12, description="bending stiffness EI, N·m²")
    ratios: list[Positive] | None = Field(
        default=None,
        min_length=1,
        max_length=50,
        description="partials over the first, as makers tune them; only these are built",
    )

    EXACTLY_ONE_OF: ClassVar[list[tuple[str, str, str]]] = [
        ("density", "mass", "density in kg/m or mass in kg"),
        ("bending", "frequency", "bending stiffness in N·m² or frequency in Hz"),
    ]
    PITCH_POWERS: ClassVar[dict[str, int]] = {"frequency": 1, "bending": 2}

    def free_modes(self, max_omega: float) -> ModeSet:
        """ω = β²·√(EI/μ), where cos(βL)·cosh(βL) = 1 (both ends free, or both clamped) or -1 (cantilever); shapes of
        mean square 1 (Fletcher & Rossing, sec. 2.15 to 2.16; Blevins, Formulas for Natural Frequency and Mode Shape,
        table 8-1)."""
        density, length = self.linear_density(), self.length
        first = float(bar_roots(self.ends, np.array([1.0]))[0])
        speed = 2 * math.pi * (self.frequency or 0.0) * (length / first) ** 2
        if self.bending:
            speed = math.sqrt(self.bending / density)
        if self.ratios is not None:
            root = bar_roots(self.ends, np.arange(1.0, len(self.ratios) + 1))
            omega = speed * (first / length) ** 2 * np.array(self.ratios)
            chosen = omega < max_omega
            omega, root = omega[chosen][: self.modes], root[chosen][: self.modes]
        else:
            number = mode_numbers(lambda n: speed * (bar_roots(self.ends, n) / length) ** 2, self.modes, max_omega)
            root = bar_roots(self.ends, number)
            omega = speed * (root / length) ** 2
        scale = 1 / math.sqrt(density * length)
        return ModeSet(omega, self.decay_rates(omega, root / length), lambda x: scale * bar_shape(self.ends, root, x))

    @classmethod
    def faults(cls, path: KeyPath, table: dict[str, Any]) -> Iterator[InitErrorDetails]:
        """The ratios of partials rise from 1."""
        yield from super().faults(path, table)
        ratios: Any = table.get("ratios")
        if are_positive(ratios) and not rise_from_one(ratios):
            remedy = "the first is 1, each next one is higher"
            yield make_fault((*path, "ratios"), ratios, "these do not rise from 1", remedy)


def bar_roots(ends: str, number: np.ndarray) -> np.ndarray:
    """βL of modes 1, 2, …, by Newton's method from its asymptote."""
    sign = -1.0 if ends == "cantilever" else 1.0
    root = (number + 0.5 * sign) * math.pi
    for _ in range(6):  # cos x = sign/cosh x; the right side is a small correction
        small = sign / np.cosh(np.minimum(root, 700.0))
        root = root - (np.cos(root) - small) / (-np.sin(root) + small * np.tanh(root))
    return np.asarray(root)


def bar_shape(ends: str, root: np.ndarray, x: float) -> np.ndarray:
    """Shape of the modes with βL = root at fraction x, of mean square 1: cosh z - s·sinh z ± (cos z - s·sin z),
    z = βL·x, written with falling exponentials only, or the high ones would cancel."""
    z = root * x
    down = np.exp(-root)
    if ends == "cantilever":
        bottom = 1 + down**2 + 2 * down * np.cos(root)
        s = (1 - down**2 - 2 * down * np.sin(root)) / bottom
        rest = (down + np.cos(root) + np.sin(root)) / bottom
    else:
        bottom = 1 - down**2 - 2 * down * np.sin(root)
        s = (1 + down**2 - 2 * down * np.cos(root)) / bottom
        rest = (np.cos(root) - np.sin(root) - down) / bottom
    growing = np.exp(z - root) * rest + 0.5 * (1 + s) * np.exp(-z)
    wave = np.cos(z) - s * np.sin(z)
    return np.asarray(growing + wave if ends == "free" else growing - wave)
