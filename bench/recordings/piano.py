"""The piano that is compared with a recorded one: how a key sounds, and which keys it was tuned on."""

from functools import cache

import engine
from bench.publish.report import ROOT
from bench.recordings.instrument import Sound
from bench.recordings.patches import RATE, strike_once

TUNED = (36, 60, 96)  # C2, C4, C7: at most one in three of the keys recorded
PATCHES = {36: "grand_c2", 60: "grand_c4", 96: "grand_c7"}


def render_note(key: int, velocity: int, seconds: float) -> Sound | None:
    """Sound of a key, struck once at one of 16 velocities and held; None if there is no such key."""
    if key not in PATCHES:
        return None
    return engine.render(strike_once(load_patch(PATCHES[key]), velocity), seconds, RATE).audio, RATE


@cache
def load_patch(name: str) -> engine.Scene:
    """A patch of the folder of patches."""
    return engine.load(ROOT / "patches" / f"{name}.toml")
