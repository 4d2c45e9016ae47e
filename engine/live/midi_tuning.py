"""MIDI Tuning Standard (MIDI Manufacturers Association, 1996 and 1999): system exclusive messages that tune keys, while
they sound, too."""

from collections.abc import Iterable, Iterator, Sequence

from engine.instrument.key_names import HIGHEST_KEY

UNIVERSAL = 0x7E, 0x7F  # first byte: of any maker, later or at once
TUNING = 0x08
BULK, SINGLE, BULK_OF_BANK, SINGLE_OF_BANK, OCTAVE, FINE_OCTAVE = 0x01, 0x02, 0x04, 0x07, 0x08, 0x09
NAME_BYTES = 16
UNCHANGED = (0x7F, 0x7F, 0x7F)
SEMITONE = 1 << 14  # of a fraction
CLASSES = 12  # of pitch, C first

Cents = dict[int, float]  # by key: above its frequency in equal temperament, with A4 = 440 Hz


def is_tuning(data: Sequence[int]) -> bool:
    """True if a system exclusive message tunes keys. data: without its first and last byte"""
    return len(data) > 4 and data[0] in UNIVERSAL and data[2] == TUNING


def read_tuning_message(data: Sequence[int]) -> Cents:
    """Return the keys that a message tunes; none if it is cut off, or asks for something else. data: as of
    `is_tuning`"""
    if not is_tuning(data):
        return {}
    kind, rest = data[3], list(data[4:])
    if kind in (SINGLE, SINGLE_OF_BANK):
        rest = rest[1:] if kind == SINGLE_OF_BANK else rest
        groups = _groups(rest[2:], 4)
        return dict(_tuned((key, tuple(pitch)) for key, *pitch in groups[: rest[1] if len(rest) > 1 else 0]))
    if kind in (BULK, BULK_OF_BANK):
        rest = rest[1 + (kind == BULK_OF_BANK) + NAME_BYTES :]
        return dict(_tuned((key, tuple(pitch)) for key, pitch in enumerate(_groups(rest, 3)[: HIGHEST_KEY + 1])))
    if kind == OCTAVE and len(rest) >= 3 + CLASSES:
        return {key: float(rest[3 + key % CLASSES] - 64) for key in range(HIGHEST_KEY + 1)}
    if kind == FINE_OCTAVE and len(rest) >= 3 + 2 * CLASSES:
        steps = [(high << 7 | low) - 8192 for high, low in _groups(rest[3:], 2)]
        return {key: 100.0 * steps[key % CLASSES] / 8192 for key in range(HIGHEST_KEY + 1)}
    return {}


def _groups(data: Sequence[int], size: int) -> list[list[int]]:
    """The bytes in groups; those that make no whole one are left out."""
    return [list(data[n : n + size]) for n in range(0, len(data) - size + 1, size)]


def _tuned(pitches: Iterable[tuple[int, tuple[int, ...]]]) -> Iterator[tuple[int, float]]:
    """The keys that have a new pitch: a semitone and a fraction of one."""
    for key, (semitone, high, low) in pitches:
        if (semitone, high, low) != UNCHANGED:
            yield key, 100.0 * (semitone - key + (high << 7 | low) / SEMITONE)
