"""What a patch says, as a whole: a `Scene`, validated.

`Scene.model_validate({...})` reports every fault at once, structure and references together.
"""

from collections.abc import Iterator
from pathlib import Path
from typing import Any

from pydantic import Field, ModelWrapValidatorHandler, ValidationError, ValidationInfo, model_validator
from pydantic_core import InitErrorDetails

from engine.accuracy import Accuracy
from engine.measured import read
from engine.parts import SECONDS, Body, Contact, Event, Force, Part, Pickup, Samples
from engine.references import fault, references, tables

SAMPLERATES = (4_000, 768_000)  # Hz


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
    body: list[Body] = Field(min_length=1, description="the bodies")
    contact: list[Contact] = Field(default=[], description="where bodies collide")
    force: list[Force] = Field(default=[], description="external forces")
    event: list[Event] = Field(default=[], description="the score: what happens when")
    pickup: list[Pickup] = Field(min_length=1, description="what is heard")

    @model_validator(mode="wrap")
    @classmethod
    def _all_faults(cls, data: Any, handler: ModelWrapValidatorHandler["Scene"], info: ValidationInfo) -> "Scene":
        """Report faults of reference together with those of structure."""
        faults: list[InitErrorDetails] = []
        scene = None
        folder = Path((info.context or {}).get("folder", "."))
        if isinstance(data, dict):
            faults += list(_files(data, folder))
            data = _measured(data, folder)
        try:
            scene = handler(data)
        except ValidationError as error:
            faults += [_again(e, data) for e in error.errors(include_url=False)]
        if isinstance(data, dict):
            faults += list(references(data))
        if faults or scene is None:
            raise ValidationError.from_exception_data(cls.__name__, faults)
        if not any(isinstance(f, Samples) for f in scene.force):
            return scene
        return scene.model_copy(update={"force": [_found(f, folder) for f in scene.force]})


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


def _measured(data: dict[str, Any], folder: Path) -> dict[str, Any]:
    """The same, with modes from files in place of the files' names; a scene is then complete in itself."""
    bodies = data.get("body")
    if not isinstance(bodies, list):
        return data
    filled = []
    for body in bodies:
        if isinstance(body, dict) and body.get("kind") == "modes" and isinstance(body.get("file"), str):
            try:
                own = read(folder / body["file"])
                body = {k: v for k, v in body.items() if k != "file"} | own
            except (OSError, ValueError):
                pass  # _files tells
        filled.append(body)
    return data | {"body": filled}


def _files(data: dict[str, Any], folder: Path) -> Iterator[InitErrorDetails]:
    """Files that cannot be read."""
    sorts = (("force", "file", "audio", "a WAV, FLAC or OGG file"), ("body", "modes", "CSV", "a table of modes"))
    for key, kind, sort, right in sorts:
        for i, table in tables(data, key):
            file = table.get("file")
            if table.get("kind") != kind or not isinstance(file, str) or not file:
                continue
            path = folder / file
            if not path.is_file():
                yield fault((key, i, "file"), file, f"no such file: {path}", "a path relative to the patch")
                continue
            try:
                channels = 0 if key == "body" and read(path) else _channels(path)
            except (OSError, RuntimeError, ValueError) as error:  # soundfile's own error is a RuntimeError
                yield fault((key, i, "file"), file, f"cannot be read as {sort} ({error})", right)
                continue
            channel = table.get("channel", 1)
            if key == "force" and isinstance(channel, int) and channel > channels:
                yield fault((key, i, "channel"), channel, f"the file has {channels} channel(s)", f"1 to {channels}")


def _channels(path: Path) -> int:
    import soundfile

    return int(soundfile.info(str(path)).channels)


def joined(scene: Scene, name: str) -> set[str]:
    """The bodies that contacts join with one, and it."""
    found, size = {name}, 0
    while size < len(found):
        size = len(found)
        for contact in scene.contact:
            if contact.on is not None and found & {contact.body, contact.on}:
                found |= {contact.body, contact.on}
    return found
