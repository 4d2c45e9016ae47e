"""Sliders of a page: their names, and how they follow the score."""

import json

import pytest

import engine
from engine.export.lv2_text import description_of
from engine.export.plugin_data import PluginSettings, make_plugin_data
from tests.export.browser import SOUND_AT_ONCE, Browser
from tests.export.pages import needs_browser, page_of

CHANGES = {  # what a score may change, of contacts, springs and friction
    "piano_c4": {"contact.felt.stiffness": 9e9, "contact.felt.gap": 3e-4},
    "tanpura": {"contact.bridge.barrier": -2e-4, "contact.bridge.stiffness": 5e8},
    "bolt_on_a_string": {
        "connection.thread.stiffness": 1e5,
        "connection.thread.damping_coefficient": 0.002,
        "connection.thread.rest": 1e-3,
        "contact.head.stiffness": 2e8,
    },
    "bowed_violin": {"friction.bow.velocity": 0.2, "friction.bow.force": 0.8, "friction.bow.static": 0.7},
}
CHANGE_FRAME = 3000
REPORT_FRAMES = 2048  # between two reports of the audio side
WAIT_FOR_BOW = """(async () => {
  while (sliders[0].place() < 0.1) await new Promise(done => setTimeout(done, 20));
})()"""
PLACES = "Object.fromEntries(sliders.map(slider => [slider.path, slider.place()]))"


def page_with_changes(name, changes):
    document = engine.load(name).document
    document.pop("bow", None)
    if name == "bowed_violin":
        document["friction"] = [{"name": "bow", "body": "string", "at": 0.109, "velocity": 0.1, "force": 0.5}]
        document.pop("labels")
    time = CHANGE_FRAME / 44_100
    events = [{"kind": "change", "time": time, "parameter": path, "value": value} for path, value in changes.items()]
    return engine.export_page(engine.load(document | {"event": events}))


def follow(browser, frames):
    """Let the sliders of a page follow what its audio side reports last of so many samples; return their places."""
    values = json.loads(browser.ask(f"window.fdh.render({frames}, '[]')"))["meter"]["values"]
    browser.ask(f"followScore({json.dumps(values)})")
    return browser.ask(PLACES)


@pytest.mark.hard
@needs_browser
@pytest.mark.parametrize("name", CHANGES)
def test_sliders_follow_the_score(name, tmp_path):
    """To the values that the score sets, and no others move."""
    changes = CHANGES[name]
    page_with_changes(name, changes).save(tmp_path / "page.html")
    with Browser(tmp_path / "browser") as browser:
        browser.open(tmp_path / "page.html")
        browser.ask("started")
        home = browser.ask(PLACES)
        assert follow(browser, REPORT_FRAMES) == home
        places = follow(browser, 2 * REPORT_FRAMES)
        for path, place in places.items():
            sets = f"sliders.find(slider => slider.path === '{path}').placeOf({changes.get(path)!r})"
            expected = browser.ask(sets) if path in changes else home[path]
            assert place == pytest.approx(expected, rel=1e-6, abs=1e-9), path
        assert {path for path in places if places[path] != home[path]} == set(changes)
        assert browser.errors == []


@pytest.mark.hard
@needs_browser
def test_a_slider_in_use_is_left_alone_and_keeps_its_place_for_the_next_play(tmp_path):
    page_of("bowed_violin")[0].save(tmp_path / "page.html")
    with Browser(tmp_path / "browser", options=(SOUND_AT_ONCE,)) as browser:
        browser.open(tmp_path / "page.html")
        browser.ask("started")
        browser.ask("play()")
        browser.ask(WAIT_FOR_BOW)
        shown = browser.ask("document.querySelector('.slider output').textContent")
        assert shown.endswith("m/s") and not shown.startswith("0.00")
        browser.ask("sliders[0].move(-0.3); followScore(data.sliders.map(slider => slider.value))")
        assert browser.ask("sliders[0].place()") == -0.3
        rested = "sliders[0].movedAt = -Infinity; followScore(data.sliders.map(slider => slider.value))"
        assert browser.ask(f"{rested}; sliders[0].place()") == 0.0
        assert browser.ask("movedRows().map(row => row[6])") == [-0.3]
        assert browser.errors == []


@pytest.mark.hard
@needs_browser
def test_a_slider_has_the_name_that_the_patch_gives_and_then_its_path_and_unit(tmp_path):
    page_of("piano_c4")[0].save(tmp_path / "page.html")
    with Browser(tmp_path / "browser") as browser:
        browser.open(tmp_path / "page.html")
        browser.ask("started")
        row = "document.querySelector('.slider')"
        assert browser.ask(f"{row}.querySelector('label').innerText.split('\\n')") == [
            "hardness of the hammer's felt",
            "contact.felt.stiffness",
        ]
        assert browser.ask(f"{row}.querySelector('output').textContent") == "4.50e+9 N/mᵅ"
        names = {node["name"]["value"] for node in browser.roles() if node["role"]["value"] == "slider"}
        assert any(name.startswith("hardness of the hammer's felt") for name in names)


def test_names_of_parameters_are_those_of_ports_in_lv2():
    data = make_plugin_data(engine.load("piano_c4"), PluginSettings("piano_c4", lambda: 1.0, [44_100]))
    text = description_of("piano_c4", data)
    assert 'lv2:symbol "p1" ; lv2:name "hardness of the hammer\'s felt"' in text
