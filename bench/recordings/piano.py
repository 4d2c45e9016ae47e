"""The piano that is compared with a recorded one: how a key sounds, and which keys it was tuned on."""

from functools import cache

import engine
from bench.recordings.instrument import Sound
from engine.patch.note_scene import scene_of_note

RATE = 44_100  # Hz
TUNED = (21, 30, 39, 48, 57, 66, 75, 84, 93, 102)  # every third of the keys recorded
HELD_LONGER = 1.0  # s, than is measured


def render_note(key: int, velocity: int, seconds: float, piano: engine.Scene | None = None) -> Sound:
    """Sound of a key, struck once at one of 16 velocities and held; of the shipped piano if none is given."""
    scene = scene_of_note(piano or load_piano(), key, min(127, 8 * velocity - 2), seconds + HELD_LONGER, seconds)
    return engine.render(scene, seconds, RATE).audio, RATE


@cache
def load_piano() -> engine.Scene:
    """The shipped piano."""
    return engine.load("piano")
