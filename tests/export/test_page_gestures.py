"""Gestures on a page in a real browser: no note sticks, every key can be reached, and Stop stops."""

import pytest

from tests.export.browser import Browser
from tests.export.pages import WAIT_FOR_LEVEL, needs_browser, page_of

SOUND_AT_ONCE = "--autoplay-policy=no-user-gesture-required"
DOWN = "[...down].map(key => key.number)"
MIDI = """(() => {
  const input = { id: "in", onmidimessage: null };
  const access = { inputs: new Map([["in", input]]), onstatechange: null };
  navigator.requestMIDIAccess = async () => access;
  window.cable = { input, access };
  return useMidi();
})()"""
PULL = """(() => {
  cable.access.inputs.clear();
  cable.access.onstatechange({ port: { id: "in", type: "input", state: "disconnected" } });
})()"""


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    return tmp_path_factory.mktemp("pages")


@pytest.fixture(scope="module")
def marimba(folder):
    """A browser with the page of an instrument."""
    page_of("marimba_keys")[0].save(folder / "marimba.html")
    with Browser(folder / "browser", options=(SOUND_AT_ONCE,)) as browser:
        yield browser


@pytest.fixture
def page(marimba, folder):
    """The page, as it is loaded."""
    marimba.open(folder / "marimba.html")
    marimba.ask("started")
    yield marimba
    assert marimba.errors == []


def place_of(browser, selector):
    """The middle of an element, near its lower end."""
    box = browser.ask(
        f"(({{ x, y, width, height }}) => [x + width / 2, y + 0.9 * height])("
        f"document.querySelector({selector!r}).getBoundingClientRect())"
    )
    return tuple(box)


def key_of(name):
    return f".keys button[aria-label='{name}']"


# --- no note sticks


@pytest.mark.hard
@needs_browser
def test_a_key_ends_with_the_key_of_the_computer_that_pressed_it(page):
    """Whatever is pressed, clicked or focused meanwhile: a modifier, Shift, which is the pedal, a slider, Tab."""
    page.key("keyDown", "KeyZ", "z")
    assert len(page.ask(DOWN)) == 1
    page.key("keyDown", "ControlLeft", "Control", 2)
    page.key("keyUp", "KeyZ", "z", 2)
    page.key("keyUp", "ControlLeft", "Control")
    assert page.ask(DOWN) == []
    page.key("keyDown", "Digit2", "2")
    page.key("keyDown", "ShiftLeft", "Shift", 8)
    assert len(page.ask(DOWN)) == 1
    page.key("keyUp", "Digit2", "@", 8)
    page.key("keyUp", "ShiftLeft", "Shift")
    assert page.ask(DOWN) == []
    page.key("keyDown", "KeyZ", "z")
    page.ask("document.getElementById('gain').focus()")
    page.key("keyUp", "KeyZ", "z")
    assert page.ask(DOWN) == []
    page.key("keyDown", "KeyX", "x")  # and a slider in focus does not keep the keys from playing
    assert len(page.ask(DOWN)) == 1
    page.key("keyUp", "KeyX", "x")
    page.ask(f'document.querySelector("{key_of("F3")}").focus()')
    page.key("keyDown", "Space", " ")
    assert page.ask(DOWN) == [53]
    page.ask("document.getElementById('play').focus()")
    page.key("keyUp", "Space", " ")
    assert page.ask(DOWN) == []


@pytest.mark.hard
@needs_browser
def test_keys_are_let_go_where_the_window_loses_focus(page):
    page.key("keyDown", "ShiftLeft", "Shift", 8)
    page.key("keyDown", "KeyZ", "Z", 8)
    assert len(page.ask(DOWN)) == 1
    page.ask("window.dispatchEvent(new Event('blur'))")
    assert page.ask(DOWN) == [] and page.ask("pedals.sustain") == 0


@pytest.mark.hard
@needs_browser
@pytest.mark.parametrize(("end", "rest"), [("PULL", []), (123, []), (120, []), (121, [60]), (127, [])])
def test_what_a_cable_holds_ends_with_it_or_as_it_says(page, end, rest):
    page.ask(MIDI)
    page.ask("cable.input.onmidimessage({ data: [0x90, 60, 90] })")
    assert page.ask(DOWN) == [60]
    page.ask(PULL if end == "PULL" else f"cable.input.onmidimessage({{ data: [0xb0, {end}, 0] }})")
    assert page.ask(DOWN) == rest


@pytest.mark.hard
@needs_browser
def test_focus_that_is_lost_lets_no_key_of_a_cable_go(page):
    page.ask(MIDI)
    page.ask("cable.input.onmidimessage({ data: [0x90, 60, 90] })")
    page.ask("window.dispatchEvent(new Event('blur'))")
    assert page.ask(DOWN) == [60]


# --- every key can be reached


@pytest.mark.hard
@needs_browser
@pytest.mark.parametrize(("layout", "key"), [("AZERTY", "w"), ("QWERTZ", "y"), ("Dvorak", ";"), ("Russian", "я")])
def test_keys_of_the_computer_play_by_their_places(page, layout, key):
    """The key below A and beside Shift is Z in the US, and C3 here, whatever is written on it."""
    page.key("keyDown", "KeyZ", key)
    assert page.ask(DOWN) == [48], layout
    page.key("keyUp", "KeyZ", key)
    assert page.ask(DOWN) == []


@pytest.mark.hard
@needs_browser
def test_the_keys_of_the_computer_move_by_octaves_and_play_as_hard_as_asked(page):
    page.ask("document.getElementById('higher').click()")
    page.ask("document.getElementById('hardness').value = 33")
    page.ask("window.send = message => { window.last = message; }")
    page.key("keyDown", "KeyZ", "z")
    assert page.ask(DOWN) == [60] and page.ask("velocities.get([...down][0])") == 33
    page.key("keyUp", "KeyZ", "z")
    assert page.ask(f'document.querySelector("{key_of("C4")}").dataset.letter') == "Z"


@pytest.mark.hard
@needs_browser
def test_fingers_on_a_phone_reach_all_keys_and_are_drawn_over_them(folder):
    """At 390 px: buttons move the keyboard to its ends, a finger glides over nine keys, and ten fingers play ten."""
    page_of("marimba_keys")[0].save(folder / "phone.html")
    with Browser(folder / "phone", size=(390, 844), options=(SOUND_AT_ONCE,)) as browser:
        browser.emulate(390, 844)
        browser.open(folder / "phone.html")
        browser.ask("started")
        browser._call("Emulation.setTouchEmulationEnabled", enabled=True, maxTouchPoints=10)
        seen = "(() => { const { left, right } = document.getElementById('keyboard').getBoundingClientRect();"
        seen += " return [...document.querySelectorAll('.keys button')].filter(b => { const box ="
        seen += " b.getBoundingClientRect(); return box.right <= right + 1 && box.left >= left - 1; })"
        seen += ".map(b => b.ariaLabel); })()"
        reached = set(browser.ask(seen))
        for name in ("lower", "higher"):
            for _ in range(8):
                browser.ask(f"document.getElementById('{name}').click()")
                browser.ask("new Promise(r => setTimeout(r, 350))")
                reached |= set(browser.ask(seen))
        assert reached == set(browser.ask("data.keys.map(key => key.name)"))
        browser.ask("window.send = () => {}")
        names = browser.ask("[...document.querySelectorAll('.keys .white')].slice(-6).map(b => b.ariaLabel)")
        places = [place_of(browser, key_of(name)) for name in names]
        browser.fingers("touchStart", places[0])
        sounded = [browser.ask(DOWN)]
        for place in places[1:]:
            browser.fingers("touchMove", place)
            browser.ask("new Promise(requestAnimationFrame)")
            sounded.append(browser.ask(DOWN))
        browser.fingers("touchEnd")
        assert [len(keys) for keys in sounded] == [1] * len(places)
        assert len({keys[0] for keys in sounded}) == len(places)
        assert browser.ask(DOWN) == []
        browser.fingers("touchStart", *places)
        assert len(browser.ask(DOWN)) == len(places)
        browser.fingers("touchEnd")
        assert browser.ask(DOWN) == [] and browser.errors == []


@pytest.mark.hard
@needs_browser
def test_the_right_button_of_the_mouse_plays_nothing(page):
    x, y = place_of(page, key_of("C4"))
    page.mouse("mousePressed", x, y, "right")
    assert page.ask(DOWN) == []
    page.mouse("mouseReleased", x, y, "right")
    page.mouse("mousePressed", x, y)
    assert page.ask(DOWN) == [60]
    page.mouse("mouseReleased", x, y)
    assert page.ask(DOWN) == []


# --- assistive technology


@pytest.mark.hard
@needs_browser
def test_a_screen_reader_finds_keys_that_play(page):
    """Buttons with names that say whether they are pressed; one stop of Tab, and arrows from there; click() plays."""
    keys = [
        node for node in page.roles() if node.get("role", {}).get("value") == "button" and "C4" in str(node.get("name"))
    ]
    assert len(keys) == 1 and any(p["name"] == "pressed" for p in keys[0]["properties"])
    assert page.ask("document.querySelectorAll('.keys button[tabindex=\"0\"]').length") == 1
    page.ask("document.querySelector('.keys button[tabindex=\"0\"]').focus()")
    before = page.ask("document.activeElement.ariaLabel")
    page.key("keyDown", "ArrowRight", "ArrowRight")
    assert page.ask("document.activeElement.ariaLabel") != before
    button = f'document.querySelector("{key_of("C4")}")'
    page.ask(f"{button}.click()")
    assert page.ask(DOWN) == [60] and page.ask(f"{button}.ariaPressed") == "true"
    page.ask("new Promise(r => setTimeout(r, 600))")
    assert page.ask(DOWN) == [] and page.ask(f"{button}.ariaPressed") == "false"


@pytest.mark.hard
@needs_browser
@pytest.mark.parametrize("name", ["piano", "violin", "snare_wires"])
def test_all_that_can_be_pressed_or_moved_has_a_name(folder, name):
    page_of(name)[0].save(folder / f"{name}_names.html")
    with Browser(folder / f"{name}_names", options=(SOUND_AT_ONCE,)) as browser:
        browser.open(folder / f"{name}_names.html")
        browser.ask("started")
        found = [node for node in browser.roles() if node.get("role", {}).get("value") in ("button", "slider")]
        names = [str(node.get("name", {}).get("value", "")).strip() for node in found]
        shown = browser.ask("[...document.querySelectorAll('button, input')].filter(x => x.checkVisibility()).length")
        assert len(names) == shown > 4 and all(names)
        keys = browser.ask("data.keys.map(key => key.name)")
        assert set(keys) <= set(names) and len(browser.ask("data.pads")) <= len(names)
        assert browser.errors == []


# --- the sound ends


@pytest.mark.hard
@needs_browser
@pytest.mark.parametrize("name", ["violin", "bowed_violin"])
def test_stop_ends_what_never_ends_by_itself(folder, name):
    """A bow goes on for ever: Stop fades it out, and Play begins anew."""
    page_of(name)[0].save(folder / f"{name}.html")
    with Browser(folder / name, options=(SOUND_AT_ONCE,)) as browser:
        browser.open(folder / f"{name}.html")
        browser.ask("started")
        browser.ask("document.getElementById('damp').click()")  # nothing sounds yet, and nothing begins
        assert browser.ask("playing === undefined")
        browser.ask("document.getElementById('play').click()")
        browser.ask(WAIT_FOR_LEVEL)
        assert browser.ask("document.getElementById('play').textContent") == "Stop"
        browser.ask("document.getElementById('play').click()")
        browser.ask("new Promise(r => setTimeout(r, 400))")
        assert browser.ask("context.state") == "suspended"
        assert browser.ask("document.getElementById('play').textContent") == "Play"
        browser.ask("document.getElementById('play').click()")
        browser.ask("new Promise(r => setTimeout(r, 400))")
        assert browser.ask("context.state") == "running" and browser.errors == []


@pytest.mark.hard
@needs_browser
def test_a_slider_that_is_moved_before_the_sound_begins_nothing(folder):
    page_of("piano_c4")[0].save(folder / "piano.html")
    with Browser(folder / "piano", options=(SOUND_AT_ONCE,)) as browser:
        browser.open(folder / "piano.html")
        browser.ask("started")
        browser.ask("(s => { s.value = s.max; s.oninput(); })(document.querySelector('#sliders input'))")
        assert browser.ask("playing === undefined") and browser.ask("movedRows().length") > 0
        browser.ask("document.getElementById('play').click()")
        browser.ask(WAIT_FOR_LEVEL)
        assert browser.errors == []


@pytest.mark.hard
@needs_browser
def test_what_a_page_needs_is_said_in_a_sentence(page):
    """Plain http, a site that forbids, a clipboard that is not there."""
    said = page.ask(
        "(() => { Object.defineProperty(window, 'isSecureContext', { value: false }); return missing(); })()"
    )
    assert "plain http" in said and "https" in said
    page.ask(
        "document.dispatchEvent(new SecurityPolicyViolationEvent('securitypolicyviolation', { effectiveDirective: "
        "'script-src', documentURI: 'x', violatedDirective: 'x', originalPolicy: 'x', disposition: 'enforce', "
        "statusCode: 0 }))"
    )
    assert "forbids what the page needs (script-src)" in page.ask("document.getElementById('fault').textContent")
    page.ask("Object.defineProperty(navigator, 'clipboard', { value: undefined, configurable: true })")
    page.ask("document.getElementById('copy').click()")
    page.ask("new Promise(r => setTimeout(r, 50))")
    assert "Selected" in page.ask("document.getElementById('copy').textContent")
