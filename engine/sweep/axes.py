"""Axes of a sweep: which value of a patch varies, and over what."""

import math
from dataclasses import dataclass
from statistics import NormalDist
from typing import Any

from engine.bodies.table import KeyPath
from engine.patch.paths import locate
from engine.patch.scene import Scene

MAX_GRID_POINTS = 100_000  # more are taken for a mistake
VALUE_DIGITS = 12  # of a value between two bounds: 0.3, not 0.30000000000000004
AXIS_FORMS = "give PATH=A..B:N, PATH=A..B:log:N or PATH=A,B,C; for random values also A~B"
FARTHEST = 1e-9  # of all normal values, what lies beyond those that are drawn, at either end

Value = int | float | str


@dataclass(frozen=True)
class SweepAxis:
    """One value of a patch that varies.

    path:     what the user calls it
    key_path: its path in the document; empty if it is none of its values, but which note is played, and how
    bounds:   the values of a list, or the two ends of a range
    count:    how many values a range has; None for a list, or for a range of which random values are taken
    normal:   the bounds are the mean and the standard deviation of a normal distribution
    """

    path: str
    key_path: KeyPath
    bounds: tuple[Value, ...]
    is_range: bool = False
    log: bool = False
    integer: bool = False
    count: int | None = None
    normal: bool = False

    def value_at(self, fraction: float) -> Value:
        """The value at a fraction of the range, 0 to 1; of a list, one of its values."""
        if not self.is_range:
            return self.bounds[min(int(fraction * len(self.bounds)), len(self.bounds) - 1)]
        low, high = (float(bound) for bound in self.bounds)
        if self.normal:
            value = NormalDist(low, high).inv_cdf(min(max(fraction, FARTHEST), 1.0 - FARTHEST))
            return round(value) if self.integer else float(f"{value:.{VALUE_DIGITS}g}")
        if self.integer and self.count is None and not self.log:  # each is as likely as any other
            first, last = math.ceil(min(low, high)), math.floor(max(low, high))
            return min(first + int(fraction * (last - first + 1)), last)
        if fraction in (0.0, 1.0):
            value = high if fraction else low
        else:
            value = low * (high / low) ** fraction if self.log else low + (high - low) * fraction
            value = float(f"{value:.{VALUE_DIGITS}g}")
        return round(value) if self.integer else value

    def grid_values(self) -> list[Value]:
        """All values of the grid along this axis; integers of a range are not repeated."""
        if self.count is None:
            return list(self.bounds)
        return list(dict.fromkeys(self.value_at(n / (self.count - 1)) for n in range(self.count)))


def parse_axis(text: str, scene: Scene, data: dict[str, Any], is_random: bool = False) -> SweepAxis:
    """Make an axis of PATH=RANGE. Raises ValueError, whose message is one line.

    scene, data: the patch, and the document that it was read from
    is_random:   values are taken at random, so that a range needs no count
    """
    path, equals, values = (part.strip() for part in text.partition("="))
    if not equals or not path or not values:
        raise ValueError(f'"{text}" is not a variation; {AXIS_FORMS}')
    key_path, integer = locate(path, scene, data)
    try:
        if is_random and "~" in values:
            mean, deviation = map(float, values.split("~"))
            if not (math.isfinite(mean) and 0.0 < deviation < math.inf):
                raise ValueError
            return SweepAxis(path, key_path, (mean, deviation), True, False, integer, normal=True)
        if ".." not in values or "/" in values:  # ../bell.csv is a file
            return SweepAxis(path, key_path, tuple(_parse_value(word.strip()) for word in values.split(",")))
        low, _, rest = values.partition("..")
        high, *options = rest.split(":")
        bounds = float(low), float(high)
        log = options[:1] == ["log"]
        count = [int(word) for word in options[log:]]
    except ValueError:
        raise ValueError(f'{path}: "{values}" is neither a range nor a list; {AXIS_FORMS}') from None
    if len(count) > 1 or not all(map(math.isfinite, bounds)) or bounds[0] == bounds[1]:
        raise ValueError(f'{path}: "{values}" is not a range; {AXIS_FORMS}')
    if log and min(bounds) <= 0.0:
        raise ValueError(f'{path}: "{values}" reaches 0 or below, where there is no logarithm; give PATH=A..B:N')
    if not count and not is_random:
        remedy = f"give {values}:16 for 16 values, or --random N for random points"
        raise ValueError(f'{path}: "{values}" does not say how many; {remedy}')
    if count and not 2 <= count[0] <= MAX_GRID_POINTS:
        raise ValueError(
            f'{path}: {count[0]} values from "{low}" to "{high}" are not possible; give 2 to {MAX_GRID_POINTS}'
        )
    if integer and math.ceil(min(bounds)) > math.floor(max(bounds)):
        raise ValueError(f'{path}: "{values}" holds no whole number; {AXIS_FORMS}')
    return SweepAxis(path, key_path, bounds, True, log, integer, count[0] if count else None)


def _parse_value(word: str) -> Value:
    """A number if the word is one, else the word. Raises ValueError if it is empty."""
    if not word:
        raise ValueError(word)
    try:
        return int(word)
    except ValueError:
        pass
    try:
        return float(word)
    except ValueError:
        return word
