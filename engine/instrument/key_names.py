"""Keys by name and number: C4 is 60, as in MIDI."""

import re
from functools import lru_cache

from engine.arithmetic.plain_numbers import power

PITCH_CLASSES = ["C", "C#", "D", "D#", "E", "F", "F#", "G", "G#", "A", "A#", "B"]
LOWEST_KEY, HIGHEST_KEY = 0, 127
LOWEST_PIANO_KEY = 21  # A0, key 1 of a piano
KEY_PATTERN = re.compile(r"([A-Ga-g])([#b♯♭]?)(-1|\d)")
RANGE_SEPARATOR = ".."
PART_SEPARATOR = "__"  # between the name of a part of a rig and that of what it has
KEY_HELP = 'a key such as "C4", "F#3" or "Bb2"'


def note_name(key: int) -> str:
    """The name of a key: that of 60 is C4."""
    return f"{PITCH_CLASSES[key % 12]}{key // 12 - 1}"


def plain_note_name(key: int) -> str:
    """Its name of letters and digits alone, as part of other names: Fs3, Cm1."""
    return note_name(key).replace("#", "s").replace("-", "m")


def note_frequency(key: int, a4: float = 440.0) -> float:
    """Its frequency in equal temperament, Hz."""
    return a4 * power(2.0, (key - 69) / 12)


@lru_cache(1024)
def parse_key(text: str) -> int:
    """The number of a key by its name. Raises ValueError."""
    match = KEY_PATTERN.fullmatch(text.strip())
    if match is None:
        raise ValueError(f'"{text}" is not a key; {KEY_HELP}')
    letter, accidental, octave = match.groups()
    shift = {"": 0, "#": 1, "♯": 1, "b": -1, "♭": -1}[accidental]
    key = PITCH_CLASSES.index(letter.upper()) + shift + 12 * (int(octave) + 1)
    if not LOWEST_KEY <= key <= HIGHEST_KEY:
        raise ValueError(f'"{text}" is outside the MIDI range; give C-1 to G9')
    return key


@lru_cache(1024)
def parse_keys(text: str) -> range:
    """The keys of a range such as "A0..C8", or the one key that a text names. Raises ValueError."""
    low, separator, high = text.partition(RANGE_SEPARATOR)
    first = parse_key(low)
    last = parse_key(high) if separator else first
    if last < first:
        raise ValueError(f'"{text}" goes downwards; give the lower key first')
    return range(first, last + 1)


def name_of_copy(key: int, name: str, copy: int | None) -> str:
    """The name in the scene of what a key has: C4_string1, Fs3_hammer; `copy` from 1, None of what there is once."""
    return f"{plain_note_name(key)}_{name}{'' if copy is None else copy}"


def describe_keys(keys: list[int]) -> str:
    """Some keys, upwards, in words."""
    if keys[-1] - keys[0] + 1 == len(keys):
        return f"{note_name(keys[0])} to {note_name(keys[-1])}"
    return ", ".join(note_name(key) for key in keys)
