"""Messages of a MIDI port, as a player hears them: of an instrument with keys, and of voices of a patch."""

import copy
import math
import sys
import types

import numpy as np
import pytest
from conftest import ROOT
from hypothesis import given, settings
from hypothesis import strategies as st

import engine
from engine.instrument.held_keys import PEDAL_NAMES, HeldKeys
from engine.instrument.key_names import note_frequency
from engine.live import midi_port
from engine.live.controls import Controls
from engine.live.key_allocator import KeyAllocator, live_scene
from engine.live.midi_port import MAX_AT_ONCE, MidiPort, leave_out_passing_moves, take_message
from engine.live.mpe import MpeZones
from engine.live.player import Player
from engine.live.voice_allocator import PEDAL_DOWN, VoiceAllocator
from engine.patch.control_tables import Midi

mido = pytest.importorskip("mido", reason="needs mido")
RATE, C4, E4, PORT = 44_100, 60, 64, "Drum"
ENDED, HELD = 0.02, 0.3  # levels, of that before: below, a note was let go; above, it sounds on
BARS = """
keyboard = { keys = ["C4", "E4"] }
[key]
body = [{ name = "bar", kind = "oscillator", mass = 1e-3, frequency = "= f", damping_rate = 1.0 }]
on = [{ kind = "pluck", body = "bar", amplitude = "= v", duration = 1e-3 }]
damper = [{ body = "bar", sigma = 40.0 }]
pickup = [{ body = "bar" }]
"""


def on(key, channel=1):
    return mido.Message("note_on", channel=channel - 1, note=key, velocity=64)


def off(key, channel=1):
    return mido.Message("note_off", channel=channel - 1, note=key)


def cc(control, value=0, channel=1):
    return mido.Message("control_change", channel=channel - 1, control=control, value=value)


def wheel(pitch, channel=1):
    return mido.Message("pitchwheel", channel=channel - 1, pitch=pitch)


def rpn(low, *data, channel=1, high=0):
    """A registered parameter is chosen, and data controllers follow."""
    return [cc(101, high, channel), cc(100, low, channel), *(cc(*one, channel) for one in data)]


class Keyboard:
    """A port, what plays its notes, and what it says."""

    def __init__(self, scene, driver, midi):
        self.driver, self.said = driver, []
        scene = scene.model_copy(update={"midi": Midi(**midi)})
        if scene.instrument is not None:
            self.player = Player(live_scene(scene), RATE, math.inf, 1e-3, waiting=True)
            self.allocator = KeyAllocator(self.player)
        else:
            self.player = Player(scene, RATE, math.inf, 0.02, voices=3, lowest=0.5)
            self.allocator = VoiceAllocator(self.player)
        self.port = MidiPort(PORT.lower(), lambda: self.allocator, Controls(scene, self.player), self.said.append)

    def send(self, *messages):
        """Send messages, and let them be taken."""
        for message in messages:
            self.driver.opened[-1].send(message)
        for _ in range(1 + len(messages) // MAX_AT_ONCE):
            self.port.poll()
        self.allocator.poll()

    def hear(self):
        """Return a fifth of a second of sound, a fifth of a second later."""
        out = np.zeros((2, RATE // 5, self.player.channels), np.float32)
        self.player.render_into(out.reshape(-1, self.player.channels))
        return out[1].sum(axis=1) * np.hanning(RATE // 5)

    def levels(self, *messages):
        """Return the levels of C4 and E4 after messages."""
        self.send(*messages)
        sound = self.hear()
        return np.array([level(sound, note_frequency(key)) for key in (C4, E4)])

    def pitch(self, *messages):
        """Return by how many semitones the strongest partial is above C4 after messages."""
        self.send(*messages)
        sound, near = self.hear(), np.linspace(-3.0, 3.0, 241)
        return float(max(near, key=lambda semitones: level(sound, note_frequency(C4 + semitones))))


def level(sound, hertz):
    return abs(np.sum(sound * np.exp(-2j * np.pi * hertz * np.arange(sound.size) / RATE)))


@pytest.fixture
def driver(monkeypatch):
    """A MIDI driver that is none, whose ports can vanish: what is sent to one comes out of it."""
    module = types.ModuleType("no_driver")
    module.opened, module.names = [], [PORT]

    def open_input(name=None, **told):
        module.opened.append(mido.ports.EchoPort(name))
        return module.opened[-1]

    module.Input = open_input
    module.get_devices = lambda **told: [{"name": n, "is_input": True, "is_output": False} for n in module.names]
    monkeypatch.setitem(sys.modules, "no_driver", module)
    before = mido.backend
    mido.set_backend("no_driver")
    yield module
    mido.set_backend(before)


@pytest.fixture(params=["keys", "voices"])
def keyboard(request, driver, tmp_path):
    bars, piano = tmp_path / "bars.toml", ROOT / "patches" / "piano_c4.toml"
    bars.write_text(BARS, "utf-8")
    path = bars if request.param == "keys" else piano
    return lambda **midi: Keyboard(engine.load(path), driver, midi)


RANGES = {
    "NRPN": ([*rpn(0, (6, 2)), cc(99, 1), cc(98, 8), cc(6, 64)], 2.0),
    "null": ([*rpn(0, (6, 2)), *rpn(127, (6, 1), high=127)], 2.0),
    "RPN after NRPN": ([*rpn(0, (6, 2)), cc(99, 1), cc(98, 8), cc(6, 64), *rpn(0, (6, 1))], 1.0),
    "cents": (rpn(0, (6, 1), (38, 50)), 1.5),
    "no cents": (rpn(0, (6, 1), (38, 50), (6, 1)), 1.0),
    "increment": (rpn(0, (6, 1), *100 * [(96, 0)]), 2.0),
    "decrement": (rpn(0, (6, 2), *50 * [(97, 0)]), 1.5),
    "reset": (rpn(0, (6, 2), (121, 0), (6, 1)), 2.0),
}


@pytest.mark.parametrize("name", RANGES)
def test_the_wheel_bends_by_its_range(keyboard, name):
    messages, semitones = RANGES[name]
    assert keyboard().pitch(*messages, wheel(8191), on(C4)) == pytest.approx(semitones, abs=0.03)


@pytest.mark.parametrize("control", [123, 124, 125, 126, 127])
def test_all_notes_off_and_the_modes_let_go_of_the_keys_of_their_channel(keyboard, control):
    keys = keyboard()
    before = keys.levels(on(C4, 1), on(E4, 2))
    after = keys.levels(cc(control)) / before
    assert after[0] < ENDED and after[1] > HELD


def test_a_key_that_two_channels_hold_sounds_until_both_let_go(keyboard):
    keys = keyboard()
    before = keys.levels(on(C4, 1), on(C4, 2))[0]
    assert keys.levels(cc(123))[0] > HELD * before
    assert keys.levels(off(C4, 2))[0] < ENDED * before


@pytest.mark.parametrize("pedal", [64, 66])
def test_reset_all_controllers_lifts_the_pedals_of_all_channels(keyboard, pedal):
    keys = keyboard()
    before = keys.levels(on(C4), cc(pedal, 127, channel=2), off(C4))[0]
    assert keys.levels()[0] > HELD * before
    assert keys.levels(cc(121))[0] < ENDED * before


@pytest.mark.hard
def test_reset_all_controllers_puts_the_wheel_of_its_channel_in_the_middle(keyboard):
    keys = keyboard(mpe_lower=15, mpe_bend_range=2.0)
    assert keys.pitch(wheel(8191, 2), wheel(-8192, 3), on(C4, 2)) == pytest.approx(2.0, abs=0.03)
    assert keys.pitch(cc(121, channel=2)) == pytest.approx(0.0, abs=0.03)
    keys.levels(off(C4, 2), on(C4, 3))  # until the first has ended
    assert keys.pitch() == pytest.approx(-2.0, abs=0.03)


@pytest.mark.parametrize(
    ("midi", "message", "held", "free"),
    [
        ({}, rpn(6, (6, 7)), 3, 9),
        ({"mpe_lower": 7}, rpn(6, (6, 0)), 8, 9),
        ({"mpe_lower": 7}, rpn(6, (6, 7)), 1, 9),
        ({"mpe_lower": 3, "mpe_upper": 3}, rpn(6, (6, 8), channel=16), 16, 3),
        ({"mpe_lower": 1, "mpe_upper": 3}, rpn(6, (6, 12)), 13, 16),
    ],
)
def test_a_zone_that_is_set_lets_its_notes_go_and_no_note_hangs(keyboard, midi, message, held, free):
    """It begins, ends, stays, is the upper one, or takes a member of the other."""
    keys = keyboard(**midi)
    before = keys.levels(on(C4, held), on(E4, free))
    after = keys.levels(*message) / before
    assert after[0] < ENDED and after[1] > HELD
    assert keys.levels(off(C4, held), off(E4, free))[1] < ENDED * before[1]


def test_of_many_moves_of_a_controller_the_last_counts():
    moves = [cc(1, n % 128) for n in range(300)]
    assert leave_out_passing_moves(moves) == moves[-1:]
    apart = [cc(1, 5), cc(2, 6), cc(1, 7, channel=2), wheel(8), wheel(9, 2)]
    assert leave_out_passing_moves(moves + apart) == apart
    touches = [mido.Message("polytouch", note=key, value=value) for value in (1, 2) for key in (C4, E4)]
    assert leave_out_passing_moves(touches) == touches[2:]


def test_a_pedal_counts_on_each_side_of_a_note():
    messages = [cc(64, 127), on(C4), cc(64, 60), cc(64, 0), off(C4), cc(64, 127)]
    assert leave_out_passing_moves(messages) == [m for m in messages if m != cc(64, 60)]


def test_pedals_that_go_up_and_down_and_parameters_are_kept_whole():
    parameters = [*rpn(0, (6, 2), (38, 1), (38, 1), (96, 0), (96, 0)), cc(99, 1), cc(98, 8), cc(6, 3), cc(6, 4)]
    for messages in ([cc(64, 0), cc(64, 127)], [cc(64, 70), cc(66, 0), cc(64, 90)], parameters):
        assert leave_out_passing_moves(messages) == messages


class Played:
    """The state of keys, pedals, wheels and controllers, and that which each note finds."""

    scene = types.SimpleNamespace(instrument=None, midi=Midi())

    def __init__(self):
        self.held, self.sounding, self.wheels, self.moved, self.notes = HeldKeys(), set(), {}, {}, []

    def play(self, note):
        if note.kind == "bend":
            self.wheels[note.channels] = note.value
            return
        if note.kind in PEDAL_NAMES:
            self.held.move_pedal(note.kind, float(note.value >= PEDAL_DOWN), note.channels.channel)
        else:
            self.notes.append((note, self.state()))
            if note.kind == "on":
                self.held.press(note.number, note.channels.followed())
            else:
                self.held.down.discard(note.number)
            self.sounding |= self.held.down
        self.sounding = {key for key in self.sounding if self.held.damper_share(key) == 0.0}

    def release_all(self, part):
        self.notes.append((part, self.state()))

    def takes(self, move):
        self.moved[move[:3]] = move.value
        return False

    def state(self):
        return copy.deepcopy((self.sounding, vars(self.held), self.wheels, self.moved))


PARAMETERS = [cc(101), cc(100), cc(6, 1), cc(6, 20), cc(38, 50), cc(96), cc(98, 8), cc(123), wheel(0), wheel(8191)]
PEDALS = [on(60), off(60), *(cc(pedal, value) for pedal in (64, 66) for value in (0, 70, 127))]
MESSAGES = [*PARAMETERS, *PEDALS, on(61, 2), off(61, 2), wheel(-8192, 2), cc(1, 5), cc(1, 6), cc(64, 0, 2)]


@pytest.mark.hard
@settings(max_examples=500, deadline=None)
@given(st.lists(st.sampled_from(MESSAGES), max_size=40) | st.lists(st.sampled_from(PEDALS), min_size=12, max_size=40))
def test_what_is_left_out_changes_no_note_and_not_the_end(messages):
    kept, ends = leave_out_passing_moves(messages), []
    for some in (messages, kept):
        played, zones = Played(), MpeZones(Midi())
        for message in some:
            if not zones.feed(message):
                take_message(message, zones, played, played)
        ends.append((played.notes, played.state()))
    assert ends[0] == ends[1]
    rest = iter(messages)
    assert all(any(message is one for one in rest) for message in kept)  # in their order


def test_no_more_than_some_messages_are_taken_at_once_and_none_is_lost(driver):
    played = Played()
    port = MidiPort(PORT, lambda: played, played)
    sent = [(on if n % 2 == 0 else off)(n % 120) for n in range(3 * MAX_AT_ONCE + 8)]
    for message in sent:
        driver.opened[0].send(message)
    for polls in range(1, 6):
        port.poll()
        assert len(played.notes) == min(polls * MAX_AT_ONCE, len(sent))
    assert [note.number for note, _ in played.notes] == [message.note for message in sent]


@pytest.mark.hard_for("voices")
def test_a_port_that_vanishes_lets_its_notes_go_and_plays_when_it_is_back(keyboard, driver, monkeypatch):
    monkeypatch.setattr(midi_port, "LOOK_SECONDS", 0.0)
    keys = keyboard()
    assert keys.pitch(on(C4), cc(64, 127), wheel(8191), on(E4, 2), off(E4, 2)) > 1.9 and keys.said == []
    before = level(keys.hear(), note_frequency(C4 + 2))
    driver.names.clear()
    keys.send()  # the port is looked for
    sound = keys.hear()
    assert all(level(sound, note_frequency(key)) < ENDED * before for key in (C4, C4 + 2, E4, E4 + 2))
    (line,) = keys.said
    assert line.startswith(f"MIDI: {PORT} is gone, and its notes are let go")
    driver.names.append(PORT)
    keys.send()
    assert keys.said[1:] == [f"MIDI: {PORT} is back"]
    assert keys.pitch(on(C4)) == pytest.approx(0.0, abs=0.03)
    before = keys.levels()[0]
    assert keys.levels(off(C4))[0] < ENDED * before
