"""Numbers and units as pages and messages have them."""

import math
import re

UNITS = (
    *("m", "m³", "kg", "s", "Hz", "N", "dB", "m/s", "m/s²", "m²/s", "m³/s", "1/s", "s/m", "1/√kg", "cents"),
    *("kg/m", "kg/m²", "kg/m³", "kg/s", "N/m", "N·m", "N·m²", "N/m^exponent", "Pa", "rad"),
)
UNIT_PATTERN = re.compile(rf", ({'|'.join(map(re.escape, sorted(UNITS, key=len, reverse=True)))})(?=[;:,]|$)")


def split_unit(description: str) -> tuple[str, str]:
    """Split a description in its meaning and its unit, which is "" where it has none."""
    unit = UNIT_PATTERN.search(description)
    return (description, "") if unit is None else (description[: unit.start()] + description[unit.end() :], unit[1])


def format_number(number: float) -> str:
    """A number as one writes it: 0.12, 1e-15, 20000, 4.5e9."""
    if math.isinf(number):
        return f"{number:g}"
    mantissa, exponent = f"{number:.9e}".split("e")
    scientific = f"{mantissa.rstrip('0').rstrip('.')}e{int(exponent)}"
    plain = f"{number:.10g}"
    return scientific if "e" in plain or len(plain) > len(scientific) + 2 else plain
