"""Pieces of half a minute, one for each instrument: from memory what is in the public domain, and studies of ours.

A piece is a Score; `PIECES` has them by name, and bench/gallery.toml says which instrument plays which.
"""

from collections.abc import Callable, Iterable

from engine.instrument.key_names import parse_key
from engine.instrument.score import PedalMove, PlayedNote, Score, make_score

RELEASE = 64
# Bach, prelude in C, BWV 846: of each bar the five notes that it breaks
PRELUDE = [
    *("C4 E4 G4 C5 E5", "C4 D4 A4 D5 F5", "B3 D4 G4 D5 F5", "C4 E4 G4 C5 E5", "C4 E4 A4 E5 A5"),
    *("C4 D4 F#4 A4 D5", "B3 D4 G4 D5 G5", "B3 C4 E4 G4 C5", "A3 C4 E4 G4 C5"),
]
BREAK = (0, 1, 2, 3, 4, 2, 3, 4)  # which of them in turn, twice a bar
# Bach, prelude of the first suite for cello, BWV 1007, an octave higher: of each half bar the three notes
CELLO = [
    *("G3 D4 B4", "G3 D4 B4", "G3 E4 C5", "G3 E4 C5", "G3 F#4 C5", "G3 F#4 C5", "G3 G4 B4", "G3 G4 B4"),
    *("G3 E4 B4", "G3 E4 B4", "G3 D4 A4", "G3 D4 A4", "G3 C#4 A4", "F#3 D4 A4", "G3 D4 B4"),
]
NEIGHBOUR = {"B4": "A4", "C5": "B4", "A4": "G4"}
# Romance, of an unknown hand of the 19th century: melody, and the bass of each bar
ROMANCE = ["B4 B4 B4 E2", "B4 A4 G4 E2", "G4 F#4 E4 E2", "E4 G4 B4 E2", "E5 E5 E5 E2", "E5 D5 C5 E2", "C5 B4 A4 A2"]

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


def _pedals(times: Iterable[float], length: float) -> list[PedalMove]:
    """The sustain pedal down from each time on, and up shortly before the next."""
    return [
        move for t in times for move in (PedalMove(t + 0.08, "sustain", 1.0), PedalMove(t + length, "sustain", 0.0))
    ]


def prelude() -> Score:
    """Bach's prelude in C on a piano, with the pedal; a chord at the end."""
    step, notes = 0.205, list[PlayedNote]()
    for bar, chord in enumerate(PRELUDE):
        names = chord.split()
        for n in range(16):
            held = 8 * step if n % 8 < 2 else step
            swell = 62 + 3 * bar - 12 * (n % 8 > 0) + 6 * (n % 8 == 4)
            notes.append(_note((16 * bar + n) * step, names[BREAK[n % 8]], swell, held))
    end = 16 * len(PRELUDE) * step
    notes += [_note(end + 0.03 * n, name, 56, 2.5) for n, name in enumerate(("C2", "C3", "G3", "E4", "C5"))]
    return make_score(notes, _pedals([16 * step * bar for bar in range(len(PRELUDE))], 16 * step))


def cello_prelude() -> Score:
    """Bach's prelude in G for bars: an octave higher, each note let ring."""
    step, notes = 0.235, list[PlayedNote]()
    for half, chord in enumerate(CELLO):
        low, middle, high = chord.split()
        pattern = (low, middle, high, NEIGHBOUR[high], high, middle, high, middle)
        for n, name in enumerate(pattern):
            notes.append(_note((8 * half + n) * step, name, 66 + 22 * (n == 0) + 6 * (n == 2), 0.9 * step))
    end = 8 * len(CELLO) * step
    return make_score([*notes, _note(end, "G3", 80, 1.5), _note(end, "D4", 70, 1.5), _note(end, "B4", 84, 1.5)])


def romance() -> Score:
    """The Romance on a guitar: melody above, broken chords of open strings, a bass each bar."""
    beat, notes = 0.62, list[PlayedNote]()
    for bar, text in enumerate([*ROMANCE, *ROMANCE[:7]]):
        *melody, bass = text.split()
        inner = ("B3", "G3") if bass == "E2" else ("C4", "A3")
        start = 3 * beat * bar
        notes.append(_note(start, bass, 84, 3 * beat))
        for n, name in enumerate(melody):
            time = start + n * beat
            notes.append(_note(time, name, 92, beat))
            notes += [_note(time + (k + 1) * beat / 3, low, 52, 2 * beat / 3) for k, low in enumerate(inner)]
    end = 3 * beat * 14
    return make_score([*notes, *(_note(end + 0.05 * n, k, 70, 3.0) for n, k in enumerate(("E2", "B2", "E3", "B4")))])


def slow_chords() -> Score:
    """A study of ours for a vibraphone: slow chords, each under the pedal, and a line above them."""
    chords = [
        "G3 D4 F4 A4",
        "C4 E4 G4 B4",
        "F3 C4 E4 A4",
        "A#3 D4 F4 A4",
        "E4 G4 A#4 D5",
        "A3 C#4 G4 B4",
        "D4 F4 A4 C5",
    ]
    line = ["C5", "D5", "E5", "C5", "F5", "D5", "A4"]
    bar, notes = 4.0, list[PlayedNote]()
    for n, (chord, top) in enumerate(zip(chords, line, strict=True)):
        names = chord.split()
        notes += [_note(n * bar + 0.12 * k, name, 58 + 6 * k, 2.0) for k, name in enumerate(names)]
        notes += [_note(n * bar + 1.0, top, 84, 1.0), _note(n * bar + 2.0, names[3], 62, 1.0)]
        notes += [_note(n * bar + 3.0, names[2], 54, 0.8), _note(n * bar + 3.5, names[3], 50, 0.5)]
    return make_score(notes, _pedals([bar * n for n in range(len(chords))], bar))


def thumbs() -> Score:
    """A study of ours for a kalimba: both thumbs in turn, over a bass that changes every other bar."""
    figure, basses = ("G4", "E5", "A4", "D5", "G4", "C5", "E4", "D5"), ("C4", "A4", "F4", "G4")
    step, notes = 0.235, list[PlayedNote]()
    for bar in range(16):
        bass = basses[bar // 2 % 4]
        for n, name in enumerate(figure):
            time = (8 * bar + n) * step
            if n % 4 == 0:
                notes.append(_note(time, bass, 90 - 10 * (n > 0), 1.5))
            notes.append(_note(time, name if bar % 4 < 3 or n < 4 else "C6", 60 + 16 * (n % 3 == 0), 1.2))
    return make_score(notes)


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


def march() -> Score:
    """Rudiments on a snare drum: taps, flams, a roll that swells, and rim shots."""
    step, notes = 0.125, list[PlayedNote]()
    bars = ["X..x..x.X.x.x.xx", "X..x..x.X.xxx.X.", "xxxxxxxxxxxxxxxx", "X...X.x.XxxxR..."]
    for bar in range(14):
        for n, sign in enumerate(bars[bar % 4]):
            velocity = {"X": 104, "x": 52, "R": 118}.get(sign)
            if bar % 4 == 2 and velocity:
                velocity = 36 + 5 * n
            if velocity:
                time = (16 * bar + n) * step
                notes.append(_note(time, "E2" if sign == "R" else "D2", velocity, 0.1))
                if sign == "X" and n == 0:
                    notes.append(_note(max(0.0, time - 0.03), "D2", 44, 0.02))
    return make_score(notes)


def fills() -> Score:
    """Tom-toms: a figure on the low ones, and fills from high to low."""
    toms, step, notes = ("D3", "C3", "B2", "A2", "G2", "F2"), 0.14, list[PlayedNote]()
    for bar in range(13):
        for n in range(16):
            time = (16 * bar + n) * step
            if bar % 4 == 3:
                notes.append(_note(time, toms[min(5, n // 3)], 70 + 40 * (n % 3 == 0), 0.1))
            elif n in (0, 3, 6, 8, 11, 14):
                notes.append(_note(time, toms[5 - (n % 8 > 2) - 2 * (n == 14)], 64 + 44 * (n % 8 == 0), 0.1))
    return make_score(notes)


PIECES: dict[str, Callable[[], Score]] = {
    piece.__name__: piece
    for piece in (prelude, cello_prelude, romance, slow_chords, thumbs, alap, drone, greensleeves, march, fills)
}
