"""The frequencies of the keys of an instrument: in equal temperament, or as its tuning has them."""

from typing import Any

from engine.instrument.key_names import HIGHEST_KEY, LOWEST_KEY, note_frequency, parse_key

STANDARD_A4 = 440.0  # Hz


def pitch_of_a4(keyboard: dict[str, Any]) -> float:
    """Return the frequency of A4 of a keyboard, Hz."""
    return float(keyboard.get("a4", STANDARD_A4))


def frequencies_of(keyboard: dict[str, Any]) -> dict[int, float]:
    """Return the frequencies of the keys that sound, Hz."""
    own = keyboard.get("frequencies")
    if own is not None:
        return {parse_key(name): float(frequency) for name, frequency in own.items()}
    a4 = pitch_of_a4(keyboard)
    return {key: note_frequency(key, a4) for key in range(LOWEST_KEY, HIGHEST_KEY + 1)}
