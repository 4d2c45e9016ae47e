"""Volume, expression and pan of the channels of a MIDI file, as gains of a sound (General MIDI Level 1)."""

import math
from collections.abc import Iterable
from typing import NamedTuple

import numpy as np

from engine.assembly.table_changes import LEVEL_STEP_SECONDS, glide_between
from engine.patch.frames import nearest_frame

VOLUME, PAN, EXPRESSION = 7, 10, 11  # controllers
FULL, CENTRE = 127, 64
DEFAULT_VOLUME = 100  # where another channel has one
RAMP_SECONDS = 0.02  # from one gain to the next


class LevelMove(NamedTuple):
    """A move of one of these controllers."""

    seconds: float
    channel: int
    control: int
    value: int


class Gain(NamedTuple):
    """The gains of the left and the right channel from a time on."""

    seconds: float
    left: float
    right: float


class ChannelLevels(NamedTuple):
    """The gains of a sound over time, which begin at 0 s.

    controls: that they follow
    remark:   what a user may not expect, as a line without its beginning; "" if there is nothing
    """

    gains: tuple[Gain, ...] = (Gain(0.0, 1.0, 1.0),)
    controls: frozenset[int] = frozenset()
    remark: str = ""

    @property
    def pans(self) -> bool:
        """True if the left and the right channel differ."""
        return any(not math.isclose(gain.left, gain.right) for gain in self.gains)

    def on_channels(self, gain: Gain, channels: int) -> list[float]:
        """Return a gain on each channel of a sound. One channel follows volume alone; of more than two, the others
        do."""
        middle = math.sqrt((gain.left * gain.left + gain.right * gain.right) / 2)
        return [gain.left, gain.right, *[middle] * (channels - 2)] if channels > 1 else [middle]

    def apply(self, audio: np.ndarray, samplerate: int) -> np.ndarray:
        """Return a sound at its gains, [frames, channels], which glide as levels do in live sound."""
        if len(self.gains) == 1 and self.gains[0][1:] == (1.0, 1.0):
            return audio
        factors = np.ones(audio.shape)
        for gain in self.gains:
            values = self.on_channels(gain, audio.shape[1])
            begin, seconds = nearest_frame(gain.seconds, samplerate), RAMP_SECONDS if gain.seconds > 0.0 else 0.0
            steps = max(1, math.ceil(seconds / LEVEL_STEP_SECONDS))
            if begin >= len(audio):
                break
            before = factors[begin].tolist()
            factors[begin:] = before
            for n in range(1, steps + 1):  # each value amid the time for which it holds
                due = begin + (nearest_frame((n - 0.5) * seconds / steps, samplerate) if steps > 1 else 0)
                factors[due:] = [glide_between(*ends, n / steps) for ends in zip(before, values, strict=True)]
        return audio * factors


def has_volume(moves: Iterable[LevelMove]) -> bool:
    """True if any channel has a volume."""
    return any(move.control == VOLUME for move in moves)


def levels_of(moves: list[LevelMove], channels: Iterable[int], default_volume: int) -> ChannelLevels:
    """The gains of a sound that some channels play together. One sound can follow them only if they are the same.

    default_volume: of channels that have none
    """
    curves = {channel: gains_of_channel(moves, channel, default_volume) for channel in sorted(set(channels))}
    controls = frozenset(move.control for move in moves if move.channel in curves)
    if len(set(curves.values())) <= 1:
        return ChannelLevels(next(iter(curves.values()), ChannelLevels().gains), controls)
    names = ", ".join(map(str, curves))
    remark = f"channels {names} have different volumes or pans, which one sound cannot follow; render a mix of them"
    return ChannelLevels(remark=f"{remark} with --play, such as {max(curves)}=PATCH")


def gains_of_channel(moves: list[LevelMove], channel: int, default_volume: int) -> tuple[Gain, ...]:
    """The gains of a channel: 40 log10(value/127) dB for volume and for expression, and a pan of equal power."""
    state, gains = {VOLUME: default_volume, EXPRESSION: FULL, PAN: CENTRE}, dict[float, Gain]()
    gains[0.0] = Gain(0.0, *stereo_gain(state))
    for move in moves:
        if move.channel == channel:
            state[move.control] = move.value
            gains[move.seconds] = Gain(move.seconds, *stereo_gain(state))
    kept = list[Gain]()
    for gain in gains.values():
        if not kept or gain[1:] != kept[-1][1:]:
            kept.append(gain)
    return tuple(kept)


def stereo_gain(state: dict[int, int]) -> tuple[float, float]:
    """The gains of the left and the right channel; both are those of the volume in the centre."""
    volume = (state[VOLUME] / FULL) ** 2 * (state[EXPRESSION] / FULL) ** 2
    if state[PAN] == CENTRE:
        return volume, volume
    angle = max(0, state[PAN] - 1) / (FULL - 1) * math.pi / 2
    return volume * math.sqrt(2) * math.cos(angle), volume * math.sqrt(2) * math.sin(angle)
