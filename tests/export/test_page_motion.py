"""What a page draws: the bodies as they are, slowed, and where they are touched."""

import json
import math

import numpy as np
import pytest

import engine
from engine.export.motion import MOST_MODES, find_motion
from engine.export.row_recorder import player_of_scene
from tests.export.browser import SOUND_AT_ONCE, Browser
from tests.export.pages import WAIT_FOR_LEVEL, needs_browser, page_of

RATE = 44_100  # Hz
TIME_FRAMES = """(async () => {
  const spent = { draw: [], show: [] };
  const timed = (name, call) => (...given) => {
    const begin = performance.now();
    call(...given);
    spent[name].push(performance.now() - begin);
  };
  draw = timed("draw", draw);
  show = timed("show", show);
  await new Promise(done => setTimeout(done, 3000));
  return spent;
})()"""
TOLD_FRAMES = 2048  # between two reports of the audio side


def motion_at(browser, frames):
    """What the audio side of a page told last, of so many samples of the score."""
    return json.loads(browser.ask(f"window.fdh.render({frames}, '[]')"))["meter"]["motion"]


def heights_of(browser, state):
    """The heights of a body on a page as they are at the moment, m."""
    shown = f"{state['seconds'] * state['omega'][0] / math.tau!r} / SWINGS"
    script = f"(body => [...shapeOf(body, {json.dumps(state)}, {shown})])(data.motion.bodies[{state['body']}])"
    return np.array(browser.ask(script))


@pytest.mark.hard
@needs_browser
@pytest.mark.parametrize("name", ["marimba", "guitar_frets", "snare_wires", "piano_c4"])
def test_what_is_drawn_is_where_the_body_is(name, tmp_path):
    """Beside a rendering with its shapes, and of strings the part of their lowest modes: to 1 % of the largest height
    there is, as a page knows the first two digits of mode shapes."""
    page_of(name)[0].save(tmp_path / "page.html")
    shapes = engine.render(engine.load(name), seconds=4000 / RATE, trace_shapes=True).trace
    with Browser(tmp_path / "browser") as browser:
        browser.open(tmp_path / "page.html")
        browser.ask("started")
        compared = 0
        for state in motion_at(browser, TOLD_FRAMES)["bodies"]:
            body = browser.ask(f"data.motion.bodies[{state['body']}].name")
            every = shapes[f"shape.{body}"]
            times, places = shapes["shape_time"], shapes[f"shape_positions.{body}"]
            n = int(np.argmin(np.abs(times - state["seconds"])))
            assert times[n] == pytest.approx(state["seconds"], abs=0.01 / RATE)
            drawn = browser.ask(f"data.motion.shapes[data.motion.bodies[{state['body']}].shape].places")
            is_string = places.ndim == 1 and name != "marimba"
            whole = every[n] if not is_string else of_lowest_sines(every[n], places)
            expected = whole.reshape(-1)[[index_of(places, place) for place in drawn]]
            largest = np.nanmax(np.abs(every))
            assert np.abs(heights_of(browser, state) - expected).max() <= 0.01 * largest
            compared += largest > 0.0
        assert compared and browser.errors == []


@pytest.mark.slow
@needs_browser
@pytest.mark.parametrize("name", ["piano", "snare_wires", "bowed_violin"])
def test_a_frame_takes_little_time(name, tmp_path):
    """Half of all pictures, and of what is told between them, take less than 2 ms of script while the score plays: on a
    busy machine some are interrupted."""
    page_of(name)[0].save(tmp_path / "page.html")
    with Browser(tmp_path / "browser", options=(SOUND_AT_ONCE,)) as browser:
        browser.open(tmp_path / "page.html")
        browser.ask("started")
        browser.ask("play()")
        browser.ask(WAIT_FOR_LEVEL)
        spent = browser.ask(TIME_FRAMES)
        assert len(spent["draw"]) > 30 and len(spent["show"]) > 10
        assert np.median(spent["draw"]) < 2.0 and np.median(spent["show"]) < 2.0
        assert browser.errors == []


def of_lowest_sines(shape, places):
    """The part of a shape of a string between two pins that its lowest modes have."""
    sines = np.sin(math.pi * np.outer(np.arange(1, MOST_MODES + 1), places))
    return 2.0 / (len(places) - 1) * sines.T @ (sines @ shape)


def index_of(positions, place):
    """The number of a place among the positions of a trace."""
    flat = positions.reshape(-1, 2) if positions.ndim == 3 else positions
    off = np.abs(flat - place)
    return int(np.argmin(off.sum(axis=1) if off.ndim == 2 else off))


def test_strings_share_their_shapes_and_contacts_lie_on_bodies():
    motion = find_motion(player_of_scene(engine.load("violin"), RATE, "general").layout)
    strings = [body for body in motion.bodies if body.is_harmonic]
    assert len(strings) > 4 and len({body.shape for body in strings}) < len(strings)
    assert motion.touched and all(0.0 <= touched.place <= 1.0 for touched in motion.touched)
    assert all(len(body.modes) <= MOST_MODES and body.modes == sorted(body.modes) for body in strings)
