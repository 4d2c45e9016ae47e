"""MIDI files as people have them: drums, several parts, long songs, silence at the beginning."""

import json

import numpy as np
import pytest
import soundfile
from conftest import ROOT

import engine
from engine.cli import main
from engine.live import instrument_notes, midi_port
from engine.live.instrument_notes import scene_of_file
from engine.live.midi_drivers import MidiError
from engine.live.midi_files import read_notes
from engine.live.midi_parts import Excerpt
from engine.live.mpe import MpeZones
from engine.patch.control_tables import Midi

mido = pytest.importorskip("mido", reason="needs mido")
SECOND = 960  # ticks, at 120 beats a minute and 480 ticks a beat
RATE = 44_100
PIANO_STRING = ROOT / "patches" / "piano_c4.toml"
RODS = """
[keyboard]
keys = "C1..C7"

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

[[key.damper]]
body = "rod"
sigma = 20.0

[[key.pickup]]
body = "rod"
"""


@pytest.fixture
def rods(tmp_path, monkeypatch):
    """A patch with a keyboard, in the folder that the test is in."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "rods.toml").write_text(RODS, "utf-8")
    return "rods.toml"


def notes(*played, channel=1, name="", program=None):
    """A track of notes: key, when it begins and how long it is, s; None for a key that is never let go."""
    track = [(0.0, mido.MetaMessage("track_name", name=name))] if name else []
    if program is not None:
        track.append((0.0, mido.Message("program_change", channel=channel - 1, program=program)))
    for key, begin, duration in played:
        track.append((begin, mido.Message("note_on", channel=channel - 1, note=key, velocity=80)))
        if duration is not None:
            track.append((begin + duration, mido.Message("note_on", channel=channel - 1, note=key, velocity=0)))
    return sorted(track, key=lambda message: message[0])


def write(path, *tracks, kind=1):
    """A file of tracks: messages with their times, s."""
    file = mido.MidiFile(type=kind, ticks_per_beat=480)
    for messages in tracks:
        before, track = 0, mido.MidiTrack()
        for seconds, message in messages:
            ticks = round(seconds * SECOND)
            track.append(message.copy(time=ticks - before))
            before = ticks
        file.tracks.append(track)
    file.save(path)
    return path.name


def render(*words):
    """The samples of a rendering in SI units, with 64 bits."""
    assert main.main(["render", *words, "-o", "out.wav", "--gain", "0", "--subtype", "DOUBLE"]) == 0
    return soundfile.read("out.wav", always_2d=True)[0]


MELODY = notes((60, 0.0, 0.2), (64, 0.2, 0.2), name="Melody", program=40)
BASS = notes((36, 0.0, 0.4), channel=2, name="Bass", program=32)
BEAT = notes((38, 0.0, 0.1), (42, 0.1, 0.1), (45, 0.2, 0.1), channel=10, name="Kit")


# --- drums


def test_drums_are_left_out_and_counted(rods, tmp_path, capsys):
    song = write(tmp_path / "song.mid", MELODY, BEAT)
    alone = write(tmp_path / "melody.mid", MELODY)
    heard = render(rods, "--midi", song, "--seconds", "0.5")
    assert "song.mid: 3 notes of channel 10, drums, were left out" in capsys.readouterr().err
    np.testing.assert_array_equal(heard, render(rods, "--midi", alone, "--seconds", "0.5"))
    assert "drums" not in capsys.readouterr().err
    only = write(tmp_path / "beat.mid", BEAT)
    assert main.main(["render", rods, "--midi", only]) == 2
    assert "has only notes of drums (channel 10)" in capsys.readouterr().err
    assert render(rods, "--midi", only, "--channels", "10", "--seconds", "0.5").any()


@pytest.mark.parametrize(("name", "keys", "lacks"), [("snare", [38], [42, 45]), ("toms", [45], [38, 42])])
def test_shipped_drums_take_those_of_general_midi(tmp_path, name, keys, lacks):
    write(tmp_path / "song.mid", MELODY, BEAT)
    played = scene_of_file(engine.load(name), tmp_path / "song.mid")
    assert [note.key for note in played.score.notes] == keys
    assert list(played.file.unknown_drums) == lacks
    assert [part.name for part in played.file.left_out] == ["Melody"]


def test_a_drum_is_on_the_key_that_the_patch_has_for_it(rods, tmp_path, capsys):
    drums = RODS.replace("[[key.body]]", 'drums = { 38 = "C4" }\n\n[[key.body]]', 1)
    (tmp_path / "drums.toml").write_text(drums, "utf-8")
    song = write(tmp_path / "song.mid", MELODY, BEAT)
    wanted = render(rods, "--midi", write(tmp_path / "c4.mid", notes((60, 0.0, 0.1))), "--seconds", "0.5")
    capsys.readouterr()
    np.testing.assert_array_equal(render("drums.toml", "--midi", song, "--seconds", "0.5"), wanted)
    said = capsys.readouterr().err
    assert "does not have them: Closed Hi-Hat (42) 1 ×, Low Tom (45) 1 ×" in said
    assert '2 notes were left out that are not drums: track 0 "Melody" (channel 1, Violin)' in said
    without = write(tmp_path / "without.mid", notes((60, 0.0, 0.1)))  # drums on another channel, by their keys
    np.testing.assert_array_equal(render("drums.toml", "--midi", without, "--seconds", "0.5"), wanted)


def test_drums_of_keys_that_there_are_not_are_refused(rods, tmp_path, capsys):
    for value, says in {
        '38 = "C9"': "the instrument has no key C9",
        'snare = "C4"': '"snare" is not the key of a drum',
    }.items():
        (tmp_path / "bad.toml").write_text(RODS.replace("[[key.body]]", f"drums = {{ {value} }}\n[[key.body]]", 1))
        assert main.main(["check", "bad.toml"]) != 0
        said = capsys.readouterr()
        assert "keyboard.drums" in said.out + said.err and says in said.out + said.err


def test_channel_10_of_an_mpe_zone_is_no_drum(tmp_path):
    path = tmp_path / "mpe.mid"
    write(path, notes((60, 0.0, 0.1), channel=2), notes((64, 0.0, 0.1), channel=10))
    file = read_notes(path, Midi(mpe_lower=15))
    assert sorted(note.number for note in file.notes if note.kind == "on") == [60, 64]
    assert {part.channel for part in file.parts} == {1} and not file.left_out


# --- parts


def test_parts_on_one_instrument_are_named_in_a_line(rods, tmp_path, capsys):
    song = write(tmp_path / "song.mid", [], MELODY, BASS, BEAT)
    render(rods, "--midi", song, "--seconds", "0.5")
    (line,) = [line for line in capsys.readouterr().err.splitlines() if "parts are" in line]
    assert "2 parts are played on one instrument" in line
    assert 'track 1 "Melody" (channel 1, Violin); track 2 "Bass" (channel 2, Acoustic Bass)' in line
    assert "--channels" in line and "--tracks" in line and "--play" in line


@pytest.mark.parametrize("kind", [0, 1])
@pytest.mark.parametrize("choice", [("--channels", "2"), ("--tracks", "1"), ("--tracks", "bass")])
def test_channels_and_tracks_choose(rods, tmp_path, choice, kind):
    """In a file of one track too, which has channels alone."""
    if kind == 0 and choice[0] == "--tracks":
        choice = ("--channels", " 2")
    tracks = [MELODY, BASS] if kind else [sorted(MELODY + BASS, key=lambda message: message[0])]
    song = write(tmp_path / "song.mid", *tracks, kind=kind)
    alone = write(tmp_path / "bass.mid", BASS)
    chosen = render(rods, "--midi", song, *choice, "--seconds", "0.5")
    np.testing.assert_array_equal(chosen, render(rods, "--midi", alone, "--seconds", "0.5"))


def test_what_cannot_be_chosen_is_said_with_what_can(rods, tmp_path, capsys):
    song = write(tmp_path / "song.mid", MELODY, BASS)
    for choice, says in {
        ("--channels", "3"): 'no notes on channel 3; the parts are track 0 "Melody" (channel 1, Violin)',
        ("--tracks", "violin"): "no notes on track violin; the parts are",
        ("--channels", "17"): '"17" are not MIDI channels; give numbers from 1 to 16, such as 1,2',
        ("--channels", "1,,2"): '"1,,2" is not a list',
        ("--play", "guitar"): '"guitar" does not name a channel and a patch; give CHANNEL=PATCH',
        ("--play", "0=guitar"): "0 is not a MIDI channel",
        ("--play", "2=guitr"): "did you mean guitar?",
        ("--play", "5=rods.toml"): "has no notes on 5; its parts are",
        ("--play", "2=rods.toml", "--plot"): "--plot: cannot be combined with --play",
    }.items():
        assert main.main(["render", rods, "--midi", song, *choice]) == 2
        assert says in capsys.readouterr().err
    for words in (["render", rods, "--channels", "1"], ["play", rods, "--midi", "a port", "--channels", "1"]):
        assert main.main(words) == 2
        assert "--channels: requires --midi with a file" in capsys.readouterr().err
    assert main.main(["render", rods, "--play", "1=rods.toml"]) == 2
    assert "--play: requires --midi" in capsys.readouterr().err


def test_a_key_that_one_part_lets_go_sounds_on_in_another(tmp_path):
    """Two hands on one channel, in a track each."""
    write(tmp_path / "hands.mid", notes((60, 0.0, 2.0)), notes((60, 0.5, 0.25), (48, 0.5, 1.0)))
    file = read_notes(tmp_path / "hands.mid")
    score = instrument_notes.score_of_notes(file.notes, file.end)
    assert [(n.key, n.time, n.duration) for n in score.notes] == [(60, 0.0, 2.0), (48, 0.5, 1.0), (60, 0.5, 0.25)]


def test_names_of_tracks_are_as_they_were_written(tmp_path):
    """In UTF-8, or padded with spaces and zeros."""
    for written, name in {"Bratsche ": "Bratsche", "Fl\xf6te": "Fl\xf6te", "Piano\0": "Piano"}.items():
        write(tmp_path / "a.mid", notes((60, 0.0, 0.1), name=written.encode().decode("latin-1")))
        assert [part.name for part in read_notes(tmp_path / "a.mid").parts] == [name]


# --- several patches


@pytest.mark.hard
def test_a_mix_is_the_sum_of_its_parts(rods, tmp_path, capsys):
    """In SI units, each as it is alone; the shorter one is followed by silence."""
    (tmp_path / "low.toml").write_text(RODS.replace("damping_rate = 3.0", "damping_rate = 9.0"), "utf-8")
    song = write(tmp_path / "song.mid", MELODY, BASS, BEAT)
    first = render(rods, "--midi", song, "--channels", "1")
    second = render("low.toml", "--midi", song, "--channels", "2")
    wanted = np.zeros((max(len(first), len(second)), 1))
    wanted[: len(first)] += first
    wanted[: len(second)] += second
    capsys.readouterr()
    mix = render(rods, "--midi", song, "--play", "2=low.toml")
    np.testing.assert_allclose(mix, wanted, atol=1e-15)
    said = capsys.readouterr()
    assert "3 notes were left out" in said.err and "rods (1)" in said.out and "low (2)" in said.out
    np.testing.assert_array_equal(render(rods, "--midi", song, "--play", "bass=low.toml"), mix)
    quiet = render(rods, "--midi", song, "--play", "t1=low.toml@-20")
    wanted[: len(second)] -= 0.9 * second
    np.testing.assert_allclose(quiet, wanted, atol=1e-15)


def test_a_mix_takes_the_level_of_each_patch_if_asked_for(rods, tmp_path, capsys):
    """Patches that give a level are mixed at it, as they would be heard live; nothing is normalised."""
    (tmp_path / "loud.toml").write_text("level = 20.0\n" + RODS, "utf-8")
    (tmp_path / "low.toml").write_text("level = -20.0\n" + RODS, "utf-8")
    song = write(tmp_path / "song.mid", MELODY, BASS)
    first = render("loud.toml", "--midi", song, "--channels", "1")
    second = render("low.toml", "--midi", song, "--channels", "2")
    wanted = np.zeros((max(len(first), len(second)), 1))
    wanted[: len(first)] += 10.0 * first
    wanted[: len(second)] += 0.1 * 2.0 * second
    words = ["render", "loud.toml", "--midi", song, "--play", f"2=low.toml@{20 * np.log10(2.0)}"]
    assert main.main([*words, "--level", "patch", "--subtype", "DOUBLE", "-o", "mix.wav"]) == 0
    np.testing.assert_allclose(soundfile.read("mix.wav", always_2d=True)[0], wanted, atol=1e-12)
    assert main.main(["render", "loud.toml", "--midi", song, "--play", "2=" + rods, "--level", "patch"]) == 2
    assert "gives no level" in capsys.readouterr().err


def test_a_mix_brings_its_patches_to_one_level(rods, tmp_path, capsys):
    """Units of different pickups do not compare: one patch is a millionth as loud."""
    (tmp_path / "soft.toml").write_text(RODS.replace('velocity = "= v"', 'velocity = "= 1e-6*v"'), "utf-8")
    song = write(tmp_path / "song.mid", MELODY, notes((36, 0.6, 0.2), channel=2))
    words = ["render", rods, "--midi", song, "--play", "2=soft.toml", "--json"]
    assert main.main(words) == 0
    stats = json.loads(capsys.readouterr().out)
    heard, _ = soundfile.read("song_mix.wav")
    assert stats["peak_file"] == pytest.approx(10 ** (-1 / 20), rel=1e-6) and stats["trusted"]
    assert [len(part["parts"]) for part in stats["parts"]] == [1, 1]
    ratio = np.abs(heard[round(0.7 * RATE) :]).max() / np.abs(heard[: round(0.6 * RATE)]).max()
    assert 0.3 < ratio < 3.0


def test_a_patch_without_keyboard_and_one_with_are_mixed(rods, tmp_path, capsys):
    song = write(tmp_path / "song.mid", MELODY, BASS)
    voices = render(str(PIANO_STRING), "--midi", song, "--channels", "1", "--seconds", "0.3", "--voices", "2")
    keyed = render(rods, "--midi", song, "--channels", "2", "--seconds", "0.3")
    words = (str(PIANO_STRING), "--midi", song, "--play", "2=rods.toml", "--seconds", "0.3", "--voices", "2")
    np.testing.assert_allclose(render(*words), voices + keyed, atol=1e-15)


def test_a_patch_with_nothing_to_play_does_not_end_the_mix(rods, tmp_path, capsys):
    song = write(tmp_path / "song.mid", MELODY, notes((36, 2.0, 0.2), channel=2))
    alone = render(rods, "--midi", song, "--channels", "1", "--seconds", "0.5")
    np.testing.assert_array_equal(render(rods, "--midi", song, "--play", "2=rods.toml@-3", "--seconds", "0.5"), alone)
    assert "rods: song.mid: there are no notes of track 1 (channel 2) in the first 0.5 s" in capsys.readouterr().err


# --- length


def test_the_beginning_of_a_long_song_is_played_at_once(rods, tmp_path):
    """As if the file ended there, and as the beginning of the whole: keys that are held go on to the end."""
    song = write(tmp_path / "song.mid", notes((60, 0.0, 0.2), (64, 0.3, 2.0), (67, 1.0, 0.5), (90, 1.5, 1.0)))
    played = scene_of_file(engine.load(rods), tmp_path / song, Excerpt(seconds=0.5))
    assert [note.key for note in played.score.notes] == [60, 64] and played.scene.seconds == 0.5
    assert {body.name for body in played.scene.body} == {"C4_rod", "E4_rod"}
    part = render(rods, "--midi", song, "--seconds", "0.5")
    np.testing.assert_array_equal(part, render(rods, "--midi", song)[: len(part)])


def test_a_song_with_too_many_events_says_how_much_of_it_can_be_played(rods, tmp_path, monkeypatch, capsys):
    monkeypatch.setattr(instrument_notes, "MAX_EVENTS", 20)
    song = write(tmp_path / "song.mid", notes(*((60 + n % 3, 0.25 * n, 0.125) for n in range(40))))
    assert main.main(["render", rods, "--midi", song]) == 2
    said = capsys.readouterr().err
    assert (
        "song.mid has 123 events of keys and dampers; the limit is 20, which the first" in said
    )  # 40 strikes, and dampers: at rest, lifted, let go
    seconds = said.split("--seconds ")[1].strip()
    count = int(said.split("the first ")[1].split()[0])
    assert f"the first {count} of its 40 notes reach after {seconds} s" in said
    assert sum(0.25 * n < float(seconds) for n in range(40)) == count > 5
    assert main.main(["render", rods, "--midi", song, "--seconds", seconds]) == 0


@pytest.mark.parametrize("patch", ["rods.toml", str(PIANO_STRING)], ids=["keyboard", "voices"])
def test_a_rendering_begins_with_its_first_note(rods, tmp_path, patch, capsys):
    late = write(tmp_path / "late.mid", notes((60, 4.5, 0.2), (64, 4.75, 0.2)))
    soon = write(tmp_path / "soon.mid", notes((60, 0.0, 0.2), (64, 0.25, 0.2)))
    heard = render(patch, "--midi", late, "--seconds", "0.4")
    assert "late.mid: 4.5 s of silence before the first note were left out" in capsys.readouterr().err
    np.testing.assert_array_equal(heard, render(patch, "--midi", soon, "--seconds", "0.4"))
    assert "silence" not in capsys.readouterr().err and heard[:100].any()


def test_files_as_programs_write_them(tmp_path):
    """Running status, a tempo on a track of its own, an empty track, notes that never end."""
    tempo = [(0.5, mido.MetaMessage("set_tempo", tempo=1_000_000))]  # half as fast from half a second on
    write(tmp_path / "a.mid", tempo, [], notes((60, 0.0, 0.25), (62, 0.75, None)))
    data = (tmp_path / "a.mid").read_bytes()
    assert data.count(b"\x90") == 1, "mido writes running status"
    file = read_notes(tmp_path / "a.mid")
    score = instrument_notes.score_of_notes(file.notes, file.end)
    assert [(n.key, n.time, n.duration) for n in score.notes] == [(60, 0.0, 0.25), (62, 1.0, 1.0)]
    with pytest.raises(MidiError, match="has no notes"):
        read_notes(tmp_path / write(tmp_path / "none.mid", [], tempo))


# --- what is printed and written


def test_a_sound_is_named_like_the_tune_and_the_instrument(rods, tmp_path, capsys):
    song = write(tmp_path / "song.mid", MELODY, BASS)
    for words, name in (([], "song_rods.wav"), (["--play", "2=rods.toml@-6"], "song_mix.wav")):
        assert main.main(["render", rods, "--midi", song, "--seconds", "0.2", *words]) == 0
        assert (tmp_path / name).exists() and capsys.readouterr().out.endswith(f"{name}\n")


def test_the_speed_of_voices_is_a_number(rods, tmp_path, capsys):
    song = write(tmp_path / "song.mid", notes((60, 0.0, 0.2)))
    words = ["render", str(PIANO_STRING), "--midi", song, "--seconds", "0.3", "--voices", "1"]
    assert main.main(words) == 0
    assert "inf" not in capsys.readouterr().out
    assert main.main([*words, "--json"]) == 0
    stats = json.loads(capsys.readouterr().out)
    assert 0.01 < stats["real_time_factor"] < 1e5 and stats["live"]["real_time_factor"] == stats["real_time_factor"]
    assert len(stats["table_digest"]) == 16 and stats["live"]["table_digest"] == stats["table_digest"]


def test_a_drum_of_a_port_is_on_the_key_that_the_patch_has_for_it(rods, tmp_path):
    """Channel 10 alone: on other channels, keys are as they are."""
    drums = RODS.replace("[[key.body]]", 'drums = { 38 = "C4" }\n\n[[key.body]]', 1)
    (tmp_path / "drums.toml").write_text(drums, "utf-8")
    scene, played = engine.load("drums.toml"), []

    class Keys:
        def play(self, note):
            played.append(note.number)

        def targets(self, move, is_of_one_note):
            return None

    class NoControls:
        def __init__(self):
            self.scene = scene

        def takes(self, move):
            return False

    for channel in (9, 0):
        message = mido.Message("note_on", channel=channel, note=38, velocity=80)
        midi_port.take_message(message, MpeZones(scene.midi), Keys(), NoControls())
    assert played == [60, 38]
