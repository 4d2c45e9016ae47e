"""A `Scene`: a patch as a whole, validated.

`Scene.model_validate({...})` reports every fault at once, those of structure and those that break a rule of the whole.
"""

import copy
import math
from collections.abc import Callable, Iterator
from itertools import islice
from pathlib import Path
from typing import Any, Self

from pydantic import Field, ModelWrapValidatorHandler, PrivateAttr, ValidationError, ValidationInfo, model_validator
from pydantic_core import InitErrorDetails

from engine.arithmetic.plain_numbers import power
from engine.bodies import Body
from engine.bodies.csv_files import read_modes, read_shape
from engine.bodies.table import KeyPath, Table, make_fault
from engine.files import check_regular_file
from engine.instrument.expansion import expand, is_instrument
from engine.instrument.tables import Keyboard, KeyTables, Note, Pedal
from engine.output_files import error_reason, soundfile_path
from engine.patch.accuracy import Accuracy
from engine.patch.bow import Bow, expand_bows
from engine.patch.control_rules import as_plain_change, check_changes, check_controls
from engine.patch.control_tables import Control, Midi
from engine.patch.frames import SAMPLE_RATE_RANGE
from engine.patch.friction import Friction
from engine.patch.labels import Label
from engine.patch.live_parameters import live_paths
from engine.patch.materials import fill_in_materials
from engine.patch.named_values import fill_in_values
from engine.patch.positions import tables_of
from engine.patch.rules import check_rules
from engine.patch.tables import MAX_GRAVITY, MAX_SECONDS, Connection, Contact, Event, Force, Pickup, SampledForce
from engine.patch.tremolo import Tremolo
from engine.patch.tuning_files import fill_in_tuning
from engine.wording import to_one_line

MAX_LEVEL = 400.0  # dB, either way
MAX_TABLES = 5_000  # of one section
MAX_EVENTS = 100_000
MAX_NOTES = 20_000
MAX_CONTROLS = 500
MAX_LABELS = 500
MAX_FAULTS_COLLECTED = 2_000  # beyond, no more are looked for
MAX_PATH_CHARACTERS = 200  # of a file's name, or of why it cannot be read, in a message
MAX_FORCE_SAMPLES = 1 << 25  # of a force file, all channels together


class SceneTables(Table):
    """The tables of a patch, validated; `engine.patch.scene.Scene` adds what can be done with them."""

    title: str = Field(default="", description="title")
    author: str = Field(default="", description="who made the patch, for the tags of sounds and for plug-ins")
    licence: str = Field(default="", description="licence of the patch, such as CC BY 4.0, for the same")
    seconds: float = Field(default=2.0, gt=0.0, le=MAX_SECONDS, description="length of the sound, s")
    level: float | None = Field(
        default=None,
        ge=-MAX_LEVEL,
        le=MAX_LEVEL,
        description="gain of live sound, of pages and of files with --level patch, dB",
    )
    gravity: float = Field(
        default=0.0,
        ge=-MAX_GRAVITY,
        le=MAX_GRAVITY,
        description="downward acceleration of masses and oscillators, m/s²: with 9.81 their weight is -9.81 N/kg",
    )
    values: dict[str, float | str] = Field(
        default={},
        exclude=True,
        description='named values: numbers, numbers with a unit ("6 cm"), or formulas ("= 2*radius"), which all other'
        " values may use",
    )
    vary: dict[str, str | int | list[float | int | str]] = Field(
        default={},
        exclude=True,
        description="what variations draw anew (`fdh sweep --variations`): a named value, or the path of a value, and"
        ' its range: "A..B", "A..B:log", "A~B" (normal, with standard deviation B), or a list of values; `seed`',
    )
    labels: dict[str, Label] = Field(
        default={},
        max_length=MAX_LABELS,
        description='names of live parameters for people: `"contact.felt.stiffness" = "hardness of the felt"`. Pages,'
        " plug-ins (LV2), libraries in C and `fdh params` show them",
    )
    tremolo: Tremolo | None = Field(default=None, description="tremolo of the output")
    accuracy: Accuracy = Field(default=Accuracy(), description="accuracy settings")
    body: list[Body] = Field(min_length=1, max_length=MAX_TABLES, description="the bodies")
    contact: list[Contact] = Field(
        default=[], max_length=MAX_TABLES, description="contacts between bodies, or with barriers"
    )
    connection: list[Connection] = Field(
        default=[],
        max_length=MAX_TABLES,
        description="connections between bodies: springs, rigid joints, ends of strings, air",
    )
    friction: list[Friction] = Field(
        default=[], max_length=MAX_TABLES, description="friction between bodies, or with surfaces such as bows"
    )
    bow: list[Bow] = Field(
        default=[], max_length=MAX_TABLES, description="bows: short for friction, and for the events that move it"
    )
    force: list[Force] = Field(default=[], max_length=MAX_TABLES, description="external forces")
    event: list[Event] = Field(default=[], max_length=MAX_EVENTS, description="events of the score")
    pickup: list[Pickup] = Field(min_length=1, max_length=MAX_TABLES, description="outputs of the scene")
    control: list[Control] = Field(
        default=[], max_length=MAX_CONTROLS, description="live parameters that controllers change"
    )
    midi: Midi = Field(default=Midi(), description="MIDI settings")
    keyboard: Keyboard | None = Field(default=None, exclude=True, description="keys of an instrument")
    key: KeyTables | None = Field(default=None, exclude=True, description="tables of each key of an instrument")
    note: list[Note] = Field(default=[], max_length=MAX_NOTES, exclude=True, description="notes of an instrument")
    pedal: list[Pedal] = Field(default=[], max_length=MAX_NOTES, exclude=True, description="pedals of an instrument")
    _document: dict[str, Any] | None = PrivateAttr(default=None)  # of an instrument, as it was read
    _source: dict[str, Any] | None = PrivateAttr(default=None)  # of a patch with named values, as it was read
    _folder: Path = PrivateAttr(default=Path())
    _rig: Any = PrivateAttr(default=None)  # of several instruments (engine.patch.rig)
    _output_gains: dict[int, float] = PrivateAttr(default_factory=dict)  # of channels, from 0, as a session sets them

    @model_validator(mode="wrap")
    @classmethod
    def _report_all_faults(cls, data: Any, handler: ModelWrapValidatorHandler[Self], info: ValidationInfo) -> Self:
        """Validate a document, and report the faults that pydantic finds together with those that we find."""
        faults: list[InitErrorDetails] = []
        scene = None
        context = info.context or {}
        folder, document = Path(context.get("folder", ".")), None
        source = data
        if isinstance(data, dict):
            data, faults = fill_in_values(data)
            if faults:
                raise ValidationError.from_exception_data(cls.__name__, faults[:MAX_FAULTS_COLLECTED])
        if is_instrument(data):
            data, faults = fill_in_tuning(data, folder)
            if faults:
                raise ValidationError.from_exception_data(cls.__name__, faults)
            expansion = context.get("expansion")
            document = data if expansion is not None else copy.deepcopy(data)  # which who gave it may change
            expansion = expansion or expand(_limit_integers(data))
            data = expansion.document
            if "origins" in context:
                context["origins"].update(expansion.origins)
            if expansion.faults:
                faults += expansion.faults
                raise ValidationError.from_exception_data(cls.__name__, faults[:MAX_FAULTS_COLLECTED])
        if isinstance(data, dict):
            data, bow_faults = expand_bows(data, document is not None, context.get("origins", {}))
            faults += bow_faults
            data = fill_in_materials(data)
            data, file_faults = _read_body_files(_limit_integers(data), folder)
            faults += [*file_faults, *islice(_check_force_files(data, folder), MAX_FAULTS_COLLECTED)]
        try:
            scene = handler(data)
        except ValidationError as error:
            errors = error.errors(include_url=False)[:MAX_FAULTS_COLLECTED]
            if document is not None:  # its keys would have made what is missing, had they been right
                errors = [e for e in errors if e["type"] != "missing" or len(e["loc"]) > 1] or errors
            faults += [_repeat_error(e, data) for e in errors]
        if isinstance(data, dict):
            faults += islice(check_rules(data), MAX_FAULTS_COLLECTED)
        if scene is not None and not faults:
            faults += [*check_controls(scene), *check_changes(scene)]
        if faults or scene is None:
            raise ValidationError.from_exception_data(cls.__name__, faults[:MAX_FAULTS_COLLECTED])
        kinds = {body.name: type(body) for body in scene.body}
        pickups = [p if p.quantity else p.model_copy(update={"quantity": kinds[p.body].HEARD}) for p in scene.pickup]
        forces = [_with_absolute_file(f, folder) for f in scene.force]
        is_given = "accuracy" in scene.model_fields_set
        accuracy = scene.accuracy.beside_friction() if scene.friction else scene.accuracy
        scene = scene.model_copy(update={"pickup": pickups, "force": forces, "accuracy": accuracy})
        if not is_given:
            scene.model_fields_set.discard("accuracy")
        if any(getattr(event, "parameter", None) for event in scene.event):
            paths = live_paths(scene, True)
            scene = scene.model_copy(update={"event": [as_plain_change(event, paths) for event in scene.event]})
        if document is not None:
            scene._document, scene._folder = document, folder
        elif scene.values:
            scene._source, scene._folder = copy.deepcopy(source), folder
        return scene

    @property
    def instrument(self) -> dict[str, Any] | None:
        """The document of the instrument that this scene was written out from; None if it is none."""
        return self._document

    @property
    def document(self) -> dict[str, Any]:
        """Return the patch as a document that can be read again: a copy, with numbers in place of the files that bodies
        name; of an instrument, or of a patch with named values, as it was read."""
        source = self._document if self._document is not None else self._source
        return self.model_dump(exclude_unset=True) if source is None else copy.deepcopy(source)

    @property
    def folder(self) -> Path:
        """The folder to which files in the document are relative."""
        return self._folder

    @property
    def level_factor(self) -> float | None:
        """The factor on SI units that its level means; None if it gives no level."""
        return None if self.level is None else power(10.0, self.level / 20.0)

    @property
    def channels(self) -> int:
        """Number of channels of its sound."""
        return max(channel for p in self.pickup for channel in p.channels)

    def output_gain(self, channel: int) -> float:
        """The gain of a channel, from 0, that a session has set, such as the volume of a MIDI file."""
        return self._output_gains.get(channel, 1.0)

    def with_output_gain(self, channel: int, gain: float) -> Self:
        """The patch with another gain of a channel."""
        changed = self.model_copy()
        changed._output_gains = self._output_gains | {channel: gain}
        return changed


def _limit_integers(value: Any) -> Any:
    """The value with integers beyond 64 bits, which TOML has not, as floating point; such as none has, infinite."""
    if isinstance(value, dict):
        return {key: _limit_integers(inner) for key, inner in value.items()}
    if isinstance(value, list):
        return [_limit_integers(inner) for inner in value]
    if isinstance(value, int) and abs(value) >= 1 << 63:
        return float(value) if abs(value) < 10**300 else math.inf
    return value


def _repeat_error(error: Any, data: Any) -> InitErrorDetails:
    """An error that pydantic raised, by itself or for a check of ours on one key, to be raised with the others."""
    if error["type"] == "scene":
        path: KeyPath = ()
        value = data
        for part in error["loc"]:
            if isinstance(value, dict) and part not in value:
                continue  # pydantic puts a table's kind there
            path, value = (*path, part), value[part]
        message, _, remedy = error["msg"].partition("; ")
        return make_fault(path, error["input"], message, remedy)
    details = InitErrorDetails(type=error["type"], loc=error["loc"], input=error["input"])
    if "ctx" in error:
        details["ctx"] = error["ctx"]
    return details


def _read_body_files(data: dict[str, Any], folder: Path) -> tuple[dict[str, Any], list[InitErrorDetails]]:
    """The document with numbers in place of the files that bodies name, so that a scene is complete in itself; and the
    faults of the files that cannot be read."""
    bodies = data.get("body")
    if not isinstance(bodies, list):
        return data, []
    complete, faults = [], list[InitErrorDetails]()

    def replace_file(table: Any, path: KeyPath, read: Callable[[Path], dict[str, Any]], content: str) -> Any:
        if not isinstance(table, dict) or not isinstance(table.get("file"), str):
            return table
        try:
            columns = read(folder / table["file"])
            if twice := [key for key in columns if table.get(key) is not None]:
                message = f"file and {twice[0]} are both given"
                faults.append(make_fault((*path, "file"), table["file"], message, "give one of them"))
            return {k: v for k, v in table.items() if k != "file"} | columns
        except (OSError, ValueError) as error:
            faults.append(_make_file_fault((*path, "file"), table["file"], "CSV", error, content))
            return table

    for i, body in enumerate(bodies):
        if isinstance(body, dict):
            if body.get("kind") == "modes":
                body = replace_file(body, ("body", i), read_modes, "a table of modes")
            for key in ("displacement", "velocity"):
                if isinstance(body.get(key), dict) and body[key].get("kind") == "points":
                    shape = replace_file(body[key], ("body", i, key), read_shape, "columns x, value")
                    body = body | {key: shape}
        complete.append(body)
    return data | {"body": complete}, faults


def _check_force_files(data: dict[str, Any], folder: Path) -> Iterator[InitErrorDetails]:
    """The faults of force files that cannot be read, or have no such channel."""
    for i, table in tables_of(data, "force"):
        file = table.get("file")
        if table.get("kind") != "file" or not isinstance(file, str) or not file:
            continue
        try:
            channels = _count_channels(folder / file)
        except (OSError, RuntimeError, TypeError, ValueError) as error:  # soundfile's own are RuntimeErrors
            yield _make_file_fault(("force", i, "file"), file, "audio", error, "a WAV, FLAC or OGG file")
            continue
        channel = table.get("channel", 1)
        if isinstance(channel, int) and channel > channels:
            message = f"the file has {channels} channel(s)"
            yield make_fault(("force", i, "channel"), channel, message, f"1 to {channels}")


def _make_file_fault(path: KeyPath, file: str, file_format: str, error: Exception, remedy: str) -> InitErrorDetails:
    """The fault of a file that cannot be read."""
    if isinstance(error, FileNotFoundError):
        message = f"no such file: {to_one_line(str(error.filename), MAX_PATH_CHARACTERS)}"
        return make_fault(path, file, message, "a path relative to the patch")
    reason = to_one_line(error_reason(error), MAX_PATH_CHARACTERS)
    return make_fault(path, file, f"cannot be read as {file_format} ({reason})", remedy)


def _count_channels(path: Path) -> int:
    """Count the channels of an audio file. Raises OSError, RuntimeError or ValueError if it cannot be a force."""
    import soundfile

    check_regular_file(path)
    info = soundfile.info(soundfile_path(path))
    if info.frames * info.channels > MAX_FORCE_SAMPLES:
        raise ValueError(f"it has {info.frames * info.channels} samples, more than {MAX_FORCE_SAMPLES}")
    low, high = SAMPLE_RATE_RANGE
    if not low <= info.samplerate <= high:
        raise ValueError(f"its sample rate is {info.samplerate} Hz, not {low} to {high}")
    return int(info.channels)


def _with_absolute_file(force: Any, folder: Path) -> Any:
    """The force with the absolute path of its file, so that what is kept of a scene can be read from anywhere."""
    if not isinstance(force, SampledForce):
        return force
    return force.model_copy(update={"file": str((folder / force.file).resolve())})
