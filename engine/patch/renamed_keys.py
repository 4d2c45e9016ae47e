"""Keys of patches that have better names now. The old ones work: a document is brought to the new ones when it is read.

`RENAMED` is the one table. Everything behind it knows the new names alone.
"""

from dataclasses import dataclass, field
from typing import Any

from pydantic import BaseModel
from pydantic_core import InitErrorDetails

from engine.bodies import BODIES
from engine.bodies.distributed import Support
from engine.bodies.table import KeyPath, make_fault
from engine.patch.tables import ChangeEvent, SpringConnection

# by section and old key: the new key, in those kinds of tables that have it, and what the note says of it
RENAMED: dict[str, dict[str, dict[str, str]]] = {
    "body": {
        "damping": {"damping_rate": "1/s"},
        "density": {"linear_density": "kg/m", "area_density": "kg/m²"},
        "bending": {"bending_stiffness": "EI, N·m²"},
        "rigidity": {"flexural_rigidity": "D, N·m"},
        "sigma1": {"sigma_beta": "m/s, per wave number β; Bilbao's sigma1 is per β²"},
        "sigma3": {"sigma_beta3": "m³/s, per β³"},
    },
    "support": {"damping": {"damping_coefficient": "kg/s"}},
    "connection": {"damping": {"damping_coefficient": "kg/s"}},
    "event": {"damping": {"damping_coefficient": "kg/s"}},
}
_KINDS: dict[str, dict[str, type[BaseModel]]] = {
    "body": dict(BODIES),
    "support": {"": Support},
    "connection": {"spring": SpringConnection},
    "event": {"change": ChangeEvent},
}
_DEFAULT_KINDS = {"support": "", "connection": "spring"}
_EVENT_SECTIONS = ("on", "off")  # of [key]


@dataclass(frozen=True)
class RenamedKey:
    """An old key of a patch. path: its own, as the patch has it"""

    path: KeyPath
    new: str
    meaning: str

    def __str__(self) -> str:
        return f"now called {self.new} ({self.meaning}); the old name still works"


@dataclass
class RenamedKeys:
    """The old keys of a document, by the paths that they have with their new names; and what is wrong with them."""

    by_path: dict[KeyPath, RenamedKey] = field(default_factory=dict)
    faults: list[InitErrorDetails] = field(default_factory=list)

    def path_in_patch(self, path: KeyPath) -> KeyPath:
        """A path with the keys as the patch has them."""
        for n in range(len(path), 0, -1):
            if path[:n] in self.by_path:
                return (*self.by_path[path[:n]].path, *path[n:])
        return path

    def first_of_each(self) -> list[RenamedKey]:
        """One for each old and new key."""
        first: dict[tuple[Any, str], RenamedKey] = {}
        for key in self.by_path.values():
            first.setdefault((key.path[-1], key.new), key)
        return list(first.values())


def current_key(section: str, kind: Any, key: str) -> str:
    """The name that a key of a table has now; the key itself if it is no old one.

    section: body, support, connection or event; of a [key] also on and off
    kind:    of the table; None where it gives none
    """
    section = "event" if section in _EVENT_SECTIONS else section
    names = RENAMED.get(section, {}).get(key)
    if names is None:
        return key
    table = _KINDS[section].get(_DEFAULT_KINDS.get(section, "") if kind is None else str(kind))
    if table is None or key in table.model_fields:
        return key
    return next((new for new in names if new in table.model_fields), key)


def old_keys() -> dict[str, dict[str, str]]:
    """The new key of each old one, by the name of the model that has it."""
    keys: dict[str, dict[str, str]] = {}
    for section, names in RENAMED.items():
        for kind, model in _KINDS[section].items():
            renamed = {old: current_key(section, kind, old) for old in names}
            keys[model.__name__] = {old: new for old, new in renamed.items() if new != old}
    return keys


def current_parameter(path: str) -> str:
    """The path of a live parameter, such as connection.bridge.damping, with the name that its key has now."""
    section, _, rest = path.partition(".")
    name, _, key = rest.partition(".")
    return f"{section}.{name}.{current_key(section, None, key)}" if key else path


def rename_keys(document: dict[str, Any], renamed: RenamedKeys) -> dict[str, Any]:
    """A document with new keys in place of the old ones, which are added to `renamed`."""
    changed = {
        section: _rename_tables(section, (section,), document.get(section), renamed)
        for section in ("body", "connection", "event")
    }
    key = document.get("key")
    if isinstance(key, dict):
        inner = {
            section: _rename_tables(section, ("key", section), key.get(section), renamed)
            for section in ("body", "connection", *_EVENT_SECTIONS)
        }
        changed["key"] = key | {section: tables for section, tables in inner.items() if section in key}
    return document | {section: tables for section, tables in changed.items() if section in document}


def _rename_tables(section: str, path: KeyPath, tables: Any, renamed: RenamedKeys) -> Any:
    """The tables of a section, renamed."""
    if not isinstance(tables, list):
        return tables
    return [
        _rename_table(section, (*path, i), table, renamed) if isinstance(table, dict) else table
        for i, table in enumerate(tables)
    ]


def _rename_table(section: str, path: KeyPath, table: dict[str, Any], renamed: RenamedKeys) -> dict[str, Any]:
    """A table with its new keys, in the order of the old ones."""
    changed: dict[str, Any] = {}
    for key, value in table.items():
        new = current_key(section, table.get("kind"), key)
        if section == "body" and key == "support":
            value = _rename_tables("support", (*path, key), value, renamed)
        if new != key and new in table:
            message, remedy = f"{key} and {new} are both given, and are the same", f"give {new}"
            renamed.faults.append(make_fault((*path, key), value, message, remedy))
            continue
        if new != key:
            meaning = RENAMED["event" if section in _EVENT_SECTIONS else section][key][new]
            renamed.by_path[(*path, new)] = RenamedKey((*path, key), new, meaning)
        changed[new] = value
    return changed
