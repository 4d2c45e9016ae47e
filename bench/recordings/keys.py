"""Names, numbers and frequencies of keys."""

NAMES = ("C", "C#", "D", "D#", "E", "F", "F#", "G", "G#", "A", "A#", "B")


def key_name(key: int) -> str:
    """60 is C4."""
    return f"{NAMES[key % 12]}{key // 12 - 1}"


def key_number(name: str) -> int:
    """C4 is 60."""
    return 12 * (int(name[-1]) + 1) + NAMES.index(name[:-1].upper())


def key_frequency(key: int) -> float:
    """Frequency of a key in equal temperament, Hz; 69 is A4."""
    return float(440.0 * 2.0 ** ((key - 69) / 12))
