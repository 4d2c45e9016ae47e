"""What a patch says, as a whole: a `Scene`, validated.

`Scene.model_validate({...})` reports every fault at once, structure and references together.
"""

import math
from collections.abc import Iterator
from itertools import islice
from pathlib import Path
from typing import Any

from pydantic import Field, ModelWrapValidatorHandler, ValidationError, ValidationInfo, model_validator
from pydantic_core import InitErrorDetails

from engine.accuracy import Accuracy
from engine.files import regular
from engine.lines import Where
from engine.measured import read
from engine.parts import SECONDS, Body, Contact, Event, Force, Part, Pickup, Samples
from engine.references import fault, references, tables
from engine.save import reason
from engine.wording import one_line

SAMPLERATES = (4_000, 768_000)  # Hz
TABLES = 5_000  # of one sort
MANY = 2_000  # faults, beyond which nobody looks for more
PATH = 200  # characters of a file's name that are told
PUSHES = 1 << 25  # samples of a force file, all channels


class Scene(Part):
    """A patch, validated. Everything in SI units; at rest at 0 unless said otherwise."""

    title: str = Field(default="", description="what it is")
    seconds: float = Field(default=2.0, gt=0.0, le=SECONDS, description="how long it sounds, s")
    gravity: float = Field(
        default=0.0,
        ge=-1e4,
        le=1e4,
        description="downward acceleration of masses and oscillators, m/s²: with 9.81 their weight is -9.81 N/kg",
    )
    accuracy: Accuracy = Field(default=Accuracy(), description="how exactly it is computed")
    body: list[Body] = Field(min_length=1, max_length=TABLES, description="the bodies")
    contact: list[Contact] = Field(default=[], max_length=TABLES, description="where bodies collide")
    force: list[Force] = Field(default=[], max_length=TABLES, description="external forces")
    event: list[Event] = Field(default=[], max_length=TABLES, description="the score: what happens when")
    pickup: list[Pickup] = Field(min_length=1, max_length=TABLES, description="what is heard")

    @model_validator(mode="wrap")
    @classmethod
    def _all_faults(cls, data: Any, handler: ModelWrapValidatorHandler["Scene"], info: ValidationInfo) -> "Scene":
        """Report faults of reference together with those of structure."""
        faults: list[InitErrorDetails] = []
        scene = None
        folder = Path((info.context or {}).get("folder", "."))
        if isinstance(data, dict):
            data, unread = _measured(_tame(data), folder)
            faults += [*unread, *islice(_forces(data, folder), MANY)]
        try:
            scene = handler(data)
        except ValidationError as error:
            faults += [_again(e, data) for e in islice(error.errors(include_url=False), MANY)]
        if isinstance(data, dict):
            faults += islice(references(data), MANY)
        if faults or scene is None:
            raise ValidationError.from_exception_data(cls.__name__, faults[:MANY])
        if not any(isinstance(f, Samples) for f in scene.force):
            return scene
        return scene.model_copy(update={"force": [_found(f, folder) for f in scene.force]})


def _tame(value: Any) -> Any:
    """The same with whole numbers that are beyond those of TOML, which has 64 bits, as any others."""
    if isinstance(value, dict):
        return {key: _tame(inner) for key, inner in value.items()}
    if isinstance(value, list):
        return [_tame(inner) for inner in value]
    if isinstance(value, int) and abs(value) >= 1 << 63:
        return float(value) if abs(value) < 10**300 else math.inf
    return value


def _found(force: Any, folder: Path) -> Any:
    """The force, with the whole path of its file: what is kept of a scene can be read from anywhere."""
    if not isinstance(force, Samples):
        return force
    return force.model_copy(update={"file": str((folder / force.file).resolve())})


def _again(error: Any, data: Any) -> InitErrorDetails:
    """A fault found by pydantic, or by a check of ours on one key, to be raised once more beside the others."""
    if error["type"] == "scene":
        where = error["loc"]
        if len(where) > 2 and data[where[0]][where[1]].get("kind") == where[2]:  # pydantic puts a table's kind there
            where = where[:2] + where[3:]
        what, _, right = error["msg"].partition("; ")
        return fault(where, error["input"], what, right)
    again = InitErrorDetails(type=error["type"], loc=error["loc"], input=error["input"])
    if "ctx" in error:
        again["ctx"] = error["ctx"]
    return again


def _measured(data: dict[str, Any], folder: Path) -> tuple[dict[str, Any], list[InitErrorDetails]]:
    """The same, with modes from files in place of the files' names; a scene is then complete in itself. And the
    files that cannot be read."""
    bodies = data.get("body")
    if not isinstance(bodies, list):
        return data, []
    filled, faults = [], []
    for i, body in enumerate(bodies):
        if isinstance(body, dict) and body.get("kind") == "modes" and isinstance(body.get("file"), str):
            try:
                body = {k: v for k, v in body.items() if k != "file"} | read(folder / body["file"])
            except (OSError, ValueError) as error:
                faults.append(_unread(("body", i, "file"), body["file"], "CSV", error, "a table of modes"))
        filled.append(body)
    return data | {"body": filled}, faults


def _forces(data: dict[str, Any], folder: Path) -> Iterator[InitErrorDetails]:
    """Force files that cannot be read, or not as asked."""
    for i, table in tables(data, "force"):
        file = table.get("file")
        if table.get("kind") != "file" or not isinstance(file, str) or not file:
            continue
        try:
            channels = _channels(folder / file)
        except (OSError, RuntimeError, TypeError, ValueError) as error:  # soundfile's own are RuntimeErrors
            yield _unread(("force", i, "file"), file, "audio", error, "a WAV, FLAC or OGG file")
            continue
        channel = table.get("channel", 1)
        if isinstance(channel, int) and channel > channels:
            yield fault(("force", i, "channel"), channel, f"the file has {channels} channel(s)", f"1 to {channels}")


def _unread(where: Where, file: str, sort: str, error: Exception, right: str) -> InitErrorDetails:
    """A file that cannot be read, as a fault."""
    if isinstance(error, FileNotFoundError):
        return fault(
            where, file, f"no such file: {one_line(str(error.filename), PATH)}", "a path relative to the patch"
        )
    return fault(where, file, f"cannot be read as {sort} ({one_line(reason(error), PATH)})", right)


def _channels(path: Path) -> int:
    """How many channels an audio file has. Raises what says that it cannot be a force."""
    import soundfile

    regular(path)
    found = soundfile.info(str(path))
    if found.frames * found.channels > PUSHES:
        raise ValueError(f"it has {found.frames * found.channels} samples, more than {PUSHES}")
    if not SAMPLERATES[0] <= found.samplerate <= SAMPLERATES[1]:
        low, high = SAMPLERATES
        raise ValueError(f"its sample rate is {found.samplerate} Hz, not {low} to {high}")
    return int(found.channels)


def joined(scene: Scene, name: str) -> set[str]:
    """The bodies that contacts join with one, and it."""
    found, size = {name}, 0
    while size < len(found):
        size = len(found)
        for contact in scene.contact:
            if contact.on is not None and found & {contact.body, contact.on}:
                found |= {contact.body, contact.on}
    return found
