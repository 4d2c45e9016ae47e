"""Pieces of the gallery, 30 to 60 s each: works in the public domain, and studies of ours.

Most are text, in bench/pieces (bench/publish/notation.py says how it is written and performed); three are functions
here. bench/gallery.toml says which instrument plays which.
"""

from collections.abc import Callable
from pathlib import Path

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


def _note(time: float, name: str, velocity: float, duration: float) -> PlayedNote:
    return PlayedNote(time, parse_key(name), max(1, min(127, round(velocity))), duration, RELEASE)


def alap() -> Score:
    """A study of ours for a sitar: slow notes that settle on the tonic, then faster strokes."""
    slow = ["C3", "E3", "F#3", "G3", "A3", "B3", "C4", "B3", "G3", "E3", "D3", "C3"]
    times = [0.0, 1.4, 2.3, 2.8, 4.4, 5.2, 5.8, 8.0, 8.8, 9.8, 10.8, 11.4]
    notes = [_note(t, name, 74, 2.0) for t, name in zip(times, slow, strict=True)]
    fast = [
        "C3",
        "C3",
        "E3",
        "G3",
        "F#3",
        "E3",
        "D3",
        "E3",
        "C3",
        "G3",
        "A3",
        "B3",
        "C4",
        "C4",
        "B3",
        "A3",
        "G3",
        "F#3",
        "E3",
        "D3",
    ]
    for n in range(60):
        notes.append(_note(14.0 + 0.23 * n, fast[n % len(fast)], 64 + 24 * (n % 4 == 0) + 10 * (n % 4 == 2), 0.23))
    return make_score([*notes, _note(28.2, "C3", 90, 3.0)])


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
