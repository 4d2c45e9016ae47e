"""Scala files: scales (.scl) and keyboard maps (.kbm), as Manuel Op de Coul defines them
(https://www.huygens-fokker.org/scala/scl_format.html and help.htm#mappings). A file of this format that libraries read
loosely (a comma in place of a dot, missing or negative tones) is refused here, with its line; and frequencies are the
same on every machine.
"""

import math
import re
from collections.abc import Iterator
from dataclasses import dataclass

from engine.arithmetic.plain_numbers import power
from engine.instrument.key_names import HIGHEST_KEY, note_frequency

COMMENT = "!"
MIDDLE_C = 60
MAX_TONES = 4096  # of a scale, or of a map
RATIO = re.compile(r"(\d+)(?:/(\d+))?")
CENTS = re.compile(r"[-+]?(?:\d+\.\d*|\.\d+)")
LARGEST_RATIO, LARGEST_CENTS = 1e6, 24_000.0  # of a tone, above or below the first


class ScalaError(ValueError):
    """A file is no scale, or no keyboard map; the message says in which line."""


@dataclass(frozen=True)
class Scale:
    """A scale that repeats at its last tone.

    tones: ratios of frequencies to that of its first degree, 1/1, which is not among them
    """

    title: str
    tones: tuple[float, ...]

    def ratio(self, degree: int) -> float:
        """Return the ratio of the frequency of a degree, from 0, to that of the first one."""
        octave, step = divmod(degree, len(self.tones))
        return power(self.tones[-1], octave) * (self.tones[step - 1] if step else 1.0)


@dataclass(frozen=True)
class KeyboardMap:
    """A map from keys to degrees of a scale.

    degrees:   of the keys from `middle` on; None of those that are left out. Without any, each key is a degree
    octave:    degree by whose interval it rises where it repeats
    first, last: keys that are mapped; all others have their frequencies in equal temperament
    reference: key whose frequency (Hz) is given
    """

    degrees: tuple[int | None, ...]
    octave: int
    first: int
    last: int
    middle: int
    reference: int
    frequency: float

    def ratio(self, key: int, scale: Scale) -> float | None:
        """Return the ratio of the frequency of a key to that of the first degree; None if it is left out."""
        if not self.degrees:
            return scale.ratio(key - self.middle)
        octave, step = divmod(key - self.middle, len(self.degrees))
        degree = self.degrees[step]
        return None if degree is None else scale.ratio(degree) * power(scale.ratio(self.octave), octave)


def map_from_middle_c(a4: float) -> KeyboardMap:
    """Return the map that a scale has without one: from middle C on, each key is a degree. a4: Hz"""
    return KeyboardMap((), 0, 0, HIGHEST_KEY, MIDDLE_C, MIDDLE_C, note_frequency(MIDDLE_C, a4))


def frequencies_of_keys(scale: Scale, keyboard_map: KeyboardMap, a4: float) -> dict[int, float]:
    """Return the frequencies of all keys but those that are left out, Hz. a4: of keys that the map does not concern.
    Raises ScalaError."""
    reference = keyboard_map.ratio(keyboard_map.reference, scale)
    if reference is None:
        raise ScalaError(f"its key {keyboard_map.reference}, whose frequency it gives, is left out by the map")
    base, found = keyboard_map.frequency / reference, dict[int, float]()
    for key in range(HIGHEST_KEY + 1):
        ratio = keyboard_map.ratio(key, scale)
        if not keyboard_map.first <= key <= keyboard_map.last:
            found[key] = note_frequency(key, a4)
        elif ratio is not None:
            found[key] = base * ratio
    return found


def read_scale(text: str) -> Scale:
    """Read a scale. Raises ScalaError."""
    lines = _lines(text)
    _, title = next(lines, (0, ""))
    number, count = _next_number(lines, "the number of tones", 1, MAX_TONES)
    tones = list[float]()
    for number, line in lines:
        if len(tones) < count:
            tones.append(_parse_tone(number, line))
    if len(tones) < count:
        raise ScalaError(f"line {number}: it ends after {len(tones)} of {count} tones")
    return Scale(title.strip(), tuple(tones))


def _parse_tone(number: int, line: str) -> float:
    """The ratio of a tone: cents, which have a dot, or a ratio of whole numbers; what follows is a comment."""
    word = (line.split() or [""])[0]
    if CENTS.fullmatch(word):
        cents = float(word)
        if abs(cents) <= LARGEST_CENTS:
            return power(2.0, cents / 1200.0)
    elif match := RATIO.fullmatch(word):
        above, below = int(match[1]), int(match[2] or 1)
        if above and below and 1 / LARGEST_RATIO <= above / below <= LARGEST_RATIO:
            return above / below
    raise ScalaError(f'line {number}: "{word}" is no tone; give cents, which have a dot, or a ratio such as 3/2')


def read_keyboard_map(text: str) -> KeyboardMap:
    """Read a keyboard map. Raises ScalaError."""
    lines = _lines(text)
    _, size = _next_number(lines, "the size of the map", 0, MAX_TONES)
    first, last, middle, reference = (
        _next_number(lines, f"the {what} key", 0, HIGHEST_KEY)[1] for what in ("first", "last", "middle", "reference")
    )
    number, frequency = _next_frequency(lines)
    number, octave = _next_number(lines, "the degree of the octave", 0, MAX_TONES)
    degrees = list[int | None]()
    for number, line in lines:
        if len(degrees) < size:
            degrees.append(_parse_degree(number, line))
    if last < first:
        raise ScalaError(f"line {number}: its last key {last} lies below its first one, {first}")
    degrees += [None] * (size - len(degrees))
    return KeyboardMap(tuple(degrees), octave, first, last, middle, reference, frequency)


def check_map(scale: Scale, keyboard_map: KeyboardMap) -> None:
    """Raise ScalaError if a map wants degrees that a scale has not."""
    highest = max((degree for degree in keyboard_map.degrees if degree is not None), default=0)
    if max(highest, keyboard_map.octave) > len(scale.tones):
        wanted = max(highest, keyboard_map.octave)
        raise ScalaError(f"the map has degree {wanted}; the scale has {len(scale.tones)}")


def _parse_degree(number: int, line: str) -> int | None:
    word = (line.split() or [""])[0]
    if word.lower() == "x":
        return None
    if word.isdecimal() and int(word) <= MAX_TONES:
        return int(word)
    raise ScalaError(f'line {number}: "{word}" is no degree; give a whole number, or x for a key that is left out')


def _lines(text: str) -> Iterator[tuple[int, str]]:
    """The lines of a file but for comments, with their numbers."""
    for number, line in enumerate(text.splitlines(), 1):
        if not line.startswith(COMMENT):
            yield number, line


def _next_number(lines: Iterator[tuple[int, str]], what: str, low: int, high: int) -> tuple[int, int]:
    """The whole number in the next line, and the number of the line."""
    number, line = next(lines, (0, ""))
    word = (line.split() or [""])[0]
    if not number:
        raise ScalaError(f"it ends before {what}")
    if not word.isdecimal() or not low <= int(word) <= high:
        raise ScalaError(f'line {number}: "{word}" is not {what}; give {low} to {high}')
    return number, int(word)


def _next_frequency(lines: Iterator[tuple[int, str]]) -> tuple[int, float]:
    """The frequency in the next line, and the number of the line."""
    number, line = next(lines, (0, ""))
    word = (line.split() or [""])[0]
    try:
        frequency = float(word)
    except ValueError:
        frequency = math.nan
    if not number:
        raise ScalaError("it ends before the frequency of its reference key")
    if not 1e-3 <= frequency <= 1e6:
        raise ScalaError(f'line {number}: "{word}" is no frequency; give Hz, such as 440.0')
    return number, frequency
