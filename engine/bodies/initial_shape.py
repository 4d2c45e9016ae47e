"""Initial shapes of strings, bars, membranes and plates: a displacement or a velocity as a function of the position."""

import math
from abc import abstractmethod
from collections.abc import Callable, Iterator
from functools import lru_cache
from typing import Annotated, Any, Literal, NamedTuple

import numpy as np
from pydantic import Field
from pydantic_core import InitErrorDetails

from engine.arithmetic.elementary import cos, interpolate, sin, square
from engine.arithmetic.products import product
from engine.arithmetic.quadrature import gauss_legendre
from engine.bodies.body import UnfitBody
from engine.bodies.table import Fraction, KeyPath, Positions, Table, is_given, is_number, make_fault

MAX_SHAPE_POINTS = 10_000  # of a file
Amplitude = Annotated[float, Field(ge=-1e3, le=1e3)]
AT_ONCE = 512  # positions
Shape = Callable[[Any], np.ndarray]  # positions → [..., modes], 1/√kg
Profile = Callable[[Any], float]  # position → m, or m/s


class Quadrature(NamedTuple):
    """Positions on a body, and the mass that each stands for."""

    positions: list[Any]
    masses: np.ndarray  # [positions], kg
    everywhere: list[Any]  # positions that are close enough to see how large a mode is at its largest

    def project(self, profile: Profile, shape: Shape) -> np.ndarray:
        """∫ Φ·y dm of a profile y: the modal coordinates that add up to it [modes], √kg·m of a displacement."""
        weights = self.masses * np.array([profile(position) for position in self.positions])
        total = np.zeros(1)
        for first in range(0, len(self.positions), AT_ONCE):
            part = slice(first, first + AT_ONCE)
            total = total + product(weights[part], shape(np.array(self.positions[part])))
        return total


class InitialShape(Table):
    """A displacement or a velocity at time 0."""

    def kinks(self) -> list[float]:
        """Return the positions of kinks of a profile along a line, as fractions of its length."""
        return []

    @abstractmethod
    def modal(self, shape: Shape, quadrature: Quadrature, peak: Callable[[Any], Profile]) -> np.ndarray:
        """Return the initial modal coordinates [modes]: √kg·m of a displacement, √kg·m/s of a velocity.

        shape:      of the modes
        quadrature: of the body
        peak:       from a place to the profile that is 1 there and falls to 0 at the ends or the rim
        """

    @classmethod
    def faults(cls, path: KeyPath, table: dict[str, Any], is_sheet: bool) -> Iterator[InitErrorDetails]:
        """Faults that no key shows alone. The table is as it was read; path: of the table"""
        yield from ()


class InitialTriangle(InitialShape):
    """A triangle on a string or bar, or a cone on a membrane or plate, which is zero at the ends or rim."""

    kind: Literal["triangle"]
    at: Positions = Field(description="position of the maximum")
    amplitude: Amplitude = Field(description="value at the maximum, m; of a velocity m/s")

    def kinks(self) -> list[float]:
        at = self.at[0] if isinstance(self.at, list) and len(self.at) == 1 else self.at
        return [float(at)] if is_number(at) else []

    def modal(self, shape: Shape, quadrature: Quadrature, peak: Callable[[Any], Profile]) -> np.ndarray:
        return self.amplitude * quadrature.project(peak(self.at), shape)


class InitialMode(InitialShape):
    """The shape of one mode."""

    kind: Literal["mode"]
    number: int = Field(default=1, ge=1, le=20_000, description="mode number; 1 is the lowest")
    amplitude: Amplitude = Field(description="maximum value, m; of a velocity m/s")

    def modal(self, shape: Shape, quadrature: Quadrature, peak: Callable[[Any], Profile]) -> np.ndarray:
        """Raises UnfitBody."""
        positions = quadrature.everywhere
        if self.number > (count := shape(positions[0]).size):
            raise UnfitBody(f"has no mode {self.number}, but {count} at this sample rate; a lower one")
        parts = [np.array(positions[first : first + AT_ONCE]) for first in range(0, len(positions), AT_ONCE)]
        largest = max(float(np.max(np.abs(shape(part)[:, self.number - 1]))) for part in parts)
        modal = np.zeros(shape(positions[0]).size)
        modal[self.number - 1] = self.amplitude / largest
        return modal


class InitialPoints(InitialShape):
    """Values at points, linear between them: lists, or a CSV file with columns x (and y, on a surface) and value."""

    kind: Literal["points"]
    file: str | None = Field(
        default=None, min_length=1, description="CSV file, relative to the patch; instead of the lists"
    )
    x: list[Fraction] | None = Field(
        default=None, min_length=2, max_length=MAX_SHAPE_POINTS, description="positions, fractions of the length"
    )
    y: list[Fraction] | None = Field(
        default=None,
        min_length=2,
        max_length=MAX_SHAPE_POINTS,
        description="positions on a membrane or plate along its other side, fractions",
    )
    value: list[Amplitude] | None = Field(
        default=None,
        min_length=2,
        max_length=MAX_SHAPE_POINTS,
        description="values at these positions, m; of a velocity m/s",
    )
    scale: Amplitude = Field(default=1.0, description="factor on the values")

    def kinks(self) -> list[float]:
        return [] if self.y is not None or self.x is None else self.x

    def modal(self, shape: Shape, quadrature: Quadrature, peak: Callable[[Any], Profile]) -> np.ndarray:
        x, value = np.array(self.x or []), np.array(self.value or [])
        if self.y is None:
            order = np.argsort(x, kind="stable")
            x, value = x[order], value[order]
            return self.scale * quadrature.project(
                lambda at: float(interpolate(at, x, value)) if x[0] <= at <= x[-1] else 0.0, shape
            )
        from scipy.interpolate import LinearNDInterpolator

        try:
            inner = LinearNDInterpolator(np.column_stack([x, self.y]), value, fill_value=0.0)
        except RuntimeError:  # of Qhull
            raise UnfitBody("begins with points that lie on a line; some beside it too") from None
        return self.scale * quadrature.project(lambda at: float(inner(at[0], at[1])), shape)

    @classmethod
    def faults(cls, path: KeyPath, table: dict[str, Any], is_sheet: bool) -> Iterator[InitErrorDetails]:
        """The lists are equally long, and as many as the body has directions."""
        if is_given(table, "file"):  # which could not be read
            return
        needed = ("x", "y", "value") if is_sheet else ("x", "value")
        for key in ("x", "y", "value"):
            if (key in needed) != is_given(table, key):
                message = f"no {key} is given" if key in needed else "a string or a bar has no y"
                yield make_fault(path, table, message, f"give a file, or {', '.join(needed)}")
                return
        sizes = [len(table[key]) for key in needed if isinstance(table[key], list)]
        if len(set(sizes)) > 1:
            yield make_fault(path, table, "lists of unlike lengths", "one number for each point in each")


INITIAL_SHAPES: dict[str, type[InitialShape]] = {
    "triangle": InitialTriangle,
    "mode": InitialMode,
    "points": InitialPoints,
}
Initial = Annotated[InitialTriangle | InitialMode | InitialPoints, Field(discriminator="kind")]


def peak_of_line(at: float) -> Profile:
    """1 at a place of a line, and linear to 0 at its ends."""
    return lambda x: float(interpolate(x, [0.0, at, 1.0], [float(at == 0.0), 1.0, float(at == 1.0)]))


def peak_of_rectangle(at: list[float]) -> Profile:
    """1 at a place of a rectangle, and linear to 0 at its rim: a pyramid."""

    def share(x: float, a: float) -> float:
        return (x - a) / (1 - a) if x > a else (a - x) / a if x < a else 0.0

    return lambda place: 1 - max(share(place[0], at[0]), share(place[1], at[1]))


def peak_of_circle(at: list[float]) -> Profile:
    """1 at a place of a circle, whose positions are fractions of the square around it, and linear to 0 at its rim: a
    cone."""
    apex = 2 * np.array(at) - 1

    def value(place: Any) -> float:
        way = 2 * np.array(place) - 1 - apex  # the rim is where |apex + s·way| = 1
        length, along = float(product(way, way)), float(product(way, apex))
        if length == 0.0:
            return 1.0
        to_rim = (math.sqrt(square(along) + length * (1 - float(product(apex, apex)))) - along) / length
        return 1 - 1 / to_rim if to_rim > 1 else 0.0

    return value


def line_quadrature(waves: int, kinks: list[float], mass: float) -> Quadrature:
    """Six Gauss points in each half-wave of a line, and between kinks.

    waves: half-waves of the highest mode; kinks: fractions; mass: kg
    """
    ends = np.unique(np.concatenate([np.linspace(0.0, 1.0, waves + 1), kinks]))
    node, weight = gauss_legendre(6)
    width = np.diff(ends)[:, None]
    positions = (ends[:-1, None] + width * (node + 1) / 2).ravel()
    everywhere = np.linspace(0.0, 1.0, 64 * waves + 1).tolist()
    return Quadrature(positions.tolist(), mass * (width * weight / 2).ravel(), everywhere)


@lru_cache(maxsize=8)  # a bend builds the same body anew every 5 ms
def rectangle_quadrature(waves: tuple[int, int], mass: float) -> Quadrature:
    """Gauss points of a rectangle. waves: half-waves of the highest modes along its sides; mass: kg"""
    (x, wx), (y, wy) = (gauss_legendre(math.ceil(1.3 * n) + 12) for n in waves)
    positions = [[(1 + a) / 2, (1 + b) / 2] for a in x.tolist() for b in y.tolist()]
    border_to_border = [np.linspace(0.0, 1.0, 12 * n + 1).tolist() for n in waves]
    everywhere = [[a, b] for a in border_to_border[0] for b in border_to_border[1]]
    return Quadrature(positions, mass * np.outer(wx, wy).ravel() / 4, everywhere)


def circle_quadrature(waves: int, mass: float) -> Quadrature:
    """Gauss points of a circle, on rays. waves: around it, of the highest modes; mass: kg"""
    node, weight = gauss_legendre(math.ceil(waves / 2) + 12)
    rays = 2 * waves + 16
    masses = mass * np.repeat(weight * (node + 1) / 2 / rays, rays)
    return Quadrature(polar((node + 1) / 2, rays), masses, polar(np.linspace(0.0, 1.0, 6 * waves + 1), 8 * waves + 8))


def polar(radius: np.ndarray, rays: int) -> list[Any]:
    """Positions on rays of a circle, fractions of the square around it."""
    angle = np.arange(rays) * (2 * math.pi / rays)
    x, y = (np.outer(radius, wave(angle)).ravel() / 2 + 0.5 for wave in (cos, sin))
    return list(np.column_stack([x, y]).tolist())
