"""A page within another one: what its address asks for, messages from around it, and what it says of itself."""

import json

import pytest

from engine.cli.main import main
from engine.files import find_patch
from tests.export.browser import Browser
from tests.export.pages import needs_browser, page_of

SOUND_AT_ONCE = "--autoplay-policy=no-user-gesture-required"
DOWN = "[...down].map(key => key.number)"


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    found = tmp_path_factory.mktemp("site")
    for name in ("marimba_keys", "snare_wires"):
        page_of(name)[0].save(found / f"{name}.html")
    return found


@pytest.fixture(scope="module")
def browser(folder):
    with Browser(folder / "browser", options=(SOUND_AT_ONCE,)) as made:
        yield made


def tell(browser, **message):
    """Send a page a message, as the page around it does."""
    browser.ask(f"window.postMessage({json.dumps(message)}, '*'); new Promise(r => setTimeout(r, 50))")


@pytest.mark.hard
@needs_browser
def test_a_page_says_that_it_is_ready_and_refuses_what_it_cannot_do(folder, browser):
    orders = [
        {"fdh": "note_on", "key": 3},
        {"fdh": "note_on", "key": 60, "velocity": 200},
        {"fdh": "dance"},
        {"fdh": "constructor"},
        {"fdh": "set", "path": "x", "value": 1},
        {"fdh": "strike", "pad": "stick"},
        {"other": "message"},
        "word",
    ]
    (folder / "around.html").write_text(
        f"""<iframe id="page" src="marimba_keys.html?embed" allow="autoplay"></iframe><script>
        window.heard = [];
        addEventListener("message", ({{ data }}) => {{
          heard.push(data);
          const page = document.getElementById("page").contentWindow;
          if (data.fdh === "ready") for (const order of {json.dumps(orders)}) page.postMessage(order, "*");
        }});</script>""",
        "utf-8",
    )
    browser.open(folder / "around.html")
    browser.ask("new Promise(r => { const wait = () => heard.length > 6 ? r() : setTimeout(wait, 50); wait(); })")
    ready, *refused = browser.ask("heard")
    assert ready["fdh"] == "ready" and 60 in ready["keys"] and ready["pads"] == []
    assert [answer["fdh"] for answer in refused] == ["refused"] * 6
    words = " | ".join(answer["why"] for answer in refused)
    for told in (
        "no key 3",
        "velocity 200: from 1 to 127",
        "there is no dance",
        "no constructor",
        "no slider is called x",
    ):
        assert told in words


@pytest.mark.hard
@needs_browser
def test_messages_press_keys_as_fingers_do(folder, browser):
    browser.open(folder / "marimba_keys.html")
    browser.ask("started")
    tell(browser, fdh="note_on", key=60, velocity=33)
    assert browser.ask(DOWN) == [60] and browser.ask("velocities.get([...down][0])") == 33
    tell(browser, fdh="note_off", key=60)
    assert browser.ask(DOWN) == []
    tell(browser, fdh="play")
    assert browser.ask("isScore")
    tell(browser, fdh="stop")
    assert not browser.ask("isScore")


@pytest.mark.hard
@needs_browser
def test_messages_move_sliders_and_a_button_leads_back(folder, browser):
    browser.open(folder / "snare_wires.html")
    browser.ask("started")
    path, low, value = browser.ask("[data.sliders[0].path, data.sliders[0].low, data.sliders[0].value]")
    tell(browser, fdh="set", path=path, value=low)
    place = "sliders[0].placeOf(data.sliders[0].low)"
    assert browser.ask("sliders[0].place()") == pytest.approx(browser.ask(place)) and browser.ask("sliders[0].isMoved")
    browser.ask("document.querySelector('#sliders button').click()")
    assert browser.ask("sliders[0].place()") == pytest.approx(browser.ask("sliders[0].placeOf(data.sliders[0].value)"))
    assert browser.ask("document.querySelector('#sliders label').innerText").splitlines()[1] == path and value > low


@pytest.mark.hard
@needs_browser
def test_an_address_hides_what_is_around_the_instrument_and_sets_colours(folder, browser):
    browser.open(folder / "marimba_keys.html", "?embed&accent=rgb(200,0,0)&page=none;evil")
    browser.ask("started")
    hidden = "['header', 'footer', 'details'].map(x => getComputedStyle(document.querySelector(x)).display)"
    assert browser.ask(hidden) == ["none"] * 3
    colours = "['--accent', '--page'].map(x => document.documentElement.style.getPropertyValue(x))"
    assert browser.ask(colours) == ["rgb(200,0,0)", ""]
    assert browser.errors == []


def test_a_page_tells_its_policy_and_no_folder_of_its_maker(tmp_path, capsys):
    (tmp_path / "a b;c.toml").write_text(find_patch("repelled_oscillator").read_text("utf-8"), "utf-8")
    assert main(["export", str(tmp_path / "a b;c.toml"), "-o", str(tmp_path / "x y.html"), "--json"]) == 0
    policy = json.loads(capsys.readouterr().out)["policy"]
    html = (tmp_path / "x y.html").read_text("utf-8")
    assert policy.startswith("default-src 'none'; script-src 'sha256-") and "unsafe-inline" not in policy
    assert "fdh export &#x27;a b;c.toml&#x27; -o &#x27;x y.html&#x27;" in html and str(tmp_path) not in html
