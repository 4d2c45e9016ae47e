"""A log of what was played, and the same samples made of it again."""

import json
import math
from collections.abc import Callable
from pathlib import Path
from typing import Annotated, Any, NamedTuple

import numpy as np
from pydantic import BaseModel, ConfigDict, Field, ValidationError

from engine.assembly.event_table import EventRow
from engine.files import read_bytes
from engine.kernel.data.effects import FRICTION
from engine.kernel.data.enums import FRICTION_EVENTS, PUSHING_EVENTS, EventKind
from engine.live.audio_memory import MAX_FRAMES
from engine.live.event_queue import RowSet, make_row_set
from engine.live.player import Player
from engine.live.shared_memory import Slot
from engine.patch.frames import SAMPLE_RATE_RANGE
from engine.patch.scene import Scene
from engine.patch.tables import MAX_EXPONENT

PIECE_FRAMES = 16_384  # between two looks at Ctrl-C
MAX_QUALITY = 1 << 20  # level
HOURS = 10  # that a log tells of at most
CONNECTION_EVENTS = EventKind.CONNECTION_STIFFNESS, EventKind.CONNECTION_DAMPING, EventKind.CONNECTION_REST
Whole = Annotated[int, Field(ge=-(1 << 62), le=1 << 62)]  # that the audio thread can hold
Real = Annotated[float, Field(allow_inf_nan=False)]


class LoggedEvent(BaseModel):
    """One event of a log: `why` is the call as the user made it, `row` the event as the audio thread took it at a
    frame; the frame is None if the event was dropped."""

    model_config = ConfigDict(strict=True)

    frame: int | None = Field(ge=0, le=MAX_FRAMES)
    why: list[Any]
    row: list[Whole | Real] = Field(min_length=8, max_length=len(EventRow._fields))
    sets: list[int | list[Any]] = []  # of a group; each with its rows where it comes first


class Log(BaseModel):
    """The log that Player.log returns."""

    model_config = ConfigDict(strict=True, allow_inf_nan=False)

    scene: dict[str, Any]
    samplerate: int = Field(ge=SAMPLE_RATE_RANGE[0], le=SAMPLE_RATE_RANGE[1])
    gain: float
    frames: int = Field(ge=0, le=1 << 33)
    end: int = Field(ge=0, le=MAX_FRAMES)
    fade: int = Field(ge=0, le=1 << 20)  # 0: it begins at once
    leave: int = Field(ge=1, le=1 << 20)
    voices: int = Field(ge=0, le=64)
    lowest: float = Field(gt=0.0, le=1.0)
    general: bool = False
    waiting: bool = False
    table_digest: str = Field(default="", pattern=r"^[0-9a-f]{0,64}$")  # older logs have none
    events: list[LoggedEvent]
    next: "Log | None" = None  # of a player that took over

    def made(self) -> Scene:
        """The scene that was played."""
        return Scene.model_validate(self.scene)


def read_log(path: Path) -> Log:
    """A log from its file. Raises OSError or ValueError if it is none."""
    try:
        record = json.loads(read_bytes(path, None).decode(), parse_constant=_none)
        return Log.model_validate(record)
    except RecursionError:
        raise ValueError("its brackets are nested too deeply") from None
    except ValidationError as error:
        fault = error.errors()[0]
        raise ValueError(f"{'.'.join(map(str, fault['loc']))}: {fault['msg']}") from None


def _none(name: str) -> Any:
    raise ValueError(f"{name} is not a valid JSON number")


def replay(
    record: dict[str, Any] | Log,
    progress: Callable[[float], None] | None = None,
    warn: Callable[[str], object] | None = None,
) -> np.ndarray:
    """Compute the sound of a session from its log: single precision [frames, channels], the same bit for bit. Raises
    ValueError (pydantic's, or BuildError) if the log is not valid.

    progress: called now and then with the share rendered, 0 to 1
    warn:     called with a message if the tables are not those of the log, so that the samples may differ
    """
    log = record if isinstance(record, Log) else Log.model_validate(record)
    if log.frames > HOURS * 3600 * log.samplerate:
        raise ValueError(f"it has {log.frames} frames; at most {HOURS} hours")
    try:
        parts = _make_parts(log)
        if warn is not None and (message := _describe_other_tables(parts)):
            warn(message)
        return _played(parts, progress or (lambda share: None))
    except (LookupError, ArithmeticError, TypeError, RecursionError) as error:
        raise ValueError(f"it describes an impossible state: {error}") from error


class _Part(NamedTuple):
    """A player of a log, and when it begins: at the beginning, or as it takes over."""

    log: Log
    player: Player
    begin: int  # frame of the session
    sets: dict[int, RowSet]  # that its groups of events name


def _describe_other_tables(parts: list[_Part]) -> str:
    """Describe where the tables of players differ from those of their logs; "" if they do not, or the logs are of an
    earlier version, which named none."""
    pairs = [(part.log.table_digest, part.player.table_digest) for part in parts if part.log.table_digest]
    different = [(before, now) for before, now in pairs if before != now]
    if not different:
        return ""
    before, now = different[0]
    return (
        f"tables {now} differ from those of the session, {before}: another processor, NumPy or version of the engine"
        " computed those, and the samples may differ"
    )


def _make_parts(log: Log) -> list[_Part]:
    """Make the players of a log, in the order in which they take over."""
    parts = [_make_part(log, 0)]
    while (following := parts[-1].log.next) is not None:
        parts.append(_make_part(following, parts[-1].begin + parts[-1].log.end - parts[-1].log.leave))
    return parts


def _played(parts: list[_Part], progress: Callable[[float], None]) -> np.ndarray:
    """Compute the sound of a valid log, by its players."""
    first, last = parts[0].player, parts[-1]
    out, at = np.zeros((last.begin + min(last.log.frames, last.log.end), first.channels), np.float32), 0

    def render_until(end: int) -> None:
        nonlocal at
        for piece in range(at, max(end, at + 1), PIECE_FRAMES):
            progress(piece / max(1, len(out)))
            first.render_into(out[piece : min(end, piece + PIECE_FRAMES)])
        at = end

    for frame, part, event in _timeline(parts):
        if frame < len(out):
            render_until(frame)
            if event is None:
                parts[parts.index(part) - 1].player.cross_fade_to(part.player)
            else:
                _do(part, event)
    render_until(len(out))
    return out


def _make_part(log: Log, begin: int) -> _Part:
    """Make the player of a log."""
    options = {name: getattr(log, name) for name in ("voices", "lowest", "general", "waiting")}
    player = Player(log.made(), log.samplerate, math.inf, log.gain, **options)
    end = log.end if log.next is None else MAX_FRAMES  # another one will say when
    player.counters[[Slot.END, Slot.FADE_IN_FRAMES, Slot.FADE_OUT_FRAMES]] = end, log.fade, log.leave
    return _Part(log, player, begin, {})


def _timeline(parts: list[_Part]) -> list[tuple[int, _Part, LoggedEvent | None]]:
    """Return what was done at which frames of a session, in order; None: the player of a part took over."""
    done: list[tuple[int, _Part, LoggedEvent | None]] = [(part.begin, part, None) for part in parts[1:]]
    for part in parts:
        events = [e for e in part.log.events if e.frame is not None and e.why[:1] != ["score"]]  # the scene has a score
        frames = [e.frame for e in events if e.frame is not None]
        if frames != sorted(frames):
            raise ValueError("its events are not sorted by frame")
        done += [(part.begin + frame, part, event) for frame, event in zip(frames, events, strict=True)]
    return sorted(done, key=lambda one: one[0])


def _do(part: _Part, event: LoggedEvent) -> None:
    """Do again what an event of a log says."""
    player, why, sets = part.player, event.why, part.sets
    if why[:1] == ["tune"] and len(why) in (3, 4):
        player.tune(int(why[1]), float(why[2]), body=why[3] if why[3:] else None)
    elif why[:1] == ["set"] and len(why) == 3:
        player.set(str(why[1]), float(why[2]), seconds=0.0)
    elif why[:1] == ["set"] and len(why) == 2:
        player.set({str(name): float(value) for name, value in dict(why[1]).items()}, seconds=0.0)
    else:
        for one in event.sets:
            if not isinstance(one, int):
                sets[one[0]] = make_row_set(one[0], [validated_row(player, row) for row in one[1]])
        numbers = [one if isinstance(one, int) else one[0] for one in event.sets]
        player.queue_unlogged(validated_row(player, event.row), [sets[number] for number in numbers])


def validated_row(player: Player, row: list[int | float]) -> EventRow:
    """A row that touches nothing but what it may: the audio thread asks no questions. Raises ValueError."""
    row = [*row, *[0] * (len(EventRow._fields) - len(row))]  # older logs have fewer values
    kind, island, first, last, start, length = (int(number) for number in row[:6])
    model = player.model
    count = model.islands.mode.size - 1
    sizes: dict[int, Any] = dict.fromkeys(
        (EventKind.STRIKE, EventKind.DAMP, EventKind.LIFT, EventKind.LAUNCH_AND_LIFT), model.islands.mode
    )
    sizes |= dict.fromkeys((EventKind.STIFFNESS, EventKind.BARRIER, EventKind.EXPONENT), model.islands.contact)
    sizes |= dict.fromkeys(FRICTION_EVENTS if model.effects & FRICTION else (), model.islands.contact)
    sizes |= dict.fromkeys(CONNECTION_EVENTS, model.islands.connection)
    sizes |= dict.fromkeys(PUSHING_EVENTS, model.islands.force)
    if kind == EventKind.QUALITY:
        good = 0 <= first <= MAX_QUALITY
    elif kind in (EventKind.CANCEL, EventKind.GROUP):
        good = True
    else:
        good = kind in sizes and 0 <= island < count
        good = good and 0 <= first < last <= sizes[kind][island + 1] - sizes[kind][island]
    if kind in (EventKind.CONNECTION_STIFFNESS, EventKind.CONNECTION_DAMPING):
        good = good and row[6] >= 0.0
    if kind == EventKind.EXPONENT:
        good = good and 1.0 <= row[6] <= MAX_EXPONENT
    if kind == EventKind.PLUCK:
        good = good and row[7] > 0.0 and row[8] >= 0.0
    good = good and all(abs(number) <= 1 << 62 for number in row[:6])
    if not good or not all(math.isfinite(number) for number in row) or not 0 <= start <= MAX_FRAMES:
        raise ValueError(f"it has an impossible event: {row}")
    value, value2, value3 = (float(number) for number in row[6:9])
    numbers = kind, island, first, last, start, max(0, length)
    return EventRow(*numbers, value, value2, value3, int(row[9]), bool(row[10]))
