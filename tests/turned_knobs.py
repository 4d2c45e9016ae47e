"""Knobs that are turned fast while a scene is played."""

import math

import numpy as np

from engine.live.player import Player

BLOCK = 64


def sweep_knobs(player: Player, ranges: dict[str, tuple[float, float]], frames: int, begin: float) -> np.ndarray:
    """Play with knobs swept from end to end of their ranges and back, 20 times a second, while hammers fly.

    begin: displacement at which the hammers are thrown, m
    """
    out = np.zeros((frames, player.channels), np.float32)
    for n in range(frames // BLOCK):
        if n % 60 == 0:
            player.strike(velocity=4.0, displacement=begin)
        share = 0.5 - 0.5 * math.cos(2 * math.pi * 20 * n * BLOCK / 44_100)
        for knob, (low, high) in ranges.items():
            value = low * (high / low) ** share if low > 0.0 else low + (high - low) * share
            player.set(knob, value, BLOCK / 44_100)
        player.render_into(out[n * BLOCK : (n + 1) * BLOCK])
    return out
