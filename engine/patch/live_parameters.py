"""The numbers of a patch that can change while it sounds. Events of the score, `[[control]]`, Python and `--watch` all
go by this one list.

There are two sorts. What the audio thread holds as a number of its own, such as the stiffness of a contact, *glides*
there, sample by sample. All else is part of tables that are made when a scene is built, such as the pitch of a body;
these are made anew and exchanged, in steps (engine.assembly.table_exchange).
"""

from collections.abc import Iterator, Sequence
from difflib import get_close_matches
from typing import Any, NamedTuple

from pydantic import BaseModel, ValidationError

from engine.patch.live_ranges import FACTORS, live_range
from engine.patch.tables import SpringConnection
from engine.wording import describe_violation

GLIDED_KEYS = {
    "contact": ("stiffness", "exponent", "barrier", "gap"),
    "connection": ("stiffness", "damping_coefficient", "rest"),
    "friction": ("velocity", "force", "static", "dynamic", "speed", "memory", "bristle"),  # in the order of Sliding
}
TABLE_KEYS = {"contact": ("loss", "at", "on_at"), "force": ("amplitude", "at")}
TABLE_KEYS |= dict.fromkeys(("connection", "friction"), ("at", "on_at"))
PICKUP_KEYS = ("gain", "pan", "distance", "at")
LEVEL_KEYS = ("gain", "pan")  # of pickups: nothing has to be built for these
FIRST_KEYS = ("displacement", "velocity")  # of bodies: what they begin with, which nothing changes later
MAX_NAMES = 12  # in a message
SECTIONS = ("body", "contact", "connection", "friction", "force", "pickup")
OUTPUT = "output"  # section of the gains of channels, which no patch has


class LivePath(NamedTuple):
    """The place of a live parameter in a scene: `contact.felt.stiffness`, `body.string.tension`, `pickup.0.gain`,
    `gravity`."""

    section: str  # "" of the whole patch
    number: int  # of the table in its section
    keys: tuple[str | int, ...]  # within the table: of a list or a table in it there are several
    name: str | None = None  # of the table

    @property
    def is_glided(self) -> bool:
        """True if the audio thread glides it, sample by sample."""
        return self.keys[0] in GLIDED_KEYS.get(self.section, ())

    @property
    def is_level(self) -> bool:
        """True if it is a level of a pickup, or of a channel."""
        return (self.section == "pickup" and self.keys[0] in LEVEL_KEYS) or self.section == OUTPUT


def output_paths(channels: int) -> dict[str, LivePath]:
    """List the gains of the channels of the sound, by path: a session sets them, and no user."""
    return {output_gain_path(n): LivePath(OUTPUT, n, ("gain",)) for n in range(channels)}


def output_gain_path(channel: int) -> str:
    """The path of the gain of a channel, from 0."""
    return f"{OUTPUT}.{channel}.gain"


def live_paths(scene: Any, variable_exponents: bool = False) -> dict[str, LivePath]:
    """List the parameters that can change while a scene is played, by the paths that `fdh params` shows. A table is
    named by its name, or by its number from 0.

    variable_exponents: also exponents of contacts, if the model was built so
    """
    paths: dict[str, LivePath] = {}
    for section, index, table in _tables(scene):
        name = getattr(table, "name", None)
        prefix = f"{section}.{index if name is None else name}."
        for key in _glided(section, table, variable_exponents):
            paths[prefix + key] = LivePath(section, index, (key,), name)
        for keys in _tabled(section, table):
            paths.setdefault(prefix + ".".join(map(str, keys)), LivePath(section, index, keys, name))
    if scene.gravity != 0.0:
        paths["gravity"] = LivePath("", 0, ("gravity",))
    return paths


def _tables(scene: Any) -> Iterator[tuple[str, int, Any]]:
    for section in SECTIONS:
        yield from ((section, i, table) for i, table in enumerate(getattr(scene, section)))


def _glided(section: str, table: Any, variable_exponents: bool) -> Iterator[str]:
    """The keys of a table that the audio thread glides; those of tables without a name are left alone."""
    if table.__class__ is SpringConnection and table.name is not None and not table.rigid:
        yield from GLIDED_KEYS["connection"]
    if section == "friction" and table.name is not None:
        absent = {"velocity" if table.on is not None else "", "force" if table.contact is not None else ""}
        yield from (key for key in GLIDED_KEYS["friction"] if key not in absent)
    if section == "contact" and table.name is not None and table.stiffness > 0.0:
        yield "stiffness"
        yield "gap" if table.on else "barrier"
        if variable_exponents:
            yield "exponent"


def _tabled(section: str, table: Any) -> Iterator[tuple[str | int, ...]]:
    """Yield the keys within a table of the numbers that need new arrays."""
    values = table.model_dump(exclude_unset=True)
    if section == "pickup":
        chosen = {"gain": table.gain} | {key: values[key] for key in PICKUP_KEYS if values.get(key) is not None}
    elif section == "body":
        chosen = {key: value for key, value in values.items() if key not in FIRST_KEYS}
    elif section == "connection" and table.__class__ is not SpringConnection:
        return
    else:
        chosen = {key: values[key] for key in TABLE_KEYS[section] if values.get(key) is not None}
    yield from _numbers_within(chosen)


def _numbers_within(value: Any) -> Iterator[tuple[str | int, ...]]:
    """The keys of all numbers within a value; integers count things, and stay."""
    if isinstance(value, float):
        yield ()
    elif isinstance(value, list | dict):
        for key, inner in enumerate(value) if isinstance(value, list) else value.items():
            yield from ((key, *keys) for keys in _numbers_within(inner))


def explain_unknown(parameter: str, known: Sequence[str]) -> str:
    """That there is no such live parameter, and which there are: of the same table, or else with like names."""
    table = parameter.rpartition(".")[0]
    near = [path for path in known if path.rpartition(".")[0] == table] or get_close_matches(parameter, known, n=5)
    shown = ", ".join((near or list(known))[:MAX_NAMES]) or "none; give a contact or a connection a name"
    return f"no live parameter {parameter}; the live parameters are {shown}"


def value_at(scene: Any, path: LivePath) -> float:
    """The value that a patch gives a live parameter; a list of offsets moves by its first."""
    if path.section == OUTPUT:
        return float(scene.output_gain(path.number))
    value: Any = getattr(scene, path.section)[path.number] if path.section else scene
    for key in path.keys:
        value = getattr(value, str(key)) if isinstance(value, BaseModel) else value[key]
        if isinstance(value, list) and key in ("barrier", "gap"):
            value = value[0]
    return float(value or 0.0)


def check_range(scene: Any, path: LivePath, parameter: str, value: float) -> None:
    """Raise ValueError if a live parameter cannot have a value. parameter: its path as one writes it"""
    limits = FACTORS if path.section == OUTPUT else live_range(scene, path.section, path.number, path.keys)
    if value not in limits:
        raise ValueError(f"{parameter} = {value:g} is out of range; {limits}")


def with_value(scene: Any, path: LivePath, parameter: str, value: float) -> Any:
    """The scene with another value of a live parameter. Raises ValueError if that is out of range, or if the other
    values of the table allow no such value.

    parameter: its path as one writes it
    """
    check_range(scene, path, parameter, value)
    if not path.section:
        return scene.model_copy(update={"gravity": value})
    if path.section == OUTPUT:
        return scene.with_output_gain(path.number, value)
    table = getattr(scene, path.section)[path.number]
    data = table.model_dump(exclude_unset=True)
    _put(data, path.keys, value)
    try:
        changed = type(table).model_validate(data)
    except ValidationError as error:
        fault = error.errors()[0]
        raise ValueError(f"{parameter} = {value:g} is out of range; {describe_violation(fault)}") from None
    if path.section == "body":
        for fault in type(table).faults((path.section, path.number), data):
            raise ValueError(f"{parameter} = {value:g}: {fault['type']}")
    tables = [*getattr(scene, path.section)]
    values = {name: getattr(changed, name) for name in changed.model_fields_set}
    tables[path.number] = table.model_copy(update=values)  # with what no patch says of it
    return scene.model_copy(update={path.section: tables})


def _put(node: Any, keys: tuple[str | int, ...], value: float) -> None:
    """Write a value into lists and tables within each other."""
    for key in keys[:-1]:
        node = node[key]
    node[keys[-1]] = value
