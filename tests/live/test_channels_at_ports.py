"""Messages of channels at a port: the setting says for whose notes they are."""

import math

import mido
import numpy as np
import pytest
from bars import RATE, VOICE, cents, write_bars
from smf import cc, off, on, rpn, wheel

import engine
from engine.instrument.key_names import note_frequency
from engine.live.controls import Controls
from engine.live.key_allocator import KeyAllocator, live_scene
from engine.live.midi_port import MidiPort
from engine.live.player import Player
from engine.live.voice_allocator import VoiceAllocator
from engine.patch.control_tables import Midi

bars = pytest.fixture(write_bars)


class Port:
    """A port, whose messages are taken at once, and what plays them."""

    def __init__(self, patch, monkeypatch, **midi):
        scene = engine.load(patch).model_copy(update={"midi": Midi(**midi)})
        if scene.instrument is None:
            self.player = Player(scene, RATE, math.inf, 0.02, voices=6, lowest=0.25)
            self.keys = VoiceAllocator(self.player)
        else:
            self.player = Player(live_scene(scene, [57, 63]), RATE, math.inf, 1e-3, waiting=True)
            self.keys = KeyAllocator(self.player)
        monkeypatch.setattr("engine.live.midi_port.open_port", mido.ports.EchoPort)
        self.port = MidiPort("Keys", lambda: self.keys, Controls(scene, self.player))
        self.hear(0.1)

    def send(self, *messages):
        for message in messages:
            self.port._port.send(mido.Message.from_bytes(message))
            self.port.poll()
        self.keys.poll()

    def hear(self, seconds):
        out = np.zeros((round(seconds * RATE), self.player.channels), np.float32)
        self.player.render_into(out)
        return out.sum(axis=1).astype(float)


SETTINGS = {  # whether the wheel and the pedal of channel 1 act on a note of channel 2, too
    "auto": False,
    "apart": False,
    "together": True,
}


@pytest.mark.parametrize("patch", ["bars", "voices"])
@pytest.mark.parametrize("setting", SETTINGS)
def test_at_a_port_the_setting_says_whose_notes_a_message_is_for(bars, monkeypatch, setting, patch):
    port = Port(bars if patch == "bars" else VOICE, monkeypatch, channels=setting)
    port.send(on(57), on(63, channel=2), wheel(8191), cc(64, 127))
    sound = port.hear(0.5)
    assert cents(sound, 57, 3) == pytest.approx(200, abs=4.0)
    assert cents(sound, 63, 3) == pytest.approx(200 if SETTINGS[setting] else 0, abs=4.0)
    port.send(wheel(0), off(57), off(63, channel=2))
    sound = np.concatenate([sound, port.hear(1.0)])
    held = np.abs(np.fft.rfft(sound[-RATE // 2 :] * np.hanning(RATE // 2)))
    near = [held[round(note_frequency(key) / 2) - 4 : round(note_frequency(key) / 2) + 5].max() for key in (57, 63)]
    assert (near[1] > 0.05 * near[0]) == SETTINGS[setting]


def test_one_channel_that_plays_has_the_wheel_of_any(bars, monkeypatch):
    """A wheel, or a pedal board, on a channel of its own, until notes come on a second one."""
    port = Port(bars, monkeypatch)
    port.send(wheel(8191, 5), on(57))
    assert cents(port.hear(0.5), 57) == pytest.approx(200, abs=2.0)
    port.send(on(63, channel=2))
    sound = port.hear(0.5)
    assert cents(sound, 57, 3) == pytest.approx(0, abs=2.0) and cents(sound, 63, 3) == pytest.approx(0, abs=2.0)


@pytest.mark.parametrize("patch", ["bars", "voices"])
def test_at_a_port_a_key_is_held_as_often_as_it_was_pressed(bars, monkeypatch, patch):
    port = Port(bars if patch == "bars" else VOICE, monkeypatch)
    port.send(on(57), on(57), off(57))
    first = np.abs(port.hear(0.5)[-4410:]).max()
    port.send(off(57))
    assert np.abs(port.hear(0.5)[-4410:]).max() < 0.05 * first


def test_at_a_port_tunings_are_heard(bars, monkeypatch):
    port = Port(bars, monkeypatch)
    port.send(*(data for _, data in rpn(2, (6, 66))), *(data for _, data in rpn(1, (6, 96))), on(57))
    assert cents(port.hear(0.5), 57) == pytest.approx(250, abs=2.0)
