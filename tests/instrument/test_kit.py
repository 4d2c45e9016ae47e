"""The drum kit: each key sounds, and in what order of brightness; the hi-hat, whose plates touch; what is lacking."""

import functools
import math
import time

import numpy as np
import pytest

import engine
from engine.cli import main
from engine.instrument.expansion import expand_for_score, keys_of
from engine.instrument.key_names import note_name
from engine.instrument.score import PlayedNote, make_score
from engine.live.controls import Controls
from engine.live.general_midi import DRUMS, LOWEST_DRUM
from engine.live.key_allocator import KeyAllocator, live_scene
from engine.live.midi_notes import Note
from engine.live.midi_port import take_message
from engine.live.mpe import MpeZones
from engine.live.player import Player
from engine.patch.note_scene import scene_of_note

mido = pytest.importorskip("mido", reason="needs mido")
RATE = 44_100
KIT = engine.load("kit")
KEYS = [note_name(key) for key in keys_of(KIT.instrument["keyboard"])]
WANTED = {*range(35, 49), 50, 54, 56, 69, 70, *range(75, 78)} - {39}  # of General MIDI; no hand clap
CLOSED, PEDAL, OPEN = 42, 44, 46
GAP = "contact.hats.gap"


@functools.lru_cache
def play(key: str, velocity: int = 100) -> engine.Rendering:
    return engine.render(scene_of_note(KIT, key, velocity, hold=0.2, seconds=0.4))


@functools.lru_cache
def play_hats(*notes: tuple[float, int], seconds: float = 1.0) -> np.ndarray:
    """The mean of both channels of some notes: when, s, and which key."""
    score = make_score([PlayedNote(time, key, 100, 0.1, 64) for time, key in notes])
    document = KIT.instrument | {"seconds": seconds}
    rendering = engine.render(KIT.with_expansion(expand_for_score(document, score)))
    assert rendering.stats.energy.error_max <= 1e-12
    return rendering.audio.mean(axis=1)


def centroid(key: str) -> float:
    """The mean frequency, weighted by power, Hz."""
    power = np.abs(np.fft.rfft(play(key).audio.mean(axis=1))) ** 2
    return float(power @ np.fft.rfftfreq(play(key).audio.shape[0], 1 / RATE) / power.sum())


def fall(sound: np.ndarray, begin: float, seconds: float = 0.2) -> float:
    """By how much the level falls from 10 ms after a stroke to some time after that, dB."""
    early, late = (sound[round(t * RATE) : round((t + 0.03) * RATE)].std() for t in (begin + 0.01, begin + seconds))
    return 20 * math.log10(early / late)


def test_it_has_the_drums_of_general_midi_that_were_asked_for():
    assert {int(drum) for drum in KIT.instrument["keyboard"]["drums"]} == WANTED
    assert {LOWEST_DRUM <= drum < LOWEST_DRUM + len(DRUMS) for drum in WANTED} == {True}
    assert len(KEYS) == len(WANTED)


@pytest.mark.parametrize("key", KEYS)
def test_a_key_sounds_and_its_energy_closes(key):
    """At the level of the patch, no stroke is more than 45 dB below full scale, nor beyond it."""
    rendering = play(key)
    peak = 20 * math.log10(np.abs(rendering.audio).max()) + KIT.level
    assert -45.0 < peak < 0.0
    assert rendering.stats.energy.error_max <= 1e-12
    assert rendering.stats.newton.unconverged == 0


def test_from_the_kick_to_the_hi_hat_they_are_brighter():
    found = [centroid(key) for key in ("C2", "A2", "D2", "F#2")]
    assert found[0] < found[1] < found[2] / 3 < found[3] / 9, found


@pytest.mark.parametrize("key", KEYS)
def test_a_harder_stroke_is_louder(key):
    soft, hard = (np.abs(play(key, velocity).audio).max() for velocity in (50, 110))
    assert hard > 1.5 * soft


def test_a_closed_hat_is_short_and_chokes_an_open_one():
    alone = play_hats((0.0, OPEN))
    assert fall(alone, 0.0) < 20.0
    choked = play_hats((0.0, OPEN), (0.3, PEDAL))
    np.testing.assert_array_equal(choked[: round(0.29 * RATE)], alone[: round(0.29 * RATE)])
    assert fall(choked, 0.3) > fall(alone, 0.3) + 15.0
    assert fall(play_hats((0.0, CLOSED)), 0.0) > fall(alone, 0.0) + 15.0


def test_an_open_hat_is_open_again_after_a_closed_one():
    again = play_hats((0.0, CLOSED), (0.4, OPEN))
    assert fall(again, 0.4) == pytest.approx(fall(play_hats((0.0, OPEN)), 0.0), abs=3.0)


def test_the_pedal_alone_claps_the_plates_together():
    clap, stroke = play_hats((0.0, PEDAL)), play_hats((0.0, CLOSED))
    assert 0.05 < np.abs(clap).max() / np.abs(stroke).max() < 1.0


def test_controller_4_moves_the_plates_by_contact_alone():
    """An open hat, live: the pedal goes down under it; no key and no damper says so."""
    heard = []
    for value in (0, 127):
        scene = live_scene(KIT, [OPEN])
        player = Player(scene, gain=1e-5, seconds=math.inf, waiting=True)
        keys, moved, zones = KeyAllocator(player), Controls(scene, player), MpeZones(scene.midi)
        out = np.zeros((RATE // 10, player.channels), np.float32)
        take_message(mido.Message("note_on", channel=9, note=OPEN, velocity=100), zones, keys, moved)
        player.render_into(out)
        take_message(mido.Message("control_change", channel=9, control=4, value=value), zones, keys, moved)
        sound = []
        for _ in range(40):
            moved.poll()
            player.render_into(out[: RATE // 100])
            sound.append(out[: RATE // 100].copy())
        assert player.value(GAP) == pytest.approx(scene.control[0].range[value == 127], abs=1e-5)
        assert player.meter()["energy_error"] <= 1e-12
        heard.append(np.concatenate(sound).mean(axis=1))
    apart, together = (sound[-RATE // 20 :].std() for sound in heard)
    assert apart > 3 * together


def test_a_drum_that_it_lacks_is_said_once(tmp_path, monkeypatch, capsys):
    """Crash and ride, twice each, beside a kick."""
    monkeypatch.chdir(tmp_path)
    beat = mido.MidiTrack(mido.Message("note_on", channel=9, note=drum, time=120) for drum in (36, 49, 51, 49, 51))
    mido.MidiFile(tracks=[beat]).save("x.mid")
    assert main.main(["render", "piano", "--midi", "x.mid", "--play", "10=kit", "-o", "x.wav"]) == 0
    said = capsys.readouterr().err
    assert said.count("Crash Cymbal 1 (49) 2 ×") == said.count("Ride Cymbal 1 (51) 2 ×") == 1
    assert "Bass Drum" not in said


@pytest.mark.hard
def test_a_beat_takes_less_than_half_of_a_core():
    """Kick, snare, and eighths on the hi-hat at 120 quarter notes a minute, live, with all keys; 13 % where it was
    written, by the time of the thread."""
    player = Player(live_scene(KIT), gain=1e-5, seconds=math.inf, waiting=True, cores=1)
    keys, out, spent = KeyAllocator(player), np.zeros((RATE // 100, player.channels), np.float32), []
    for n in range(400):
        if n % 25 == 0:
            beat = n // 25 % 8
            for key in (OPEN if beat == 7 else CLOSED, *({0: [36], 2: [38], 4: [36], 6: [38]}.get(beat, []))):
                keys.play(Note(0.0, "on", key, 100))
        begin = time.thread_time()
        player.render_into(out)
        spent.append(time.thread_time() - begin)
    assert player.meter()["energy_error"] <= 1e-12 and np.abs(out).max() > 0.0
    assert np.mean(spent) * 100 < 0.5
