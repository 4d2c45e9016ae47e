"""The page of a render: what it holds, and that a browser shows and plays it."""

import base64
import contextlib
import http.server
import io
import json
import queue
import shutil
import subprocess
import threading
from html.parser import HTMLParser
from importlib.util import find_spec
from pathlib import Path

import numpy as np
import pytest
import soundfile
from conftest import ROOT, exit_code

import engine
from engine.cli import main, option_checks
from engine.report import console, html, plots

BALL = ROOT / "patches" / "bouncing_ball.toml"
OSCILLATOR = ROOT / "patches" / "repelled_oscillator.toml"
HOSTILE = "<script>alert('hé')</script> & \"<b>quoted</b>\""
STEREO = '\n[[pickup]]\nbody = "ball"\nchannel = 2\nquantity = "displacement"\n'
SILENT = '[[body]]\nname = "b"\nkind = "mass"\nmass = 1\n[[pickup]]\nbody = "b"\n'
BROWSER = next((path for name in ("chromium", "google-chrome") if (path := shutil.which(name))), None)
VOID = {"meta", "link", "img", "br"}


class Reader(HTMLParser):
    """The tags of a page, its text by the tag it stands in, and its tables."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.open, self.tags, self.text, self.rows = [], [], {}, []
        self.feed(text)
        self.close()
        assert not self.open, "not all is closed"

    def handle_starttag(self, tag, attrs):
        self.tags.append((tag, dict(attrs)))
        if tag not in VOID:
            self.open.append(tag)
        if tag == "tr":
            self.rows.append([])
        if tag in ("th", "td"):
            self.rows[-1].append("")

    def handle_endtag(self, tag):
        assert self.open.pop() == tag

    def handle_data(self, data):
        inmost = self.open[-1] if self.open else ""
        self.text[inmost] = self.text.get(inmost, "") + data
        if {"th", "td"} & set(self.open):
            self.rows[-1][-1] += data

    def all(self, name: str) -> list[dict[str, str]]:
        return [attributes for tag, attributes in self.tags if tag == name]


def rendered(folder: Path, name: str, text: str, *words: str, command: str = "render") -> dict:
    """What --json says of a patch rendered with a page."""
    patch = folder / f"{name}.toml"
    patch.write_text(text, "utf-8")
    said = io.StringIO()
    with contextlib.redirect_stdout(said):
        assert main.main([command, str(patch), "-o", str(folder / f"{name}.wav"), "--report", "--json", *words]) == 0
    return json.loads(said.getvalue())


@pytest.fixture(scope="module")
def pages(tmp_path_factory):
    """A folder of renders with their pages, and what --json says of each."""
    folder, ball = tmp_path_factory.mktemp("pages"), BALL.read_text("utf-8")
    titled = ball.replace('"Bouncing ball (paper, Fig. 5)"', f"'''{HOSTILE}'''")
    told = {
        "ball": rendered(folder, "ball", titled, "--seconds", "0.5"),
        "stereo": rendered(folder, "stereo", ball + STEREO, "--seconds", "4"),
        "silent": rendered(folder, "silent", SILENT, "--seconds", "0.01"),
        "priced": rendered(folder, "priced", OSCILLATOR.read_text("utf-8"), "--seconds", "0.02", command="accuracy"),
    }
    return folder, told


@pytest.mark.hard
def test_a_page_holds_all_it_shows(pages):
    folder, told = pages
    assert sorted(p.name for p in folder.iterdir() if p.suffix != ".toml") == sorted(
        f"{name}.{kind}" for name in told for kind in ("html", "wav")
    )
    for name in told:
        read = Reader((folder / f"{name}.html").read_text("utf-8"))
        assert all(tag["src"].startswith("data:image/png;base64,") and tag["alt"] for tag in read.all("img"))
        assert len(read.all("img")) == {"priced": 6, "silent": 4}.get(name, 5)
        (audio,) = read.all("audio")
        assert "controls" in audio and audio["src"].startswith("data:audio/")
        addresses = [v for _, tag in read.tags for k, v in tag.items() if k in ("src", "href", "srcset", "action")]
        assert all(address.startswith("data:") for address in addresses)
        assert not read.all("script") and "url(" not in read.text["style"] and "@import" not in read.text["style"]
        assert any(tag.get("name") == "viewport" for tag in read.all("meta"))
        assert read.text["code"].endswith((folder / f"{name}.toml").read_text("utf-8"))


@pytest.mark.hard
def test_a_title_is_text_whatever_it_holds(pages):
    read = Reader((pages[0] / "ball.html").read_text("utf-8"))
    assert read.text["h1"] == read.text["title"] == HOSTILE
    assert not read.all("b")


@pytest.mark.hard
def test_its_numbers_are_those_of_json(pages):
    folder, told = pages
    assert told
    for name, stats in told.items():
        read = Reader((folder / f"{name}.html").read_text("utf-8"))
        rows = {row[0]: row[1] for row in read.rows if len(row) == 2}
        flat = dict(html.flatten({key: value for key, value in stats.items() if key != "price"}))
        assert {"seconds", "real_time_factor", "newton.histogram", "newton.regimes.capped", "energy.error_max"} <= set(
            flat
        )
        assert {key: json.loads(rows[key]) for key in flat} == flat
        assert rows["Newton iterations"] == console.detailed_rows(stats)["Newton iterations"]
        for effect in stats["effects"]["compiled"]:
            assert rows[effect] == "enabled"
        assert rows["events"] == "disabled: there are no events"


@pytest.mark.hard
def test_it_says_what_made_it(pages):
    footer = (pages[0] / "ball.html").read_text("utf-8").partition("<footer>")[2]
    for word in ("Python 3.", f"numpy {np.__version__}", "numba ", "fdh-engine ", " cores", "20"):
        assert word in footer


@pytest.mark.hard
def test_the_price_of_accuracy_is_in_the_page(pages):
    folder, told = pages
    read = Reader((folder / "priced.html").read_text("utf-8"))
    shown = {row[0].removesuffix(" *").strip(): row[1] for row in read.rows if len(row) == 12}
    price = told["priced"]["price"]
    for row in price["rows"]:
        assert shown[row["setting"]] == f"{row['error']:.1e}"
    assert len(price["rows"]) > 3 and price["verdict"][1:] in read.text["p"]
    assert soundfile.info(folder / "priced.wav").frames == 882
    assert all("price" not in told[name] for name in ("ball", "stereo", "silent"))


@pytest.mark.parametrize(("seconds", "kind", "within"), [(1.0, "audio/flac", 1e-4), (4.0, "audio/ogg", 0.02)])
def test_the_sound_in_the_page_is_that_of_the_file(seconds, kind, within):
    time = np.arange(round(seconds * 44_100)) / 44_100
    sound = np.stack([0.8 * np.sin(2 * np.pi * 300 * time), 0.5 * np.sin(2 * np.pi * 500 * time)], 1)
    data, told = html.encode_for_browser(sound, 44_100)
    heard, rate = soundfile.read(io.BytesIO(data))
    assert (told, rate, heard.shape) == (kind, 44_100, sound.shape)
    assert np.abs(heard - sound)[2000:-2000].max() < within


def test_a_sound_above_full_scale_is_played_at_full_scale():
    sound = 100.0 * np.sin(2 * np.pi * 300 * np.arange(4410) / 44_100)[:, None]
    read = Reader("".join(html.audio_element("loud", sound, 44_100, "loud.wav")))
    data = base64.b64decode(read.all("audio")[0]["src"].partition(",")[2])
    np.testing.assert_allclose(soundfile.read(io.BytesIO(data))[0], sound[:, 0] / 100.0, atol=1e-4)
    assert "attenuated by 40 dB" in read.text["p"]


def test_many_channels_and_rates_become_what_browsers_play():
    tones = np.tile(np.sin(2 * np.pi * 300 * np.arange(9600) / 96_000)[:, None], (1, 5)) * [0.5, 0, 0.5, 0, 0.5]
    heard, rate = soundfile.read(io.BytesIO(html.encode_for_browser(tones, 96_000)[0]))
    assert (rate, heard.shape) == (48_000, (4800, 2))
    assert np.abs(heard[:, 0]).max() == pytest.approx(0.5, abs=0.01) and not heard[:, 1].any()
    assert soundfile.read(io.BytesIO(html.encode_for_browser(tones[:1], 4000)[0]))[0].shape == (12, 2)


@pytest.mark.hard
def test_a_picture_of_an_oversampled_render_keeps_its_time():
    """The ball lands at √(2·0.2/9.81) = 0.2019 s, and nowhere else in 0.3 s."""
    from matplotlib.figure import Figure

    from engine.report.contact_shading import ContactShading

    rendering = engine.render(engine.load(BALL), seconds=0.3, oversample=2, trace=True)
    axes = Figure().subplots()
    plots.plot_iterations(axes, rendering)
    assert axes.get_xlim() == (0.0, pytest.approx(0.3))
    (shading,) = [drawn for drawn in axes.collections if isinstance(drawn, ContactShading)]
    [(begin, _)] = shading.intervals
    assert begin == pytest.approx(0.2019, abs=1e-3)


@pytest.mark.parametrize(
    ("words", "says"),
    [
        (["render", "--report", "page.txt"], '--report: "page.txt" is not the name of a page; end it in .html'),
        (["render", "--report", "no/page.html"], "--report: no such folder: no"),
        (["inspect", "--report"], "unrecognized arguments: --report; --report belongs to fdh render, fdh accuracy"),
        (["play", "--report"], "unrecognized arguments: --report; --report belongs to fdh render, fdh accuracy"),
        (["render", "--report", "--midi", "a.mid"], "--report: cannot be combined with --midi"),
        (["render", "--report", "a.html", "--trace", "a.html"], "--report: a.html would be written twice"),
    ],
)
def test_faults(tmp_path, words, says, capsys, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert exit_code(words[0], str(BALL), *words[1:]) == 2
    assert says in capsys.readouterr().err
    assert not list(tmp_path.iterdir())


def test_other_faults(tmp_path, capsys, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert exit_code("replay", "log.json", "--report") == 2
    assert "unrecognized arguments: --report; --report belongs to" in capsys.readouterr().err
    monkeypatch.setattr(option_checks, "find_spec", lambda name: None if name == "matplotlib" else find_spec(name))
    assert main.main([str(BALL), "--report"]) == 2
    assert "--report: needs matplotlib; run uv sync --extra plot" in capsys.readouterr().err
    assert not list(tmp_path.iterdir())


def test_a_page_that_cannot_be_made_leaves_nothing(tmp_path, capsys, monkeypatch):
    """It is made before the sound is written."""

    def fail(*_):
        raise MemoryError

    monkeypatch.setattr(html, "compose_page", fail)
    assert main.main([str(BALL), "-o", str(tmp_path / "a.wav"), "--seconds", "0.1", "--report"]) == 1
    assert "not enough memory" in capsys.readouterr().err
    assert not list(tmp_path.iterdir())


LOOK = """<!doctype html><link rel="icon" href="data:,"><body><script>
async function look(name, width) {
  const frame = document.createElement("iframe");
  frame.style.cssText = `border: 0; width: ${width}px; height: 844px`;
  frame.src = name;
  await new Promise(done => { frame.onload = done; document.body.append(frame); });
  const inside = frame.contentDocument, audio = inside.querySelector("audio");
  while (audio.readyState < 1 && !audio.error) await new Promise(done => setTimeout(done, 20));
  return {name, width, seconds: audio.duration, failed: audio.error && audio.error.message,
    images: [...inside.images].map(image => image.naturalWidth), across: inside.documentElement.scrollWidth};
}
(async () => {
  const found = [];
  for (const name of NAMES) for (const width of [390, 1200]) found.push(await look(name, width));
  await fetch("found", {method: "POST", body: JSON.stringify(found)});
})();
</script>"""


@pytest.mark.skipif(BROWSER is None, reason="neither chromium nor google-chrome is in PATH")
@pytest.mark.hard
def test_a_browser_shows_and_plays_it(pages, tmp_path):
    """On a phone and on a desk: the player knows how long the sound is, pictures are there, nothing is wider than
    the window, nothing is complained of, and nothing else is asked of the network."""
    folder, told = pages
    names, asked, answers = [f"{name}.html" for name in told], [], queue.Queue()

    class Server(http.server.SimpleHTTPRequestHandler):
        def do_GET(self):
            asked.append(self.path)
            body = LOOK.replace("NAMES", json.dumps(names)).encode()
            if self.path[1:] in names:
                body = (folder / self.path[1:]).read_bytes()
            self.send_response(200)
            self.send_header("Content-Type", "text/html; charset=utf-8")
            self.end_headers()
            self.wfile.write(body)

        def do_POST(self):
            answers.put(self.rfile.read(int(self.headers["Content-Length"])))
            self.send_response(204)
            self.end_headers()

        def log_message(self, *_):
            pass

    with http.server.ThreadingHTTPServer(("127.0.0.1", 0), Server) as server, open(tmp_path / "said", "wb") as said:
        threading.Thread(target=server.serve_forever, daemon=True).start()
        words = [BROWSER, "--headless", "--no-sandbox", "--disable-gpu", "--hide-scrollbars", "--disable-dev-shm-usage"]
        words += [f"--user-data-dir={tmp_path / 'profile'}", "--enable-logging=stderr", "--no-first-run"]
        browser = subprocess.Popen([*words, f"http://127.0.0.1:{server.server_port}/"], stderr=said)
        try:
            found = json.loads(answers.get(timeout=60))
        finally:
            browser.terminate()
            browser.wait(timeout=20)
            server.shutdown()
    assert [(row["name"], row["width"]) for row in found] == [(name, width) for name in names for width in (390, 1200)]
    for row in found:
        assert row["failed"] is None
        assert row["seconds"] == pytest.approx(told[row["name"][:-5]]["seconds"], abs=0.01)
        assert row["images"] and min(row["images"]) > 0
        assert row["across"] <= row["width"]
    assert set(asked) == {"/", *(f"/{name}" for name in names)}
    complaints = [line for line in (tmp_path / "said").read_text("utf-8", "replace").splitlines() if "CONSOLE" in line]
    assert not complaints


@pytest.mark.hard
def test_encoded_sound_is_what_the_page_plays(pages):
    """Bit for bit, but for 16 bits."""
    folder, _ = pages
    (audio,) = Reader((folder / "ball.html").read_text("utf-8")).all("audio")
    heard, rate = soundfile.read(io.BytesIO(base64.b64decode(audio["src"].partition(",")[2])))
    file, own = soundfile.read(folder / "ball.wav")
    assert rate == own
    assert np.abs(heard - file).max() <= 2**-15
