"""Notes of a MIDI file as the score of an instrument."""

from pathlib import Path
from typing import NamedTuple

from pydantic import ValidationError

from engine.instrument.expansion import expand_for_score, keys_of
from engine.instrument.key_names import note_name
from engine.instrument.score import PedalMove, PlayedNote, Score, make_score
from engine.live.key_bends import KeyBends, bend_events, bent_parameters
from engine.live.midi_notes import MidiError, Note, read_notes
from engine.patch.scene import Scene
from engine.patch.tables import MAX_SECONDS


class PlayedFile(NamedTuple):
    """A MIDI file as a scene, and what of the file is not in it."""

    scene: Scene
    score: Score
    refused: list[str]  # keys that the instrument has not
    ignored: dict[str, int]  # messages, by what they are


def scene_of_file(scene: Scene, path: Path) -> PlayedFile:
    """An instrument that plays a MIDI file. Raises MidiError, ValidationError."""
    document = scene.instrument
    if document is None:
        raise MidiError("the patch is not an instrument: it has no [keyboard]")
    notes, ignored, _ = read_notes(path, scene.midi)
    score, known = score_of_notes(notes), set(keys_of(document["keyboard"]))
    refused = sorted({note.key for note in score.notes} - known)
    score = make_score([note for note in score.notes if note.key in known], score.pedals)
    if not score.notes:
        raise MidiError(f"{path} has no note for any key of the instrument")
    if score.end > MAX_SECONDS:
        raise MidiError(f"{path} lasts {score.end:.0f} s; at most {MAX_SECONDS:g}")
    try:
        expansion = expand_for_score(document | {"seconds": None}, score)
        if count := sum(note.kind == "bend" for note in notes):
            bends = KeyBends(list(bent_parameters(expansion.document["body"], known)))
            expansion.document["event"] = [*expansion.document.get("event", []), *bend_events(bends, notes)]
            ignored = ignored if bends.parameters else ignored | {"pitch bend": count}
        played = scene.with_expansion(expansion)
    except ValidationError as error:
        raise MidiError(f"{path} cannot be played ({error.errors()[0]['msg']})") from None
    return PlayedFile(played, score, [note_name(key) for key in refused], ignored)


def score_of_notes(notes: list[Note]) -> Score:
    """The notes and pedals of messages; a key that is never let go is held to the last message."""
    end = max((note.seconds for note in notes), default=0.0)
    begun: dict[int, Note] = {}
    played, moves = list[PlayedNote](), list[PedalMove]()

    def finish(number: int, seconds: float, release: float) -> None:
        note = begun.pop(number, None)
        if note is not None:
            duration = max(1e-3, seconds - note.seconds)
            played.append(PlayedNote(note.seconds, number, int(note.value), duration, int(release)))

    for note in notes:
        if note.kind == "on":
            finish(note.number, note.seconds, 64)
            begun[note.number] = note
        elif note.kind == "off":
            finish(note.number, note.seconds, note.value)
        elif note.kind != "bend":
            moves.append(PedalMove(note.seconds, note.kind, note.value / 127.0))
    for number in list(begun):
        finish(number, end + 1.0, 64)
    return make_score(played, moves)
