"""An instrument as a plain scene: what each of some keys has is written out, and the score becomes events."""

from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import Any

from pydantic import ValidationError

from engine.bodies.table import make_fault
from engine.instrument.bent_parameters import bent_parameters, events_of_bends
from engine.instrument.key_frequencies import frequencies_of
from engine.instrument.key_names import describe_keys, note_name, parse_key, parse_keys
from engine.instrument.key_sequencer import KeyEvent, KeySequencer, Table, waiting_forces
from engine.instrument.key_writer import SECTIONS, KeyWriter, Origins
from engine.instrument.score import Score, read_score
from engine.instrument.tables import InstrumentDocument

LATEST_EVENT = 1e-6  # s before the end, at which nothing can begin
TAIL_SECONDS = 3.0  # after the last note, if the patch does not say how long it sounds
OWN_TABLES = ("keyboard", "key", "note", "pedal")  # of a document that is an instrument


@dataclass
class Expansion:
    """A plain document, and where in the patch its tables come from."""

    document: dict[str, Any]
    origins: Origins = field(default_factory=dict)
    faults: list[Any] = field(default_factory=list)


def is_instrument(document: Any) -> bool:
    """True if a document describes an instrument."""
    return isinstance(document, dict) and any(document.get(name) is not None for name in OWN_TABLES)


def keys_of(keyboard: dict[str, Any]) -> list[int]:
    """The keys of a keyboard that have a frequency, upwards. Raises ValueError."""
    frequencies = frequencies_of(keyboard)
    return [key for key in all_keys_of(keyboard) if key in frequencies]


def all_keys_of(keyboard: dict[str, Any]) -> list[int]:
    """The keys of a keyboard, upwards, with those that its tuning leaves out. Raises ValueError."""
    keys = keyboard["keys"]
    return sorted({key for text in ([keys] if isinstance(keys, str) else keys) for key in parse_keys(text)})


def expand(document: dict[str, Any]) -> Expansion:
    """Write an instrument out, as its score needs it: the bodies of the keys that are played, or of all keys where it
    has sympathetic strings and the sustain pedal is used. A document that cannot be read so is returned as it is, for
    the faults of its structure."""
    try:
        InstrumentDocument.model_validate(document)
    except ValidationError:  # which the scene will report
        return Expansion(document)
    score, keys = read_score(document), keys_of(document["keyboard"])
    if not keys:
        message, remedy = "no key has a frequency", "a tuning of some of its keys"
        return Expansion(document, faults=[make_fault(("keyboard",), None, message, remedy)])
    silent = set(all_keys_of(document["keyboard"])) - set(keys)
    score = score.without_keys(silent)
    if not score.notes:
        score = score.with_middle_note(keys)
    expansion = Expansion(document)
    expansion.faults += _check_score(score, keys)
    return expansion if expansion.faults else expand_keys(document, keys_needed(document, score), score)


def expand_for_score(document: dict[str, Any], score: Score) -> Expansion:
    """Write out an instrument for another score than that of its document, which may end before its other events."""
    seconds = document.get("seconds")
    seconds = score.end + TAIL_SECONDS if seconds is None else seconds
    events = [event for event in document.get("event") or [] if event.get("time", 0.0) < seconds]
    document = document | {"seconds": seconds, "event": events}
    return expand_keys(document, keys_needed(document, score), score)


def keys_needed(document: dict[str, Any], score: Score) -> list[int]:
    """The keys whose bodies a score needs."""
    wants_all = document["keyboard"].get("sympathetic") and score.uses_sustain()
    return keys_of(document["keyboard"]) if wants_all else sorted({note.key for note in score.notes})


def expand_keys(document: dict[str, Any], keys: list[int], score: Score, is_live: bool = False) -> Expansion:
    """Write out what some keys have, with the events of a score.

    is_live: plucks are forces that wait, and dampers stay down until they are lifted
    """
    writer = KeyWriter(document)
    writer.check_formulas()
    for key in keys:
        writer.write_key(key)
    plain = {name: value for name, value in document.items() if name not in SECTIONS}
    expansion = Expansion(plain | writer.sections, writer.origins, writer.faults)
    if plain.get("seconds") is None:
        plain["seconds"] = expansion.document["seconds"] = score.end + TAIL_SECONDS
    added: dict[str, list[Any]] = {name: list(document.get(name) or []) for name in ("event", "force")}
    known = len(writer.faults)
    tables = {"force": [one for key in keys for one in waiting_forces(writer, key)] if is_live else []}
    tables["event"] = score_events(writer, keys, Score() if is_live else score, plain["seconds"])
    if any(note.bend for note in score.notes) and not is_live:
        bent = list(bent_parameters(writer.sections["body"], keys))
        expansion.faults += _check_bends(score, {one.key for one in bent})
        tables["event"] += events_of_bends(bent, score.notes, plain["seconds"] - LATEST_EVENT)
    faults, writer.faults[known:] = writer.faults[known:], []
    for section, written in tables.items():
        for table, origin, name in written:
            expansion.origins[section, len(added[section])] = (origin, name)
            added[section].append(table)
    expansion.document |= {name: tables for name, tables in added.items() if tables}
    expansion.faults += faults
    return expansion


def score_events(writer: KeyWriter, keys: list[int], score: Score, seconds: float) -> list[Table]:
    """Return the events of a score, those of keys at rest with them. Nothing begins after `seconds`."""
    sequencer, known = KeySequencer(writer, keys), set(keys)
    events: list[Table | None] = []  # None: it was cancelled
    of_notes: dict[int, list[int]] = {}  # places of events that may be cancelled, by their notes

    def add(begin: float, event: KeyEvent) -> None:
        later = event.table.get("time", 0.0)
        time = begin + (later if isinstance(later, int | float) else 0.0)
        if event.note:
            of_notes.setdefault(event.note, []).append(len(events))
        is_heard = time < seconds - LATEST_EVENT
        events.append((event.table | {"time": time}, event.path, event.key) if is_heard else None)

    for event in sequencer.rest():
        add(0.0, event)
    for message in score.messages():
        if message.kind in ("on", "off") and message.key not in known:
            continue
        for one in sequencer.take(message):
            if isinstance(one, KeyEvent):
                add(message.time, one)
                continue
            for n in of_notes.pop(one.note, []):
                table = events[n]
                events[n] = table if table is not None and table[0]["time"] < message.time else None
    return [event for event in events if event is not None]


def _check_score(score: Score, keys: list[int]) -> Iterator[Any]:
    """The faults of notes for which there is no key."""
    known = set(keys)
    for i, note in enumerate(score.notes):
        if note.key not in known:
            message = f"the instrument has no key {note_name(note.key)}"
            yield make_fault(("note", i, "key"), note_name(note.key), message, f"{describe_keys(keys)}")


def _check_bends(score: Score, bent: set[int]) -> Iterator[Any]:
    """The faults of notes that bend, but whose keys cannot."""
    for i, note in enumerate(score.notes):
        if note.bend and note.key not in bent:
            message = f"the key {note_name(note.key)} has no body with a frequency or a tension"
            yield make_fault(("note", i, "bend"), list(note.bend), message, "leave the bend out")


def parse_key_of(document: dict[str, Any], text: str) -> int:
    """A key of an instrument by its name or number. Raises ValueError."""
    key = int(text) if text.isdecimal() else parse_key(text)
    keys = keys_of(document["keyboard"])
    if key not in keys:
        raise ValueError(f"the instrument has no key {text}; {describe_keys(keys)}")
    return key
