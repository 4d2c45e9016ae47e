"""Names of the sounds of a sweep: what is varied can be read in them, on every file system."""

import re
from collections.abc import Iterable

from engine.instrument.key_names import parse_key, plain_note_name
from engine.sweep.axes import Value

OTHER_CHARACTERS = re.compile(r"[^A-Za-z0-9_.-]+")  # of a file name, which shells or SFZ players may stumble over
MAX_STEM_CHARACTERS = 100  # of a name; file systems take 255, but paths have limits, too
MAX_LABEL_CHARACTERS = 32  # of the path of a value, of which the end says more
MAX_VALUE_CHARACTERS = 20
VALUE_DIGITS = 6  # index.csv has all
MAX_NUMBER = 1e300  # larger integers are no floats
EXPONENT = re.compile(r"e\+?(-?)0*(?=\d)")


def sound_name(number: int, values: Iterable[tuple[str, Value]]) -> str:
    """The name of the audio file of a point, by its number and its values by their paths:
    0001_felt.stiffness=1e7_hammer.velocity=2.wav. Values that would make it too long are left out."""
    return f"{point_stem(number, values)}.wav"


def point_stem(number: int, values: Iterable[tuple[str, Value]]) -> str:
    """The name of a point's audio file, without its ending."""
    stem = f"{number:04d}"
    for path, value in values:
        longer = f"{stem}_{short_path(path)}={short_value(value)}"
        if len(longer) > MAX_STEM_CHARACTERS:
            break
        stem = longer
    return stem


def short_path(path: str) -> str:
    """The path of a value without its table: felt.stiffness for contact.felt.stiffness."""
    rest = path.partition(".")[2]
    return plain_text(rest if "." in rest and not rest[0].isdecimal() else path)[-MAX_LABEL_CHARACTERS:]


def short_value(value: Value) -> str:
    """A value in few characters: 1e7 for 10000000.0."""
    if isinstance(value, str) or abs(value) > MAX_NUMBER:
        return plain_text(str(value))[:MAX_VALUE_CHARACTERS]
    return EXPONENT.sub(lambda found: f"e{found[1]}", f"{value:.{VALUE_DIGITS}g}")


def note_file_name(stem: str, note: str, velocity: int) -> str:
    """The name of the audio file of a note: piano_Cs4_v096.wav."""
    return f"{stem}_{plain_note_name(parse_key(note))}_v{velocity:03d}.wav"


def plain_text(text: str) -> str:
    """A text with nothing in it that would have to be quoted."""
    return OTHER_CHARACTERS.sub("_", text) or "_"


def is_name_of_number(name: str, number: int) -> bool:
    """True if a sweep may have given a name to the sound of a point, with any values."""
    begin, rest = f"{number:04d}_", name.removesuffix(".wav")
    return name.endswith(".wav") and rest.startswith(begin) and not OTHER_CHARACTERS.search(rest.replace("=", ""))
