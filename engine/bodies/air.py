"""Air: in a rigid box with a hole, and in tubes."""

import math
from abc import abstractmethod
from typing import Any, ClassVar, Literal, Self

import numpy as np
from pydantic import Field

from engine.arithmetic.elementary import cos, sin, square
from engine.bodies.body import MAX_MODES, ModalBody, UnfitBody
from engine.bodies.distributed import DistributedBody, ModeSet, mode_numbers
from engine.bodies.initial_shape import Profile, Quadrature, line_quadrature, peak_of_line
from engine.bodies.table import Positive, Table, is_given

AIR_DENSITY = 1.204  # ρ at 20 °C, kg/m³
SPEED_OF_SOUND = 343.2  # c at 20 °C, m/s
BULK_MODULUS = AIR_DENSITY * square(SPEED_OF_SOUND)  # ρc², Pa
FLANGED_END, FREE_END = 0.85, 0.61  # end corrections, of the radius (Fletcher & Rossing, sec. 8.3)
WALL_LOSS = 3e-5  # √s: what walls take of a wave per length, times radius over √frequency (the same, eq. 8.15)


class AirBody(DistributedBody):
    """Vibrating air, whose pickup measures the pressure of its opening. If no loss is given, be it 0, it loses at its
    walls, and by the sound that it radiates."""

    sigma0: float | None = Field(  # type: ignore[assignment]
        default=None, ge=0.0, le=1e6, description="decay rate of all modes, 1/s; 0: nothing damps them"
    )

    HEARD: ClassVar[str] = "pressure"
    HAS_AREA: ClassVar[bool] = True

    BEGINS_AT_REST: ClassVar[bool] = True

    @abstractmethod
    def opening(self) -> float:
        """Area of its opening, m²; 0 without one."""

    @abstractmethod
    def volume_row(self, body: ModalBody) -> np.ndarray:
        """The volume that flows out of it per mode [modes], m²/√kg. body: its modes"""

    def has_loss(self) -> bool:
        """True if the patch gives losses for the air."""
        ways = (self.sigma0, self.decay, self.t60)
        return any(way is not None for way in ways) or any((self.sigma_beta, self.sigma_beta3, self.b3))

    def quadrature(self, modes: int, kinks: list[float]) -> Quadrature:
        return line_quadrature(modes + 2, kinks, self.total_mass())

    def peak(self, at: Any) -> Profile:
        return peak_of_line(at)


def wall_decay(omega: np.ndarray | float, radius: float) -> np.ndarray:
    """σ of air along the walls of a tube, c·3e-5·√f/radius, 1/s (Fletcher & Rossing, eq. 8.15). omega: rad/s"""
    return np.asarray(SPEED_OF_SOUND * WALL_LOSS * np.sqrt(np.asarray(omega) / (2 * math.pi)) / radius)


def radiated_share(omega: np.ndarray | float, radius: float) -> np.ndarray:
    """The resistance of an opening that radiates all around, share of ρcS: (k·radius)²/4, at most 1/4 (Fletcher &
    Rossing, sec. 8.3)."""
    return np.asarray(square(np.minimum(np.asarray(omega) / SPEED_OF_SOUND * radius, 1.0)) / 4)


class Hole(Table):
    """A round hole in a wall of a box: the air in it is a mass on the spring of the air behind."""

    radius: float = Field(gt=0.0, le=10.0, description="radius, m")
    thickness: float = Field(default=0.0, ge=0.0, le=10.0, description="thickness of the wall, or length of a neck, m")

    def area(self) -> float:
        """Area, m²."""
        return math.pi * square(self.radius)

    def mass(self) -> float:
        """Mass that moves in it, kg: ρ·S·(thickness + 2·0.85·radius) (Fletcher & Rossing, sec. 8.3 and 10.3)."""
        return AIR_DENSITY * self.area() * (self.thickness + 2 * FLANGED_END * self.radius)

    def natural_decay(self, omega: float) -> float:
        """σ of the air in it, 1/s: at its wall, as in a tube, and R/2m by the sound that it radiates."""
        radiated = AIR_DENSITY * SPEED_OF_SOUND * self.area() * radiated_share(omega, self.radius) / (2 * self.mass())
        return float(wall_decay(omega, self.radius) + radiated)


class AirBox(AirBody):
    """The air in a rigid box: its Helmholtz resonance, if it has a hole, and its lowest standing waves. Plates on its
    walls drive it by connections of kind "air". If no loss is given, it is that of its walls and of the sound that
    its hole radiates."""

    kind: Literal["air"]
    size: list[Positive] = Field(min_length=3, max_length=3, description="sides of the box, m: x, y, and its height")
    hole: Hole | None = Field(default=None, description="a hole in a wall")
    modes: int | None = Field(
        default=None, ge=1, le=200, description="number of standing waves, the lowest; 6 if absent"
    )

    def volume(self) -> float:
        """Volume, m³."""
        return self.size[0] * self.size[1] * self.size[2]

    def standing_waves(self) -> np.ndarray:
        """Half-waves along x, y and z of the standing waves, the lowest first [waves, 3]."""
        count = self.modes or 6
        numbers = np.array(
            [
                (i, j, k)
                for i in range(count + 1)
                for j in range(count // max(i, 1) + 1)
                for k in range(count // (max(i, 1) * max(j, 1)) + 1)
                if i or j or k
            ]
        )
        order = np.argsort(np.sum(square(numbers / np.array(self.size)), axis=1), kind="stable")
        return np.asarray(numbers[order][:count])

    def free_modes(self, max_omega: float) -> ModeSet:
        """The plug in the hole, ω² = ρc²·S²/(V·m), and standing waves, ω = πc·√((l/a)² + (m/b)² + (n/c)²) (Fletcher &
        Rossing, sec. 6.6 and 10.3). The place is "hole"."""
        k = math.pi * np.sqrt(np.sum(square(self.standing_waves() / np.array(self.size)), axis=1))
        if self.hole is not None:
            helmholtz = math.sqrt(BULK_MODULUS / self.volume() / self.hole.mass()) * self.hole.area() / SPEED_OF_SOUND
            if helmholtz * SPEED_OF_SOUND >= max_omega:
                raise UnfitBody("has a hole that resonates above 0.49 of the sample rate; a larger box, or no hole")
            k = np.concatenate([[helmholtz], k])
        k = k[k * SPEED_OF_SOUND < max_omega]
        shape = np.zeros(k.size)
        if self.hole is not None:
            shape[0] = 1 / math.sqrt(self.hole.mass())
        omega = k * SPEED_OF_SOUND
        sigma = self.decay_rates(omega, k) if self.has_loss() else self.natural_decay(omega)
        return ModeSet(omega, sigma, lambda position: shape)

    def natural_decay(self, omega: np.ndarray) -> np.ndarray:
        """σ, 1/s: of standing waves as in a tube with as much wall for its volume, of radius 2V/S."""
        sigma = wall_decay(omega, 1 / float(np.sum(1 / np.array(self.size))))
        if self.hole is not None:
            sigma[0] = self.hole.natural_decay(omega[0])
        return sigma

    def wall_rows(self, modes: int, positions: np.ndarray, height: float) -> np.ndarray:
        """√(ρc²/Λ)·ψ at places of a wall [places, 1 + waves], √(J)/m³: of uniform pressure, and of standing waves
        ψ = cos·cos·cos, Λ = ∫ψ² dV.

        modes: of the body that are built; positions: [places, 2], fractions of x and y; height: of the wall, 0 or 1
        """
        waves = self.standing_waves()[: modes - (self.hole is not None)]
        numbers = np.concatenate([np.zeros((1, 3)), waves])
        places = np.column_stack([positions, np.full(len(positions), height)])
        shape = np.prod(cos(math.pi * numbers * places[:, None, :]), axis=2)
        share = np.prod(np.where(numbers > 0, 0.5, 1.0), axis=1)
        return np.asarray(shape * np.sqrt(BULK_MODULUS / (self.volume() * share)))

    def opening(self) -> float:
        return self.hole.area() if self.hole is not None else 0.0

    def total_mass(self) -> float:
        return AIR_DENSITY * self.volume()

    def volume_row(self, body: ModalBody) -> np.ndarray:
        """The volume that flows out of the hole per mode [modes], m²/√kg."""
        return self.opening() * body.shape("hole")

    @classmethod
    def has_position(cls, table: dict[str, Any], item: Any) -> bool:
        return item == "hole" and is_given(table, "hole")

    @classmethod
    def position_help(cls, table: dict[str, Any]) -> str:
        return '"hole"' if is_given(table, "hole") else '"hole", of a box that has one'


class Tube(AirBody):
    """The air in a tube, such as a resonator under a bar: 0 is its first end, 1 its open mouth. If no loss is given, it
    is that of its walls and of the sound that it radiates."""

    kind: Literal["tube"]
    length: float = Field(gt=0.0, le=1e3, description="length, m")
    radius: float = Field(gt=0.0, le=10.0, description="radius, m")
    ends: Literal["closed", "open"] = Field(default="closed", description="whether the first end is closed or open")

    def free_modes(self, max_omega: float) -> ModeSet:
        """Displacement sin or cos of kx, k = (n - ½)π/L', or nπ/L' where both ends are open; L' is longer by 0.61 of
        the radius at each open end, and the modal mass ρSL/2 (Fletcher & Rossing, sec. 8.2 to 8.3)."""
        shift = 0.5 if self.ends == "closed" else 0.0
        effective = self.length + FREE_END * self.radius * (1 if self.ends == "closed" else 2)
        number = mode_numbers(
            lambda n: (n - shift) * math.pi / effective * SPEED_OF_SOUND, self.modes or MAX_MODES, max_omega
        )
        phase = (number - shift) * math.pi
        k = phase / effective
        scale = math.sqrt(2 / (AIR_DENSITY * self.opening() * self.length))
        wave = sin if self.ends == "closed" else cos
        omega = k * SPEED_OF_SOUND
        sigma = self.decay_rates(omega, k) if self.has_loss() else self.natural_decay(omega)
        return ModeSet(omega, sigma, lambda x: scale * wave(phase * np.asarray(x)[..., None]))

    def retuned(self, ratio: float) -> Self:
        """A tube of another length, whose resonances are higher by a ratio."""
        ends = FREE_END * self.radius * (1 if self.ends == "closed" else 2)
        return self.model_copy(update={"length": max((self.length + ends) / ratio - ends, 1e-6)})

    def natural_decay(self, omega: np.ndarray) -> np.ndarray:
        """σ, 1/s: at the walls c·3e-5·√f/radius, and c·(k·radius)²/4L radiated by each open end, at most c/4L
        (Fletcher & Rossing, eq. 8.15 and sec. 8.3)."""
        mouths = 1 if self.ends == "closed" else 2
        radiated = mouths * SPEED_OF_SOUND * radiated_share(omega, self.radius) / self.length
        return np.asarray(wall_decay(omega, self.radius) + radiated)

    def opening(self) -> float:
        return math.pi * square(self.radius)

    def total_mass(self) -> float:
        return AIR_DENSITY * self.opening() * self.length

    def volume_row(self, body: ModalBody) -> np.ndarray:
        """The volume that flows out of its open ends per mode [modes], m²/√kg."""
        return self.opening() * (body.shape(1.0) - (body.shape(0.0) if self.ends == "open" else 0.0))
