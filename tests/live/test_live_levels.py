"""Volume, expression and pan of a MIDI file: live, they give the sound that a rendering has."""

import json
import math

import numpy as np
import pytest
from conftest import ROOT
from smf import cc, off, on, smf, track

import engine
from engine.cli.notes import levels_of_file
from engine.live.channel_levels import ChannelLevels, Gain
from engine.live.instrument_notes import scene_of_file
from engine.live.level_player import LevelPlayer
from engine.live.midi import MidiFilePlayer, lowest_ratio, read_for, render_notes
from engine.live.midi_parts import Excerpt
from engine.live.player import Player
from engine.live.replay import replay
from engine.live.shared_memory import Slot
from engine.live.voice_allocator import VoiceAllocator

RATE, GAIN, FRAMES = 44_100, 2.0**-24, 26_460
MOVES = [(7, 100), (10, 20), (11, 90), (7, 3), (10, 127), (7, 0), (11, 127), (7, 80), (10, 64), (11, 40)]
PIECE = [
    *[(0, cc(7, 64)), (0, cc(10, 90)), (0, on(57)), (20, on(64))],
    *((n % 3 * 11 + 2, cc(control, value)) for n, (control, value) in enumerate(MOVES * 3)),
    *[(100, off(57)), (0, off(64))],
]
BARS = """
keyboard = { keys = "C3..C6" }
[key]
body = [{ name = "bar", kind = "oscillator", mass = 1e-3, frequency = "= f", damping_rate = 0.5 }]
on = [{ kind = "pluck", body = "bar", amplitude = "= v", duration = 1e-3 }]
pickup = [{ body = "bar", channel = CHANNEL }]
"""


def save(folder):
    (folder / "x.mid").write_bytes(smf(track(*PIECE)))
    return folder / "x.mid"


def played(player, *polled, block=256):
    """The sound of a player, while others tell it what comes."""
    player.counters[Slot.FADE_IN_FRAMES] = 0
    out = np.zeros((FRAMES, player.channels), np.float32)
    for begin in range(0, FRAMES, block):
        for one in polled:
            one.poll()
        player.render_into(out[begin : begin + block])
    return out


def assert_nearly_same(sound, rendered, differing=5e-3):
    """Single precision rounds once: two roundings of nearly one number lie beside each other at most, which is rare."""
    wanted = (rendered * GAIN).astype(np.float32)
    assert np.all(np.abs(sound.astype(float) - wanted) <= np.spacing(np.abs(wanted)))
    assert np.mean(sound != wanted) < differing and np.abs(wanted).max() > 0.0


@pytest.mark.hard
@pytest.mark.parametrize("channels", ["1", "[1, 2]", "[1, 2, 3]"])
@pytest.mark.parametrize("block", [64, 1000])
def test_keys_have_the_levels_of_a_rendering(tmp_path, channels, block):
    (tmp_path / "bars.toml").write_text(BARS.replace("CHANNEL", channels), "utf-8")
    notes = scene_of_file(engine.load(tmp_path / "bars.toml"), save(tmp_path))
    levels = levels_of_file(notes.file)
    rendering = engine.render(notes.scene, seconds=FRAMES / RATE, samplerate=RATE)
    player = Player(notes.scene, RATE, math.inf, GAIN)
    sound = played(player, LevelPlayer(levels, player, 0.0, player.channels), block=block)
    wanted = levels.apply(rendering.audio.reshape(FRAMES, -1), RATE)
    assert len({tuple(gain[1:]) for gain in levels.gains}) > 10
    assert_nearly_same(sound, wanted)
    np.testing.assert_array_equal(replay(json.loads(json.dumps(player.log()))), sound)


@pytest.mark.hard
def test_voices_have_the_levels_of_a_rendering(tmp_path):
    scene, path = engine.load(ROOT / "patches" / "piano_c4.toml"), str(save(tmp_path))
    rendered = render_notes(scene, path, RATE, Excerpt(seconds=FRAMES / RATE), 2)
    player = Player(scene, RATE, math.inf, GAIN, voices=2, lowest=lowest_ratio(path, scene))
    notes = MidiFilePlayer(VoiceAllocator(player), read_for(scene, path))
    levels = LevelPlayer(levels_of_file(notes.file), player, 0.0, player.channels)
    sound = played(player, notes, levels)
    wanted = levels_of_file(rendered.file).apply(rendered.audio.astype(float), RATE)
    assert np.abs(sound - (wanted * GAIN).astype(np.float32)).max() <= 3e-7 * np.abs(sound).max()


@pytest.mark.hard
def test_a_sound_of_one_channel_is_as_loud_on_both(tmp_path):
    """On a device of two channels, a patch of one follows volume alone, as its rendering does."""
    (tmp_path / "bars.toml").write_text(BARS.replace("CHANNEL", "1"), "utf-8")
    notes = scene_of_file(engine.load(tmp_path / "bars.toml"), save(tmp_path))
    levels, scene = levels_of_file(notes.file), notes.scene
    both = scene.model_copy(update={"pickup": [p.model_copy(update={"channel": [1, 2]}) for p in scene.pickup]})
    player = Player(both, RATE, math.inf, GAIN)
    sound = played(player, LevelPlayer(levels, player, 0.0, 1))
    np.testing.assert_array_equal(sound[:, 0], sound[:, 1])
    wanted = levels.apply(engine.render(scene, seconds=FRAMES / RATE, samplerate=RATE).audio.reshape(FRAMES, 1), RATE)
    assert_nearly_same(sound[:, :1], wanted)


def test_a_volume_stays_when_a_pickup_or_a_body_changes():
    """A control of the level or of the pitch does not undo the volume of the file, whichever comes first."""
    scene = engine.load(ROOT / "patches" / "piano_c4.toml")
    levels = ChannelLevels((Gain(0.0, 0.5, 0.25), Gain(0.2, 0.125, 1.0)))
    sounds = []
    for gains in (ChannelLevels(), levels):
        player = Player(scene, RATE, math.inf, GAIN)
        followed = LevelPlayer(gains, player, 0.0, 2)
        player.set("pickup.0.gain", 0.3, 0.0, 3000)
        player.set("body.string.frequency", 300.0, 0.0, 6000)
        player.set("pickup.0.gain", 0.6, 0.0, 12_000)
        player.set("body.string.frequency", 250.0, 0.0, 15_000)
        sounds.append(played(player, followed))
    plain, sound = (one.astype(float) for one in sounds)
    assert player.channels == 2
    assert_nearly_same(sound.astype(np.float32), levels.apply(plain / GAIN, RATE), differing=0.02)  # both are rounded
