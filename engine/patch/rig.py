"""Rigs: several instruments that are played together, each on its channel, its keys and at its level. A rig is read as
one scene, in which what a part has begins with its name."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, get_origin

from pydantic import Field, ValidationError

from engine.arithmetic.plain_numbers import power
from engine.bodies.table import KeyPath, Name, Table
from engine.faults import Fault, PatchError
from engine.instrument.expansion import keys_of
from engine.instrument.key_names import HIGHEST_KEY, PART_SEPARATOR, describe_keys, parse_keys
from engine.instrument.tables import KeyRange
from engine.patch.accuracy import Accuracy
from engine.patch.control_tables import Midi
from engine.patch.error_messages import describe_error, format_path, locate_error
from engine.patch.reader import Document
from engine.patch.scene_tables import SceneTables
from engine.patch.toml_lines import locate_keys, nearest_line

PART = "part"  # section of a rig, by which it is known
LONGEST_NAME = 16
SECTIONS = [
    name for name, key in SceneTables.model_fields.items() if get_origin(key.annotation) is list and not key.exclude
]
REFERENCES = ["name", "on", *SECTIONS]  # keys of tables that are names, of what is in a section
FULL = 127  # velocity
MAX_PARTS = 64
Load = Callable[[str | Path], SceneTables]
MAX_TRANSPOSITION = 60  # semitones


class RigPart(Table):
    """An instrument of a rig."""

    patch: str = Field(min_length=1, description="patch of the instrument: a shipped name, or a file beside the rig")
    name: Name | None = Field(default=None, max_length=LONGEST_NAME, description="name; that of the patch if absent")
    channel: int | None = Field(default=None, ge=1, le=16, description="MIDI channel; all if absent")
    keys: KeyRange | None = Field(default=None, description='keys that it plays, as they are pressed: "C1..B2"')
    transpose: int = Field(
        default=0, ge=-MAX_TRANSPOSITION, le=MAX_TRANSPOSITION, description="semitones by which it plays higher"
    )
    velocities: list[int] = Field(
        default=[1, FULL], min_length=2, max_length=2, description="lowest and highest velocity that it plays"
    )
    curve: float = Field(
        default=1.0, ge=0.1, le=10.0, description="exponent of the velocity: below 1, soft keys play louder"
    )
    level: float = Field(default=0.0, ge=-200.0, le=200.0, description="level, on that of its patch, dB")
    pan: float | None = Field(default=None, ge=-1.0, le=1.0, description="place: -1 is left, 1 is right")
    mute: bool = Field(default=False, description="true: it is left out")
    program: int | None = Field(
        default=None, ge=1, le=128, description="program that chooses it among those of its channel; always if absent"
    )

    def takes(self, channel: int, key: int, velocity: float) -> bool:
        """True if it plays a key that is pressed on a channel, 0 of none, at a velocity of 1 to 127."""
        low, high = self.velocities
        return self.is_on(channel) and low <= velocity <= high and (self.keys is None or key in keys_in(self.keys))

    def is_on(self, channel: int) -> bool:
        """True if messages of a channel, 0 of all, are for it."""
        return self.channel is None or channel in (0, self.channel)

    def velocity(self, velocity: float) -> float:
        """Return the velocity at which it plays, 1 to 127."""
        return max(1.0, round(FULL * power(velocity / FULL, self.curve))) if self.curve != 1.0 else velocity


class RigTables(Table):
    """A rig, as its file says."""

    title: str = Field(default="", description="title")
    seconds: float | None = Field(default=None, gt=0.0, le=3600.0, description="length of the sound, s")
    part: list[RigPart] = Field(min_length=1, max_length=MAX_PARTS, description="the instruments")
    accuracy: Accuracy | None = Field(
        default=None, description="accuracy settings; those of the parts, the finest of each, if absent"
    )
    midi: Midi = Field(default=Midi(), description="MIDI settings")


@dataclass(frozen=True)
class Member:
    """A part of a rig with its instrument."""

    name: str
    table: RigPart
    scene: Any  # a Scene

    @property
    def prefix(self) -> str:
        """The beginning of the names of all that it has."""
        return self.name + PART_SEPARATOR

    @property
    def document(self) -> dict[str, Any]:
        """The document of its instrument."""
        return self.scene.instrument or {}


@dataclass(frozen=True)
class Rig:
    """A rig that was read: the parts that sound."""

    tables: RigTables
    members: tuple[Member, ...]

    def replace_scenes(self, scenes: Sequence[Any]) -> "Rig":
        """Return the rig with other scenes of its instruments."""
        changed = zip(self.members, scenes, strict=True)
        return Rig(self.tables, tuple(replace(member, scene=scene) for member, scene in changed))


def keys_in(keys: str | list[str]) -> frozenset[int]:
    """Return the keys of a range, or of a list of ranges."""
    return frozenset(key for text in ([keys] if isinstance(keys, str) else keys) for key in parse_keys(text))


# --- reading


def is_rig(data: Any) -> bool:
    """True if a document is a rig."""
    return isinstance(data, dict) and PART in data


def read_rig(document: Document, load: Load) -> Rig:
    """Read a rig and its patches. Raises PatchError. load: reads a patch"""
    data, folder, file, text = document
    lines: dict[KeyPath, int] = locate_keys(text) if text else {(): 1}

    def fault(path: KeyPath, message: str) -> Fault:
        return Fault(format_path(path), message, file, nearest_line(lines, path) if text else None)

    try:
        tables = RigTables.model_validate(data)
    except ValidationError as error:
        located = [(locate_error(one, RigTables), one) for one in error.errors(include_url=False)]
        raise PatchError([fault(place.path, describe_error(one, place)) for place, one in located]) from None
    faults, members, names = list[Fault](), list[Member](), set[str]()
    for n, table in enumerate(tables.part):
        scene, found = _load(table.patch, folder, load)
        faults += [fault((PART, n, "patch"), one.message) if not one.path else one for one in found]
        if scene is None:
            continue
        if message := _explain_unfit(table, scene):
            faults.append(fault((PART, n, "keys" if table.keys is not None else "patch"), message))
        name = _free_name(table, names)
        if name is None:
            faults.append(fault((PART, n, "name"), f'two parts are named "{table.name}"; give each a name of its own'))
        elif not table.mute:
            members.append(Member(name, table, scene))
    if not faults and not members:
        faults.append(fault((PART,), "all parts are mute; let one sound"))
    if faults:
        raise PatchError(faults)
    return Rig(tables, tuple(members))


def _load(patch: str, folder: Path, load: Load) -> tuple[SceneTables | None, list[Fault]]:
    """The patch of a part, or what is wrong with it."""
    beside = folder / patch
    try:
        return load(beside if beside.is_file() else patch), []
    except PatchError as error:
        return None, error.faults
    except (OSError, ValueError) as error:
        return None, [Fault("", str(error))]


def _explain_unfit(table: RigPart, scene: SceneTables) -> str:
    """Why a patch cannot be a part; "" if it can."""
    if scene.instrument is None:
        return f"{table.patch} has no keys; give an instrument, which has a [keyboard]"
    low, high = table.velocities
    if not 1 <= low <= high <= FULL:
        return f"velocities {low} to {high} are none; give two of 1 to {FULL}, the lower one first"
    own = keys_of(scene.instrument["keyboard"])
    pressed = frozenset(range(HIGHEST_KEY + 1)) if table.keys is None else keys_in(table.keys)
    if not any(key + table.transpose in own for key in pressed):
        moved = f", {table.transpose:+d} semitones" if table.transpose else ""
        return f"it has none of these keys{moved}; {table.patch} has {describe_keys(own)}"
    return ""


def _free_name(table: RigPart, names: set[str]) -> str | None:
    """A name for a part that no other one has; None if it was given, and another part has it."""
    stem = "".join(c if c.isalnum() and c.isascii() else "_" for c in Path(table.patch).stem).strip("_")
    name = table.name or (stem if stem[:1].isalpha() else f"part_{stem}")[:LONGEST_NAME].rstrip("_") or "part"
    if table.name is None and name in names:
        name = next(each for n in range(2, MAX_PARTS + 2) if (each := f"{name[: LONGEST_NAME - 3]}_{n}") not in names)
    if name in names:
        return None
    names.add(name)
    return name


# --- joining


def join_parts(rig: Rig, scenes: Sequence[SceneTables]) -> dict[str, Any]:
    """Return the document of a rig: the scenes of its members, written out, beside each other. Raises PatchError."""
    gravities = {scene.gravity for scene in scenes}
    if len(gravities) > 1:
        named = ", ".join(f"{m.name} {scene.gravity:g}" for m, scene in zip(rig.members, scenes, strict=True))
        raise PatchError([Fault("gravity", f"the parts differ in gravity ({named}); give them one")])
    joined: dict[str, Any] = {section: [] for section in SECTIONS}
    for member, scene in zip(rig.members, scenes, strict=True):
        offsets = {section: len(joined[section]) for section in SECTIONS}
        for section in SECTIONS:
            tables = [plain_table(table) for table in getattr(scene, section)]
            if section == "pickup":
                tables = [_at_place(table, member, scene) for table in tables]
            joined[section] += [rename(table, member.prefix, offsets) for table in tables]
    joined |= {"title": rig.tables.title, "gravity": gravities.pop(), "level": 0.0, "midi": rig.tables.midi}
    joined |= {"seconds": rig.tables.seconds or max(scene.seconds for scene in scenes)}
    joined |= {"accuracy": rig.tables.accuracy or join_accuracy([scene.accuracy for scene in scenes])}
    return {key: value.model_dump() if isinstance(value, Table) else value for key, value in joined.items()}


def plain_table(table: Table) -> dict[str, Any]:
    """Return a table as a document has it."""
    return {key: value for key, value in table.model_dump(exclude_unset=True).items() if value is not None}


def rename(table: dict[str, Any], prefix: str, offsets: dict[str, int] | None = None) -> dict[str, Any]:
    """Return a table with the names of a part. offsets: by section, how many tables of other parts come before"""
    named = {key: prefix + table[key] for key in REFERENCES if isinstance(table.get(key), str)}
    if isinstance(table.get("parameter"), str):
        named["parameter"] = rename_path(table["parameter"], prefix, offsets or {})
    return table | named


def rename_path(path: str, prefix: str, offsets: dict[str, int]) -> str:
    """Return the path of a live parameter of a part."""
    section, *rest = path.split(".")
    if rest and section in SECTIONS:
        rest[0] = str(int(rest[0]) + offsets.get(section, 0)) if rest[0].isdecimal() else prefix + rest[0]
    return ".".join([section, *rest])


def _at_place(pickup: dict[str, Any], member: Member, scene: SceneTables) -> dict[str, Any]:
    """A pickup of a part at its level and place."""
    level = (scene.level or 0.0) + member.table.level
    pickup = pickup | {"gain": pickup.get("gain", 1.0) * power(10.0, level / 20.0)}
    pan, own, channels = member.table.pan, pickup.get("pan"), pickup.get("channel", 1)
    if scene.channels == 1:
        rest = {key: value for key, value in pickup.items() if key != "channel"}
        return rest | ({"channel": [1, 2]} if pan is None else {"pan": pan})
    if pan is None:
        return pickup
    if own is not None:
        return pickup | {"pan": max(-1.0, min(1.0, own + pan))}
    if isinstance(channels, int) and channels in (1, 2):
        return pickup | {"gain": pickup["gain"] * min(1.0, 1.0 - pan if channels == 1 else 1.0 + pan)}
    return pickup


def explain_accuracy(rig: Rig) -> str:
    """Tell which parts make all others dearer, as a rig takes the finest setting of each; "" if none does."""
    if rig.tables.accuracy is not None:
        return ""
    told = list[str]()
    for setting in ("substeps", "order"):
        values = {member.name: getattr(member.scene.accuracy, setting) for member in rig.members}
        if len(set(values.values())) > 1:
            finest = max(values.values())
            names = ", ".join(name for name, value in values.items() if value == finest)
            told.append(f"{names} asks for {setting} = {finest}, which all parts take")
    return f"{'; '.join(told)}: an [accuracy] of the rig sets it" if told else ""


def join_accuracy(settings: Sequence[Accuracy]) -> Accuracy:
    """Return the accuracy of a scene that is no worse than those of its parts. Raises PatchError if there is none."""
    first = settings[0]
    if any(one.scheme != first.scheme or one.oversample != first.oversample for one in settings):
        message = "the parts differ in scheme or oversample; give the rig an [accuracy]"
        raise PatchError([Fault("accuracy", message)])
    errors = [one.max_error for one in settings if one.max_error is not None]
    return first.replace(
        order=max(one.order for one in settings),
        substeps=max(one.substeps for one in settings),
        max_error=min(errors, default=None),
        max_substeps=max(one.max_substeps for one in settings),
        least_detuning=min(one.least_detuning for one in settings),
        tolerance=min(one.tolerance for one in settings),
        iterations=max(one.iterations for one in settings),
        silence=min(one.silence for one in settings),
    )
