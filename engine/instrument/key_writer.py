"""Writes out the tables of one key of an instrument as tables of a plain scene."""

from collections.abc import Iterator
from typing import Any

from engine.bodies.table import KeyPath, is_number, make_fault
from engine.instrument.key_frequencies import frequencies_of, pitch_of_a4
from engine.instrument.key_names import name_of_copy, note_name, parse_keys
from engine.instrument.key_values import KeyValueError, names_of_key, value_at_key, wrong_formulas

SECTIONS = ("body", "contact", "connection", "friction", "bow", "pickup")  # of what each key has
REFERENCES = ("body", "on")  # keys of tables that name a body
EVENT_REFERENCES = ("contact", "connection", "friction")  # of events, that name what changes
ALSO_NAMED = {"friction": ("friction", "bow")}  # sections of what such a name may be of
MAX_COPIES = 8
Origins = dict[tuple[str, int], tuple[KeyPath, str]]  # of tables written out: path in the patch, and the key's name


class KeyWriter:
    """Writes what keys have into the sections of a plain document. document: of an instrument"""

    def __init__(self, document: dict[str, Any]) -> None:
        self.tables: dict[str, Any] = document.get("key") or {}
        self.keyboard: dict[str, Any] = document["keyboard"]
        self.sections = {name: list(document.get(name) or []) for name in SECTIONS}
        self.origins: Origins = {}
        self._frequencies = frequencies_of(self.keyboard)
        self._names: dict[int, dict[str, float]] = {}  # what formulas know of each key
        self.faults: list[Any] = []
        self.without_value: set[str] = set()  # names that formulas want, and of which a fault is kept already
        self.copies: dict[int, dict[str, int | None]] = {}  # of each body of each key; None of what there is once

    def check_formulas(self) -> None:
        """Keep the faults of formulas that no key can have, whether or not a key of the score uses them."""
        values = self.keyboard.get("values") or {}
        for error in [*wrong_formulas(values, ("keyboard", "values")), *wrong_formulas(self.tables, ("key",))]:
            self.add_fault(error.path, error.value, error.message, error.remedy)
        mono, known = self.keyboard.get("mono"), [*values, *names_of_key(0, 1.0, 1.0)]
        if mono is not None and mono not in known:
            self.add_fault(("keyboard", "mono"), mono, "no value has this name", f"one of {', '.join(known)}")

    def names(self, key: int) -> dict[str, float]:
        """Return the names that formulas can use at a key: those of the key, and the values of the patch."""
        if key in self._names:
            return self._names[key]
        names = self._names[key] = names_of_key(key, self._frequencies[key], pitch_of_a4(self.keyboard))
        for name, value in (self.keyboard.get("values") or {}).items():
            number = self.read(value, key, names, ("keyboard", "values", name))
            if is_number(number):
                names[name] = float(number)
            else:
                self.without_value.add(name)
                if number is not None:
                    self.add_fault(("keyboard", "values", name), value, "not a number", "give a number at every key")
        return names

    def read(self, value: Any, key: int, names: dict[str, float], path: KeyPath) -> Any:
        """A value at a key; None, and a fault, where it has none. Of the formulas that want a name which has no value,
        only the first is at fault."""
        try:
            return value_at_key(value, key, names, path)
        except KeyValueError as error:
            if error.unknown not in self.without_value:
                self.add_fault(error.path, error.value, error.message, error.remedy)
            self.without_value |= {error.unknown} - {""}
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
                self.add_fault((*path, "keys"), table["keys"], "not a range of keys", 'such as "A0..E6", or a list')
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
        count: Any = self.read(table["copies"], key, self.names(key), (*path, "copies"))
        if not is_number(count) or not 0 <= round(count) <= MAX_COPIES:
            self.add_fault((*path, "copies"), table["copies"], "not a number of copies", f"0 to {MAX_COPIES}")
            return 1
        copies: int = round(count)
        return copies

    def copies_of(self, key: int, table: dict[str, Any]) -> int | None:
        """Count the copies of the body that a table names; of two such bodies, the larger count. None if no body has
        copies."""
        counts = [self.copies[key].get(str(table.get(name))) for name in REFERENCES]
        return max((count for count in counts if count is not None), default=None)

    def _write(self, section: str, key: int, path: KeyPath, table: dict[str, Any], count: int | None) -> None:
        for copy in [None] if count is None else range(1, count + 1):
            written = self.table_of_copy(section, key, path, table, (copy, count))
            self.origins[section, len(self.sections[section])] = (path, note_name(key))
            self.sections[section].append(written)

    def table_of_copy(
        self,
        section: str,
        key: int,
        path: KeyPath,
        table: dict[str, Any],
        place: tuple[int | None, int | None],
        names: dict[str, float] | None = None,
    ) -> dict[str, Any]:
        """A table as it is at a key, for one copy of its body.

        place: which copy, of how many; None of a body without copies
        names: what formulas know beside what all do
        """
        copy, count = place
        known = self.names(key) | {"i": float(copy or 1), "copies": float(count or 1)} | (names or {})
        written = {
            name: self.read(value, key, known, (*path, name)) for name, value in table.items() if name != "copies"
        }
        if isinstance(table.get("name"), str):
            written["name"] = name_of_copy(key, table["name"], copy)
        if section != "body":
            for name in REFERENCES:
                body = written.get(name)
                if isinstance(body, str) and body in self.copies[key]:
                    written[name] = name_of_copy(key, body, None if self.copies[key][body] is None else copy)
            for name in EVENT_REFERENCES:
                if isinstance(written.get(name), str) and self.has_name(name, written[name]):
                    written[name] = name_of_copy(key, written[name], copy)
            if isinstance(written.get("parameter"), str):
                written["parameter"] = self._parameter_of_copy(key, written["parameter"], copy)
        return {name: value for name, value in written.items() if value is not None}

    def _parameter_of_copy(self, key: int, parameter: str, copy: int | None) -> str:
        """The path of a parameter of what a key has."""
        section, _, rest = parameter.partition(".")
        name, _, keys = rest.partition(".")
        if not self.has_name(section, name):
            return parameter
        if section == "body":
            copy = None if self.copies[key].get(name) is None else copy
        return f"{section}.{name_of_copy(key, name, copy)}.{keys}"

    def has_name(self, section: str, name: str) -> bool:
        """True if each key has a contact, a connection or a friction of a name."""
        sections = ALSO_NAMED.get(section, (section,))
        return any(table.get("name") == name for part in sections for table in self.tables.get(part) or [])

    def copies_by_name(self, section: str, key: int, name: str) -> int | None:
        """Count the copies of a contact, a connection or a friction of a name at a key."""
        for part in ALSO_NAMED.get(section, (section,)):
            for _, table in self.tables_at(part, key):
                if table.get("name") == name:
                    return self.copies_of(key, table)
        return None
