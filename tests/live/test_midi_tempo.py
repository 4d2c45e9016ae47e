"""The tempo of a MIDI file: another one for all of it, or that of a clock at a port."""

import json

import mido
import numpy as np
import pytest
from conftest import needs_portaudio
from test_drivers import jack, needs_jack  # noqa: F401

import engine
from engine.cli import main
from engine.live.instrument_notes import scene_of_file
from engine.live.midi_clock import ClockedFilePlayer, MidiClock
from engine.live.midi_drivers import MidiError
from engine.live.midi_files import read_notes
from engine.live.midi_parts import Excerpt
from tests.live.stage import play_on_stage

BEAT = 480  # ticks of the files here
FASTER = 80.0  # quarter notes per minute, from the third beat on


def write(path, tempos=((0, 100.0), (2, FASTER)), presses=(0, 1, 2, 3, 5), rest=0):
    """A file of notes at these beats, half a beat long, at tempos (beat, quarter notes per minute), after a rest."""
    events = [(rest + beat, 0, mido.MetaMessage("set_tempo", tempo=mido.bpm2tempo(tempo))) for beat, tempo in tempos]
    for n, beat in enumerate(presses):
        events.append((rest + beat, 1, mido.Message("note_on", note=60 + n, velocity=80)))
        events.append((rest + beat + 0.5, 0, mido.Message("note_off", note=60 + n)))
    track, before = mido.MidiTrack(), 0.0
    for beat, _, message in sorted(events, key=lambda event: event[:2]):
        track.append(message.copy(time=round((beat - before) * BEAT)))
        before = beat
    file = mido.MidiFile(ticks_per_beat=BEAT)
    file.tracks.append(track)
    file.save(path)
    return path


def begins(path, **excerpt):
    return [note.seconds for note in read_notes(path, excerpt=Excerpt(**excerpt)).notes if note.kind == "on"]


# --- another tempo


def test_another_tempo_is_that_of_the_first_note_and_the_others_follow(tmp_path):
    path = write(tmp_path / "song.mid")
    own = begins(path)
    assert own == pytest.approx([0.0, 0.6, 1.2, 1.95, 3.45])
    assert begins(path, tempo=200.0) == pytest.approx([0.5 * seconds for seconds in own])
    rested = write(tmp_path / "rested.mid", tempos=((-2, 40.0), (0, 100.0)), rest=2)
    assert np.diff(begins(rested, tempo=50.0))[:2] == pytest.approx([1.2, 1.2])  # not of the rest before it


def test_the_tempo_of_a_file_itself_changes_no_note(tmp_path):
    path, marimba = write(tmp_path / "song.mid"), engine.load("marimba_keys")
    plain, own = (scene_of_file(marimba, path, Excerpt(tempo=tempo)).scene for tempo in (None, 100.0))
    assert plain == own
    usual = write(tmp_path / "usual.mid", tempos=())
    assert begins(usual, tempo=120.0) == begins(usual)


def test_a_rendering_lasts_as_long_as_its_tempo_says_and_notes_it(tmp_path, capsys, monkeypatch):
    monkeypatch.chdir(tmp_path)
    write(tmp_path / "song.mid", tempos=((0, 100.0),))
    lengths = []
    for tempo in ("100", "200"):
        words = ["render", "kalimba", "--midi", "song.mid", "--tempo", tempo, "--stems", "stems", "-o", "x.wav"]
        assert main.main([*words, "--json"]) == 0
        lengths.append(json.loads(capsys.readouterr().out)["seconds"])
        assert f"TEMPO {tempo} 4 4" in (tmp_path / "stems" / "stems.rpp").read_text("utf-8")
    assert lengths[0] - lengths[1] == pytest.approx(5.5 * 0.3, abs=0.05)


@pytest.mark.parametrize("command", ["render", "play"])
def test_a_tempo_that_cannot_be_is_said(command, tmp_path, capsys):
    path = write(tmp_path / "song.mid")
    for words, told in (
        (["--midi", str(path), "--tempo", "0"], "--tempo: 0 is out of range; give 1 to 1000 quarter notes per minute"),
        (["--midi", str(path), "--tempo", "fast"], '--tempo: "fast" is not a number'),
        (["--tempo", "90"], "--tempo: requires --midi with a file"),
    ):
        assert main.main([command, "marimba_keys", *words]) == 2
        assert told in capsys.readouterr().err


def test_a_file_that_counts_seconds_has_no_tempo(tmp_path):
    path = write(tmp_path / "song.mid")
    data = bytearray(path.read_bytes())
    data[12:14] = bytes([256 - 25, 40])  # 25 frames of 40 ticks a second
    path.write_bytes(data)
    assert read_notes(path).notes
    with pytest.raises(MidiError, match="counts seconds and no beats"):
        read_notes(path, excerpt=Excerpt(tempo=90.0))


# --- a clock


class Band:
    """A port that tells a clock, and the time that it has."""

    def __init__(self):
        self.now, self.waiting = 0.0, []

    def iter_pending(self):
        told, self.waiting = self.waiting, []
        yield from told

    def tell(self, kind, **numbers):
        self.waiting.append(mido.Message(kind, **numbers))


class Keys:
    """Keys that note what is played, and the time."""

    def __init__(self, band):
        self.band, self.heard, self.let_go = band, [], 0

    def play(self, note, frame=0):
        if note.kind == "on":
            self.heard.append((note.number, self.band.now))

    def release_all(self, part, frame=0):
        self.let_go += 1


def conduct(player, band, beats, tempo, polls=10):
    """Let a clock tick for so many beats, and look often between two ticks."""
    for _ in range(round(24 * beats)):
        band.tell("clock")
        for _ in range(polls):
            assert player.poll() is False
            band.now += 60.0 / tempo / 24 / polls


@pytest.fixture
def led(tmp_path):
    """A file that follows a clock, its keys, and the port of the clock."""
    band = Band()
    keys, file = Keys(band), read_notes(write(tmp_path / "song.mid"))
    return ClockedFilePlayer(keys, file, MidiClock(band, lambda: band.now), None), keys, band


@pytest.mark.parametrize("tempo", [30.0, 100.0, 240.0])
def test_notes_come_at_their_beats_whatever_the_tempo_of_the_clock(led, tempo):
    player, keys, band = led
    conduct(player, band, 1, tempo)
    assert keys.heard == []  # nobody has said that it begins
    begin = band.now
    band.tell("start")
    conduct(player, band, 6, tempo)
    assert [number for number, _ in keys.heard] == [60, 61, 62, 63, 64]
    at = [(now - begin) * tempo / 60.0 for _, now in keys.heard]
    assert at == pytest.approx([0, 1, 2, 3, 5], abs=1 / 24 / 5)  # a poll, of which there are ten in a tick


def test_a_clock_that_stops_lets_go_and_goes_on_where_it_stopped(led):
    player, keys, band = led
    band.tell("start")
    conduct(player, band, 1.5, 120.0)
    band.tell("stop")
    conduct(player, band, 4, 120.0)
    assert [number for number, _ in keys.heard] == [60, 61] and keys.let_go
    band.tell("continue")
    conduct(player, band, 1, 120.0)
    assert [number for number, _ in keys.heard] == [60, 61, 62]


def test_a_clock_leads_to_any_place_of_the_song_and_begins_anew(led):
    player, keys, band = led
    band.tell("songpos", pos=10)  # sixteenths: two beats and a half
    band.tell("continue")
    conduct(player, band, 1, 120.0)
    assert [number for number, _ in keys.heard] == [63]
    band.tell("start")
    conduct(player, band, 1.5, 120.0)
    assert [number for number, _ in keys.heard] == [63, 60, 61]


def test_the_song_waits_for_a_clock_that_is_lost(led):
    player, keys, band = led
    band.tell("start")
    conduct(player, band, 0.9, 120.0)
    for _ in range(100):
        player.poll()
        band.now += 0.1
    assert [number for number, _ in keys.heard] == [60]


def test_options_of_a_clock_that_cannot_be_are_said(tmp_path, capsys):
    path = str(write(tmp_path / "song.mid"))
    for words, told in (
        (["--clock", "x"], "--clock: requires --midi with a file"),
        (["--clock", "x", "--midi", path, "--tempo", "90"], "--clock: sets the tempo; leave out --tempo"),
    ):
        assert main.main(["play", "marimba_keys", *words]) == 2
        assert told in capsys.readouterr().err


CLOCK = """
import sys, time
from socket_midi import Source
source = Source("band")
sys.stdin.readline()
time.sleep(0.5)
source.send([0xFA])
begin = time.monotonic()
for tick in range(24 * 6):
    time.sleep(max(0.0, begin + tick / 24 * 0.4 - time.monotonic()))
    source.send([0xF8])
print("done", flush=True)
sys.stdin.readline()
"""


@pytest.mark.hard
@needs_portaudio
@needs_jack
def test_a_session_follows_a_clock_on_stage(tmp_path, jack):  # noqa: F811
    """Under JACK's dummy driver: 150 quarter notes a minute of a clock, and not the 100 and 80 of the file."""
    song, log = write(tmp_path / "song.mid"), tmp_path / "log.json"
    words = ["marimba_keys", "--midi", str(song), "--clock", "band", "--event-log", str(log), "--ignore-speed"]
    play_on_stage(tmp_path, jack[0], "band", CLOCK, words)
    told = json.loads(log.read_text())
    struck = [e for e in told["events"] if e["why"][0] == "strike"]
    at = np.array([max(event["frame"], int(event["row"][4])) for event in struck]) / told["samplerate"]
    assert len(at) == 5
    assert (at - at[0]) / 0.4 == pytest.approx([0, 1, 2, 3, 5], abs=0.1)
