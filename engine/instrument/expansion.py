"""An instrument as a plain scene: what each of some keys has is written out, and the score becomes events."""

import math
from collections.abc import Iterator
from dataclasses import dataclass, field
from functools import lru_cache
from typing import Any

from engine.bodies.table import KeyPath, is_number, make_fault
from engine.instrument.key_names import name_of_copy, note_name, parse_key, parse_keys
from engine.instrument.key_values import KeyValueError, names_of_key, value_at_key
from engine.instrument.score import Score, read_score, score_events
from engine.instrument.tables import Keyboard

SECTIONS = ("body", "contact", "connection", "pickup")  # of what each key has
REFERENCES = ("body", "on")  # keys of tables that name a body
MAX_COPIES = 8
TAIL_SECONDS = 3.0  # after the last note, if the patch does not say how long it sounds
OWN_TABLES = ("keyboard", "key", "note", "pedal")  # of a document that is an instrument


@dataclass
class Expansion:
    """A plain document, and where in the patch its tables come from."""

    document: dict[str, Any]
    origins: dict[tuple[str, int], tuple[KeyPath, str]] = field(default_factory=dict)  # path, and name of the key
    faults: list[Any] = field(default_factory=list)


def is_instrument(document: Any) -> bool:
    """Whether a document is that of an instrument."""
    return isinstance(document, dict) and any(document.get(name) is not None for name in OWN_TABLES)


def keys_of(keyboard: dict[str, Any]) -> list[int]:
    """The keys of a keyboard, upwards. Raises ValueError."""
    keys = keyboard["keys"]
    return sorted({key for text in ([keys] if isinstance(keys, str) else keys) for key in parse_keys(text)})


def expand(document: dict[str, Any]) -> Expansion:
    """Write an instrument out, as its score needs it: the bodies of the keys that are played, or of all keys where it
    has sympathetic strings and the sustain pedal is used. A document that cannot be read so is returned as it is, for
    the faults of its structure."""
    try:
        keyboard = Keyboard.model_validate(document.get("keyboard"))
        score = read_score(document)
        keys = keys_of(keyboard.model_dump())
    except (ValueError, TypeError):  # which pydantic will report
        return Expansion(document)
    if not score.notes:
        score = score.with_middle_note(keys)
    expansion = Expansion(document)
    expansion.faults += _check_score(score, keys)
    if not expansion.faults:
        wants_all = keyboard.sympathetic and score.uses_sustain()
        played = keys if wants_all else sorted({note.key for note in score.notes})
        return expand_keys(document, played, score)
    return expansion


def expand_keys(document: dict[str, Any], keys: list[int], score: Score, is_live: bool = False) -> Expansion:
    """Write out what some keys have, with the events of a score.

    is_live: plucks are forces that wait, and dampers stay down until they are lifted
    """
    writer = _Writer(document)
    for key in keys:
        writer.write_key(key)
    plain = {name: value for name, value in document.items() if name not in SECTIONS}
    expansion = Expansion(plain | writer.sections, writer.origins, writer.faults)
    if "seconds" not in plain:
        plain["seconds"] = expansion.document["seconds"] = score.end + TAIL_SECONDS
    events, faults = score_events(writer, keys, score, plain["seconds"], is_live)
    for event, origin, name in events:
        section = "force" if "start" in event else "event"
        target = expansion.document.setdefault(section, [])
        target = expansion.document[section] = list(target) if target is document.get(section) else target
        expansion.origins[section, len(target)] = (origin, name)
        target.append(event)
    expansion.faults += faults
    return expansion


class _Writer:
    """Writes what keys have into the sections of a plain document."""

    def __init__(self, document: dict[str, Any]) -> None:
        self.tables: dict[str, Any] = document.get("key") or {}
        self.keyboard: dict[str, Any] = document["keyboard"]
        self.sections = {name: list(document.get(name) or []) for name in SECTIONS}
        self.origins: dict[tuple[str, int], tuple[KeyPath, str]] = {}
        self.faults: list[Any] = []
        self.copies: dict[int, dict[str, int | None]] = {}  # of each body of each key; None of what there is once

    @lru_cache(None)  # noqa: B019: a writer lives as long as an expansion
    def names(self, key: int) -> dict[str, float]:
        """What formulas know of a key: what it is, and the values of the patch."""
        names = names_of_key(key, float(self.keyboard.get("a4", 440.0)))
        for name, value in (self.keyboard.get("values") or {}).items():
            found = self.read(value, key, names, ("keyboard", "values", name))
            if is_number(found):
                names[name] = float(found)
            else:
                self.add_fault(("keyboard", "values", name), value, "no number", "a number at every key")
        return names

    def read(self, value: Any, key: int, names: dict[str, float], path: KeyPath) -> Any:
        """A value at a key; None, and a fault, where it has none."""
        try:
            return value_at_key(value, key, names, path)
        except KeyValueError as error:
            self.add_fault(error.path, error.value, error.message, error.remedy)
            return None

    def add_fault(self, path: KeyPath, value: Any, message: str, remedy: str) -> None:
        """Keep a fault, once for each path."""
        if all(fault["loc"] != path for fault in self.faults):
            self.faults.append(make_fault(path, value, message, remedy))

    def tables_at(self, section: str, key: int) -> Iterator[tuple[KeyPath, dict[str, Any]]]:
        """The tables of a section that a key has, as the patch says them, without `keys`; and their paths."""
        for i, table in enumerate(self.tables.get(section) or []):
            path: KeyPath = ("key", section, i)
            try:
                texts = table.get("keys", self.keyboard["keys"])
                keys = {k for text in ([texts] if isinstance(texts, str) else texts) for k in parse_keys(text)}
            except (ValueError, AttributeError, TypeError):
                self.add_fault((*path, "keys"), table["keys"], "no range of keys", 'such as "A0..E6", or a list')
                continue
            if key in keys:
                yield path, {name: value for name, value in table.items() if name != "keys"}

    def write_key(self, key: int) -> None:
        """Write what a key has."""
        copies: dict[str, int | None] = {}
        self.copies[key] = copies
        for path, table in self.tables_at("body", key):
            count = self._count_copies(table, key, path)
            if isinstance(table.get("name"), str):
                copies[table["name"]] = count
            self._write("body", key, path, table, count)
        for section in SECTIONS[1:]:
            for path, table in self.tables_at(section, key):
                self._write(section, key, path, table, self.copies_of(key, table))

    def _count_copies(self, table: dict[str, Any], key: int, path: KeyPath) -> int | None:
        if "copies" not in table:
            return None
        count = self.read(table["copies"], key, self.names(key), (*path, "copies"))
        if not is_number(count) or not 0 <= round(count) <= MAX_COPIES:
            self.add_fault((*path, "copies"), table["copies"], "no number of copies", f"0 to {MAX_COPIES}")
            return 1
        return round(count)

    def copies_of(self, key: int, table: dict[str, Any]) -> int | None:
        """How many copies the body has that a table names; of two such bodies, the one with more."""
        counts = [self.copies[key].get(str(table.get(name))) for name in REFERENCES]
        return max((count for count in counts if count is not None), default=None)

    def _write(self, section: str, key: int, path: KeyPath, table: dict[str, Any], count: int | None) -> None:
        for copy in [None] if count is None else range(1, count + 1):
            written = self.table_of_copy(section, key, path, table, copy, count)
            self.origins[section, len(self.sections[section])] = (path, note_name(key))
            self.sections[section].append(written)

    def table_of_copy(
        self,
        section: str,
        key: int,
        path: KeyPath,
        table: dict[str, Any],
        copy: int | None,
        count: int | None,
        names: dict[str, float] | None = None,
    ) -> dict[str, Any]:
        """A table as it is at a key, for one copy of its body; names: what formulas know beside what all do."""
        known = self.names(key) | {"i": float(copy or 1), "copies": float(count or 1)} | (names or {})
        written = {
            name: self.read(value, key, known, (*path, name)) for name, value in table.items() if name != "copies"
        }
        if isinstance(table.get("name"), str):
            written["name"] = name_of_copy(key, table["name"], copy)
        if section != "body":
            for name in REFERENCES:
                if written.get(name) in self.copies[key]:
                    own = self.copies[key][written[name]]
                    written[name] = name_of_copy(key, written[name], None if own is None else copy)
            for name in ("contact", "connection"):  # that a change refers to
                if isinstance(written.get(name), str) and self.has_name(name, written[name]):
                    written[name] = name_of_copy(key, written[name], copy)
        return {name: value for name, value in written.items() if value is not None}

    def has_name(self, section: str, name: str) -> bool:
        """Whether each key has a contact or a connection of a name."""
        return any(table.get("name") == name for table in self.tables.get(section) or [])

    def copies_by_name(self, section: str, key: int, name: str) -> int | None:
        """How many copies a key has of a contact or a connection of a name."""
        for _, table in self.tables_at(section, key):
            if table.get("name") == name:
                return self.copies_of(key, table)
        return None


def _check_score(score: Score, keys: list[int]) -> Iterator[Any]:
    """The faults of notes for which there is no key."""
    known = set(keys)
    for i, note in enumerate(score.notes):
        if note.key not in known:
            message = f"the instrument has no key {note_name(note.key)}"
            yield make_fault(("note", i, "key"), note_name(note.key), message, f"{describe_keys(keys)}")


def describe_keys(keys: list[int]) -> str:
    """The keys of an instrument, in words."""
    if keys[-1] - keys[0] + 1 == len(keys):
        return f"{note_name(keys[0])} to {note_name(keys[-1])}"
    return ", ".join(note_name(key) for key in keys)


def parse_key_of(document: dict[str, Any], text: str) -> int:
    """A key of an instrument by its name or number. Raises ValueError."""
    key = int(text) if text.isdecimal() else parse_key(text)
    keys = keys_of(document["keyboard"])
    if key not in keys:
        raise ValueError(f"the instrument has no key {text}; {describe_keys(keys)}")
    return key


def middle_of(keys: list[int]) -> int:
    """The key that is nearest to C4."""
    return min(keys, key=lambda k: (abs(k - 60), k))


def is_close(a: float, b: float) -> bool:
    """Whether two times are one."""
    return math.isclose(a, b, abs_tol=1e-9)
