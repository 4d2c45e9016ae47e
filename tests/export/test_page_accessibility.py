"""Pages under axe-core, a library of accessibility rules, in a real browser: at rest, and while they sound."""

import json
import shutil
import subprocess

import pytest

from tests.export.browser import SOUND_AT_ONCE, Browser
from tests.export.pages import WAIT_FOR_LEVEL, needs_browser, page_of

NPM = shutil.which("npm")
AXE = "axe-core@4"
FETCH_SECONDS = 120
HARM = ("serious", "critical")
LEAST_PASSED = 30  # rules that find something to look at on a page, or none was tried
LOOKS = [  # width, dark, forced colours
    (1280, False, False),
    (390, True, False),
    (390, False, False),
    (1280, False, True),
]
RUN = "axe.run(document).then(({ violations, passes }) => JSON.stringify({ violations, passed: passes.length }))"


@pytest.fixture(scope="module")
def axe(tmp_path_factory):
    """The text of axe-core, from the registry of npm."""
    if NPM is None:
        pytest.skip("no npm; Debian's package is called npm")
    folder = tmp_path_factory.mktemp("axe")
    command = [NPM, "install", "--no-audit", "--no-fund", "--ignore-scripts", "--prefix", str(folder), AXE]
    try:
        installed = subprocess.run(command, capture_output=True, text=True, timeout=FETCH_SECONDS, cwd=folder)
    except subprocess.TimeoutExpired:
        pytest.skip(f"the registry of npm did not answer within {FETCH_SECONDS} s")
    if installed.returncode:
        pytest.skip(f"axe-core could not be installed: {installed.stderr.strip()[-200:]}")
    return (folder / "node_modules" / "axe-core" / "axe.min.js").read_text("utf-8")


def find_harm(browser):
    """Return what serious or critical violations of rules the open page has, and how many rules it keeps."""
    found = json.loads(browser.ask(RUN))
    harm = [
        (one["id"], [node["target"] for node in one["nodes"]], one["nodes"][0]["failureSummary"])
        for one in found["violations"]
        if one["impact"] in HARM
    ]
    return harm, found["passed"]


@pytest.mark.slow
@needs_browser
@pytest.mark.parametrize("name", ["piano", "violin", "snare_wires"])
def test_a_page_keeps_the_rules_of_accessibility(name, axe, tmp_path):
    page_of(name)[0].save(tmp_path / "page.html")
    with Browser(tmp_path / "browser", options=(SOUND_AT_ONCE,)) as browser:
        browser.open(tmp_path / "page.html")
        browser.ask("started")
        browser.ask(f"{axe}; undefined")
        browser.ask("document.querySelectorAll('details').forEach(one => { one.open = true; })")
        for is_playing in (False, True):
            if is_playing:
                browser.ask("play(); document.querySelector('.keys button, .pad').classList.add('down')")
                browser.ask(WAIT_FOR_LEVEL)
            for look in LOOKS:
                browser.emulate(look[0], 900, *look[1:])
                harm, passed = find_harm(browser)
                assert harm == [], (look, is_playing)
                assert passed > LEAST_PASSED
        assert browser.errors == []


@pytest.mark.slow
@needs_browser
def test_the_rules_find_a_button_without_a_name_and_faint_text(axe, tmp_path):
    """So that none found means something."""
    page_of("repelled_oscillator")[0].save(tmp_path / "page.html")
    with Browser(tmp_path / "browser") as browser:
        browser.open(tmp_path / "page.html")
        browser.ask("started")
        browser.ask(f"{axe}; undefined")
        assert find_harm(browser)[0] == []
        browser.ask("document.getElementById('play').textContent = ''")
        browser.ask("document.querySelector('.soft').style.color = '#ccc'")
        assert {rule for rule, *_ in find_harm(browser)[0]} == {"button-name", "color-contrast"}
