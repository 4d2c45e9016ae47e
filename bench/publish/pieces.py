"""Pieces of the gallery, 30 to 60 s each: works in the public domain, and studies of ours.

Most are text, in bench/pieces (bench/publish/notation.py says how it is written and performed); three are functions
here. bench/gallery.toml says which instrument plays which.
"""

from collections.abc import Callable
from pathlib import Path

import numpy as np

from bench.publish.notation import Piece, read_piece
from engine.instrument.key_names import parse_key
from engine.instrument.score import PlayedNote, Score, make_score

TEXTS = Path(__file__).parents[1] / "pieces"
RELEASE = 64
# Greensleeves, English, about 1580: notes, and how many eighths each lasts
GREENSLEEVES = (
    "A4 1  C5 2 D5 1 E5 1.5 F5 .5 E5 1  D5 2 B4 1 G4 1.5 A4 .5 B4 1 "
    "C5 2 A4 1 A4 1.5 G#4 .5 A4 1  B4 2 G#4 1 E4 2 A4 1 "
    "C5 2 D5 1 E5 1.5 F5 .5 E5 1  D5 2 B4 1 G4 1.5 A4 .5 B4 1 "
    "C5 1.5 B4 .5 A4 1 G#4 1.5 F#4 .5 G#4 1  A4 6 "
    "G5 3 G5 1.5 F#5 .5 E5 1  D5 2 B4 1 G4 1.5 A4 .5 B4 1 "
    "C5 2 A4 1 A4 1.5 G#4 .5 A4 1  B4 2 G#4 1 E4 3 "
    "G5 3 G5 1.5 F#5 .5 E5 1  D5 2 B4 1 G4 1.5 A4 .5 B4 1 "
    "C5 1.5 B4 .5 A4 1 G#4 1.5 F#4 .5 G#4 1  A4 5"
)


Bend = tuple[tuple[float, float], ...]  # s after the press, and semitones

# s, key, MIDI velocity, s, and how far the string is pulled, of slow notes in the scale of Yaman
ALAP: tuple[tuple[float, str, float, float, Bend], ...] = (
    (0.0, "C3", 72, 1.9, ()),
    (1.9, "E3", 66, 1.6, ((0.35, 0), (0.6, 2), (1.1, 2), (1.4, 0))),
    (3.5, "D3", 70, 1.5, ((0, 2), (0.3, 2), (0.65, 0))),
    (5.0, "C3", 64, 1.3, ()),
    (6.3, "E3", 74, 1.0, ((0.25, 0), (0.45, 3), (0.9, 3))),
    (7.3, "G3", 78, 1.8, ((0.6, 0), (0.8, 2), (1.2, 2), (1.5, 0))),
    (9.1, "A3", 80, 1.7, ((0.3, 0), (0.5, 2), (0.8, 2), (1.0, 3), (1.5, 3))),
    (10.8, "C4", 84, 2.2, ((1.0, 0), (1.08, 0.5), (1.16, 0), (1.24, 0.5), (1.32, 0))),
    (13.0, "B3", 70, 0.9, ((0, 1), (0.2, 1), (0.45, 0))),
    (13.9, "A3", 66, 1.1, ((0, 2), (0.25, 2), (0.5, 0))),
    (15.0, "F#3", 68, 1.2, ((0.2, 0), (0.35, 1), (0.7, 1), (0.95, 0))),
    (16.2, "D3", 66, 1.3, ((0, 2), (0.3, 2), (0.6, 0))),
    (17.5, "C3", 72, 1.6, ()),
    (30.1, "E3", 86, 1.3, ((0.2, 0), (0.4, 3), (0.7, 3), (1.0, 0))),
    (31.4, "C3", 92, 3.0, ()),
)
STROKES = (  # faster, between them
    "C3 C3 E3 G3 F#3 E3 D3 E3  C3 E3 F#3 G3 A3 B3 C4 C4  D4 C4 B3 A3 G3 F#3 E3 D3 "
    "E3 G3 B3 C4 D4 E4 D4 C4  B3 C4 A3 B3 G3 A3 F#3 G3  E3 F#3 D3 E3 C3 C3 C3 C3"
)


def _note(time: float, name: str, velocity: float, duration: float, bend: Bend = ()) -> PlayedNote:
    return PlayedNote(time, parse_key(name), max(1, min(127, round(velocity))), duration, RELEASE, bend)


def alap() -> Score:
    """A study of ours for a sitar: slow notes whose string is pulled from tone to tone, then faster strokes."""
    player, beat = np.random.default_rng(7), 0.22
    notes = [_note(*one) for one in ALAP]
    for n, name in enumerate(STROKES.split()):
        accent = 24 * (n % 8 == 0) + 12 * (n % 8 in (3, 6)) + 0.3 * n
        time = 19.3 + beat * n + player.normal(0.0, 0.007)
        notes.append(_note(time, name, 58 + accent + player.normal(0.0, 3.0), beat))
    return make_score(notes)


def drone() -> Score:
    """The four strings of a tanpura in turn, as they are played for hours."""
    notes = []
    for turn in range(7):
        for n, (time, name) in enumerate(((0.0, "G2"), (1.2, "C3"), (1.8, "C3"), (2.4, "C2"))):
            notes.append(_note(4.2 * turn + time, name, 80 - 6 * (n == 3), 4.0))
    return make_score(notes)


def greensleeves() -> Score:
    """Greensleeves on a violin, each note joined to the next; the second half louder."""
    eighth, time, notes = 0.3, 0.0, list[PlayedNote]()
    words = GREENSLEEVES.split()
    for n, (name, eighths) in enumerate(zip(words[::2], words[1::2], strict=True)):
        length = eighth * float(eighths)
        swell = 60 + 22 * (2 * n > len(words) // 2) + 10 * (float(eighths) >= 2)
        notes.append(_note(time, name, swell, length))
        time += length
    return make_score(notes)


STUDIES: tuple[Callable[[], Score], ...] = (alap, drone, greensleeves)
PIECES: dict[str, Piece] = {path.stem: read_piece(path) for path in sorted(TEXTS.glob("*.toml"))}
PIECES |= {study.__name__: Piece((study.__doc__ or "").rstrip("."), {"": study()}) for study in STUDIES}
