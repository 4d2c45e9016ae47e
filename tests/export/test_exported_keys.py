"""Keys of a page and of a library in C have the samples of live sound, whatever is played."""

import numpy as np
import pytest
from conftest import mostly_hard

import engine
from engine.export.row_recorder import player_of_keys, rows_of_score
from engine.instrument.score import read_score
from engine.kernel.data.enums import EventKind
from tests.export.browser import Browser
from tests.export.key_messages import (
    BLOCK,
    KINDS,
    RATE,
    TWO_TINES,
    draw_exported_messages,
    lines_of,
    midi_of,
    play_live,
    with_polyphony,
)
from tests.export.pages import data_of, heard, messages_of_midi, needs_browser, needs_fused_node, played_in_node
from tests.export.test_c_library import COMPILER, DONE, Library, needs_compiler
from tests.export.tuned_scene import STOPPED_STRING
from tests.live.two_ways import Message

FRAMES = 160 * BLOCK
SANITIZERS = ["-g", "-fsanitize=address,undefined", "-fno-sanitize-recover=all"]
INSTRUMENTS = ["vibraphone", "violin", "guitar", "kalimba_keys", "marimba_keys"]
PAIRS = list(zip(INSTRUMENTS, KINDS, strict=True))
COMPILED, COMPILED_LATER = ["guitar", "marimba_keys", "violin"], ["kalimba_keys", "vibraphone", "sitar", "toms"]


def marked(names, mark):
    """Return values of a parameter of tests, with a mark."""
    return [pytest.param(name, marks=mark) for name in names]


def notes_that_the_pedal_keeps(a, b, c, d):
    """Return messages of keys of which two can sound: the pedal is moved twice."""
    return [
        Message(0, "on", a, 80),
        Message(2 * BLOCK, "sustain", 0, 127),
        Message(4 * BLOCK, "off", a, 64),
        Message(6 * BLOCK, "on", b, 96),
        Message(10 * BLOCK, "on", c, 96),
        Message(30 * BLOCK, "on", d, 112),
        Message(60 * BLOCK, "off", d, 64),
        Message(80 * BLOCK, "sustain", 0, 0),
        Message(90 * BLOCK, "on", a, 48),
    ]


def sound_of_page(page, messages):
    """Return what Node plays of a saved page for messages, with the fused multiply-adds of the engine."""
    midi = [[frame, midi_of(*message)] for frame, *message in messages]
    audio, meter = played_in_node(page, FRAMES, messages_of_midi(midi), fused=True)
    assert meter["error"] < 1e-11
    return audio


def assert_page_plays(scene, drawn, folder):
    """Assert that a page has the samples of live sound, all of them. drawn: messages of several sessions"""
    page = engine.export_page(scene)
    page.save(folder / "page.html")
    for messages in drawn:
        expected = play_live(scene, messages, FRAMES, data_of(page.html)["gain"]).audio
        audio = sound_of_page(folder / "page.html", messages)
        assert expected.any()
        assert np.count_nonzero(audio != expected) == 0


# --- a page


@pytest.mark.hard
@needs_fused_node
@pytest.mark.parametrize(("name", "kind"), mostly_hard(PAIRS, PAIRS[0], PAIRS[2]))
def test_a_page_plays_keys_as_live_sound_does(name, kind, tmp_path):
    scene = engine.load(name)
    assert_page_plays(scene, [draw_exported_messages(scene, kind, 0, FRAMES)], tmp_path)


@pytest.mark.hard
@needs_fused_node
def test_a_page_plays_keys_that_change_something_later(tmp_path):
    """Such a change does not begin if the key is let go or pressed again. One key too many ends the oldest, also if the
    pedal keeps it: its dampers come down for a while, and then the pedal lifts them."""
    scene = engine.load(TWO_TINES)
    drawn = [draw_exported_messages(scene, kind, 0, FRAMES) for kind in (*KINDS, "pedals")]
    assert_page_plays(scene, [*drawn, notes_that_the_pedal_keeps(60, 64, 67, 62)], tmp_path)


@pytest.mark.hard
@needs_fused_node
def test_a_page_plays_keys_that_tune_a_string_later(tmp_path):
    """The tables for that are not exchanged if the key is let go or pressed again before."""
    later = {"kind": "change", "parameter": "body.string.frequency", "time": 0.05, "value": "= 300*2**((key - 60)/12)"}
    scene = engine.load(STOPPED_STRING | {"key": STOPPED_STRING["key"] | {"on": [*STOPPED_STRING["key"]["on"], later]}})
    assert_page_plays(scene, [draw_exported_messages(scene, kind, 0, FRAMES) for kind in KINDS], tmp_path)


@pytest.mark.hard
@needs_fused_node
def test_a_page_plays_the_score_of_an_instrument_as_it_is_rendered(tmp_path):
    """With the vibrato of a note, which ends with it."""
    frames, violin = 540 * BLOCK, engine.load("violin")
    page = engine.export_page(violin)
    page.save(tmp_path / "page.html")
    audio, _ = played_in_node(tmp_path / "page.html", frames, "[{ song: fdh.data.song }]", fused=True)
    expected = engine.render(violin, seconds=frames / RATE, cores=1).audio.reshape(frames, -1)
    assert np.count_nonzero(audio != (expected * data_of(page.html)["gain"]).astype(np.float32)) == 0


def test_a_score_with_a_key_that_has_no_bodies_of_its_own_has_rows():
    """The open string of a guitar, which no finger stops."""
    guitar = engine.load("guitar_slide")
    rows = rows_of_score(player_of_keys(guitar, RATE, "general"), read_score(guitar.instrument))
    assert sum(row[0] == EventKind.PLUCK for row in rows) > 0


@pytest.mark.slow_but_each(2)
@pytest.mark.hard
@needs_fused_node
@pytest.mark.parametrize("name", [*INSTRUMENTS, "sitar", "toms"])
def test_a_page_plays_keys_as_live_sound_does_whatever_is_played(name, tmp_path):
    scene = engine.load(name)
    drawn = [draw_exported_messages(scene, kind, seed, FRAMES) for kind in (*KINDS, "pedals") for seed in range(1, 3)]
    assert_page_plays(scene, drawn, tmp_path)


@pytest.mark.hard
@needs_fused_node
@pytest.mark.parametrize("name", ["vibraphone", "violin"])
def test_a_page_ends_a_note_that_the_pedal_keeps_as_live_sound_does(name, tmp_path):
    scene = engine.load(with_polyphony(name, 2))
    drawn = [draw_exported_messages(scene, "pedals", seed, FRAMES) for seed in range(2)]
    assert_page_plays(scene, [*drawn, notes_that_the_pedal_keeps(60, 65, 72, 77)], tmp_path)


@pytest.mark.hard
@needs_browser
@pytest.mark.parametrize(("name", "kind"), list(zip(INSTRUMENTS, KINDS[::-1], strict=True)))
def test_chromium_plays_keys_as_live_sound_does(name, kind, tmp_path):
    scene = engine.load(name)
    page, messages = engine.export_page(scene), draw_exported_messages(scene, kind, 3, FRAMES)
    page.save(tmp_path / "page.html")
    midi = [[frame, midi_of(*message)] for frame, *message in messages]
    with Browser(tmp_path / "browser") as browser:
        browser.open(tmp_path / "page.html")
        browser.ask("started")
        audio, _ = heard(browser, FRAMES, browser.ask(f"JSON.stringify({messages_of_midi(midi)})"))
        assert browser.errors == []
    expected = play_live(scene, messages, FRAMES, data_of(page.html)["gain"]).audio
    assert np.count_nonzero(audio != expected) == 0


# --- a library in C


def assert_library_plays(library, scene, messages, frames=FRAMES):
    """Assert that a library in C has the samples of live sound, to the last bit."""
    expected = play_live(scene, messages, frames).samples
    audio, results = library.play(*lines_of(messages, frames))
    assert set(results) == {DONE}
    assert expected.any()
    assert np.count_nonzero(audio != expected) == 0


@pytest.mark.slow_for("violin")
@needs_compiler
@pytest.mark.parametrize("name", [*marked(COMPILED, pytest.mark.hard), *marked(COMPILED_LATER, pytest.mark.slow)])
def test_a_library_in_c_plays_keys_as_live_sound_does(name, library):
    scene = engine.load(name)
    for kind in KINDS:
        for seed in range(2):
            assert_library_plays(library(name), scene, draw_exported_messages(scene, kind, seed, FRAMES))


@pytest.mark.slow
@pytest.mark.hard
@needs_compiler
def test_a_library_in_c_plays_keys_that_change_something_later(tmp_path):
    """Such a change does not begin if the key is let go or pressed again. One key too many ends the oldest, also if the
    pedal keeps it: its dampers come down for a while, and then the pedal lifts them."""
    scene = engine.load(TWO_TINES)
    library = Library(scene, tmp_path)
    for kind in KINDS:
        assert_library_plays(library, scene, draw_exported_messages(scene, kind, 0, FRAMES))
    assert_library_plays(library, scene, notes_that_the_pedal_keeps(60, 64, 67, 62))


@pytest.mark.hard
@needs_compiler
@pytest.mark.parametrize("name", ["guitar", "marimba_keys"])
def test_ten_seconds_of_keys_and_pedals_neither_err_in_memory_nor_differ(name, tmp_path):
    """Under the sanitizers of addresses and of undefined behaviour, which end the program at the first fault."""
    scene, frames = engine.load(name), 3445 * BLOCK
    library = Library(scene, tmp_path, [COMPILER, *SANITIZERS])
    messages = [
        (begin + frame, kind, key, 127 * (value >= 64) if kind == "sustain" else value)
        for seed, begin in enumerate(range(0, frames - FRAMES, FRAMES))
        for frame, kind, key, value in draw_exported_messages(scene, ("pedals", *KINDS)[seed % 6], seed, FRAMES)
        if kind not in ("sostenuto", "soft")  # of which a library has none
    ]
    assert any(kind == "sustain" for _, kind, _, _ in messages)
    assert_library_plays(library, scene, messages, frames)
