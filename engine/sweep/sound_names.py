"""Names of the sounds of a sweep: what is varied can be read in them, on every file system and in every program."""

import re
import string
from collections.abc import Iterable, Mapping

from engine.instrument.key_names import parse_key, plain_note_name
from engine.sweep.axes import Value

OTHER_CHARACTERS = re.compile(r"[^A-Za-z0-9_-]+")  # of a name, which shells, programs or SFZ players may stumble over
FORBIDDEN = re.compile(r'[\x00-\x1f/\\:*?"<>|]')  # in names of files, by one system or another
MAX_STEM_CHARACTERS = 76  # of a name of 80 with its ending
MAX_LABEL_CHARACTERS = 32  # of the path of a value, of which the end says more
MAX_VALUE_CHARACTERS = 20
MAX_TEMPLATE_CHARACTERS = 200  # of a name that an option makes
VALUE_DIGITS = 6  # index.csv has all
MAX_NUMBER = 1e300  # larger integers are no floats
EXPONENT = re.compile(r"e\+?(-?)0*(?=\d)")


def sound_name(number: int, values: Iterable[tuple[str, Value]]) -> str:
    """The name of the audio file of a point, by its number and its values by their paths:
    0001_felt_stiffness_1e7_hammer_velocity_2.wav. Values that would make it too long are left out."""
    return f"{point_stem(number, values)}.wav"


def point_stem(number: int, values: Iterable[tuple[str, Value]]) -> str:
    """The name of a point's audio file, without its ending."""
    stem = f"{number:04d}"
    for path, value in values:
        longer = f"{stem}_{short_path(path)}_{short_value(value)}"
        if len(longer) > MAX_STEM_CHARACTERS:
            break
        stem = longer
    return stem


def short_path(path: str) -> str:
    """The path of a value without its table: felt_stiffness for contact.felt.stiffness."""
    rest = path.partition(".")[2]
    return plain_text(rest if "." in rest and not rest[0].isdecimal() else path)[-MAX_LABEL_CHARACTERS:]


def short_value(value: Value) -> str:
    """A value in few characters: 1e7 for 10000000.0, 0p05 for 0.05."""
    if isinstance(value, str) or abs(value) > MAX_NUMBER:
        return plain_text(str(value))[:MAX_VALUE_CHARACTERS]
    return without_dots(EXPONENT.sub(lambda found: f"e{found[1]}", f"{value:.{VALUE_DIGITS}g}"))


def without_dots(text: str) -> str:
    """A number without its dot, at which some programs end a name: 0p05."""
    return text.replace(".", "p")


def note_file_name(stem: str, note: str, velocity: int) -> str:
    """The name of the audio file of a note: piano_Cs4_v096.wav."""
    return f"{stem}_{plain_note_name(parse_key(note))}_v{velocity:03d}.wav"


def plain_text(text: str) -> str:
    """A text with nothing in it that would have to be quoted."""
    return OTHER_CHARACTERS.sub("_", text) or "_"


def is_name_of_number(name: str, number: int) -> bool:
    """True if a sweep may have given a name to the sound of a point, with any values."""
    begin, rest = f"{number:04d}_", name.removesuffix(".wav")
    return name.endswith(".wav") and rest.startswith(begin) and not OTHER_CHARACTERS.search(re.sub("[=.]", "", rest))


def is_plain_name(name: str) -> bool:
    """True if a name is that of a sound in the folder of a sweep, and leads nowhere else."""
    is_short = 4 < len(name) <= MAX_TEMPLATE_CHARACTERS + 4
    return is_short and name.endswith(".wav") and name[0] != "." and not FORBIDDEN.search(name)


def fill_name(template: str, fields: Mapping[str, Value]) -> str:
    """The name of an audio file as a template says it: "Bowl_{number:02}_{rim.velocity:.1f}". fields: values by name.
    Raises ValueError, with the fields there are."""
    parts = []
    try:
        parsed = list(string.Formatter().parse(template.removesuffix(".wav")))
    except ValueError as error:
        raise ValueError(f'"{template}" is not a name ({error}); write a field as {{number}}') from None
    for text, field, form, _ in parsed:
        parts.append(text)
        if field is None:
            continue
        if field not in fields:
            raise ValueError(f'there is no field "{field}"; the fields are {", ".join(fields)}')
        try:
            filled = format(fields[field], form or "")
        except (ValueError, TypeError):
            raise ValueError(f"{{{field}:{form}}} does not fit {fields[field]!r}; give {{{field}}}") from None
        parts.append(without_dots(filled) if isinstance(fields[field], int | float) else plain_text(filled))
    stem = "".join(parts)
    if (found := FORBIDDEN.search(stem)) or not stem or stem[0] in ". " or len(stem) > MAX_TEMPLATE_CHARACTERS:
        why = f"has {found[0]!r} in it" if found else "is empty, too long, or begins with a dot or a space"
        raise ValueError(f'"{stem}" cannot be the name of a file: it {why}')
    return f"{stem}.wav"
