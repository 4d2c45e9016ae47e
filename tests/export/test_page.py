"""A page plays a patch with the samples of the engine, loads nothing from anywhere, and says plainly what it cannot."""

from html.parser import HTMLParser
from pathlib import Path

import numpy as np
import pytest

import engine
from bench.publish.playable import make_pages
from engine.api import page as page_module
from engine.api.page import level_of
from engine.cli.main import main
from engine.export.faults import CannotExport
from engine.export.page import compose
from engine.export.row_recorder import keys_of_player, player_of_keys, player_of_scene, sliders_of_player
from engine.files import SHIPPED_PATCHES, shipped_names
from engine.kernel.data.enums import EventKind
from engine.patch.tremolo import Tremolo
from tests.export.browser import (
    DISPLAY_SERVER,
    FIREFOX,
    SOUND_AT_ONCE,
    WEBKIT,
    WEBKIT_DRIVER,
    Browser,
    Firefox,
    WebKit,
)
from tests.export.pages import (
    PLAIN,
    SECONDS,
    WAIT_FOR_LEVEL,
    data_of,
    heard,
    needs_browser,
    needs_node,
    page_of,
    played_in_node,
)

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


@pytest.mark.hard
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


@pytest.mark.hard
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
    assert len(page.html) < 140_000  # 20 kB of them draw what moves
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
            key = "KeyZ" if name == "marimba_keys" else "Digit1"
            pressed = f"document.dispatchEvent(new KeyboardEvent('keydown', {{ code: '{key}', bubbles: true }}))"
            browser.ask(pressed.replace("document.dispatch", "document.body.dispatch"))
            browser.ask(WAIT_FOR_LEVEL)
            assert browser.ask("document.getElementById('fault').textContent") == ""
            assert browser.errors == []


@pytest.mark.slow
@needs_browser
def test_a_page_of_a_rendering_sounds_in_a_notebook(tmp_path):
    """There it is in a frame."""
    rendering = engine.render(engine.load("piano_c4"), seconds=0.1)
    (tmp_path / "notebook.html").write_text(rendering.page()._repr_html_(), "utf-8")
    with Browser(tmp_path / "browser", options=(SOUND_AT_ONCE,)) as browser:
        browser.open(tmp_path / "notebook.html")
        browser.ask("frames[0].fdh.render(128, '[]')")
        browser.ask("frames[0].document.querySelector('#play').click()")
        browser.ask(WAIT_FOR_LEVEL.replace("document", "frames[0].document"))
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


@pytest.mark.parametrize("name", ["bowed_violin", "bolt_on_a_string", "tanpura", "marble_on_a_bell"])
def test_a_slider_has_the_unit_that_params_and_data_sets_say(name):
    """N/m of a spring, N/m^exponent of a contact, kg/s, m, m/s. Heights that frets or a bridge give are no numbers of
    the patch, but move together while it sounds."""
    scene = engine.load(name)
    units = {f"contact.{contact.name}.barrier": "m" for contact in scene.contact}
    units |= {parameter.path: parameter.unit for parameter in scene.parameters()}
    sliders = sliders_of_player(player_of_scene(scene, 44_100, "general"))
    assert sliders
    assert {slider.path: slider.unit for slider in sliders} == {slider.path: units[slider.path] for slider in sliders}


@pytest.mark.hard
def test_a_key_of_a_page_moves_its_bow_the_faster_the_harder_it_is_pressed():
    keys = keys_of_player(player_of_keys(engine.load("violin"), 44_100, "general"))
    key = next(key for key in keys if key.name == "D4")
    speeds = [[row[6] for row in rows if row[0] == EventKind.FRICTION_VELOCITY] for rows in (key.on[0], key.on[-1])]
    assert speeds == [[pytest.approx(0.03 + 0.42 / 127)], [pytest.approx(0.45)]]
    assert [row[6] for row in key.off[0] if row[0] == EventKind.FRICTION_VELOCITY] == [0.0]


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
    assert not [a for _, a in tags.found if "src" in a or not a.get("href", "data:").startswith("data:")]
    assert [t for t, _ in tags.found if t in ("b", "i")] == []
    assert sum(tag == "script" for tag, _ in tags.found) == 3
    assert "alert(1)</script>" not in html
    assert "{{DATA}} &lt;i&gt;" in html
    policy = next(a["content"] for _, a in tags.found if a.get("http-equiv") == "Content-Security-Policy")
    assert policy.startswith("default-src 'none'; script-src 'sha256-")
    assert "unsafe-inline" not in policy
    assert "'unsafe-eval'" not in policy


@pytest.mark.hard_for("piano-1500")
@pytest.mark.parametrize(("name", "kilobytes"), [("piano_c4", 500), ("piano", 1500)])
def test_a_page_is_small(name, kilobytes):
    page, data = page_of(name)
    assert len(page.html.encode()) < 1000 * kilobytes
    assert data["samplerate"] == 44_100


def test_the_level_of_a_page_is_half_of_full_scale():
    scene = engine.load("repelled_oscillator").model_copy(update={"level": None})
    peak = np.abs(engine.render(scene, seconds=2.0).audio).max()
    assert level_of(scene, 44_100) == pytest.approx(0.5 / peak, rel=1e-6)


def test_what_cannot_become_a_page_is_said_before_anything_is_made(tmp_path, capsys, monkeypatch):
    scene = engine.load("barrier_linear")
    with pytest.raises(CannotExport, match="oversample"):
        engine.export_page(scene.model_copy(update={"accuracy": scene.accuracy.replace(oversample=2)}))
    with pytest.raises(CannotExport, match="tremolo"):
        engine.export_page(scene.model_copy(update={"tremolo": Tremolo(rate=5.0)}))
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
    for words in (["--slide", "body.mass.mas"], ["--voices", "2", "--slide", "body.mass.mass"]):
        assert main(["export", "barrier_linear", *words]) == 2
    assert list(tmp_path.iterdir()) == []


@pytest.mark.hard
def test_the_command_of_a_page_works_wherever_it_is_read(tmp_path, capsys, monkeypatch):
    """A shipped patch is there by its name alone, in whatever way it was given; one's own is a file."""
    commands = list[str]()

    def note_command(scene, samplerate, kernel, text, command, *more):
        commands.append(command)
        raise CannotExport("not now")

    monkeypatch.setattr(page_module, "export_page", note_command)
    monkeypatch.chdir(tmp_path)
    shipped = SHIPPED_PATCHES / "vibraphone.toml"
    own = Path("my vibraphone.toml")
    own.write_text(shipped.read_text("utf-8"), "utf-8")
    assert main(["export", "vibraphone"]) == 2
    assert main(["export", str(shipped), "-o", "a page.html"]) == 2
    monkeypatch.chdir(SHIPPED_PATCHES)
    assert main(["export", "vibraphone.toml"]) == 2
    monkeypatch.chdir(tmp_path)
    assert main(["export", str(own)]) == 2
    assert commands == [
        "fdh export vibraphone",
        "fdh export vibraphone -o 'a page.html'",
        "fdh export vibraphone",
        "fdh export 'my vibraphone.toml'",
    ]


def test_the_command_writes_a_page_that_says_how_it_was_made(tmp_path, capsys, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert main(["export", "barrier_linear", "--slide", "body.mass.mass"]) == 0
    page = Path("barrier_linear.html")
    html = page.read_text("utf-8")
    assert "fdh export barrier_linear --slide body.mass.mass" in html
    assert "[[contact]]" in html
    assert str(page) in capsys.readouterr().out
    page.unlink()
    page.mkdir()
    assert main(["export", "barrier_linear", "--json"]) == 1
    assert "barrier_linear.html" in capsys.readouterr().err
