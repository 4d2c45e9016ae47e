"""Messages of keys, at the velocities and frames that exports have, and live sound for them."""

import math
import tomllib
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from engine.export.row_recorder import LEVELS, RELEASE
from engine.files import find_patch
from engine.live.key_allocator import KeyAllocator, live_scene
from engine.live.midi_notes import PEDALS, Note
from engine.live.player import Player
from engine.live.shared_memory import Slot
from engine.patch.scene import Scene
from tests.live.two_ways import Message, draw_messages

RATE = 44_100  # Hz, of exports
BLOCK = 128  # frames; a page takes messages between two blocks
KINDS = ("notes", "repeated", "overlapping", "pressed again", "short")


# an instrument that is built and compiled soon, whose notes change a spring later, and as they end
TWO_TINES = tomllib.loads("""
title = "Tines, of which two sound at a time"
seconds = 0.2
level = -30.0

[keyboard]
keys = "C4..G4"
polyphony = 2

[[key.body]]
name = "tine"
kind = "oscillator"
mass = 0.01
frequency = "= f"
damping_rate = 2.0

[[key.connection]]
name = "hold"
body = "tine"
stiffness = 1000.0

[[key.on]]
kind = "strike"
body = "tine"
velocity = "= v"

[[key.on]]
kind = "change"
connection = "hold"
stiffness = 3000.0
duration = 0.01

[[key.on]]
kind = "change"
connection = "hold"
time = 0.02
stiffness = 9000.0
duration = 0.1

[[key.off]]
kind = "change"
connection = "hold"
stiffness = "= 1000 + 500*v"
duration = 0.02

[[key.damper]]
body = "tine"
sigma = 30.0

[[key.pickup]]
body = "tine"
""")


class LiveSound(NamedTuple):
    """What a player plays."""

    samples: np.ndarray  # float64 [frames, channels], before the gain
    audio: np.ndarray  # float32 [frames, channels], as a device gets them


def draw_exported_messages(scene: Scene, kind: str, seed: int, frames: int) -> list[Message]:
    """Draw messages of a kind, the first at frame 0, at velocities and frames that exports play exactly."""
    messages = list[Message]()
    for frame, name, key, value in draw_messages(scene, kind, seed, frames):
        known = {"on": min(LEVELS, key=lambda one: abs(one - value)), "off": RELEASE}
        block = math.ceil(frame / BLOCK) if name == "off" else frame // BLOCK
        messages.append(Message(BLOCK * block, name, key, known.get(name, value)))
    return sorted(messages, key=lambda message: message.frame)


def play_live(scene: Scene, messages: Sequence[Message], frames: int, gain: float = 1.0) -> LiveSound:
    """Play messages on all keys of an instrument, block by block."""
    player = Player(live_scene(scene), RATE, math.inf, gain, waiting=True, kernel="general")
    player.counters[Slot.FADE_IN_FRAMES] = 0
    keys, samples = KeyAllocator(player), list[np.ndarray]()
    audio = np.zeros((frames, player.channels), np.float32)
    for begin in range(0, frames, BLOCK):
        for frame, kind, number, value in messages:
            if frame == begin:
                keys.play(Note(0.0, kind, number, value))
        player.render_into(audio[begin : begin + BLOCK])
        samples.append(player.memory.shared.audio[: len(audio[begin : begin + BLOCK])].copy())
    return LiveSound(np.concatenate(samples), audio)


def lines_of(messages: Sequence[Message], frames: int) -> list[str]:
    """Return messages as lines of the driver of a library in C, whose score is not played."""
    lines, now = ["0 skip"], 0
    for frame, kind, number, value in messages:
        if frame > now:
            lines.append(f"0 play {frame - now}")
            now = frame
        lines.append(f"0 pedal {value}" if kind == "sustain" else f"0 {kind} {number} {value}")
    return [*lines, f"0 play {frames - now}"]


def midi_of(kind, number, value):
    """Return a message of MIDI as its bytes."""
    if kind in ("on", "off"):
        return [0x90 if kind == "on" else 0x80, number, value]
    if kind == "bend":
        return [0xE0, *reversed(divmod(8192 + round(8192 * value / 200.0), 128))]
    return [0xB0, next(controller for controller, pedal in PEDALS.items() if pedal == kind), value]


def with_polyphony(name, keys):
    """Return the document of an instrument of which so many keys can sound at a time."""
    document = tomllib.loads(find_patch(name).read_text("utf-8"))
    return document | {"keyboard": document["keyboard"] | {"polyphony": keys}}
