"""Notes of a MIDI file as the score of an instrument."""

import math
from collections import Counter
from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple

from engine.instrument.bent_parameters import bent_parameters
from engine.instrument.expansion import expand_for_score, keys_of
from engine.instrument.key_frequencies import frequencies_of
from engine.instrument.key_names import note_name
from engine.instrument.key_sequencer import FULL_VELOCITY, Message
from engine.instrument.score import PedalMove, PlayedNote, Score, make_score
from engine.instrument.tables import drum_keys
from engine.live.key_bends import KeyBends, bend_events
from engine.live.midi_drivers import MidiError
from engine.live.midi_files import HELD_SECONDS, MidiNotes, read_notes, read_parts
from engine.live.midi_notes import NOT_OF_SCORE, PITCH_KINDS, UNKNOWN_RELEASE, Note, NothingToPlay
from engine.live.midi_parts import ALL_NOTES, Excerpt
from engine.live.rig_keys import RigChoice, merge_counts
from engine.patch.rig import Rig
from engine.patch.scene import Scene, join_scenes
from engine.patch.scene_tables import MAX_EVENTS
from engine.patch.tables import MAX_SECONDS


class PlayedFile(NamedTuple):
    """A MIDI file as a scene, and what of the file is not in it."""

    scene: Scene
    score: Score
    refused: list[str]  # keys that the instrument has not
    ignored: dict[str, int]  # messages, by what they are
    file: MidiNotes


def scene_of_file(scene: Scene, path: Path, excerpt: Excerpt = ALL_NOTES) -> PlayedFile:
    """An instrument, or a rig, that plays a MIDI file. Raises MidiError, PatchError if the patch has an error at a
    key."""
    if scene.rig is not None:
        return _rig_of_file(scene, scene.rig, path, excerpt)
    if scene.instrument is None:
        raise MidiError("the patch is not an instrument: it has no [keyboard]")
    file = read_notes(path, scene.midi, excerpt=excerpt, drums=drum_keys(scene.instrument))
    played = _play_notes(scene, path, file.notes, file.end, excerpt.seconds)
    if played is None:
        raise NothingToPlay(f"{path} has no note for any key of the instrument")
    programs = sum(note.kind == "program" for note in file.notes)
    ignored = merge_counts([file.ignored, played.ignored, {"program change": programs} if programs else {}])
    return PlayedFile(played.scene, played.score, played.refused, ignored, file)


class PlayedPart(NamedTuple):
    """An instrument that plays notes."""

    scene: Scene
    score: Score
    refused: list[str]
    ignored: dict[str, int]


def _play_notes(scene: Scene, path: Path, notes: list[Note], end: float, seconds: float | None) -> PlayedPart | None:
    """Let an instrument play notes of a file, which ends at a time (s), for so many seconds; None if it has none of the
    keys. Raises MidiError."""
    document = scene.instrument or {}
    score, known = score_of_notes(notes, end), set(keys_of(document["keyboard"]))
    refused = sorted({note.key for note in score.notes} - known)
    score = replace(score, notes=tuple(note for note in score.notes if note.key in known))
    if not score.notes:
        return None
    if score.end > MAX_SECONDS:
        limit = f"{MAX_SECONDS:g}"
        raise MidiError(f"{path} lasts {score.end:.0f} s; the limit is {limit} s: give --seconds {limit}")
    expansion, ignored = expand_for_score(document | {"seconds": seconds}, score), dict[str, int]()
    if count := sum(note.kind in PITCH_KINDS for note in notes):
        frequencies = frequencies_of(document["keyboard"])
        bends = KeyBends(list(bent_parameters(expansion.document["body"], known)), frequencies)
        expansion.document["event"] = [*expansion.document.get("event", []), *bend_events(bends, notes)]
        ignored = {} if bends.parameters else {"pitch bend": count}
    check_events(path, expansion.document.get("event", []), score)
    return PlayedPart(scene.with_expansion(expansion), score, [note_name(key) for key in refused], ignored)


def _rig_of_file(scene: Scene, rig: Rig, path: Path, excerpt: Excerpt) -> PlayedFile:
    """A rig that plays a MIDI file. Raises MidiError, PatchError."""
    if excerpt.parts is None and not excerpt.channels and not excerpt.tracks:  # drums too, as a part may be one of them
        excerpt = replace(excerpt, parts=frozenset(part.key for part in read_parts(path, scene.midi).parts))
    file, choice = read_notes(path, scene.midi, excerpt=excerpt), RigChoice(rig.members)
    notes: dict[str, list[Note]] = {member.name: [] for member in rig.members}
    for note in file.notes:
        for member, one in choice.divide(note):
            notes[member.name].append(one)
    sounding = dict[str, PlayedPart]()
    for member in rig.members:
        part = _play_notes(member.scene, path, notes[member.name], file.end, excerpt.seconds)
        if part is not None:
            sounding[member.name] = part
    if not sounding:
        raise NothingToPlay(f"{path} has no note for any part of the rig")
    members = tuple(member for member in rig.members if member.name in sounding)
    heard = Rig(rig.tables.model_copy(update={"seconds": None}), members)
    joined = join_scenes(heard, [part.scene for part in sounding.values()])
    refused = [f"{name} {key}" for name, part in sounding.items() for key in part.refused]
    score = make_score(note for part in sounding.values() for note in part.score.notes)
    ignored = merge_counts([file.ignored, *(part.ignored for part in sounding.values())])
    return PlayedFile(joined, score, refused, ignored, file)


def check_events(path: Path, events: list[dict[str, Any]], score: Score) -> None:
    """Raise MidiError if a scene cannot hold all events of a score, with how much of it a scene can hold."""
    if len(events) <= MAX_EVENTS:
        return
    times = sorted(event.get("time", 0.0) for event in events)
    seconds = math.floor(times[MAX_EVENTS] * 10.0) / 10.0
    notes = sum(note.time < seconds for note in score.notes)
    raise MidiError(
        f"{path} has {len(events)} events of keys and dampers; the limit is {MAX_EVENTS}, which the first {notes}"
        f" of its {len(score.notes)} notes reach after {seconds:g} s: give --seconds {seconds:g}"
    )


def score_of_notes(notes: list[Note], end: float | None = None) -> Score:
    """The notes and pedals of messages; a key that is never let go is held to the end, which is a second after the last
    message if it is None. A key is held until all parts of a file have let it go as often as they have pressed it."""
    if end is None:
        end = max((note.seconds for note in notes), default=0.0) + HELD_SECONDS
    begun: dict[tuple[int, int], Note] = {}
    presses = Counter[tuple[int, int]]()  # how often a part has pressed a key that it holds
    played, moves = list[PlayedNote](), list[PedalMove]()

    def finish(key: tuple[int, int], seconds: float, release: float) -> None:
        note = begun.pop(key, None)
        if note is not None:
            played.append(PlayedNote(note.seconds, note.number, int(note.value), seconds - note.seconds, int(release)))

    for note in notes:
        key = note.part, note.number
        if note.kind == "on":
            finish(key, note.seconds, UNKNOWN_RELEASE)
            begun[key] = note
            presses[key] += 1
        elif note.kind == "off":
            presses[key] = max(0, presses[key] - 1)
            if not presses[key]:
                finish(key, note.seconds, note.value)
        elif note.kind == "silence":
            for one in [one for one, on in begun.items() if note.channels.channel in on.channels.followed()]:
                presses[one] = 0
                finish(one, note.seconds, UNKNOWN_RELEASE)
        elif note.kind not in NOT_OF_SCORE:
            moves.append(PedalMove(note.seconds, note.kind, note.value / FULL_VELOCITY))
    messages = [message_of_note(note) for note in notes if note.kind not in NOT_OF_SCORE]
    for part, number in list(begun):
        finish((part, number), end, UNKNOWN_RELEASE)
        off = Message(end, "off", number, UNKNOWN_RELEASE / FULL_VELOCITY, part)
        messages += [off] * presses[part, number]
    return replace(make_score(played, moves), played=tuple(messages))


def message_of_note(note: Note) -> Message:
    """Return a message of MIDI as keys understand it."""
    value, channels = note.value / FULL_VELOCITY, note.channels.followed()
    return Message(note.seconds, note.kind, note.number, value, note.part, channels)
