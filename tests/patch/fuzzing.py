"""Patches gone wrong in all the ways that typing, generating and merging make them go wrong."""

import random
import re

NUMBER = re.compile(r"(?<![\w.\"])[-+]?\d+(?:\.\d+)?(?:[eE][-+]?\d+)?(?![\w\"])")
# what stands in a patch instead: numbers, other values, keys, kinds
EXTREMES = """
0 -0.0 1 -1 0.5 2 3 12 30 255 256 257 1000 5000 20000 20001 3600 3600.1 1e6 1.1e6 1e9 1.1e9 1e12 1e15 1e25 1e60 1e-3
1e-6 1e-9 1e-15 9e-16 1e-60 1e-100 1e-160 1e-300 5e-324 1e100 1e160 1e300 1.7e308 1e400 nan inf -inf -1e-300 -1e300
9223372036854775807 9223372036854775808 100000000000000000000000 0xffffffffffffffffffffffff 0.1 0.25 0.999999
1.0000001 440 30000 21609 44100
"""
OTHERS = """
"x" "" true false [] [1.0] [0.1,0.2] [0.5,0.5] [[0.1,0.2]] [["a"]] [[]] {} {a=1} 1979-05-27 07:32:00 'a' "string"
["a"] [1,"a"] [0.1,0.1,0.1] "\\u0000"
"""
KEYS = """
at on on_at body kind name barrier gap bridge frets stiffness exponent loss side length density mass tension
frequency modes sigma0 sigma1 sigma_beta sigma_beta3 b3 t60 t60_at support inharmonicity bending ratios ends radius size
rigidity flexural_rigidity bending_stiffness linear_density area_density damping_rate damping_coefficient envelope band
file sigma points damping displacement velocity gravity seconds amplitude duration release start time channel gain
quantity count height width depth order substeps scheme oversample precision tolerance iterations silence
"""
KINDS = """
mass oscillator string bar membrane plate modes constant pulse half_sine pluck file strike damp change
"""
JUNK = [*"\0é\u2028\"'[]{}=#\\,\r\t.\ufeff", "\x1b[2J", '"""', "[["]


def mutated(text: str, random: random.Random) -> str:
    """A text with one to four things wrong, or odd."""
    for _ in range(random.choice([1, 1, 1, 2, 3, 4])):
        text = random.choice(CHANGES)(text, random)
    return text


def _lines(text: str, random: random.Random) -> str:
    """A line deleted, doubled, moved, or exchanged for another."""
    lines = text.split("\n")
    a, b = random.randrange(len(lines)), random.randrange(len(lines))
    kind = random.randrange(4)
    if kind == 0:
        del lines[a]
    elif kind == 1:
        lines.insert(b, lines[a])
    elif kind == 2:
        lines[a], lines[b] = lines[b], lines[a]
    else:
        lines[a] = lines[b]
    return "\n".join(lines)


def _put(text: str, random: random.Random, found: list[re.Match[str]], into: str) -> str:
    """Something else in the place of one of the matches."""
    if not found:
        return text
    chosen = random.choice(found)
    return text[: chosen.start()] + into + text[chosen.end() :]


def _number(text: str, random: random.Random) -> str:
    return _put(text, random, list(NUMBER.finditer(text)), random.choice(EXTREMES.split()))


def _factor(text: str, random: random.Random) -> str:
    """A number by some decades larger or smaller, so that it may still be in range."""
    found = list(NUMBER.finditer(text))
    if not found:
        return text
    chosen = random.choice(found)
    value = float(chosen[0]) * 10.0 ** random.uniform(-6, 6) * random.choice([1, 1, 1, -1])
    return text[: chosen.start()] + repr(value) + text[chosen.end() :]


def _type(text: str, random: random.Random) -> str:
    found = list(re.finditer(r"(?<== ).+$", text, re.MULTILINE))
    return _put(text, random, found, random.choice(OTHERS.split()))


def _key(text: str, random: random.Random) -> str:
    found = list(re.finditer(r"^\w+(?= =)", text, re.MULTILINE))
    return _put(text, random, found, random.choice(KEYS.split()))


def _kind(text: str, random: random.Random) -> str:
    found = list(re.finditer(r"(?<=kind = \")\w+", text))
    return _put(text, random, found, random.choice(KINDS.split()))


def _added(text: str, random: random.Random) -> str:
    """A key more, with a value that may fit."""
    lines = text.split("\n")
    value = random.choice(
        [random.choice(EXTREMES.split()), random.choice(OTHERS.split()), f"{10 ** random.uniform(-6, 6):g}"]
    )
    lines.insert(random.randrange(len(lines)), f"{random.choice(KEYS.split())} = {value}")
    return "\n".join(lines)


def _junk(text: str, random: random.Random) -> str:
    at = random.randrange(len(text) + 1)
    return text[:at] + random.choice(JUNK) * random.choice([1, 1, 3, 300]) + text[at:]


CHANGES = [_lines, _lines, _type, _key, _kind, _added, _added, _junk, *[_number] * 4, *[_factor] * 12]
