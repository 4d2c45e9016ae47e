"""The piano that is compared with a recorded one: how a key sounds, and which notes it was fitted to."""

from functools import cache

import engine
from bench.recordings.keys import layer_velocity
from bench.recordings.note import Sound
from engine.patch.note_scene import scene_of_note

RATE = 44_100  # Hz
FITTED_KEYS = (21, 30, 39, 48, 57, 66, 75, 84, 93, 102)  # every third of the keys recorded
FITTED_LAYERS = (4, 10, 16)  # levels and decays at 10, brightness over all three
HELD_LONGER = 1.0  # s, than is measured


def render_note(key: int, layer: int, seconds: float, piano: engine.Scene | None = None) -> Sound:
    """Sound of a key, struck once as for one of 16 layers and held; of the shipped piano if none is given."""
    scene = scene_of_note(piano or load_piano(), key, layer_velocity(layer), seconds + HELD_LONGER, seconds)
    return engine.render(scene, seconds, RATE).audio, RATE


@cache
def load_piano() -> engine.Scene:
    """The shipped piano."""
    return engine.load("piano")
