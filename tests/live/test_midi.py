"""Notes: each sounds at its pitch and time, voices are shared, and nothing clicks."""

import math
import os
import sys
import types

import numpy as np
import pytest
import soundfile
from conftest import ROOT, mostly_hard

import engine
from engine.analysis.metrics import strongest_partial
from engine.cli import main
from engine.instrument.key_names import note_frequency, note_name
from engine.live import midi, midi_drivers, midi_files, midi_notes, voice_allocator
from engine.live.controls import Controls
from engine.live.midi_parts import Excerpt
from engine.live.midi_port import MidiPort
from engine.live.player import Player

mido = pytest.importorskip("mido", reason="needs mido")
PIANO = ROOT / "patches" / "piano_c4.toml"
RATE = 44_100


def written(path, *messages):
    """A .mid file at 120 beats a minute, 480 ticks a beat: (what, ticks)."""
    track = mido.MidiTrack([mido.MetaMessage("set_tempo", tempo=500_000)])
    track += [message.copy(time=ticks) for message, ticks in messages]
    mido.MidiFile(tracks=[track]).save(path)
    return path


def on(note, velocity=64):
    return mido.Message("note_on", note=note, velocity=velocity)


def off(note):
    return mido.Message("note_off", note=note)


def pedal(value):
    return mido.Message("control_change", control=64, value=value)


def test_notes_have_their_pitch_and_time(tmp_path):
    path = written(tmp_path / "two.mid", (on(57), 0), (off(57), 960), (on(64, 90), 480), (off(64), 960))
    audio, player, voices, *_ = midi.render_notes(engine.load(PIANO), str(path), RATE, Excerpt(), 4)
    played = voices.played_notes()
    assert len(audio) == round((2.5 + midi.TAIL_SECONDS) * RATE)
    assert played == {"string": "A3 (-300 c), E4 (+400 c)"}
    assert not audio[0].any() and audio[100:500].any()
    for begin, note in ((0.0, 57), (1.5, 64)):
        part = audio[round((begin + 0.05) * RATE) :][:RATE]
        partials = np.abs(np.fft.rfft(part[:, 0] * np.hanning(len(part))))
        wanted = note_frequency(note)
        near = slice(round(0.97 * wanted), round(1.03 * wanted) + 1)  # bins of 1 Hz
        assert near.start + int(np.argmax(partials[near])) == pytest.approx(wanted, abs=1.5)
    assert player.meter()["energy_error"] <= 1e-12
    assert strongest_partial(audio.astype(float)) > 0.0


MARIMBA = {"c": 48, "g": 55, "a": 57, "c_high": 60, "e_high": 64}


def fundamental(audio: np.ndarray, hertz: float) -> tuple[float, float]:
    """Where the partial nearest to a frequency is, Hz, and its amplitude, from a second of sound."""
    part = audio[round(0.05 * RATE) :][:RATE]
    t, window = np.arange(len(part)) / RATE, np.hanning(len(part))

    def level(f):
        return abs(np.sum(part * window * np.exp(-2j * np.pi * f * t)))

    near = hertz * 2 ** (np.linspace(-5, 5, 201) / 1200)
    found = max(near, key=level)
    return float(found), float(level(found))


def without_tubes(scene: engine.Scene) -> engine.Scene:
    """The bars of a marimba alone."""
    parts = {"connection": [], "pickup": [p for p in scene.pickup if p.body in MARIMBA]}
    return scene.model_copy(update=parts | {"body": [b for b in scene.body if b.kind != "tube"]})


@pytest.mark.hard
@pytest.mark.parametrize("note", mostly_hard([60, 51, 72], 60))
@pytest.mark.parametrize(("change", "cents"), [(without_tubes, 1.0), (lambda scene: scene, 3.0)], ids=["bars", "tubes"])
def test_a_note_sounds_one_body(tmp_path, note, change, cents):
    """The nearest in pitch, tuned to the note to a cent, or to 3 where the air of its tube, tuned as well, pulls at it;
    the other bars' fundamentals stay below -40 dB."""
    path = written(tmp_path / "one.mid", (on(note), 0), (off(note), 1920))
    marimba = change(engine.load(ROOT / "patches" / "marimba.toml"))
    audio, _, voices, *_ = midi.render_notes(marimba, str(path), RATE, Excerpt(seconds=1.2), 2)
    played = voices.played_notes()
    mono = audio.sum(axis=1)
    pitch, loud = fundamental(mono, note_frequency(note))
    assert abs(1200 * math.log2(pitch / note_frequency(note))) < cents
    name = min(MARIMBA, key=lambda bar: abs(MARIMBA[bar] - note))
    others = [other for bar, other in MARIMBA.items() if bar != name]
    assert all(fundamental(mono, note_frequency(other))[1] < 0.01 * loud for other in others)
    away = 100 * (note - MARIMBA[name])
    assert played == {name: note_name(note) + (f" ({away:+d} c)" if away else "")}


@pytest.mark.hard
def test_plucked_bodies_sound_too(tmp_path):
    """Two strings, one plucked by a force, one by the score: the nearest is, harder for a harder key."""
    string = {"kind": "string", "length": 0.6, "mass": 4e-3, "sigma0": 1.0, "modes": 20}
    pluck = {"kind": "pluck", "at": 0.2, "amplitude": 1.0, "duration": 1e-3}
    harp = engine.Scene.model_validate(
        {
            "body": [string | {"name": "low", "frequency": 220.0}, string | {"name": "high", "frequency": 440.0}],
            "force": [pluck | {"body": "low", "start": 0.1}],
            "event": [pluck | {"body": "high", "time": 0.5}],
            "pickup": [{"body": "low", "at": 0.4}, {"body": "high", "at": 0.4}],
        }
    )
    for note, name in ((58, "low"), (67, "high")):
        peaks = []
        for velocity in (40, 80):
            path = written(tmp_path / "one.mid", (on(note, velocity), 0), (off(note), 1920))
            audio, _, voices, *_ = midi.render_notes(harp, str(path), RATE, Excerpt(seconds=1.2), 2)
            played = voices.played_notes()
            pitch, _ = fundamental(audio[:, 0], note_frequency(note))
            assert abs(1200 * math.log2(pitch / note_frequency(note))) < 1.0
            assert list(played) == [name]
            peaks.append(np.abs(audio).max())
        assert 2.0 * peaks[0] < peaks[1]


def test_a_key_lifts_its_damper(tmp_path):
    """Struck again while it is being damped, a note rings as at first."""
    again = written(tmp_path / "again.mid", (on(60), 0), (off(60), 480), (on(60), 96), (off(60), 1920))
    once = written(tmp_path / "once.mid", (on(60), 0), (off(60), 1920))
    sounds = [
        midi.render_notes(engine.load(PIANO), str(path), RATE, Excerpt(seconds=seconds), 1)[0]
        for path, seconds in ((again, 1.5), (once, 0.9))
    ]
    late = [float(np.sqrt(np.mean(audio[-round(0.4 * RATE) :] ** 2))) for audio in sounds]
    assert abs(20 * math.log10(late[0] / late[1])) < 1.0


def test_harder_is_louder(tmp_path):
    peaks = []
    for velocity in (30, 60, 120):
        path = written(tmp_path / "one.mid", (on(60, velocity), 0), (off(60), 480))
        peaks.append(np.abs(midi.render_notes(engine.load(PIANO), str(path), RATE, Excerpt(seconds=0.5), 1)[0]).max())
    assert peaks[0] < 0.6 * peaks[1] < 0.36 * peaks[2]


def test_dampers_and_the_pedal(tmp_path):
    """A key let go is damped, unless the pedal is down; then when the pedal is let go."""

    def level(name, *messages):
        audio, *_ = midi.render_notes(
            engine.load(PIANO), str(written(tmp_path / name, *messages)), RATE, Excerpt(seconds=3.0), 2
        )
        return [float(np.sqrt(np.mean(audio[round(t * RATE) :][: RATE // 5] ** 2))) for t in (0.3, 1.2, 2.5)]

    held = level("held.mid", (on(60), 0), (off(60), 5000))
    short = level("short.mid", (on(60), 0), (off(60), 480))
    kept = level("kept.mid", (on(60), 0), (pedal(127), 10), (off(60), 470), (pedal(0), 1440))
    assert short[0] == pytest.approx(held[0], rel=1e-3) and kept[0] == pytest.approx(held[0], rel=1e-3)
    assert short[1] < 0.05 * held[1] and kept[1] == pytest.approx(held[1], rel=1e-3)
    assert kept[2] < 0.05 * held[2]


def test_the_sostenuto_pedal_keeps_voices_whose_keys_were_down(tmp_path):
    """A key that is pressed after the pedal is damped when it is let go."""

    def level(name, *messages):
        audio, *_ = midi.render_notes(
            engine.load(PIANO), str(written(tmp_path / name, *messages)), RATE, Excerpt(seconds=2.0), 2
        )
        return float(np.sqrt(np.mean(audio[-RATE // 5 :] ** 2)))

    def sostenuto(value):
        return mido.Message("control_change", control=66, value=value)

    kept = level("kept.mid", (on(60), 0), (sostenuto(127), 10), (off(60), 470))
    late = level("late.mid", (sostenuto(127), 0), (on(60), 10), (off(60), 470))
    freed = level("freed.mid", (on(60), 0), (sostenuto(127), 10), (off(60), 470), (sostenuto(0), 480))
    assert late < 0.05 * kept and freed < 0.05 * kept


def test_the_oldest_voice_is_taken_without_a_click():
    player = Player(engine.load(PIANO), RATE, math.inf, 0.02, voices=2, lowest=0.5)
    keys = voice_allocator.VoiceAllocator(player)
    out = np.zeros((RATE, player.channels), np.float32)
    for n, note in enumerate((60, 64, 67, 72, 60, 59)):
        keys.play(midi_notes.Note(0.0, "on", note, 64))
        player.render_into(out[n * 4410 : (n + 1) * 4410])
    assert keys.stolen == 4
    assert {voice.key.number for voice in keys._voices if voice.key} == {60, 59}
    steps = np.abs(np.diff(out, axis=0)).max(axis=1)
    calm = Player(engine.load(PIANO), RATE, math.inf, 0.02, voices=2)
    alone = np.zeros((4410, player.channels), np.float32)
    voice_allocator.VoiceAllocator(calm).play(midi_notes.Note(0.0, "on", 72, 64))
    calm.render_into(alone)
    assert steps.max() <= 3 * np.abs(np.diff(alone, axis=0)).max()
    assert player.meter()["energy_error"] <= 1e-12


@pytest.fixture
def ports(monkeypatch):
    """Two MIDI ports, of a driver that is none; what is sent to one comes out of it."""
    opened = []

    class Port(mido.ports.EchoPort):
        def __init__(self, name=None, **told):
            super().__init__(name)
            opened.append(self)

    driver = types.ModuleType("no_driver")
    driver.Input = Port
    driver.get_devices = lambda **told: [
        {"name": name, "is_input": True, "is_output": False} for name in ("Keys 1", "Keys 2", "Drum")
    ]
    monkeypatch.setitem(sys.modules, "no_driver", driver)
    before = mido.backend
    mido.set_backend("no_driver")
    yield opened
    mido.set_backend(before)


def test_notes_of_a_port(ports):
    """Keys pressed at a port are heard at the next block, let go when they are let go; other messages are passed by."""
    scene = engine.load(PIANO)
    player = Player(scene, RATE, math.inf, 0.02, voices=2, lowest=midi.lowest_ratio("drum", scene))
    voices = voice_allocator.VoiceAllocator(player)
    look = MidiPort("drum", lambda: voices, Controls(player.patch, player)).poll
    (port,) = ports
    assert port.name == "Drum"
    out = np.zeros((RATE, player.channels), np.float32)
    player.render_into(out[:4410])
    assert look() is False and not out[:4410].any()
    for message in (on(57), mido.Message("pitchwheel", pitch=100), mido.Message("program_change", program=3)):
        port.send(message)
    assert look() is False
    player.render_into(out[4410 : RATE // 2])
    partials = np.abs(np.fft.rfft(out[6000 : RATE // 2, 0] * np.hanning(RATE // 2 - 6000)))
    near = note_frequency(57) / RATE * (RATE // 2 - 6000)
    assert abs(float(np.argmax(partials[: round(1.5 * near)])) - near) < 1.0
    port.send(off(57))
    look()
    player.render_into(out[RATE // 2 :])
    assert np.abs(out[-4410:]).max() < 0.01 * np.abs(out).max()


def test_ports_that_cannot_be_told_apart(ports):
    with pytest.raises(
        midi_drivers.MidiError, match='several MIDI ports match "keys"; the ports are Keys 1, Keys 2, Drum'
    ):
        midi_drivers.open_port("keys")
    with pytest.raises(
        midi_drivers.MidiError, match='no MIDI port is called "organ"; the ports are Keys 1, Keys 2, Drum'
    ):
        midi_drivers.open_port("organ")
    assert ports == []


def test_ports_are_listed_with_the_outputs(ports, monkeypatch, capsys):
    monkeypatch.setattr("engine.live.audio_device.output_devices", lambda: [(3, "Desk", 2, 48_000)])
    assert main.main(["devices"]) == 0
    listed = capsys.readouterr().out.splitlines()
    assert listed == ["  3  Desk: 2 channels, 48000 Hz", "MIDI  Keys 1", "MIDI  Keys 2", "MIDI  Drum"]


@pytest.mark.parametrize("python", [(3, 12, 1), (3, 13, 0)])
def test_outputs_are_listed_without_the_driver_of_ports(monkeypatch, capsys, python):
    """What would bring it is said; from Python 3.13 on it is compiled, and needs what compiles it."""
    monkeypatch.setattr("engine.live.audio_device.output_devices", lambda: [(3, "Desk", 2, 48_000)])
    monkeypatch.setattr(mido, "get_input_names", lambda: __import__("rtmidi_that_is_not_there"))
    monkeypatch.setattr(sys, "version_info", python)
    assert main.main(["devices"]) == 0
    written = capsys.readouterr()
    assert written.out == "  3  Desk: 2 channels, 48000 Hz\n" and "uv sync --extra midi" in written.err
    assert written.err.count("\n") == 1 and ("C++ compiler" in written.err) == (python > (3, 13))


@pytest.mark.hard
def test_what_is_wrong_with_notes_is_said(tmp_path, capsys):
    (tmp_path / "no.mid").write_bytes(b"no notes")
    cases = {"none": "cannot be read as MIDI", "no": "cannot be read as MIDI", "empty": "has no notes"}
    written(tmp_path / "empty.mid", (pedal(1), 0))
    for name, what in cases.items():
        path = tmp_path / f"{name}.mid"
        assert main.main([str(PIANO), "--midi", str(path), "-o", str(tmp_path / "a.wav")]) == 2
        assert what in capsys.readouterr().err
    path = str(written(tmp_path / "one.mid", (on(60), 0), (off(60), 100)))
    mass = tmp_path / "mass.toml"
    mass.write_text('[[body]]\nname = "m"\nkind = "mass"\nmass = 1.0\nvelocity = 1.0\n[[pickup]]\nbody = "m"\n')
    assert main.main([str(mass), "--midi", path, "-o", str(tmp_path / "a.wav")]) == 2
    assert "m has no pitch to tune" in capsys.readouterr().err
    out = tmp_path / "out.wav"
    assert main.main([str(PIANO), "--midi", path, "-o", str(out), "--seconds", "0.5"]) == 0
    assert soundfile.info(out).frames == RATE // 2
    length, level, speed, file = capsys.readouterr().out.splitlines()
    assert "0.5 s at 44100 Hz" in length and "-1.0 dBFS" in level and "8 voices" in speed and file == str(out)
    assert main.main([str(PIANO), "--midi", path, "-o", str(out), "--seconds", "0.5", "--verbose"]) == 0
    assert "energy error" in capsys.readouterr().out


FRET = '[[contact]]\nbody = "string"\nat = 0.4\nside = "below"\nbarrier = -1e-4\nstiffness = 1e7\nexponent = 2.5\n'


@pytest.mark.hard
def test_a_voice_of_a_string_over_a_fret_is_as_if_built_at_its_pitch(tmp_path):
    """Contacts that push each other have a matrix of their own for each pitch."""
    path = tmp_path / "fretted.toml"
    path.write_text(PIANO.read_text("utf-8") + FRET, "utf-8")
    scene = engine.load(path)
    player, alone = (Player(scene, RATE, math.inf, 0.1, voices=n, lowest=low) for n, low in ((3, 0.5), (1, 1.5)))
    player.tune(1, 1.5)
    heard = []
    for one, hammer in ((player, "hammer_1"), (alone, "hammer_0")):
        one.strike(hammer)
        heard.append(np.zeros((8820, one.channels), np.float32))
        one.render_into(heard[-1])
    np.testing.assert_array_equal(*heard)
    player.tune(2, 0.7, seconds=0.05)
    player.strike("hammer_2")
    player.render_into(heard[0])
    assert heard[0].any() and player.meter()["energy_error"] <= 1e-12


NO_NOTES = {
    "type 2": (
        b"MThd\0\0\0\6\0\2\0\1\0\x60",
        "is of type 2, whose tracks are independent; save it as type 0 or 1",
    ),
    "no ticks": (b"MThd\0\0\0\6\0\1\0\1\0\0", "has 0 ticks a beat"),
    "film": (b"MThd\0\0\0\6\0\1\0\1\xe7\0", "has 0 ticks a beat"),
    "short header": (b"MThd\0\0\0\2\0\1", "cannot be read as MIDI"),
    "long header": (b"MThd\xff\xff\xff\xff\0\1", "cannot be read as MIDI"),
}


@pytest.mark.parametrize("name", NO_NOTES)
def test_a_file_that_is_none_is_refused_in_a_line(tmp_path, name):
    head, says = NO_NOTES[name]
    track = bytes([0, 0x90, 60, 64, 96, 0x80, 60, 0, 0, 0xFF, 0x2F, 0])
    (tmp_path / "a.mid").write_bytes(head + b"MTrk" + len(track).to_bytes(4, "big") + track)
    with pytest.raises(midi_drivers.MidiError, match=r"a\.mid .*") as found:
        midi_files.read_notes(tmp_path / "a.mid")
    assert says in str(found.value) and "\n" not in str(found.value)


def test_files_that_are_too_much_are_refused(tmp_path, monkeypatch, capsys):
    """In time, messages or bytes; what lasts longer than a render may is played in part."""
    path = tmp_path / "a.mid"
    written(path, (on(60), 0), (off(60), 480 * 2 * 40_000))
    with pytest.raises(midi_drivers.MidiError, match=r"lasts 11\.1 hours; the limit is 10"):
        midi_files.read_notes(path)
    written(path, (on(60), 0), (off(60), 480 * 2 * 7200))
    words = [str(PIANO), "--midi", str(path), "-o", str(tmp_path / "a.wav")]
    assert main.main(words) == 2
    assert "lasts 7203 s; the limit is 3600 s: give --seconds 3600" in capsys.readouterr().err
    monkeypatch.setattr(midi_files, "MAX_MESSAGES", 3)
    with pytest.raises(midi_drivers.MidiError, match="has 4 messages; the limit is 3"):
        midi_files.read_notes(path)
    monkeypatch.setattr(midi_files, "MAX_FILE_BYTES", 10)
    with pytest.raises(midi_drivers.MidiError, match=r"is larger than 1e-05 MB; give a \.mid file"):
        midi_files.read_notes(path)
    os.mkfifo(tmp_path / "pipe.mid")
    with pytest.raises(midi_drivers.MidiError, match="is not a file, but a pipe"):
        midi_files.read_notes(tmp_path / "pipe.mid")


def test_no_memory_for_so_many_samples_is_said(tmp_path, monkeypatch, capsys):
    path = written(tmp_path / "a.mid", (on(60), 0), (off(60), 480))

    def render(*told):
        raise MemoryError

    monkeypatch.setattr(midi, "render_notes", render)
    assert main.main([str(PIANO), "--midi", str(path), "-o", str(tmp_path / "a.wav")]) == 1
    assert "not enough memory" in capsys.readouterr().err
