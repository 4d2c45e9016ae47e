"""The events of a scene that a score is: what keys do when they are pressed and let go, and the dampers."""

from itertools import pairwise
from typing import Any, NamedTuple

from engine.bodies.table import KeyPath
from engine.instrument.held_keys import HeldKeys
from engine.instrument.key_names import note_name
from engine.instrument.key_writer import EVENT_REFERENCES, KeyWriter
from engine.instrument.score import PlayedNote, Score

FULL_VELOCITY = 127.0
UNKNOWN_RELEASE = 0.5
KEY = "key"  # the only one of which spans are computed
LATEST_EVENT = 1e-6  # s before the end, at which nothing can begin

Event = tuple[dict[str, Any], KeyPath, str]  # as in a patch; where in the patch it comes from, and the key's name


def events_of_key(writer: KeyWriter, section: str, key: int, names: dict[str, float], time: float) -> list[Event]:
    """Return the events of a scene when a key is pressed ("on") or released ("off").

    names: what formulas know of the note: v, soft, release
    """
    events: list[Event] = []
    for path, table in writer.tables_at(section, key):
        count = writer.copies_of(key, table)
        for name in EVENT_REFERENCES:
            if isinstance(table.get(name), str):
                count = writer.copies_by_name(name, key, table[name])
        for copy in [None] if count is None else range(1, count + 1):
            event = writer.table_of_copy(section, key, path, table, copy, count, names)
            later = event.get("time", 0.0)
            event["time"] = time + (later if isinstance(later, int | float) else 0.0)
            events.append((event, path, note_name(key)))
    return events


def score_events(
    writer: KeyWriter, keys: list[int], score: Score, seconds: float, is_live: bool
) -> tuple[list[Event], list[Any]]:
    """The events of a score, those of the dampers with them; and faults. Nothing begins after `seconds`."""
    before, events = len(writer.faults), list[Event]()
    notes = release_former_notes(writer, score.notes)
    for note in notes:
        soft = score.pedal_at("soft", note.time)
        pressed = {"v": note.velocity / FULL_VELOCITY, "soft": soft, "release": note.release / FULL_VELOCITY}
        events += events_of_key(writer, "on", note.key, pressed, note.time)
        events += events_of_key(writer, "off", note.key, pressed, note.end)
    for key in keys:
        if is_live:
            events += waiting_forces(writer, key)
            events += damper_events(writer, key, [Span(0.0, None, 1.0, UNKNOWN_RELEASE)])
        else:
            held = [note for note in notes if note.key == key]
            events += damper_events(writer, key, damped_spans(held, score, seconds))
    kept = [event for event in events if event[0].get("time", 0.0) < seconds - LATEST_EVENT]
    faults, writer.faults[before:] = writer.faults[before:], []
    return kept, faults


def release_former_notes(writer: KeyWriter, notes: tuple[PlayedNote, ...]) -> list[PlayedNote]:
    """The notes, shorter where a later one takes their place: of the same key, or of its group on a keyboard whose keys
    sound one at a time."""
    mono, played = writer.keyboard.get("mono"), list[PlayedNote]()
    last: dict[tuple[str, float], int] = {}
    for note in notes:
        groups = [("key", float(note.key))]
        if mono is not None:
            groups.append(("mono", writer.names(note.key).get(mono, float(note.key))))
        for group in groups:
            if group in last:
                former = played[last[group]]
                shorter = max(1e-3, min(former.duration, note.time - former.time))
                played[last[group]] = former._replace(duration=shorter)
            last[group] = len(played)
        played.append(note)
    return played


def waiting_forces(writer: KeyWriter, key: int) -> list[Event]:
    """The plucks of a key at its fullest, as forces that wait until it is pressed."""
    forces = []
    fullest = {"v": 1.0, "soft": 0.0, "release": 0.5}
    for event, path, name in events_of_key(writer, "on", key, fullest, 0.0):
        if event.get("kind") == "pluck":
            force = {k: value for k, value in event.items() if k != "time"} | {"start": 0.0}
            forces.append((force, path, name))
    return forces


# --- dampers


class Span(NamedTuple):
    """While a damper is on its strings."""

    begin: float  # s
    end: float | None  # s; None for good
    share: float  # of its force, that the sustain pedal leaves
    release: float  # how fast the key was let go, from 0 to 1


def damped_spans(notes: list[PlayedNote], score: Score, seconds: float) -> list[Span]:
    """When the damper of a key is on its strings, and how firmly. notes: of the key, in order"""
    times = {0.0, seconds, *(note.time for note in notes), *(note.end for note in notes)}
    times |= {move.time for move in score.pedals if move.name != "soft"}
    ordered = sorted(time for time in times if 0.0 <= time <= seconds)
    moves = [move for move in score.pedals if move.name != "soft"]
    held, begun, moved, last_end, spans = HeldKeys[str](), 0, 0, 0.0, list[Span]()
    for begin, end in pairwise(ordered):
        while begun < len(notes) and notes[begun].time <= begin:
            last_end = max(last_end, notes[begun].end)
            begun += 1
        held.down = {KEY} if begin < last_end else set()
        while moved < len(moves) and moves[moved].time <= begin:
            held.move_pedal(moves[moved].name, moves[moved].value)
            moved += 1
        share = held.damper_share(KEY)
        if share == 0.0:
            continue
        release = notes[begun - 1].release / FULL_VELOCITY if begun else UNKNOWN_RELEASE
        if spans and spans[-1][1:] == (begin, share, release):
            spans[-1] = spans[-1]._replace(end=end)
        else:
            spans.append(Span(begin, end, share, release))
    return spans


def damper_events(writer: KeyWriter, key: int, spans: list[Span]) -> list[Event]:
    """The events of the dampers of a key over some spans of time."""
    events: list[Event] = []
    for begin, end, share, release in spans:
        names = {"release": release, "v": 0.0, "soft": 0.0}
        for event, path, name in events_of_key(writer, "damper", key, names, begin):
            event["kind"] = "damp"
            if isinstance(event.get("sigma"), int | float):
                event["sigma"] *= share
            if end is not None:
                event["duration"] = end - begin
            events.append((event, path, name))
    return events
