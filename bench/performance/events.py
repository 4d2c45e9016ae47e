"""The price of an event: strikes, plucks, dampers and glides at a thousand a second, told in time for each block.

`uv run python -m bench events`: in this version. To compare another, copy this file there, and run both in turn.
"""

import math
import time
from collections.abc import Callable
from typing import NamedTuple

import numpy as np

import engine
from engine.live.player import Player

RATE, BLOCK, SECONDS = 48_000, 256, 2.0  # Hz, frames, s
PER_SECOND, TURNS = 1000, 7


class Case(NamedTuple):
    """A patch, and an event of it."""

    patch: str
    name: str
    send: Callable[[Player, int], None]  # to a player, for a frame


CASES = (
    Case("piano_c4", "damp", lambda player, frame: player.damp("string", 5.0, 0.01, frame=frame)),
    Case("piano_c4", "strike", lambda player, frame: player.strike("hammer", 1.0, frame=frame)),
    Case("piano_c4", "glide", lambda player, frame: player.set("contact.felt.stiffness", 1e10, 0.0005, frame=frame)),
    Case("tanpura", "pluck", lambda player, frame: player.pluck("string", frame=frame)),
)
CHANGED = {"tanpura": {"force.0.duration": 0.0005, "force.0.amplitude": -1e-9}}  # plucks neither overlap nor sound


class Price(NamedTuple):
    """What an event costs."""

    told: float  # µs, in the thread that tells it
    played: float  # µs, in the thread that renders


def measure(case: Case, ahead: int) -> Price:
    """Measure an event; the least of some turns. ahead: frames by which it is told before its block"""
    scene = engine.load(case.patch)
    scene = scene.replace(CHANGED[case.patch]) if case.patch in CHANGED else scene
    told, played, silent = math.inf, math.inf, math.inf
    for turn in range(2 * TURNS):
        player = Player(scene, RATE, math.inf, 1e-6, kernel="general")
        out, frames = np.zeros((BLOCK, player.channels), np.float32), int(SECONDS * RATE)
        player.render_into(out)
        step, sending, rendering = RATE // PER_SECOND, 0.0, 0.0
        following = BLOCK
        for begin in range(BLOCK, frames, BLOCK):
            start = time.perf_counter()
            while turn % 2 and following < begin + BLOCK + ahead:
                case.send(player, following)
                following += step
            middle = time.perf_counter()
            player.render_into(out)
            sending, rendering = sending + middle - start, rendering + time.perf_counter() - middle
        if turn % 2:
            told, played = min(told, sending), min(played, rendering)
        else:
            silent = min(silent, rendering)
    count = SECONDS * PER_SECOND
    return Price(1e6 * told / count, 1e6 * (played - silent) / count)


def main(words: list[str]) -> int:
    """Print the price of each event. Returns the exit code."""
    print("| patch | event | told | µs to tell | µs to play |")
    print("| --- | --- | --- | --- | --- |")
    for case in CASES:
        for ahead in (0, RATE // 5):
            told, played = measure(case, ahead)
            when = "0.2 s ahead" if ahead else "in its block"
            print(f"| {case.patch} | {case.name} | {when} | {told:.1f} | {played:.2f} |", flush=True)
    return 0
