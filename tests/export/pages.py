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
from engine.export.page import template
from tests.export.browser import CHROMIUM

SECONDS = 0.5
NODE = shutil.which("node")
RELAXED = "--experimental-wasm-relaxed-simd"  # of Node: with fused multiply-adds
FUSED = re.search(r'FUSED = "(.*?)"', template("page.js"))[1]  # a module with one
PLAIN = "#plain"  # at the end of a page's address: multiply-adds in two steps, as in browsers without fused ones
WAIT_FOR_LEVEL = """(async () => {
  while (!document.getElementById("level").textContent.includes("dB")) await new Promise(r => setTimeout(r, 20));
})()"""


def node_fuses():
    """Return whether Node has fused multiply-adds if it is asked for them."""
    if NODE is None:
        return False
    test = f"process.exit(WebAssembly.validate(Buffer.from('{FUSED}', 'base64')) ? 0 : 1)"
    return subprocess.run([NODE, RELAXED, "-e", test], capture_output=True).returncode == 0


needs_node = pytest.mark.skipif(NODE is None, reason="no Node; Debian's package is called nodejs")
needs_fused_node = pytest.mark.skipif(not node_fuses(), reason="no Node with fused multiply-adds")
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


def messages_of_midi(messages):
    """Return an expression of the page's script: what its keys and pedals send to its audio side at messages of MIDI.

    messages: frame and bytes of each
    """
    return """(() => {
      const sent = [];
      let now = 0;
      window.send = message => sent.push({ ...message, at: now });
      playing ||= true; // what is moved before is sent when it begins
      for (const [frame, data] of MESSAGES) {
        now = frame;
        hear({ data });
      }
      return sent;
    })()""".replace("MESSAGES", json.dumps(messages))


def played_in_node(page, frames, messages="[]", fused=False):
    """Return what Node plays of a page, without fused multiply-adds or with them, and its last meter.

    messages: to its audio side, an expression of its script
    """
    command = [NODE, *([RELAXED] if fused else []), Path(__file__).with_name("play_page.cjs"), page, str(frames)]
    ran = subprocess.run([*command, messages, "" if fused else PLAIN], capture_output=True, text=True, check=True)
    answer = json.loads(ran.stdout)
    assert answer["isFused"] == fused  # and the page says so if it does not fuse them
    return sound_of(answer), answer["meter"]
