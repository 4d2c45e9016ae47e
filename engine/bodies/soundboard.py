"""Ribbed soundboards of wood, from their dimensions."""

import math
from functools import lru_cache
from typing import Any, ClassVar, Literal

from pydantic import Field

from engine.arithmetic.elementary import square
from engine.arithmetic.plain_numbers import whole_power
from engine.bodies.decay import LossFactorDecay
from engine.bodies.distributed import ModeSet
from engine.bodies.materials import MATERIALS
from engine.bodies.plate_modes import PlateStiffness, Rib, rectangle_plate_modes
from engine.bodies.sheet import FlatSheet
from engine.bodies.table import Fraction, Positive, Table

MAX_BOARD_MODES = 200  # of a soundboard that does not say how many
LOSS_FACTOR = 0.02  # of a soundboard that gives no loss (Ege, Boutillon & Rébillat, J. Sound Vib. 332, 2013: 1 to 3 %)
board_modes = lru_cache(16)(rectangle_plate_modes)


WoodName = Literal["spruce", "cedar", "maple"]


class Ribs(Table):
    """Ribs glued to a soundboard across its grain, evenly spaced."""

    count: int = Field(ge=1, le=64, description="number of ribs")
    width: float = Field(gt=0.0, le=1.0, description="width of each, m")
    height: float = Field(gt=0.0, le=1.0, description="height of each, m")
    wood: WoodName = Field(default="spruce", description="wood")


class GluedBridge(Table):
    """A bridge glued to a soundboard along its grain or across it."""

    along: Literal["x", "y"] = Field(default="x", description="side that it is parallel to")
    at: Fraction = Field(description="position along the other side")
    width: float = Field(gt=0.0, le=1.0, description="width, m")
    height: float = Field(gt=0.0, le=1.0, description="height, m")
    wood: WoodName = Field(default="maple", description="wood")


class Soundboard(FlatSheet):
    """A board of wood whose grain runs along x, with ribs along y and bridges, from its dimensions. Its loss factor is
    0.02 if no loss is given."""

    kind: Literal["soundboard"]
    size: list[Positive] = Field(min_length=2, max_length=2, description="sides, m: along the grain, and across it")
    thickness: float = Field(gt=0.0, le=1.0, description="thickness, m")
    wood: WoodName = Field(default="spruce", description="wood: Sitka spruce, western red cedar or sugar maple")
    edges: Literal["supported", "clamped"] = Field(default="clamped", description="boundary condition of all edges")
    ribs: Ribs | None = Field(default=None, description="ribs across the grain")
    bridges: list[GluedBridge] = Field(default=[], max_length=16, description="bridges glued to it")

    BEGINS_AT_REST: ClassVar[bool] = True  # its ribs are part of its mass

    def free_modes(self, max_omega: float) -> ModeSet:
        """Modes of an orthotropic plate with beams on it (engine.bodies.plate_modes)."""
        a, b = self.size
        count, stiffness = self.modes or MAX_BOARD_MODES, self.stiffness()
        omega, shape = board_modes(
            (a, b), stiffness, self.surface_density(), 0.0, self.edges, self.beams(), count, max_omega
        )
        beta = self.wave_numbers(omega, stiffness.mean(), 0.0)
        rates = (self.sigma0, self.sigma_beta, self.sigma_beta3, self.b3)
        has_loss = self.decay is not None or self.t60 is not None or any(rates)
        law = LossFactorDecay(kind="loss_factor", eta=LOSS_FACTOR)
        return ModeSet(omega, self.decay_rates(omega, beta) if has_loss else law.rates(omega, beta), shape)

    def surface_density(self) -> float:
        return MATERIALS[self.wood].density * self.thickness

    def stiffness(self) -> PlateStiffness:
        """Flexural rigidities of the board alone, N·m (Timoshenko & Woinowsky-Krieger, sec. 85)."""
        wood, bend = MATERIALS[self.wood], whole_power(self.thickness, 3) / 12
        other = wood.poisson * wood.across / wood.young
        solid = bend / (1 - wood.poisson * other)
        return PlateStiffness(wood.young * solid, wood.across * solid, other * wood.young * solid, wood.shear * bend)

    def beams(self) -> tuple[Rib, ...]:
        """Ribs and bridges."""
        beams = []
        if self.ribs is not None:
            spacing = self.size[0] / self.ribs.count
            beams += [self.beam("y", (n + 0.5) / self.ribs.count, self.ribs, spacing) for n in range(self.ribs.count)]
        return (*beams, *(self.beam(bridge.along, bridge.at, bridge, math.inf) for bridge in self.bridges))

    def beam(self, along: Literal["x", "y"], at: float, cut: Any, spacing: float) -> Rib:
        """A rib or bridge of a rectangular cut, glued on one side of the board: what it adds to the bending stiffness
        of the strip of the board that bends with it, about the neutral axis of both (a composite beam).

        spacing: m, of the strip; at most a fifth of the length of the beam bends with it
        """
        glued, board = MATERIALS[cut.wood], MATERIALS[self.wood]
        modulus = board.across if along == "y" else board.young
        strip = min(spacing, self.size[1 if along == "y" else 0] / 5)
        stretch, stretch_of_board = glued.young * cut.width * cut.height, modulus * strip * self.thickness
        apart = (cut.height + self.thickness) / 2
        alone = glued.young * cut.width * whole_power(cut.height, 3) / 12
        bending = alone + square(apart) * stretch * stretch_of_board / (stretch + stretch_of_board)
        return Rib(along, at, bending, glued.density * cut.width * cut.height)

    def total_mass(self) -> float:
        a, b = self.size
        lengths = {"x": a, "y": b}
        return a * b * self.surface_density() + sum(beam.density * lengths[beam.along] for beam in self.beams())

    def bending_thickness(self) -> float:
        return self.thickness

    def sides(self) -> tuple[float, float] | None:
        return self.size[0], self.size[1]

    def area(self) -> float:
        return self.size[0] * self.size[1]
