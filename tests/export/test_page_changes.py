"""A page that is played and changed has the samples of live sound, and of a rendering."""

import json
import math
import random

import numpy as np
import pytest

import engine
from engine.export.faults import CannotExport
from engine.export.row_recorder import player_of_scene, sliders_of_player
from engine.export.voice_keys import bodies_of_notes, lowest_ratio, numbers_of_keys
from engine.live.key_allocator import KeyAllocator, live_scene
from engine.live.midi_notes import Note
from engine.live.player import Player
from engine.live.shared_memory import Slot
from engine.live.voice_allocator import VoiceAllocator
from engine.patch.scene import Scene
from tests.export.browser import Browser
from tests.export.key_messages import midi_of, with_polyphony
from tests.export.pages import (
    SECONDS,
    data_of,
    heard,
    messages_of_midi,
    needs_browser,
    needs_fused_node,
    needs_node,
    page_of,
    played_in_node,
)
from tests.export.tuned_scene import STOPPED_STRING, tuned_as_it_sounds

INSTRUMENTS = ["vibraphone", "toms", "piano", "violin"]


def notes_and_pedals(keys):
    """Return messages with their frames: half a pedal, a key that the sostenuto pedal keeps, and one struck softly."""
    a, b, c = (keys[3 * len(keys) // 4 + n] for n in (0, -1, -2))
    return [
        (0, "sustain", 0, 40),
        (0, "on", a, 80),
        (1024, "sostenuto", 0, 127),
        (1024, "off", a, 64),
        (2048, "on", b, 96),
        (4096, "off", b, 64),
        (6144, "sustain", 0, 79),
        (8192, "soft", 0, 70),
        (8192, "on", c, 127),
        (10240, "off", c, 64),
        (12288, "sostenuto", 0, 63),
        (16384, "sustain", 0, 0),
    ]


def notes_of_voices(keys):
    """Return messages with their frames: three voices, one struck again, and both pedals that voices have."""
    a, b, c = keys[len(keys) // 2], keys[0], keys[-1]
    return [
        (0, "on", a, 80),
        (2048, "on", b, 127),
        (3072, "sostenuto", 0, 127),
        (4096, "off", a, 64),
        (4096, "off", b, 64),
        (5120, "sustain", 0, 127),
        (6144, "on", c, 64),
        (8192, "off", c, 64),
        (9216, "on", a, 48),
        (12288, "sustain", 0, 0),
        (14336, "sostenuto", 0, 0),
        (16384, "off", a, 64),
    ]


def notes_that_end_others(keys):
    """Return messages with their frames: of keys of which two can sound at a time, some held, some by the pedal."""
    a, b, c, d = keys[len(keys) // 2 : len(keys) // 2 + 4]
    return [
        (0, "on", a, 80),
        (1024, "on", b, 96),
        (3072, "on", c, 80),
        (4096, "off", b, 64),
        (5120, "sustain", 0, 127),
        (6144, "on", d, 127),
        (7168, "off", d, 64),
        (8192, "on", a, 64),
        (10240, "sustain", 0, 0),
    ]


def notes_of_one_voice(keys):
    """Return messages with their frames: a note takes the voice of another that is still loud."""
    return [(0, "on", keys[3], 80), (4096, "on", keys[9], 96), (6144, "off", keys[3], 64), (8192, "off", keys[9], 64)]


def notes_that_take_voices(keys):
    """Return messages with their frames: of two voices, one is taken twice while it is damped, and once when quiet."""
    a, b, c, d = keys[3], keys[9], keys[6], keys[12]
    return [
        (0, "on", a, 80),
        (1024, "off", a, 64),
        (2048, "on", b, 96),
        (4096, "on", c, 80),
        (4096, "off", c, 64),
        (6144, "on", a, 127),
        (8192, "off", a, 64),
        (38_400, "on", d, 64),
        (39_424, "off", d, 64),
        (40_448, "off", b, 64),
    ]


def live_sound(scene, gain, messages, frames, voices=0):
    """Return what live sound plays of an instrument, or of so many voices of another patch, [frames, channels], if
    messages come at these frames. messages: by the keys"""
    if voices:
        bodies = bodies_of_notes(scene)
        options, keys = {"voices": voices, "lowest": lowest_ratio(bodies)}, numbers_of_keys(bodies)
    else:
        scene, options = live_scene(scene), {"waiting": True}
    player = Player(scene, 44_100, math.inf, gain, kernel="general", **options)
    player.counters[Slot.FADE_IN_FRAMES] = 0
    allocator = VoiceAllocator(player) if voices else KeyAllocator(player)
    audio = np.zeros((frames, player.channels), np.float32)
    for begin in range(0, frames, 128):
        for frame, *message in messages(keys if voices else allocator.keys):
            if frame == begin:
                allocator.play(Note(0.0, *message))
        if not voices:
            allocator.poll()
        player.render_into(audio[begin : begin + 128])
    return audio


def bent_notes(keys):
    """Return messages with their frames: two notes, and a pitch wheel that moves under both."""
    a, b = keys[len(keys) // 2 : len(keys) // 2 + 2]
    return [
        (0, "on", a, 80),
        (1024, "bend", 0, 50.0),
        (2048, "on", b, 96),
        (4096, "bend", 0, -175.0),
        (6144, "off", a, 64),
        (8192, "bend", 0, 0.0),
        (12288, "bend", 0, 200.0),
    ]


def notes_of_a_stopped_string(keys):
    """Return messages with their frames: two notes one after the other, and a third between two velocities' tables."""
    return [(0, "on", keys[0], 80), (4096, "off", keys[0], 64), (6144, "on", keys[4], 96), (12288, "on", keys[2], 64)]


@pytest.mark.slow
@needs_browser
@pytest.mark.parametrize(
    ("name", "messages", "options"),
    [(name, notes_and_pedals, {}) for name in INSTRUMENTS]
    + [(name, bent_notes, {"slide": ["bend"]}) for name in ("vibraphone", "violin")]
    + [(STOPPED_STRING, notes_of_a_stopped_string, {})]
    + [(name, notes_of_voices, {"voices": 4}) for name in ("piano_c4", "tanpura", "guitar_body")]
    + [("piano_c4", notes_of_one_voice, {"voices": 1})]
    + [(with_polyphony(name, 2), notes_that_end_others, {}) for name in ("vibraphone", "violin")],
)
def test_the_keys_of_a_page_do_what_those_of_live_sound_do(name, messages, options, tmp_path):
    """With all three pedals, the sustain pedal half down, with the pitch wheel, and where keys change the pitch of a
    string or tune a voice, by the same messages of MIDI."""
    page, data = page_of(name, **options)
    page.save(tmp_path / "page.html")
    frames = round(SECONDS * 44_100) // 128 * 128
    expected = live_sound(engine.load(name), data["gain"], messages, frames, options.get("voices", 0))
    with Browser(tmp_path / "browser") as browser:
        browser.open(tmp_path / "page.html")
        browser.ask("started")
        keys = browser.ask("fdh.data.keys.map(key => key.number)")
        heard_midi = [[frame, midi_of(*message)] for frame, *message in messages(keys)]
        audio, meter = heard(browser, frames, browser.ask(f"JSON.stringify({messages_of_midi(heard_midi)})"))
        assert browser.errors == []
    np.testing.assert_array_equal(audio, expected)
    assert np.abs(audio).max() > 0.001
    assert meter["error"] < 1e-11


@pytest.mark.hard
@needs_fused_node
@pytest.mark.parametrize("name", ["piano_c4", "marimba"])
def test_the_voices_of_a_page_are_taken_as_in_live_sound(name, tmp_path):
    """A note begins when the last one of its voice is damped, unless that is quiet; and ends as much later."""
    page, data = page_of(name, voices=2)
    page.save(tmp_path / "page.html")
    scene, frames = engine.load(name), 336 * 128
    midi = notes_that_take_voices(numbers_of_keys(bodies_of_notes(scene)))
    expected = live_sound(scene, data["gain"], notes_that_take_voices, frames, 2)
    sent = messages_of_midi([[frame, midi_of(*message)] for frame, *message in midi])
    audio, meter = played_in_node(tmp_path / "page.html", frames, sent, fused=True)
    np.testing.assert_array_equal(audio, expected)
    assert np.abs(audio).max() > 0.001
    assert meter["error"] < 1e-11


@pytest.mark.hard
@needs_node
def test_a_page_changes_the_pitch_and_the_loss_of_a_string_as_its_score_says(tmp_path):
    """In Node, which multiplies and then adds: with the samples of a rendering but for their last bits."""
    scene = tuned_as_it_sounds("piano_c4", "string")
    page = engine.export_page(scene)
    page.save(tmp_path / "page.html")
    audio = engine.render(scene, seconds=SECONDS, cores=1).audio * data_of(page.html)["gain"]
    played, meter = played_in_node(tmp_path / "page.html", len(audio))
    np.testing.assert_allclose(played, audio, rtol=0.0, atol=1e-7 * np.abs(audio).max())
    assert 0.0 < meter["error"] < 1e-12


@pytest.mark.hard
def test_what_can_have_no_slider_is_said():
    with pytest.raises(CannotExport, match=r"no live parameter body.string.sigma; .* body.string.sigma0"):
        page_of("piano_c4", slide=["body.string.sigma"])
    with pytest.raises(CannotExport, match="the score or a key changes the same tables"):
        engine.export_page(tuned_as_it_sounds("piano_c4", "string"), slide=["body.string.length"])
    with pytest.raises(CannotExport, match="a key changes the same tables"):
        page_of(STOPPED_STRING, slide=["body.string.length"])
    with pytest.raises(CannotExport, match="no keys to bend"):
        page_of("piano_c4", slide=["bend"])
    scene = engine.load("piano_c4")
    lossless = scene.body[0].model_copy(update={"sigma0": 0.0})
    with pytest.raises(CannotExport, match="as it is 0: a slider goes from half to twice the value"):
        engine.export_page(scene.model_copy(update={"body": [lossless, scene.body[1]]}), slide=["body.string.sigma0"])


def test_what_can_have_no_voices_is_said():
    for name, options, message in (
        ("vibraphone", {}, "the patch is an instrument"),
        ("ball_on_drum", {}, "no vibrating body is struck or plucked"),
        ("piano_c4", {"slide": ["body.string.length"]}, "its voices share their tables"),
    ):
        with pytest.raises(CannotExport, match=message):
            page_of(name, voices=2, **options)
    with pytest.raises(ValueError, match="voices = -1 is out of range"):
        page_of("piano_c4", voices=-1)


@pytest.mark.hard
def test_keys_that_change_two_numbers_of_the_same_tables_or_glide_are_refused():
    for change, message in (
        ({"parameter": "body.string.sigma0", "value": 4.0}, "another number of the same tables"),
        ({"parameter": "body.string.frequency", "value": 4.0, "duration": 0.1}, "a key glides body.string.frequency"),
    ):
        on = [*STOPPED_STRING["key"]["on"], {"kind": "change", **change}]
        document = STOPPED_STRING | {"key": STOPPED_STRING["key"] | {"on": on}}
        with pytest.raises(CannotExport, match=message):
            page_of(document)


@pytest.mark.hard
def test_a_score_that_changes_tables_too_often_for_a_page_is_refused():
    """What is played waits in the same queue."""
    body = {"name": "a", "kind": "oscillator", "mass": 0.01, "frequency": 300.0, "displacement": 1e-3}
    glide = {"kind": "change", "parameter": "body.a.frequency", "duration": 0.19}
    events = [glide | {"time": 0.2 * n, "value": 200.0 + n} for n in range(24)]
    scene = Scene.model_validate({"body": [body], "pickup": [{"body": "a"}], "seconds": 5.0, "event": events})
    with pytest.raises(CannotExport, match="in 912 steps; a page has room for 896"):
        engine.export_page(scene)


@pytest.mark.slow
@needs_browser
def test_a_page_makes_the_changes_of_a_score_that_need_new_tables(tmp_path):
    """Pitch and loss of a string, with the samples and the energy of a rendering."""
    scene = tuned_as_it_sounds("piano_c4", "string")
    page = engine.export_page(scene)
    page.save(tmp_path / "page.html")
    rendering = engine.render(scene, seconds=SECONDS, cores=1)
    with Browser(tmp_path / "browser") as browser:
        browser.open(tmp_path / "page.html")
        audio, meter = heard(browser, len(rendering.audio), "[]")
    np.testing.assert_array_equal(audio, (rendering.audio * data_of(page.html)["gain"]).astype(np.float32))
    untuned = engine.render(engine.load("piano_c4"), seconds=SECONDS, cores=1).audio
    assert np.abs(rendering.audio - untuned).max() > 0.1 * np.abs(untuned).max()
    assert 0.0 < meter["error"] < 1e-11


SLID = {"piano_c4": ["body.string.frequency", "body.string.length", "body.string.sigma0", "body.hammer.mass"]}
SLID |= {"guitar_body": ["body.a2.tension", "body.e4.decay.a"]}


@pytest.mark.slow
@needs_browser
@pytest.mark.parametrize(("name", "order"), [("piano_c4", 2), ("piano_c4", 4), ("guitar_body", 2)])
def test_sliders_of_a_page_exchange_the_tables_that_live_sound_would(name, order, tmp_path):
    """Pitch, tension, length and loss, with the samples of live sound. Of sliders whose tables are the same ones, one
    at a time is away from the patch's value."""
    scene, frames = engine.load(name), round(SECONDS * 44_100) // 128 * 128
    scene = scene.model_copy(update={"accuracy": scene.accuracy.replace(order=order)})
    page = engine.export_page(scene, slide=SLID[name])
    page.save(tmp_path / "page.html")
    with Browser(tmp_path / "browser") as browser:
        browser.open(tmp_path / "page.html")
        browser.ask("started")
        sliders = browser.ask("fdh.data.table_sliders.map(({ rows, ...slider }) => slider)")
        moves = [(256 + 2048 * n, n % len(sliders), (3 * n + 17) % 12) for n in range(2 * len(sliders))]
        sent = browser.ask(
            """(() => {
          const sent = [];
          let now = 0;
          window.send = message => sent.push({ ...message, at: now });
          playing ||= true; // what is moved before is sent when it begins
          const inputs = [...document.querySelectorAll("#sliders input")].slice(-COUNT);
          for (const [frame, n, place] of MOVES) {
            now = frame;
            inputs[n].value = place;
            inputs[n].oninput();
          }
          return JSON.stringify(sent);
        })()""".replace("MOVES", json.dumps(moves)).replace("COUNT", str(len(sliders)))
        )
        audio, meter = heard(browser, frames, sent)
        assert browser.errors == []
    player = Player(scene, 44_100, math.inf, data_of(page.html)["gain"], kernel="general")
    player.counters[Slot.FADE_IN_FRAMES] = 0
    expected, away = np.zeros((frames, player.channels), np.float32), set()
    for begin in range(0, frames, 128):
        for frame, n, place in moves:
            if frame == begin:
                gone = away & set(sliders[n]["overlapping"])
                player.set({sliders[m]["path"]: sliders[m]["values"][sliders[m]["home"]] for m in gone}, seconds=0.0)
                player.set(sliders[n]["path"], sliders[n]["values"][place], seconds=0.0)
                away = away - gone | {n}
        player.render_into(expected[begin : begin + 128])
    np.testing.assert_array_equal(audio, expected)
    assert np.abs(audio).max() > 0.01
    assert 0.0 < meter["error"] < 1e-11


@pytest.mark.hard
@needs_browser
@pytest.mark.parametrize("name", ["snare_wires", "guitar_frets"])
def test_the_sliders_of_a_page_have_the_values_of_live_sound(name, tmp_path):
    """Of any number, to the last bit, as contacts amplify each rounding."""
    scene, rng = engine.load(name), random.Random(name)
    engine.export_page(scene).save(tmp_path / "page.html")
    sliders = sliders_of_player(player_of_scene(scene, 44_100, "general"))
    values = [[slider.low + rng.random() * (slider.high - slider.low) for _ in range(20)] for slider in sliders]
    wanted = [[slider.law.row_value(value) for value in some] for slider, some in zip(sliders, values, strict=True)]
    with Browser(tmp_path / "browser") as browser:
        browser.open(tmp_path / "page.html")
        browser.ask("started")
        asked = f"{json.dumps(values)}.map((some, n) => some.map(x => sliderRows(fdh.data.sliders[n], x)[0][6]))"
        assert browser.ask(asked) == wanted
    assert len(sliders) > 0
