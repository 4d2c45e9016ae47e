"""Films draw what pages draw, with the sound of the rendering."""

import importlib.util
import json
import math
import re
import subprocess

import numpy as np
import pytest

import engine
from engine.cli import option_checks
from engine.cli.main import main
from engine.export.film import FRAMES_PER_SECOND, FilmPicture, follow_motion, heights_of
from engine.patch.tremolo import Tremolo
from tests.export.browser import Browser
from tests.export.pages import needs_browser, page_of

RATE = 44_100  # Hz


def moments_of(name, seconds):
    motion, moments = follow_motion(engine.load(name), seconds, RATE)
    return motion, list(moments)


@pytest.mark.hard
@needs_browser
@pytest.mark.parametrize("name", ["snare_wires", "guitar_frets", "piano_c4"])
def test_a_film_has_the_shapes_of_a_page(name, tmp_path):
    """Of the same moments: drawn by the page's script, to its rounding, and turned to the same phase."""
    motion, moments = moments_of(name, 0.3)
    page_of(name)[0].save(tmp_path / "page.html")
    with Browser(tmp_path / "browser") as browser:
        browser.open(tmp_path / "page.html")
        browser.ask("started")
        compared = 0
        for moment in (moments[2], moments[-1]):
            for moving in moment.bodies:
                told = {key: getattr(moving, key).tolist() for key in ("q", "r", "omega")} | {"seconds": moving.seconds}
                body = f"data.motion.bodies[{moving.number}]"
                drawn = np.array(browser.ask(f"[...shapeOf({body}, {json.dumps(told)}, {moment.seconds!r})]"))
                heights = heights_of(motion, moving, moment.seconds)
                assert browser.ask(f"{body}.name") == motion.bodies[moving.number].name
                np.testing.assert_allclose(drawn, heights, rtol=0.0, atol=1e-9 * np.abs(heights).max())
                compared += np.abs(heights).max() > 0.0
        assert compared


def test_the_moments_of_a_film_are_those_of_the_rendering():
    """At their own time, a body is where the rendering has it; contacts are seen in the picture after they touched."""
    name, seconds = "marimba", 0.4
    motion, moments = moments_of(name, seconds)
    shapes = engine.render(engine.load(name), seconds=seconds, trace_shapes=True).trace
    assert len(moments) == math.ceil(seconds * FRAMES_PER_SECOND)
    compared = 0
    for moment in moments[1:]:
        for moving in moment.bodies:
            body, every = motion.bodies[moving.number], shapes[f"shape.{motion.bodies[moving.number].name}"]
            n = int(np.argmin(np.abs(shapes["shape_time"] - moving.seconds)))
            if abs(shapes["shape_time"][n] - moving.seconds) > 0.01 / RATE:
                continue
            as_it_is = heights_of(motion, moving, moving.seconds * moving.omega[0] / math.tau / 0.8)
            places = np.array(motion.shapes[body.shape].places)
            expected = np.interp(places, shapes[f"shape_positions.{body.name}"], every[n])
            assert np.abs(as_it_is - expected).max() <= 0.02 * np.abs(every).max()
            compared += np.abs(expected).max() > 0.0
    assert compared > 3
    assert any(moment.touched for moment in moments) and not all(moment.touched for moment in moments)


def test_a_contact_flashes_and_fades():
    motion, moments = moments_of("piano_c4", 0.6)
    picture = FilmPicture(motion, "Piano")
    touched = next(n for n, moment in enumerate(moments) if moment.touched)
    strengths = []
    for moment in moments:
        picture.draw(moment)
        (_, _, dots), *_ = picture._panels
        strengths.append(dots.get_facecolor()[:, 3].max() if len(dots.get_offsets()) else 0.0)
    assert strengths[touched] == pytest.approx(1.0)
    assert 0.0 < strengths[touched + 5] < 0.7
    assert strengths[-1] == 0.0


@pytest.mark.hard
def test_the_command_writes_a_film_with_its_sound(tmp_path, capsys, monkeypatch):
    ffmpeg = pytest.importorskip("imageio_ffmpeg").get_ffmpeg_exe()
    monkeypatch.chdir(tmp_path)
    assert main(["render", "snare_wires", "--seconds", "0.5", "--film", "--json"]) == 0
    assert (tmp_path / "snare_wires.wav").is_file()
    asked = subprocess.run([ffmpeg, "-i", "snare_wires.mp4"], capture_output=True, text=True)
    assert re.search(r"Duration: 00:00:00\.5\d", asked.stderr)
    assert re.search(r"Video: h264.*1280x720.* 30 fps", asked.stderr)
    assert re.search(r"Audio: aac.*stereo", asked.stderr)
    raw = ["-f", "f32le", "-ar", str(RATE), "-ac", "2", "-"]
    heard = subprocess.run(
        [ffmpeg, "-loglevel", "error", "-i", "snare_wires.mp4", *raw], capture_output=True, check=True
    )
    sound = np.frombuffer(heard.stdout, np.float32).reshape(-1, 2).astype(float)
    written = engine.render(engine.load("snare_wires"), seconds=0.5).audio
    count = min(len(sound), len(written))
    assert np.corrcoef(sound[:count, 0], written[:count, 0])[0, 1] > 0.9
    pictures = ["-f", "rawvideo", "-pix_fmt", "gray", "-"]
    seen = subprocess.run([ffmpeg, "-loglevel", "error", "-i", "snare_wires.mp4", *pictures], capture_output=True)
    frames = np.frombuffer(seen.stdout, np.uint8).reshape(-1, 720, 1280)
    assert len(frames) == 15
    assert (frames[0] != frames[10]).any()


def test_a_film_that_cannot_be_made_is_refused_in_a_line(tmp_path, capsys, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert main(["render", "bouncing_ball", "--film"]) == 2
    assert "a film shows strings, bars, heads and plates, and the patch has none" in capsys.readouterr().err
    assert main(["render", "piano_c4", "--film", "x.avi"]) == 2
    assert '"x.avi" is not the name of a film; end it in .mp4' in capsys.readouterr().err
    found = importlib.util.find_spec
    monkeypatch.setattr(option_checks, "find_spec", lambda name: None if name == "imageio_ffmpeg" else found(name))
    assert main(["render", "piano_c4", "--film"]) == 2
    said = capsys.readouterr().err
    assert 'needs FFmpeg and matplotlib; run pip install "fdh-engine[film]"' in said and said.count("\n") == 1
    assert list(tmp_path.iterdir()) == []


@pytest.mark.hard
@needs_browser
def test_a_notebook_shows_the_page_of_a_patch_and_what_moves(tmp_path):
    page = engine.load("piano_c4").show()
    (tmp_path / "notebook.html").write_text(page._repr_html_(), "utf-8")
    with Browser(tmp_path / "browser") as browser:
        browser.open(tmp_path / "notebook.html")
        browser.ask("frames[0].fdh.render(128, '[]')")
        shown = "(id => frames[0].getComputedStyle(frames[0].document.querySelector(id)).display)"
        assert browser.ask(f"['header', 'footer', 'details', '#motion', '#play'].map({shown})") == [
            *["none"] * 3,
            "grid",
            "block",
        ]
        assert browser.errors == []


def test_a_patch_that_cannot_become_a_page_is_shown_as_a_picture():
    tremolo = {"tremolo": Tremolo(rate=5.0)}
    assert engine.load("piano_c4").model_copy(update=tremolo).show()._repr_png_()[:4] == b"\x89PNG"
    with pytest.raises(ValueError, match="a patch with a tremolo cannot be exported"):
        engine.load("bouncing_ball").model_copy(update=tremolo).show()
