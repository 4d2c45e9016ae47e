"""Names, numbers and frequencies of keys; and for which MIDI velocities a layer of the recordings is played."""

LAYER_TOPS = (26, 34, 36, 43, 46, 50, 56, 64, 72, 80, 87, 94, 104, 112, 120, 127)
"""Highest MIDI velocity of layers 1 to 16, as the key map of the Salamander Grand Piano V3 has them (hivel)."""

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


def layer_velocity(layer: int) -> int:
    """MIDI velocity in the middle of those for which layer 1 to 16 is played."""
    lowest = LAYER_TOPS[layer - 2] + 1 if layer > 1 else 1
    return (lowest + LAYER_TOPS[layer - 1]) // 2
