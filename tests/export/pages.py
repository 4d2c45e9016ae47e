"""Pages that tests play, in a browser or in Node."""

import base64
import json
import re
import shutil
import subprocess
from pathlib import Path

import numpy as np
import pytest

import engine
from tests.export.browser import CHROMIUM

SECONDS = 0.5
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
