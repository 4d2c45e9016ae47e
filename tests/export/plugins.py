"""Plug-ins for tests: their libraries are linked once, and lie beside the data of each patch."""

import math
import os
from functools import lru_cache
from importlib.util import find_spec
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pytest

from engine.api.page import level_of
from engine.export.plugin import this_system
from engine.export.plugin_data import PluginSettings, make_plugin_data
from engine.export.plugin_library import link_library
from engine.export.row_recorder import LOWEST_PAD, SLIDER_SECONDS, player_of_keys
from engine.export.table_sliders import _wheel_of
from engine.live.audio_memory import MAX_FRAMES
from engine.live.key_allocator import KeyAllocator, live_scene
from engine.live.midi_notes import Note
from engine.live.player import Player
from engine.live.shared_memory import Slot
from engine.live.voice_allocator import NOMINAL_VELOCITY, VELOCITY_EXPONENT
from tests.compiler.test_shipped import skip_if_stale
from tests.export.clap_host import NOTE_OFF, NOTE_ON, ClapLibrary, midi, note
from tests.export.key_messages import RATE, midi_of
from tests.live.two_ways import Message

BLOCK = 256  # frames
needs_linker = pytest.mark.skipif(
    find_spec("ziglang") is None or os.name == "nt", reason="the package ziglang is not there"
)


@lru_cache
def library_of(plugin_format):
    """Return the library of a format for this machine, as bytes."""
    skip_if_stale()
    return link_library(this_system(), plugin_format)


class Plugin(NamedTuple):
    """A plug-in that was written."""

    path: Path  # of its library
    data: Path
    gain: float  # of its samples

    def opened(self):
        """Return the library as a host has it."""
        return ClapLibrary(self.path)

    def active(self, rate=RATE):
        """Return an instance that plays."""
        plugin = self.opened().plugin()
        assert plugin.activate(rate)
        return plugin


def write_plugin(scene, folder, rates=(RATE,), slide=(), name="patch"):
    """Write a scene as a plug-in of CLAP to a folder."""
    gain = level_of(scene, rates[0])
    data = make_plugin_data(scene, PluginSettings(name, lambda: gain, rates, slide))
    path = folder / f"{name}.clap"
    path.write_bytes(library_of("clap"))
    path.with_suffix(".fdh").write_bytes(data.content)
    return Plugin(path, path.with_suffix(".fdh"), gain)


def events_of(messages, as_midi=False):
    """Return messages of keys as events of CLAP, or all of them as MIDI."""
    kinds = {} if as_midi else {"on": NOTE_ON, "off": NOTE_OFF}
    return [
        note(m.frame, kinds[m.kind], m.key, m.value)
        if m.kind in kinds
        else midi(m.frame, *midi_of(m.kind, m.key, m.value))
        for m in messages
    ]


def is_same(audio, expected):
    """True if sounds are the same, sample by sample, and not silent."""
    return bool(expected.any()) and np.count_nonzero(audio != expected) == 0


def play_live(scene, rate, gain, messages, frames):
    """Return what live sound plays, float32 [frames, channels]: of keys, or of hammers and plucks as notes."""
    has_keys = scene.instrument is not None
    player = Player(live_scene(scene) if has_keys else scene, rate, math.inf, gain, waiting=has_keys, kernel="general")
    player.counters[[Slot.FADE_IN_FRAMES, Slot.END]] = 0, MAX_FRAMES
    keys = KeyAllocator(player) if has_keys else None
    audio = np.zeros((frames, player.channels), np.float32)
    for begin in range(0, frames, BLOCK):
        for frame, kind, number, value in messages:
            if begin <= frame < begin + BLOCK:
                do(player, keys, Message(frame, kind, number, value))
        player.render_into(audio[begin : begin + BLOCK])
    return audio


def do(player, keys, message):
    """Do what a message says at its frame."""
    frame, kind, number, value = message
    if kind == "set":  # number: a parameter
        player.set(number, value, SLIDER_SECONDS, frame=frame)
    elif kind == "bend":
        positions = _wheel_of(player_of_keys(player.patch, player.samplerate, "general")).positions
        cents = min(positions, key=lambda one: abs(one - value))
        player.set({new.parameter: new.value for new in positions[cents]}, seconds=0.0, frame=frame)
    elif keys is not None:
        keys.play(Note(0.0, kind, number, value), frame)
    elif kind == "on":
        share = (value / NOMINAL_VELOCITY) ** VELOCITY_EXPONENT
        pads = [*player.strikers, *player.plucked]
        name = pads[number - LOWEST_PAD]
        if name in player.strikers:
            player.strike(name, share * player.default_velocity(name), frame=frame)
        else:
            player.pluck(name, share, frame=frame)
