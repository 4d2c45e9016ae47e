"""The base of all bodies: a name, modes, positions, and a pitch that may change."""

import math
from abc import abstractmethod
from collections.abc import Callable, Iterator
from typing import Any, ClassVar, NamedTuple, Self

import numpy as np
from pydantic import Field
from pydantic_core import InitErrorDetails

from engine.arithmetic.plain_numbers import log, power
from engine.bodies.materials import Material
from engine.bodies.stretching import Stretching
from engine.bodies.table import KeyPath, Name, Table, is_number

MIN_OMEGA = 1e-150  # rad/s; below, the square underflows, and a body on a very weak spring would stand still
TO_60_DB = 3 * log(10)  # σ·T60: e^(-σ·T60) = 10^-3
MAX_MODES = 20_000  # of one body


class ModalBody(NamedTuple):
    """A body as the kernels see it: a set of modes with mass-normalised shapes Φ.

    A force F at a position drives mode m with Φ_m·F, and the displacement there is Σ Φ_m·q_m.
    """

    omega: np.ndarray  # [modes], rad/s
    sigma: np.ndarray  # [modes], 1/s
    shape: Callable[[Any], np.ndarray]  # position → [modes], 1/√kg; of many modes also positions → [..., modes]
    q: np.ndarray  # [modes], √kg·m, displacement at time 0
    p: np.ndarray  # [modes], √kg·m/s, momentum at time 0
    gravity_participation: np.ndarray  # [modes], √kg: force on each mode in a uniform gravity of 1 m/s²
    residual: int = 0  # how many of the last modes stand for those left out (engine.assembly.mode_counts)
    silent: int = 0  # how many before these have no shape: they only take places (engine.assembly.mode_counts)


def remember_positions(shape: Callable[[Any], np.ndarray]) -> Callable[[Any], np.ndarray]:
    """Return a `shape` of a ModalBody that computes the shapes at each single position once."""
    known: dict[str, np.ndarray] = {}

    def remembered(position: Any) -> np.ndarray:
        if isinstance(position, np.ndarray):
            return shape(position)
        if (key := repr(position)) not in known:
            known[key] = shape(position)
            known[key].flags.writeable = False
        return known[key]

    return remembered


class TooManyModes(ValueError):
    """A body has more modes below the highest frequency than can be built."""


class UnfitBody(ValueError):
    """A body cannot be built; the message says why, and what would be right."""


class BodyTable(Table):
    """A body of a patch. Each kind of body is a subclass, in a file of its own."""

    name: Name = Field(description="name of the body, which contacts, forces and pickups use")

    EXACTLY_ONE_OF: ClassVar[list[tuple[str, ...]]] = []  # keys, and how to choose
    AT_MOST_ONE_OF: ClassVar[list[tuple[str, str]]] = []
    IS_LUMPED: ClassVar[bool] = False  # one mode, no positions
    HAS_LENGTH: ClassVar[bool] = False  # a string or a bar
    HEARD: ClassVar[str] = "velocity"  # what a pickup hears of it that does not say
    HAS_AREA: ClassVar[bool] = False  # pushes air as a whole: `volume_row`
    STRETCHED_BY: ClassVar[tuple[str, ...]] = ()  # keys one of which lets its tension rise
    CONTACT_RADIUS: ClassVar[float] = 0.0  # m, of what touches it, where a contact does not say
    PITCH_POWERS: ClassVar[dict[str, int]] = {}  # keys that make its pitch; each goes with this power of frequency

    @abstractmethod
    def modal_body(self, max_frequency: float = math.inf) -> ModalBody:
        """Modes of the body, those of bodies with many only up to `max_frequency` (Hz).

        Raises TooManyModes if the body has too many below it and does not limit them; ArithmeticError or another
        ValueError if its numbers are beyond floating point.
        """

    @abstractmethod
    def total_mass(self) -> float:
        """Mass of the body, kg; infinite where it is not known."""

    def initial_displacement(self, at: Any) -> float:
        """Displacement at a position at time 0, m."""
        return 0.0

    def retuned(self, ratio: float) -> Self:
        """The body with all its frequencies multiplied by a ratio."""
        changed: dict[str, Any] = {}
        for key, exponent in self.PITCH_POWERS.items():
            value = getattr(self, key)
            if isinstance(value, list):
                changed[key] = [v * power(ratio, exponent) for v in value]
            elif value is not None:
                changed[key] = value * power(ratio, exponent)
        return self.model_copy(update=changed)

    def find_stretching(self, omega: np.ndarray) -> Stretching | None:
        """Rise of the tension as the body stretches; None if there is none. omega: of its modes at rest, rad/s"""
        return None

    def tension_at_rest(self) -> float | None:
        """Tension at rest, N of a string, N/m of a sheet; None of a body without one."""
        return None

    def slope_squares(self, omega: np.ndarray) -> np.ndarray | None:
        """Mean square of the slope of each mode over a string or a membrane [modes], 1/(kg·m²); None of other bodies.
        omega: of its modes at rest, rad/s"""
        return None

    def bending_thickness(self) -> float | None:
        """Thickness of a body that bends, m; None of one that does not, or whose thickness is not known."""
        return None

    def count_whole_modes(self) -> int:
        """Count the last of its modes that move it as a whole, and do not bend it."""
        return 0

    @classmethod
    def split_positions(cls, at: Any) -> list[Any]:
        """The positions that the value of a key lists; a single one makes a list of one."""
        return at if isinstance(at, list) else [at]

    @classmethod
    def has_position(cls, table: dict[str, Any], item: Any) -> bool:
        """True if a value of a patch is a position on the body of a table. The table is as it was read."""
        return is_number(item)

    @classmethod
    def explain_outside(cls, table: dict[str, Any], item: Any) -> tuple[str, str] | None:
        """Why a valid position lies outside the body of a table, and what would be right; None if it does not."""
        return None

    @classmethod
    def position_help(cls, table: dict[str, Any]) -> str:
        """Describe a position on the body of a table in words."""
        return "a fraction of its length, 0 to 1"

    @classmethod
    def numbers_of_material(cls, table: dict[str, Any], material: Material) -> dict[str, Any]:
        """Return what a material gives the body of a table beside what the table gives. The table is as it was read."""
        return {}

    @classmethod
    def faults(cls, path: KeyPath, table: dict[str, Any]) -> Iterator[InitErrorDetails]:
        """Faults of a body's table that no key shows alone. The table is as it was read, and may have other faults.

        path: of the table
        """
        yield from ()
