"""What is played acts at its frame, however large the blocks are; and a key lifts the damper of what it strikes."""

import math

import numpy as np
import pytest
from conftest import ROOT, mostly_hard

import engine
from engine.live import midi_notes, voice_allocator
from engine.live.player import Player
from engine.live.replay import replay

RATE = 44_100
DUE = (7056, 7497, 7938, 8379)  # notes 5 ms apart
HARP = engine.Scene.model_validate(
    {
        "body": [
            {"name": "tine", "kind": "oscillator", "mass": 0.01, "frequency": 330.0, "damping_rate": 4.0},
            {"name": "hammer", "kind": "mass", "mass": 0.01, "displacement": -0.001, "velocity": 1.0},
        ],
        "contact": [{"body": "hammer", "on": "tine", "stiffness": 1e6, "exponent": 1.5}],
        "pickup": [{"body": "tine"}],
    }
)


def played(block: int, frames: int, what) -> tuple[np.ndarray, Player]:
    """What is heard in blocks of a size, of four voices of a tine to which `what` is done first."""
    player = Player(HARP, RATE, math.inf, 1e-3, voices=4, lowest=0.5)
    what(player)
    out = np.zeros((frames, 1), np.float32)
    for begin in range(0, frames, block):
        player.render_into(out[begin : begin + block])
    return out[:, 0], player


def notes(player: Player) -> None:
    keys = voice_allocator.VoiceAllocator(player)
    for n, frame in enumerate(DUE):
        keys.play(midi_notes.Note(0.0, "on", 60 + n, 64), frame)


@pytest.mark.parametrize("block", mostly_hard([64, 441, 1024, 4096, 20_000], 1024))
def test_notes_sound_at_their_frames(block):
    """Each is heard where the hammer first touches, as of a note alone; the bits are those of any other blocks."""
    sound, _ = played(block, 20_000, notes)
    np.testing.assert_array_equal(sound, played(1, 20_000, notes)[0])
    for n, frame in enumerate(DUE):
        others = np.zeros(20_000, np.float32)
        for m in range(n):
            others += played(block, 20_000, lambda player, m=m: one(player, m))[0]
        alone, _ = played(block, 20_000, lambda player, n=n: one(player, n))
        first = int(np.flatnonzero(alone)[0])
        assert frame < first <= frame + 60  # the hammer flies 1 mm at 1 m/s
        assert np.abs(sound[:first] - others[:first]).max(initial=0.0) <= 1e-6 * np.abs(sound).max()
        assert np.abs(sound[first : first + 30] - others[first : first + 30]).max() > 0.0


def one(player: Player, n: int) -> None:
    voice_allocator.VoiceAllocator(player).play(midi_notes.Note(0.0, "on", 60 + n, 64), DUE[n])


@pytest.mark.hard
def test_a_glide_has_all_its_steps_in_any_block():
    """And a strike told after it, for a frame before its end, does not wait for it."""

    def glide(player: Player) -> None:
        player.strike("hammer_0", 1.0, frame=100)
        player.tune(0, 1.5, frame=2000, seconds=0.1)
        player.strike("hammer_1", 1.0, frame=3000)

    sounds = [played(block, 12_000, glide) for block in (1, 64, 999, 12_000)]
    for sound, player in sounds[1:]:
        np.testing.assert_array_equal(sound, sounds[0][0])
        np.testing.assert_array_equal(replay(player.log())[:, 0], sound)
    taken = [e["frame"] for e in sounds[-1][1].log()["events"] if e["why"][0] == "tune"]
    assert len(taken) == 50 and taken[-1] == 2000 + 4410 and len(set(taken)) == 50
    alone, _ = played(
        64, 12_000, lambda player: player.strike("hammer_0", 1.0, frame=100) or player.tune(0, 1.5, 2000, 0.1)
    )
    second = np.flatnonzero(np.abs(sounds[0][0] - alone) > 0.0)[0]
    assert 3000 < second <= 3060


@pytest.mark.parametrize("when", mostly_hard([3.0, 8.0], 8.0))
def test_a_strike_rings_whenever_it_comes(when):
    """The damper that the score of the piano lets down for good at 5.3 s is lifted by the key: from silence, a strike
    rings as at 1 s, to 0.1 dB."""
    scene = engine.load(ROOT / "patches" / "piano_c4.toml")
    still = {"event": [e for e in scene.event if e.kind == "damp"]}
    still["body"] = [b.model_copy(update={"velocity": 0.0}) if b.kind == "mass" else b for b in scene.body]
    levels = []
    for start in (1.0, when):
        player = Player(scene.model_copy(update=still), RATE, math.inf, 1e-3)
        out = np.zeros((round((start + 3.0) * RATE), player.channels), np.float32)
        player.render_into(out[: round(start * RATE)])
        assert not out.any()
        player.strike("hammer", 2.0)
        player.render_into(out[round(start * RATE) :])
        rung = out[round(start * RATE) :].reshape(30, -1)
        levels.append(10 * np.log10(np.mean(rung.astype(float) ** 2, axis=1)))
    assert np.max(np.abs(levels[1] - levels[0])) <= 0.1
