"""A log of what was played, and the same samples made of it again."""

import math
from typing import Any

import numpy as np
from pydantic import BaseModel, ConfigDict, Field

from engine import deck, post
from engine.events import BEND, DAMP, LIFT, MOVE, STIFFEN, STRIKE, THROW
from engine.parts import STEEPEST
from engine.player import LARGEST, Player
from engine.scene import SAMPLERATES, Scene


class Event(BaseModel):
    """What was done: `why` as a person said it, `row` as the audio thread took it at a frame; None: it was dropped."""

    model_config = ConfigDict(strict=True)

    frame: int | None = Field(ge=0, le=LARGEST)
    why: list[Any]
    row: list[int | float] = Field(min_length=8, max_length=8)


class Log(BaseModel):
    """What Player.log gives."""

    model_config = ConfigDict(strict=True, allow_inf_nan=False)

    scene: dict[str, Any]
    samplerate: int = Field(ge=SAMPLERATES[0], le=SAMPLERATES[1])
    gain: float
    frames: int = Field(ge=0, le=1 << 33)
    end: int = Field(ge=0, le=LARGEST)
    fade: int = Field(ge=1, le=1 << 20)
    leave: int = Field(ge=1, le=1 << 20)
    voices: int = Field(ge=0, le=64)
    lowest: float = Field(gt=0.0, le=1.0)
    general: bool = False
    events: list[Event]


def replay(told: dict[str, Any]) -> np.ndarray:
    """What was played, from its log: single precision [frames, channels], the same bit for bit. Raises ValueError
    (pydantic's, or BuildError) if the log is none."""
    log = Log.model_validate(told)
    player = Player(
        Scene.model_validate(log.scene), log.samplerate, math.inf, log.gain, log.voices, log.lowest, log.general
    )
    player.desk[deck.END], player.desk[deck.FADE], player.desk[deck.LEAVE] = log.end, log.fade, log.leave
    out, at = np.zeros((min(log.frames, log.end), player.channels), np.float32), 0
    for event in log.events:
        if event.frame is None or event.frame >= len(out):
            continue
        if event.frame < at:
            raise ValueError("its events are not in the order of their frames")
        player.play(out[at : event.frame])
        at = event.frame
        if event.why[:1] == ["tune"] and len(event.why) in (3, 4):
            player.tune(int(event.why[1]), float(event.why[2]), body=event.why[3] if event.why[3:] else None)
        else:
            deck.put_in(player.desk.ctypes.data, *sound_row(player, event.row))
    player.play(out[at:])
    return out


def sound_row(player: Player, row: list[int | float]) -> tuple[Any, ...]:
    """A row that touches nothing but what it may: the audio thread asks no questions. Raises ValueError."""
    kind, island, first, last, start, length = (int(number) for number in row[:6])
    model = player.model
    count = model.islands.mode.size - 1
    sizes = dict.fromkeys((STRIKE, DAMP, LIFT, THROW), model.islands.mode)
    sizes |= dict.fromkeys((STIFFEN, MOVE, BEND), model.islands.contact)
    if kind == deck.QUALITY:
        good = 0 <= first <= player.desk[deck.LOWEST]
    elif kind == post.PLUCK:
        good = model.force is not None and 0 <= first < model.force.start.size and 0 <= island < count
    else:
        good = kind in sizes and 0 <= island < count
        good = good and 0 <= first < last <= sizes[kind][island + 1] - sizes[kind][island]
    if kind == BEND:
        good = good and 1.0 <= row[6] <= STEEPEST
    if not good or not all(math.isfinite(number) for number in row) or not 0 <= start <= LARGEST:
        raise ValueError(f"it has an event that cannot be: {row}")
    return kind, island, first, last, start, max(0, length), float(row[6]), float(row[7])
