"""Messages of the MIDI Tuning Standard: keys are tuned while they sound, at a port as in a file that is rendered."""

import math

import mido
import numpy as np
import pytest

import engine
from engine.instrument.key_names import note_frequency
from engine.live.controls import Controls
from engine.live.instrument_notes import scene_of_file
from engine.live.key_allocator import KeyAllocator, live_scene
from engine.live.midi import render_notes
from engine.live.midi_notes import Note
from engine.live.midi_parts import Excerpt
from engine.live.midi_port import take_message
from engine.live.midi_tuning import read_tuning_message
from engine.live.mpe import MpeZones
from engine.live.player import Player
from engine.live.voice_allocator import VoiceAllocator
from engine.patch.control_tables import Midi
from tests.live.smf import off, on, smf, track

RATE = 44_100
KEYS = {
    "keyboard": {"keys": "C3..C6"},
    "key": {
        "body": [{"name": "bar", "kind": "oscillator", "mass": 1e-3, "frequency": "= f", "damping_rate": 1.0}],
        "on": [{"kind": "pluck", "body": "bar", "amplitude": "= v", "duration": 1e-3}],
        "pickup": [{"body": "bar"}],
    },
}


def semitone_bytes(semitones: float) -> list[int]:
    """A pitch as a message has it."""
    whole, fraction = divmod(round(semitones * 16384), 16384)
    return [whole, fraction >> 7, fraction & 127]


def single(*pitches: tuple[int, float]) -> list[int]:
    """A message that tunes some keys at once."""
    return [0x7F, 0x7F, 8, 2, 0, len(pitches), *(b for key, pitch in pitches for b in [key, *semitone_bytes(pitch)])]


def octave(*cents: float) -> list[int]:
    """A message that tunes the twelve pitch classes, in steps of 100/8192 cent."""
    steps = [round(one / 100 * 8192) + 8192 for one in cents]
    return [0x7F, 0x7F, 8, 9, 3, 127, 127, *(b for step in steps for b in (step >> 7, step & 127))]


MEANTONE = (10.26, -13.69, 3.42, 20.53, -3.42, 13.69, -10.26, 6.84, -17.11, 0.0, 17.11, -6.84)


def measured(audio: np.ndarray) -> float:
    """The frequency of a tone that decays, Hz."""
    (a, b), *_ = np.linalg.lstsq(np.column_stack([audio[1:-1], -audio[:-2]]), audio[2:], rcond=None)
    return math.acos(a / (2.0 * math.sqrt(b))) / (2.0 * math.pi) * RATE


def cents(one: float, other: float) -> float:
    return 1200.0 * math.log2(one / other)


# --- the messages


def test_single_keys_bulk_dumps_and_octaves_are_read():
    assert read_tuning_message(single((60, 60.5), (61, 72.0))) == {60: pytest.approx(50.0), 61: pytest.approx(1100.0)}
    with_bank = [0x7E, 0, 8, 7, 1, 0, 1, 69, *semitone_bytes(68.75)]
    assert read_tuning_message(with_bank) == {69: pytest.approx(-25.0)}
    unchanged = [0x7F, 0x7F, 8, 2, 0, 1, 60, 127, 127, 127]
    assert read_tuning_message(unchanged) == {}
    pitches = [b for key in range(128) for b in semitone_bytes(min(127.5, key + 0.25))]
    dump = [0x7E, 0, 8, 1, 0, *b"sixteen letters ", *pitches, 0]
    assert read_tuning_message(dump)[60] == pytest.approx(25.0, abs=0.01) and len(read_tuning_message(dump)) == 128
    fine = read_tuning_message(octave(*MEANTONE))
    assert all(fine[key] == pytest.approx(MEANTONE[key % 12], abs=0.01) for key in range(128))
    coarse = [0x7E, 0, 8, 8, 3, 127, 127, *(64 + n for n in range(-6, 6))]
    assert [read_tuning_message(coarse)[key] for key in (60, 66, 71)] == [-6.0, 0.0, 5.0]


@pytest.mark.parametrize(
    "data", [[], [0x7F], [0x43, 0x10, 8, 2, 0, 1], [0x7F, 0x7F, 8, 2], [0x7F, 0, 8, 2, 0, 9, 60, 1]]
)
def test_messages_of_others_and_cut_ones_tune_nothing(data):
    assert read_tuning_message(data) == {}
    assert MpeZones(Midi()).feed(mido.Message("sysex", data=data))


@pytest.mark.parametrize("kind", [1, 2, 4, 7, 8, 9, 3])
def test_a_message_may_end_anywhere(kind):
    whole = [0x7E, 0, 8, kind, *range(1, 120)]
    tuned = [set(read_tuning_message(whole[:end])) for end in range(len(whole))]
    assert set().union(*tuned) <= set(range(128))


# --- at a port


class Port:
    """What is played at a port, and heard."""

    def __init__(self, patch: dict | str) -> None:
        scene = engine.load(patch)
        if scene.instrument is not None:
            self.player = Player(live_scene(scene), RATE, math.inf, 1e-3, waiting=True)
            self.keys = KeyAllocator(self.player)
        else:
            self.player = Player(scene, RATE, math.inf, 0.02, voices=3, lowest=0.5)
            self.keys = VoiceAllocator(self.player)
        self.zones, self.controls = MpeZones(scene.midi, is_port=True), Controls(scene, self.player)

    def send(self, *messages: mido.Message) -> None:
        for message in messages:
            if self.zones.feed(message):
                for key, value in self.zones.tuned.items():
                    self.keys.play(Note(0.0, "tune", key, value))
            else:
                take_message(message, self.zones, self.keys, self.controls)
        self.keys.poll()

    def pitch(self) -> float:
        """The pitch of what sounds, Hz."""
        out = np.zeros((RATE // 2, self.player.channels), np.float32)
        self.player.render_into(out)
        return measured(out[RATE // 10 :, 0].astype(float))


def press(key: int) -> mido.Message:
    return mido.Message("note_on", note=key, velocity=64)


def test_a_key_that_sounds_is_tuned_and_one_that_is_pressed_later():
    port = Port(KEYS)
    port.send(press(60))
    assert abs(cents(port.pitch(), note_frequency(60))) < 0.1
    port.send(mido.Message("sysex", data=single((60, 60.5), (67, 66.9))))
    assert cents(port.pitch(), note_frequency(60)) == pytest.approx(50.0, abs=0.1)
    port.send(mido.Message("note_off", note=60))
    other = Port(KEYS)
    other.send(mido.Message("sysex", data=octave(*MEANTONE)), press(64))
    assert cents(other.pitch(), note_frequency(64)) == pytest.approx(MEANTONE[4], abs=0.1)


def test_a_tuned_instrument_is_tuned_to_the_pitch_of_the_message(tmp_path):
    """Whatever its own tuning is."""
    (tmp_path / "a.scl").write_text("quarter tones\n24\n" + "".join(f"{50.0 * n:.1f}\n" for n in range(1, 25)))
    scene = engine.load(KEYS).with_tuning(tmp_path / "a.scl")
    port = Port(scene.instrument)
    port.send(press(62))
    assert cents(port.pitch(), note_frequency(61)) == pytest.approx(0.0, abs=0.1)
    port.send(mido.Message("sysex", data=single((62, 62.0))))
    assert cents(port.pitch(), note_frequency(62)) == pytest.approx(0.0, abs=0.1)


def test_voices_of_a_patch_without_keys_are_tuned():
    bar = {"name": "bar", "kind": "oscillator", "mass": 1e-3, "frequency": note_frequency(60), "damping_rate": 1.0}
    hammer = {"name": "hammer", "kind": "mass", "mass": 1e-4, "displacement": -1e-4, "velocity": 1.0}
    contact = {"body": "hammer", "on": "bar", "stiffness": 1e6, "exponent": 1.5}
    port = Port({"body": [bar, hammer], "contact": [contact], "pickup": [{"body": "bar"}]})
    port.send(mido.Message("sysex", data=single((60, 60.5))), press(60))
    assert cents(port.pitch(), note_frequency(60)) == pytest.approx(50.0, abs=1.0)
    port.send(mido.Message("sysex", data=single((60, 59.75))))
    assert cents(port.pitch(), note_frequency(60)) == pytest.approx(-25.0, abs=1.0)


# --- in a file


def sysex(data: list[int]) -> bytes:
    return bytes([0xF0, len(data) + 1, *data, 0xF7])


def test_a_file_tunes_keys_as_a_port_does(tmp_path):
    path = tmp_path / "a.mid"
    path.write_bytes(
        smf(track((0, sysex(octave(*MEANTONE))), (0, on(64)), (480, sysex(single((64, 64.5)))), (960, off(64))))
    )
    played = scene_of_file(engine.load(KEYS), path)
    audio = engine.render(played.scene, 1.4, samplerate=RATE).audio[:, 0]
    first, second = audio[RATE // 10 : RATE * 45 // 100], audio[RATE * 6 // 10 : RATE * 12 // 10]
    assert cents(measured(first), note_frequency(64)) == pytest.approx(MEANTONE[4], abs=0.1)
    assert cents(measured(second), note_frequency(64)) == pytest.approx(50.0, abs=0.1)
    path.write_bytes(smf(track((0, on(64)), (960, off(64)))))
    plain = engine.render(scene_of_file(engine.load(KEYS), path).scene, 0.5, samplerate=RATE).audio[:, 0]
    assert cents(measured(plain[RATE // 10 :]), note_frequency(64)) == pytest.approx(0.0, abs=0.1)


def test_messages_of_other_makers_in_a_file_change_nothing(tmp_path):
    path, others = tmp_path / "a.mid", [(0, sysex([0x43, 0x10, 0x4C, 0, 0, 0x7E, 0])), (0, sysex([0x7E, 0x7F, 9, 1]))]
    path.write_bytes(smf(track(*others, (0, on(64)), (960, off(64)))))
    with_others = scene_of_file(engine.load(KEYS), path)
    path.write_bytes(smf(track((0, on(64)), (960, off(64)))))
    assert with_others.score == scene_of_file(engine.load(KEYS), path).score and with_others.ignored == {}


def test_voices_are_tuned_by_a_file(tmp_path):
    path = tmp_path / "a.mid"
    path.write_bytes(smf(track((0, sysex(single((60, 60.5)))), (0, on(60)), (960, off(60)))))
    rendered = render_notes(engine.load("piano_c4"), str(path), RATE, Excerpt(seconds=0.8), 2)
    path.write_bytes(smf(track((0, on(60)), (960, off(60)))))
    plain = render_notes(engine.load("piano_c4"), str(path), RATE, Excerpt(seconds=0.8), 2)
    one, other = (strongest(np.asarray(sound.audio)[RATE // 10 :, 0]) for sound in (rendered, plain))
    assert cents(one, other) == pytest.approx(50.0, abs=3.0)


def strongest(audio: np.ndarray) -> float:
    spectrum = np.abs(np.fft.rfft(audio * np.hanning(audio.size), 1 << 19))
    return float(np.argmax(spectrum)) * RATE / (1 << 19)
