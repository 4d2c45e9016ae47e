"""A page plays a patch with the samples of the engine, loads nothing from anywhere, and says plainly what it cannot."""

import base64
import json
import math
import re
import shutil
import subprocess
from html.parser import HTMLParser
from pathlib import Path

import numpy as np
import pytest

import engine
from bench.publish.playable import make_pages
from engine.api.page import level_of
from engine.cli.main import main
from engine.export.faults import CannotExport
from engine.export.page import compose
from engine.export.row_recorder import keys_of_player, player_of_keys, player_of_scene, sliders_of_player
from engine.files import shipped_names
from engine.kernel.data.enums import EventKind
from engine.live.key_allocator import KeyAllocator, live_scene
from engine.live.midi_notes import PEDALS, Note
from engine.live.player import Player
from engine.live.shared_memory import Slot
from tests.export.browser import (
    CHROMIUM,
    DISPLAY_SERVER,
    FIREFOX,
    SOUND_AT_ONCE,
    WEBKIT,
    WEBKIT_DRIVER,
    Browser,
    Firefox,
    WebKit,
)
from tests.export.tuned_scene import STOPPED_STRING, tuned_as_it_sounds

SECONDS = 0.5
PATCHES = [  # contacts with and without loss, bridges, connections, several islands, forces, events
    "repelled_oscillator",
    "lossy_bounce",
    "bouncing_ball",
    "piano_c4",
    "grand_c4",
    "tanpura",
    "guitar_frets",
    "snare_wires",
    "marimba",
    "kalimba",
    "rattle",
    "ball_on_drum",
    "guitar_body",
    "sympathetic_strings",
    "bowed_violin",
]
SENSITIVE = "snare_wires", "guitar_frets", "rattle", "bowed_violin"  # contacts and friction that amplify last bits
INSTRUMENTS = ["vibraphone", "toms", "piano", "violin"]
NODE = shutil.which("node")
PLAIN = "#plain"  # at the end of a page's address: multiply-adds in two steps, as in browsers without fused ones
WAIT_FOR_LEVEL = """(async () => {
  while (!document.getElementById("level").textContent.includes("dB")) await new Promise(r => setTimeout(r, 20));
})()"""
needs_node = pytest.mark.skipif(NODE is None, reason="no Node; Debian's package is called nodejs")
needs_browser = pytest.mark.skipif(CHROMIUM is None, reason="no Chromium; Debian's package is called chromium")


def page_of(name, **options):
    """Return the page of a shipped patch, and its data."""
    page = engine.export_page(engine.load(name), **options)
    return page, data_of(page.html)


def data_of(html):
    return json.loads(re.search(r'id="data">(.*?)</script>', html, re.S)[1])


def heard(browser, frames, messages):
    """Return what the open page plays, [frames, channels], and its last meter. messages: to its audio side, JSON"""
    answer = json.loads(browser.render(frames, messages))
    return sound_of(answer), answer["meter"]


def sound_of(answer):
    return np.stack([np.frombuffer(base64.b64decode(text), np.float32) for text in answer["channels"]], axis=1)


def played_in_node(page, frames):
    """Return what Node plays of a page without fused multiply-adds, and its last meter."""
    command = [NODE, Path(__file__).with_name("play_page.cjs"), page, str(frames), "[]", PLAIN]
    answer = json.loads(subprocess.run(command, capture_output=True, text=True, check=True).stdout)
    assert not answer["isFused"]  # and the page says so
    return sound_of(answer), answer["meter"]


@pytest.mark.slow
@needs_browser
@pytest.mark.parametrize("name", PATCHES)
def test_a_page_has_the_samples_of_the_engine(name, tmp_path):
    """All single-precision samples are those of `engine.render`, brought to the level of the page."""
    page, data = page_of(name)
    page.save(tmp_path / "page.html")
    frames = round(SECONDS * 44_100)
    rendered = engine.render(engine.load(name), seconds=SECONDS, cores=1).audio
    with Browser(tmp_path / "browser") as browser:
        browser.open(tmp_path / "page.html")
        audio, meter = heard(browser, frames, "[]")
        assert browser.errors == []
        assert [url for url in browser.requests if not url.startswith(("file:", "data:"))] == []
    np.testing.assert_array_equal(audio, (rendered * data["gain"]).astype(np.float32))
    assert np.abs(audio).max() > 0.01
    assert 0.0 < meter["error"] < 1e-11


@needs_node
@pytest.mark.parametrize(("name", "order"), [("piano_c4", 2), ("sympathetic_strings", 2), ("bouncing_ball", 4)])
def test_without_fused_multiply_add_the_samples_of_a_page_differ_in_their_last_bits(name, order, tmp_path):
    """What its meter says of the level shows it in double precision: of the last 2048 samples that it has heard."""
    scene = engine.load(name)
    scene = scene.model_copy(update={"accuracy": scene.accuracy.replace(order=order)})
    page = engine.export_page(scene)
    page.save(tmp_path / "page.html")
    audio = engine.render(scene, seconds=SECONDS, cores=1).audio * data_of(page.html)["gain"]
    played, meter = played_in_node(tmp_path / "page.html", len(audio))
    np.testing.assert_allclose(played, audio, rtol=0.0, atol=1e-7 * np.abs(audio).max())
    end = len(audio) // 2048 * 2048
    assert meter["level"] == pytest.approx(np.abs(audio[end - 2048 : end]).max(), rel=1e-12)
    assert 0.0 < meter["error"] < 1e-12


@needs_node
@pytest.mark.parametrize("name", ["snare_wires", "bowed_violin"])
def test_without_fused_multiply_add_contacts_and_friction_keep_their_energy(name, tmp_path):
    """Many contacts, and friction, amplify last bits to another sound, as good as that of the engine."""
    page, data = page_of(name)
    page.save(tmp_path / "page.html")
    audio = engine.render(engine.load(name), seconds=SECONDS, cores=1).audio * data["gain"]
    played, meter = played_in_node(tmp_path / "page.html", len(audio))
    assert np.isfinite(played).all()
    assert np.square(played).mean() == pytest.approx(np.square(audio).mean(), rel=0.1)
    assert 0.0 < meter["error"] < 1e-12


@pytest.mark.slow
@needs_node
def test_a_page_with_a_kernel_of_its_own_has_the_samples_of_the_engine(tmp_path, monkeypatch):
    """Also where the engine compiles its own kernel for the first time just before."""
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    name = "barrier_quadratic"
    page, data = page_of(name, kernel="special")
    page.save(tmp_path / "page.html")
    assert len(page.html) < 100_000
    audio = engine.render(engine.load(name), seconds=SECONDS, cores=1).audio * data["gain"]
    played, meter = played_in_node(tmp_path / "page.html", len(audio))
    np.testing.assert_allclose(played, audio, rtol=0.0, atol=1e-7 * np.abs(audio).max())
    assert meter["error"] < 1e-12


@pytest.mark.slow
@pytest.mark.skipif(FIREFOX is None, reason="no Firefox; Debian's package is called firefox-esr")
def test_firefox_plays_the_same_samples(tmp_path):
    with Firefox(tmp_path / "browser") as browser:
        for name in PATCHES:
            page, data = page_of(name)
            page.save(tmp_path / "page.html")
            rendered = engine.render(engine.load(name), seconds=SECONDS, cores=1).audio
            browser.open(tmp_path / "page.html")
            audio, meter = heard(browser, len(rendered), "[]")
            np.testing.assert_array_equal(audio, (rendered * data["gain"]).astype(np.float32), err_msg=name)
            assert 0.0 < meter["error"] < 1e-11


@pytest.mark.slow
@pytest.mark.skipif(
    not (WEBKIT and WEBKIT_DRIVER and DISPLAY_SERVER),
    reason="no WebKit; Debian's packages are called webkit2gtk-driver, gstreamer1.0-plugins-good and xvfb",
)
def test_webkit_plays_a_page_without_fused_multiply_add(tmp_path):
    """It says so, sounds as the engine does, and a click starts it."""
    said = "document.getElementById('unfused').hidden ? '' : document.getElementById('unfused').textContent"
    with WebKit() as browser:
        for name in PATCHES:
            page, data = page_of(name)
            page.save(tmp_path / "page.html")
            audio = engine.render(engine.load(name), seconds=SECONDS, cores=1).audio * data["gain"]
            browser.open(tmp_path / "page.html")
            played, meter = heard(browser, len(audio), "[]")
            assert np.isfinite(played).all(), name
            if name not in SENSITIVE:
                atol = 1e-7 * np.abs(audio).max()
                np.testing.assert_allclose(played, audio, rtol=0.0, atol=atol, err_msg=name)
            assert 0.0 < meter["error"] < 1e-12, name
            assert "multiplies and adds in two steps" in browser.ask(said)
        browser.click("#play")
        browser.ask(WAIT_FOR_LEVEL)
        assert browser.ask("document.getElementById('fault').textContent") == ""


@pytest.mark.slow
@needs_browser
def test_a_page_says_when_it_does_not_fuse_multiply_adds(tmp_path):
    """Chromium can be told not to, by the address of the page."""
    page_of("repelled_oscillator")[0].save(tmp_path / "page.html")
    for address, is_fused in (("", True), (PLAIN, False)):
        with Browser(tmp_path / f"browser{address}") as browser:
            browser.open(tmp_path / "page.html", address)
            audio, meter = heard(browser, 4096, "[]")
            assert browser.ask("document.getElementById('unfused').hidden") == is_fused
            assert np.abs(audio).max() > 0.01
            assert meter["error"] < 1e-12


def midi_of(kind, number, value):
    """Return a message of MIDI as its bytes."""
    if kind in ("on", "off"):
        return [0x90 if kind == "on" else 0x80, number, value]
    if kind == "bend":
        return [0xE0, *reversed(divmod(8192 + round(8192 * value / 200.0), 128))]
    return [0xB0, next(controller for controller, pedal in PEDALS.items() if pedal == kind), value]


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
        (8192, "on", c, 112),
        (10240, "off", c, 64),
        (12288, "sostenuto", 0, 63),
        (16384, "sustain", 0, 0),
    ]


def live_sound(scene, gain, messages, frames):
    """Return what live sound plays of an instrument, [frames, channels], if messages come at these frames."""
    player = Player(live_scene(scene), 44_100, math.inf, gain, waiting=True, kernel="general")
    player.counters[Slot.FADE_IN_FRAMES] = 0
    allocator, audio = KeyAllocator(player), np.zeros((frames, player.channels), np.float32)
    for begin in range(0, frames, 128):
        for frame, *message in messages(allocator.keys):
            if frame == begin:
                allocator.play(Note(0.0, *message))
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
    + [(STOPPED_STRING, notes_of_a_stopped_string, {})],
)
def test_the_keys_of_a_page_do_what_those_of_live_sound_do(name, messages, options, tmp_path):
    """With all three pedals, the sustain pedal half down, with the pitch wheel, and where keys change the pitch of a
    string, by the same messages of MIDI."""
    page, data = page_of(name, **options)
    page.save(tmp_path / "page.html")
    frames = round(SECONDS * 44_100) // 128 * 128
    expected = live_sound(engine.load(name), data["gain"], messages, frames)
    with Browser(tmp_path / "browser") as browser:
        browser.open(tmp_path / "page.html")
        browser.ask("started")
        keys = browser.ask("fdh.data.keys.map(key => key.number)")
        heard_midi = [[frame, midi_of(*message)] for frame, *message in messages(keys)]
        sent = """(() => {
          const sent = [];
          let now = 0;
          window.send = message => sent.push({ ...message, at: now });
          for (const [frame, data] of MESSAGES) {
            now = frame;
            hear({ data });
          }
          return sent;
        })()""".replace("MESSAGES", json.dumps(heard_midi))
        audio, meter = heard(browser, frames, browser.ask(f"JSON.stringify({sent})"))
        assert browser.errors == []
    np.testing.assert_array_equal(audio, expected)
    assert np.abs(audio).max() > 0.001
    assert meter["error"] < 1e-11


@pytest.mark.slow
@needs_browser
def test_a_page_is_played_by_mouse_and_by_keyboard(tmp_path):
    """Pads and keys sound, at both widths, and no text is wider than the page."""
    for name in ("piano_c4", "marimba_keys"):
        page_of(name)[0].save(tmp_path / f"{name}.html")
        with Browser(tmp_path / name, options=(SOUND_AT_ONCE,)) as browser:
            browser.open(tmp_path / f"{name}.html")
            browser.ask("started")
            for width, is_dark in ((1200, False), (390, True)):
                browser.emulate(width, 900, is_dark)
                assert browser.ask("document.documentElement.scrollWidth <= innerWidth")
                assert browser.picture()[:4] == b"\x89PNG"
            key = "z" if name == "marimba_keys" else "1"
            pressed = f"document.dispatchEvent(new KeyboardEvent('keydown', {{ key: '{key}', bubbles: true }}))"
            browser.ask(pressed.replace("document.dispatch", "document.body.dispatch"))
            browser.ask(WAIT_FOR_LEVEL)
            assert browser.ask("document.getElementById('fault').textContent") == ""
            assert browser.errors == []


@pytest.mark.slow
@needs_browser
def test_a_page_on_a_phone_sounds_at_the_first_touch(tmp_path):
    """Of a pad, though phones let no sound begin until the finger leaves the screen."""
    page_of("piano_c4")[0].save(tmp_path / "page.html")
    with Browser(tmp_path / "browser") as browser:
        browser.emulate(390, 900)
        browser.open(tmp_path / "page.html")
        browser.ask("started")
        browser.touch(".pad")
        browser.ask(WAIT_FOR_LEVEL)
        assert browser.errors == []


@pytest.mark.slow
@needs_browser
def test_every_shipped_patch_has_a_page_that_sounds(tmp_path):
    """The site of all patches, each page opened and struck or played."""
    names = make_pages(tmp_path)
    assert names == shipped_names()
    with Browser(tmp_path / "browser") as browser:
        for name in names:
            browser.open(tmp_path / f"{name}.html")
            struck = "fdh.data.keys.length ? fdh.data.keys[0].on[8] : fdh.data.pads.flatMap(pad => pad.rows)"
            browser.ask("started")
            audio, meter = heard(browser, 44_100, browser.ask(f"JSON.stringify([{{ rows: {struck} }}])"))
            assert np.isfinite(audio).all(), name
            assert np.abs(audio).max() > 1e-4, name
            assert meter["error"] < 1e-10, name
            assert browser.errors == [], name


def test_a_page_has_sliders_for_the_speed_and_the_force_of_a_bow():
    """They go both ways from rest, and no further than live sound lets them."""
    player = player_of_scene(engine.load("bowed_violin"), 44_100, "general")
    sliders = {slider.path: slider for slider in sliders_of_player(player)}
    speed, force, static = (sliders[f"friction.bow.{key}"] for key in ("velocity", "force", "static"))
    assert (speed.low, speed.high, speed.unit) == (-0.5, 0.5, "m/s")
    assert (force.low, force.high, force.unit) == (0.0, 1.0, "N")
    assert static.high == 10.0


def test_a_key_of_a_page_moves_its_bow_the_faster_the_harder_it_is_pressed():
    keys = keys_of_player(player_of_keys(engine.load("violin"), 44_100, "general"))
    key = next(key for key in keys if key.name == "D4")
    speeds = [[row[6] for row in rows if row[0] == EventKind.FRICTION_VELOCITY] for rows in (key.on[0], key.on[-1])]
    assert speeds == [[pytest.approx(0.12 + 0.4 / 127)], [pytest.approx(0.52)]]
    assert [row[6] for row in key.off if row[0] == EventKind.FRICTION_VELOCITY] == [0.0]


class Tags(HTMLParser):
    """The elements of a page, with their attributes."""

    def __init__(self, html):
        super().__init__()
        self.found = []
        self.feed(html)

    def handle_starttag(self, tag, attributes):
        self.found.append((tag, dict(attributes)))


def test_a_page_loads_nothing_and_runs_its_own_scripts_alone():
    html = compose(
        {"a": "</script><script>alert(1)</script>"}, {"title": "<b>&", "text": "{{DATA}} <i>", "command": "x"}
    )
    tags = Tags(html)
    assert not [a for _, a in tags.found if "src" in a or "href" in a]
    assert [t for t, _ in tags.found if t in ("b", "i")] == []
    assert sum(tag == "script" for tag, _ in tags.found) == 3
    assert "alert(1)</script>" not in html
    assert "{{DATA}} &lt;i&gt;" in html
    policy = next(a["content"] for _, a in tags.found if a.get("http-equiv") == "Content-Security-Policy")
    assert policy.startswith("default-src 'none'; script-src 'sha256-")
    assert "unsafe-inline" not in policy
    assert "'unsafe-eval'" not in policy


@pytest.mark.parametrize(("name", "kilobytes"), [("piano_c4", 500), ("piano", 1500)])
def test_a_page_is_small(name, kilobytes):
    page, data = page_of(name)
    assert len(page.html.encode()) < 1000 * kilobytes
    assert data["samplerate"] == 44_100


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


def test_keys_that_change_two_numbers_of_the_same_tables_or_glide_are_refused():
    for change, message in (
        ({"parameter": "body.string.sigma0", "value": 4.0}, "another number of the same tables"),
        ({"parameter": "body.string.frequency", "value": 4.0, "duration": 0.1}, "a key glides body.string.frequency"),
    ):
        on = [*STOPPED_STRING["key"]["on"], {"kind": "change", **change}]
        document = STOPPED_STRING | {"key": STOPPED_STRING["key"] | {"on": on}}
        with pytest.raises(CannotExport, match=message):
            page_of(document)


def test_the_level_of_a_page_is_half_of_full_scale():
    scene = engine.load("repelled_oscillator").model_copy(update={"level": None})
    peak = np.abs(engine.render(scene, seconds=2.0).audio).max()
    assert level_of(scene, 44_100) == pytest.approx(0.5 / peak, rel=1e-6)


def test_what_cannot_become_a_page_is_said_before_anything_is_made(tmp_path, capsys, monkeypatch):
    scene = engine.load("barrier_linear")
    with pytest.raises(CannotExport, match="oversample"):
        engine.export_page(scene.model_copy(update={"accuracy": scene.accuracy.replace(oversample=2)}))
    with pytest.raises(ValueError, match="no kernel of a page is called 'fast'; there are general and special"):
        engine.export_page(scene, kernel="fast")
    monkeypatch.chdir(tmp_path)
    assert main(["export", "barrier_linear", "-o", "none/page.txt", "--kernel", "fast", "--seconds", "1"]) == 2
    said = capsys.readouterr().err
    for words in (
        "a page is an .html file",
        "the folder is not there",
        "no kernel is called 'fast'",
        "a page takes none",
    ):
        assert words in said
    assert list(tmp_path.iterdir()) == []


def test_the_command_writes_a_page_that_says_how_it_was_made(tmp_path, capsys, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert main(["export", "barrier_linear", "--slide", "body.mass.mass"]) == 0
    page = Path("barrier_linear.html")
    html = page.read_text("utf-8")
    assert "fdh export barrier_linear.toml --slide body.mass.mass" in html
    assert "[[contact]]" in html
    assert str(page) in capsys.readouterr().out
    page.unlink()
    page.mkdir()
    assert main(["export", "barrier_linear", "--json"]) == 1
    assert "barrier_linear.html" in capsys.readouterr().err


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
@pytest.mark.parametrize("name", SLID)
def test_sliders_of_a_page_exchange_the_tables_that_live_sound_would(name, tmp_path):
    """Pitch, tension, length and loss, with the samples of live sound. Of sliders whose tables are the same ones, one
    at a time is away from the patch's value."""
    scene, frames = engine.load(name), round(SECONDS * 44_100) // 128 * 128
    page, data = page_of(name, slide=SLID[name])
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
    player = Player(scene, 44_100, math.inf, data["gain"], kernel="general")
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
