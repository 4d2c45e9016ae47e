"""Instruments played by MIDI files and live: the same notes give the same sound, and what is not played is said."""

import itertools
import math

import numpy as np
import pytest
import soundfile
from test_keyboards import RATE, SCORE, STRINGS

import engine
from engine.assembly.modal_system import ModalSystem
from engine.cli import main
from engine.instrument.key_names import note_name
from engine.live.controls import Controls
from engine.live.instrument_notes import scene_of_file, score_of_notes
from engine.live.key_allocator import KeyAllocator, live_scene
from engine.live.midi import render_notes
from engine.live.midi_drivers import MidiError
from engine.live.midi_notes import Note
from engine.live.midi_parts import Excerpt
from engine.live.midi_port import take_message
from engine.live.mpe import MpeZones, NoteChannels
from engine.live.player import Player
from engine.live.replay import replay
from engine.patch.frames import nearest_frame

mido = pytest.importorskip("mido")
SECOND = 960  # ticks, at 120 beats a minute and 480 ticks a beat


@pytest.fixture
def path(tmp_path):
    file = tmp_path / "strings.toml"
    file.write_text(STRINGS + SCORE, "utf-8")
    return file


def write_midi(path, *messages):
    """A file of messages, each with the seconds since the one before it."""
    file = mido.MidiFile(ticks_per_beat=480)
    file.tracks.append(mido.MidiTrack(m.copy(time=round(seconds * SECOND)) for m, seconds in messages))
    file.save(path)
    return path


def on(key, velocity=100):
    return mido.Message("note_on", note=key, velocity=velocity)


def off(key, velocity=64):
    return mido.Message("note_off", note=key, velocity=velocity)


def test_a_midi_file_sounds_as_the_same_score_does(path, tmp_path):
    file = write_midi(tmp_path / "a.mid", (on(60), 0.0), (off(60), 0.4))
    played = scene_of_file(engine.load(path), file)
    assert played.refused == [] and played.ignored == {}
    wanted = engine.render(engine.load(path), seconds=1.0).audio
    assert np.array_equal(engine.render(played.scene, seconds=1.0).audio, wanted)


@pytest.mark.hard
def test_a_time_between_two_frames_is_the_same_frame_in_a_score_and_in_midi(path, tmp_path):
    """Times at the middle between two frames, and as a MIDI file adds them up: the later frame, of keys and of voices;
    the sound is the same, bit for bit."""
    times = [(5 + 10 * k) / 1000 for k in range(60)]
    frames = [441 * k + 221 for k in range(60)]
    assert [nearest_frame(time, RATE) for time in times] == frames
    assert [nearest_frame(time, RATE) for time in itertools.accumulate([0.005] + [0.01] * 59)] == frames
    track = mido.MidiTrack([mido.MetaMessage("set_tempo", tempo=1_000_000)])  # a tick is a millisecond
    track += [on(60).copy(time=0), off(60).copy(time=4)]  # a file begins with its first note
    track += [message.copy(time=5) for _ in times for message in (on(60), off(60))]
    track[3].time = 1
    file = tmp_path / "ties.mid"
    mido.MidiFile(tracks=[track], ticks_per_beat=1000).save(file)
    notes = [(0.0, 0.004), *((time, 0.005) for time in times)]
    score = "".join(f'[[note]]\ntime = {t}\nkey = "C4"\nvelocity = 100\nduration = {d}\n' for t, d in notes)
    path.write_text(STRINGS + score, "utf-8")
    scene = engine.load(path)
    wanted = engine.render(scene, seconds=0.7).audio
    assert np.array_equal(engine.render(scene_of_file(scene, file).scene, seconds=0.7).audio, wanted)
    _, player, *_ = render_notes(engine.load("piano_c4"), str(file), RATE, Excerpt(seconds=0.7), 2)
    assert [event["row"][4] for event in player.log()["events"] if event["why"][0] == "strike"] == [0, *frames]


def test_the_command_says_what_of_a_file_is_not_played(path, tmp_path, capsys):
    bend, program = mido.Message("pitchwheel", pitch=4000), mido.Message("program_change", program=3)
    notes = [(on(60), 0.0), (on(20), 0.1), (bend, 0.0), (program, 0.0), (off(20), 0.1), (off(60), 0.1)]
    file, output = write_midi(tmp_path / "a.mid", *notes), tmp_path / "a.wav"
    assert main.main(["render", str(path), "--midi", str(file), "-o", str(output)]) == 0
    said = capsys.readouterr().err
    assert "G#0" in said and "pitch bend" not in said and "program change (1)" in said
    audio, _ = soundfile.read(output)
    assert np.abs(audio).max() > 0.1
    only = write_midi(tmp_path / "b.mid", (on(20), 0.0), (off(20), 0.1))
    assert main.main(["render", str(path), "--midi", str(only), "-o", str(output)]) == 2
    assert "no note for any key of the instrument" in capsys.readouterr().err


def test_pedals_and_keys_that_are_never_let_go_are_in_the_score():
    notes = [Note(0.0, "on", 60, 80), Note(0.1, "sustain", 0, 127), Note(0.5, "on", 62, 90), Note(0.7, "off", 60, 30)]
    score = score_of_notes([*notes, Note(1.0, "soft", 0, 64)])
    assert [(n.key, n.time, round(n.duration, 6), n.release) for n in score.notes] == [
        (60, 0.0, 0.7, 30),
        (62, 0.5, 1.5, 64),
    ]
    assert score.pedals == ((0.1, "sustain", 1.0), (1.0, "soft", pytest.approx(64 / 127)))
    assert [message.kind for message in score.messages()] == ["on", "sustain", "on", "off", "soft", "off"]


def test_a_plain_patch_has_no_keys():
    with pytest.raises(ValueError, match="not an instrument"):
        live_scene(engine.load("bouncing_ball"))
    with pytest.raises(MidiError, match="not an instrument"):
        scene_of_file(engine.load("bouncing_ball"), None)


def play(path, *notes: tuple[int, Note], keys=None, seconds=1.0, text=None):
    """What is played live, at a gain of one thousandth; and what gave the notes to the player."""
    if text is not None:
        path.write_text(text, "utf-8")
    player = Player(live_scene(engine.load(path), keys), RATE, math.inf, 1e-3, waiting=True)
    allocator = KeyAllocator(player)
    for frame, note in sorted(notes):
        allocator.play(note, frame)
    allocator.poll()
    out = np.zeros((round(seconds * RATE), player.channels), np.float32)
    for begin in range(0, len(out), 128):
        player.render_into(out[begin : begin + 128])
    return out, allocator


def test_live_keys_sound_as_the_score_does(path):
    begin = 4410  # the player has faded in
    out, allocator = play(path, (begin, Note(0, "on", 60, 100)), (begin + 17640, Note(0, "off", 60, 64)))
    wanted = engine.render(engine.load(path), seconds=0.9).audio[:, 0] * 1e-3
    heard = out[begin:, 0][: wanted.size]
    assert np.abs(heard - wanted).max() < 1e-5 * np.abs(wanted).max()
    assert allocator.player.meter().energy_error < 1e-12 and allocator.played_notes() == {"C4": "1 times"}


@pytest.mark.hard
def test_a_key_that_two_parts_hold_sounds_until_both_let_go(path):
    """As in a file, so live, where the parts are channels."""
    begin, first, last = 4410, Note(0, "off", 60, 64, part=1), Note(0, "off", 60, 64, part=2)
    presses = [(begin + 4410 * n, Note(0, "on", 60, 100, part=n)) for n in (1, 2)]
    with_both, _ = play(path, *presses, (begin + 13230, first), (begin + 26460, last))
    with_one, _ = play(path, *presses, (begin + 26460, first), (begin + 26460, last))
    never, _ = play(path, *presses)
    np.testing.assert_array_equal(with_both, with_one)
    assert np.abs(with_both[-4410:]).max() < 0.5 * np.abs(never[-4410:]).max()


def after(path, message, pedal=0):
    """Two seconds of two keys, each held by a channel of its own, from a message of half a second on."""
    player = Player(live_scene(engine.load(path)), RATE, math.inf, 1e-3, waiting=True)
    keys, zones, controls = KeyAllocator(player), MpeZones(player.patch.midi), Controls(player.patch, player)
    sustain = mido.Message("control_change", control=64, value=pedal)
    parts = [np.zeros((frames, player.channels), np.float32) for frames in (RATE // 2, 2 * RATE)]
    for messages, out in zip(([on(60), on(64).copy(channel=1), sustain], [message]), parts, strict=True):
        for one in messages:
            take_message(one, zones, keys, controls)
        player.render_into(out)
    return parts[1]


@pytest.mark.hard
def test_all_notes_off_lets_go_of_the_keys_of_its_channel(path):
    panic = after(path, mido.Message("control_change", control=123))
    np.testing.assert_array_equal(panic, after(path, off(60)))
    assert not np.array_equal(panic, after(path, off(64).copy(channel=1)))


@pytest.mark.hard
def test_all_sound_off_leaves_nothing_of_its_channel_whatever_the_pedal(path):
    """C4 is heard on the left, E4 of the other channel on the right."""
    silent, ringing = (after(path, mido.Message("control_change", control=c), pedal=127)[-4410:] for c in (120, 123))
    assert np.abs(silent[:, 0]).max() < 1e-6 * np.abs(ringing[:, 0]).max()
    np.testing.assert_array_equal(silent[:, 1], ringing[:, 1])


SHARED = """
[keyboard]
keys = ["C4", "D4", "E4"]

[[body]]
name = "box"
kind = "oscillator"
mass = 1.0
frequency = 300.0
damping_rate = 20.0

[[pickup]]
body = "box"

[[force]]
kind = "pluck"
body = "box"
amplitude = 50.0
duration = 1e-3

[[key.body]]
name = "tongue"
kind = "oscillator"
mass = 1e-3
frequency = "= f"

[[key.on]]
kind = "pluck"
body = "box"
amplitude = "= -v*(f - 200)"
duration = 1e-3
"""


@pytest.mark.parametrize("keys", [[60], [64], [60, 62, 64]])
def test_a_key_plucks_a_body_that_keys_share_as_hard_live_as_in_a_score(path, keys):
    """Not by the plucks of the other keys, nor by the one that the patch begins with, which waits."""
    score = "".join(f'[[note]]\ntime = 0.2\nkey = "{note_name(key)}"\nvelocity = 90\n' for key in keys)
    out, _ = play(path, *((round(0.2 * RATE), Note(0, "on", key, 90)) for key in keys), text=SHARED + score)
    path.write_text(SHARED.replace("50.0", "0.0") + score, "utf-8")
    wanted = engine.render(engine.load(path), seconds=0.4).audio[:, 0] * 1e-3
    assert np.abs(out[: wanted.size, 0] - wanted).max() < 1e-5 * np.abs(wanted).max()


def test_what_a_key_does_later_is_later_live_too(path):
    """A strike 0.05 s after the key, which is pressed at once, when sound has been playing for a while."""
    text = STRINGS.replace('velocity = "= 4*v"', 'velocity = "= 4*v"\ntime = 0.05') + SCORE
    _, allocator = play(path, keys=[60], seconds=0.2, text=text)
    player, out = allocator.player, np.zeros((4410, 1), np.float32)
    pressed = player.frame
    allocator.play(Note(0, "on", 60, 100))
    player.render_into(out)
    strike = next(event for event in player.log()["events"] if event["why"][0] == "strike")
    assert strike["row"][4] == pressed + 2205


def test_what_was_played_live_can_be_replayed(path):
    notes = [(2000, Note(0, "on", 60, 100)), (9000, Note(0, "sustain", 0, 80)), (12000, Note(0, "off", 60, 10))]
    out, allocator = play(path, *notes, (20000, Note(0, "on", 64, 20)), (30000, Note(0, "sustain", 0, 0)))
    assert np.array_equal(replay(allocator.player.log()), out)


@pytest.mark.hard
def test_the_sustain_pedal_holds_notes_and_gives_them_back(path):
    def after(*notes) -> float:
        out, _ = play(path, (1000, Note(0, "on", 60, 100)), (5000, Note(0, "off", 60, 64)), *notes)
        return float(np.sqrt(np.mean(out[-4410:] ** 2)))

    held = after((3000, Note(0, "sustain", 0, 127)))
    half = after((3000, Note(0, "sustain", 0, 64)))
    lifted = after((3000, Note(0, "sustain", 0, 127)), (35000, Note(0, "sustain", 0, 0)))
    assert after() < 1e-3 * half < 1e-3 * held and lifted < 0.1 * held


@pytest.mark.hard
def test_too_many_notes_take_the_place_of_the_oldest(path):
    text = STRINGS.replace('keys = "C3..C5"', 'keys = "C3..C5"\npolyphony = 2')
    notes = [(1000 + 2000 * n, Note(0, "on", 60 + n, 100)) for n in range(3)]
    _, allocator = play(path, *notes, text=text)
    assert allocator.stolen == 1
    _, allocator = play(path, (0, Note(0, "on", 20, 100)), text=text)
    assert allocator.refused == 1


# --- the pitch wheel


def wheel(cents):
    """To a bend of so many cents, of 200 either way."""
    return mido.Message("pitchwheel", pitch=round(cents / 200 * 8192))


def frequency(audio):
    """Of the strongest partial of half a second, Hz."""
    spectrum = np.abs(np.fft.rfft(audio * np.hanning(audio.size), 1 << 18))
    return float(np.argmax(spectrum) * RATE / (1 << 18))


def test_the_wheel_bends_what_sounds_and_what_comes(path, tmp_path):
    """A tone down before the note, with which the scene begins, and a semitone up while it sounds."""
    messages = [(wheel(-200), 0.0), (on(60), 0.1), (wheel(100), 0.9), (off(60), 1.0)]
    played = scene_of_file(engine.load(path), write_midi(tmp_path / "a.mid", *messages))
    rendering, half = engine.render(played.scene), RATE // 2
    begin = round(0.2 * RATE), round(1.1 * RATE)
    plain = frequency(engine.render(engine.load(path)).audio[round(0.2 * RATE) :][:half, 0])
    cents = [1200 * math.log2(frequency(rendering.audio[at : at + half, 0]) / plain) for at in begin]
    assert cents == pytest.approx([-200.0, 100.0], abs=2.0) and played.ignored == {}
    assert rendering.stats.energy.error_max <= 1e-10


@pytest.mark.hard
def test_a_wheel_that_moves_live_bends_as_one_in_a_file(path):
    out, allocator = play(path, (1000, Note(0, "on", 60, 100)), (3000, Note(0, "bend", 0, 100.0)))
    bent, plain = (player.value("body.C4_string1.frequency") for player in (allocator.player, play(path)[1].player))
    assert bent == pytest.approx(2 ** (1 / 12) * plain)
    assert np.array_equal(replay(allocator.player.log()), out) and allocator.refused == 0


@pytest.mark.hard
def test_bent_keys_sound_as_if_all_bodies_were_built_again(monkeypatch):
    """The wheel moves twice; what it does not bend keeps its modes, and the samples are the same, bit for bit."""

    def sound():
        keys = KeyAllocator(Player(live_scene(engine.load("piano"), [45, 60]), RATE, math.inf, waiting=True))
        heard = np.zeros((4096, keys.player.channels), np.float32)
        notes = [Note(0, "on", 60, 100), Note(0, "bend", 0, 150.0), Note(0, "bend", 0, -80.0), Note(0, "on", 45, 100)]
        for block, note in zip(np.split(heard, 4), notes, strict=True):
            keys.play(note)
            keys.poll()
            keys.player.render_into(block)
        return heard, keys.player.layout

    quick, layout = sound()
    assert layout.same_bodies(layout.scene).keys() == set(range(len(layout.scene.body)))
    monkeypatch.setattr(ModalSystem, "same_bodies", lambda self, scene: {})
    np.testing.assert_array_equal(sound()[0], quick)
    assert np.abs(quick).max() > 0.0


def test_of_a_zone_each_key_has_its_own_wheel(path):
    zone = NoteChannels(2, 1), NoteChannels(3, 1)
    notes = [Note(0, "on", 60, 100, zone[0]), Note(0, "on", 64, 100, zone[1]), Note(0, "bend", 0, 100.0, zone[1])]
    _, allocator = play(path, *((1000, note) for note in notes))
    c4, e4 = (allocator.player.value(f"body.{key}_string1.frequency") for key in ("C4", "E4"))
    assert 1200 * math.log2(e4 / c4) == pytest.approx(500.0)


RODS = """
[keyboard]
keys = "C4..D4"

[[key.body]]
name = "rod"
kind = "oscillator"
mass = 0.01
stiffness = "= 0.01*(6.2832*f)**2"
damping_rate = 3.0

[[key.on]]
kind = "strike"
body = "rod"
velocity = "= v"

[[key.pickup]]
body = "rod"
"""


def test_an_instrument_without_pitches_says_that_it_ignores_the_wheel(path, tmp_path):
    bend = Note(0, "bend", 0, 50.0)
    _, allocator = play(path, (0, Note(0, "on", 60, 100)), (0, bend), (0, bend), text=RODS)
    assert allocator.ignored == {"pitch bend": 2}
    file = write_midi(tmp_path / "a.mid", (on(60), 0.0), (wheel(50), 0.1), (off(60), 0.1))
    assert scene_of_file(engine.load(path), file).ignored == {"pitch bend": 1}


@pytest.mark.hard
def test_plucked_keys_sound_live(path):
    strike = 'kind = "strike"\nbody = "hammer"\ndisplacement = -1e-3\nvelocity = "= 4*v"\n'
    pluck = 'kind = "pluck"\nbody = "string"\nat = 0.2\namplitude = "= 2*v"\nduration = 0.002\n'
    assert strike in STRINGS
    text = STRINGS.replace(strike, pluck).replace("copies = 2", "copies = 1")
    loud, _ = play(path, (1000, Note(0, "on", 60, 127)), text=text)
    soft, _ = play(path, (1000, Note(0, "on", 60, 64)), text=text)
    silent, _ = play(path, text=text)
    assert np.abs(silent).max() == 0.0
    assert np.abs(soft).max() / np.abs(loud).max() == pytest.approx(64 / 127, rel=0.02)
