"""A log of what was played, and the same samples made of it again."""

import json
import math
from collections.abc import Callable
from pathlib import Path
from typing import Annotated, Any

import numpy as np
from pydantic import BaseModel, ConfigDict, Field, ValidationError

from engine.assembly.event_table import EventRow
from engine.files import read_bytes
from engine.kernel.data.enums import FRICTION_EVENTS, EventKind
from engine.live.audio_memory import MAX_FRAMES
from engine.live.player import Player
from engine.live.shared_memory import Slot
from engine.patch.frames import SAMPLE_RATE_RANGE
from engine.patch.scene import Scene
from engine.patch.tables import MAX_EXPONENT

MAX_LOG_BYTES = 64_000_000  # bytes of a log
PIECE_FRAMES = 16_384  # between two looks at Ctrl-C
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
    row: list[Whole | Real] = Field(min_length=8, max_length=8)


class Log(BaseModel):
    """The log that Player.log returns."""

    model_config = ConfigDict(strict=True, allow_inf_nan=False)

    scene: dict[str, Any]
    samplerate: int = Field(ge=SAMPLE_RATE_RANGE[0], le=SAMPLE_RATE_RANGE[1])
    gain: float
    frames: int = Field(ge=0, le=1 << 33)
    end: int = Field(ge=0, le=MAX_FRAMES)
    fade: int = Field(ge=1, le=1 << 20)
    leave: int = Field(ge=1, le=1 << 20)
    voices: int = Field(ge=0, le=64)
    lowest: float = Field(gt=0.0, le=1.0)
    general: bool = False
    waiting: bool = False
    events: list[LoggedEvent]

    def made(self) -> Scene:
        """The scene that was played."""
        return Scene.model_validate(self.scene)


def read_log(path: Path) -> Log:
    """A log from its file. Raises OSError or ValueError if it is none."""
    try:
        record = json.loads(read_bytes(path, MAX_LOG_BYTES).decode(), parse_constant=_none)
        return Log.model_validate(record)
    except RecursionError:
        raise ValueError("its brackets are nested too deeply") from None
    except ValidationError as error:
        fault = error.errors()[0]
        raise ValueError(f"{'.'.join(map(str, fault['loc']))}: {fault['msg']}") from None


def _none(name: str) -> Any:
    raise ValueError(f"{name} is not a valid JSON number")


def replay(record: dict[str, Any] | Log, progress: Callable[[float], None] | None = None) -> np.ndarray:
    """Compute the sound of a session from its log: single precision [frames, channels], the same bit for bit. Raises
    ValueError (pydantic's, or BuildError) if the log is not valid.

    progress: called now and then with the share rendered, 0 to 1
    """
    log = record if isinstance(record, Log) else Log.model_validate(record)
    if log.frames > HOURS * 3600 * log.samplerate:
        raise ValueError(f"it has {log.frames} frames; at most {HOURS} hours")
    try:
        return _played(log, progress or (lambda share: None))
    except (LookupError, ArithmeticError, TypeError, RecursionError) as error:
        raise ValueError(f"it describes an impossible state: {error}") from error


def _played(log: Log, progress: Callable[[float], None]) -> np.ndarray:
    """Compute the sound of a valid log."""
    options = {name: getattr(log, name) for name in ("voices", "lowest", "general", "waiting")}
    player = Player(log.made(), log.samplerate, math.inf, log.gain, **options)
    player.counters[[Slot.END, Slot.FADE_IN_FRAMES, Slot.FADE_OUT_FRAMES]] = log.end, log.fade, log.leave
    out, at = np.zeros((min(log.frames, log.end), player.channels), np.float32), 0

    def render_pieces(begin: int, end: int) -> None:
        for piece in range(begin, max(end, begin + 1), PIECE_FRAMES):
            progress(piece / max(1, len(out)))
            player.render_into(out[piece : min(end, piece + PIECE_FRAMES)])

    for event in log.events:
        if event.frame is None or event.frame >= len(out) or event.why[:1] == ["score"]:
            continue  # what the score says, the scene says
        if event.frame < at:
            raise ValueError("its events are not sorted by frame")
        render_pieces(at, event.frame)
        at = event.frame
        if event.why[:1] == ["tune"] and len(event.why) in (3, 4):
            player.tune(int(event.why[1]), float(event.why[2]), body=event.why[3] if event.why[3:] else None)
        elif event.why[:1] == ["set"] and len(event.why) == 3:
            player.set(str(event.why[1]), float(event.why[2]), seconds=0.0)
        elif event.why[:1] == ["set"] and len(event.why) == 2:
            player.set({str(name): float(value) for name, value in dict(event.why[1]).items()}, seconds=0.0)
        else:
            player.queue_unlogged(validated_row(player, event.row))
    render_pieces(at, len(out))
    return out


def validated_row(player: Player, row: list[int | float]) -> EventRow:
    """A row that touches nothing but what it may: the audio thread asks no questions. Raises ValueError."""
    kind, island, first, last, start, length = (int(number) for number in row[:6])
    model = player.model
    count = model.islands.mode.size - 1
    sizes: dict[int, Any] = dict.fromkeys(
        (EventKind.STRIKE, EventKind.DAMP, EventKind.LIFT, EventKind.LAUNCH_AND_LIFT), model.islands.mode
    )
    sizes |= dict.fromkeys((EventKind.STIFFNESS, EventKind.BARRIER, EventKind.EXPONENT), model.islands.contact)
    sizes |= dict.fromkeys(FRICTION_EVENTS if model.contact and model.contact.friction else (), model.islands.contact)
    sizes |= dict.fromkeys(CONNECTION_EVENTS, model.islands.connection)
    if kind == EventKind.QUALITY:
        good = 0 <= first <= player.memory.shared.lowest_quality
    elif kind == EventKind.PLUCK:
        good = model.force is not None and 0 <= first < model.force.start.size and 0 <= island < count
    else:
        good = kind in sizes and 0 <= island < count
        good = good and 0 <= first < last <= sizes[kind][island + 1] - sizes[kind][island]
    if kind in (EventKind.CONNECTION_STIFFNESS, EventKind.CONNECTION_DAMPING):
        good = good and row[6] >= 0.0
    if kind == EventKind.EXPONENT:
        good = good and 1.0 <= row[6] <= MAX_EXPONENT
    good = good and all(abs(number) <= 1 << 62 for number in row[:6])
    if not good or not all(math.isfinite(number) for number in row) or not 0 <= start <= MAX_FRAMES:
        raise ValueError(f"it has an impossible event: {row}")
    return EventRow(kind, island, first, last, start, max(0, length), float(row[6]), float(row[7]))
