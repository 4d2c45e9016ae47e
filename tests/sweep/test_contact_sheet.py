"""The contact sheet of a sweep, in a browser."""

import json

import pytest
from sweeps import MARBLE

from engine.cli import main
from engine.sweep import contact_sheet
from tests.export.browser import CHROMIUM, SOUND_AT_ONCE, Browser

pytestmark = [pytest.mark.system, pytest.mark.skipif(CHROMIUM is None, reason="Chromium is not installed")]


def test_it_plays_sorts_and_finds(tmp_path):
    words = "--vary", "body.marble.mass=0.002,0.004,0.008", "--seconds", "0.3", "--sheet", "--cores", "1"
    assert main.main(["sweep", MARBLE, *words, "-o", str(tmp_path / "a")]) == 0
    with Browser(tmp_path / "profile", options=(SOUND_AT_ONCE,)) as browser:
        browser.open(tmp_path / "a" / "index.html")
        assert browser.ask("document.querySelectorAll('#rows .row').length") == 3
        browser.ask("document.querySelectorAll('#rows .row')[1].click()")
        while not browser.ask("sound.currentTime > 0"):
            pass
        assert browser.ask("decodeURIComponent(sound.src)").endswith("0002_marble_mass_0p004.wav")
        browser.ask("document.querySelectorAll('#head button')[1].click()")
        browser.ask("document.querySelectorAll('#head button')[1].click()")
        assert browser.ask("data.rows[shown[0]].cells[0]") == 0.008
        browser.ask("find.value = 'mass<0.005'; arrange()")
        assert browser.ask("count.textContent") == "2 of 3 sounds"
        assert not browser.errors


def test_ten_thousand_rows_scroll(tmp_path):
    rows = [{"file": f"{n:05d}.wav", "peaks": "#}" * 32, "cells": [n / 7, 1.0, 2.0]} for n in range(10_000)]
    data = json.dumps({"columns": ["a", "b", "c"], "rows": rows}).replace("<", "\\u003c")
    template = contact_sheet.Template(contact_sheet.page_template())
    (tmp_path / "index.html").write_text(template.substitute(title="many", data=data), "utf-8")
    with Browser(tmp_path / "profile") as browser:
        browser.open(tmp_path / "index.html")
        frames = """(async () => { let worst = 0;
            for (let n = 0; n < 60; n++) { const t = performance.now(); list.scrollTop = n * 6000; draw();
                worst = Math.max(worst, performance.now() - t); await new Promise(requestAnimationFrame); }
            return worst; })()"""
        assert browser.ask(frames) < 50.0  # ms, for a picture
        assert browser.ask("document.querySelectorAll('#rows .row').length") < 60
        browser.ask("find.value = '09999'; arrange()")
        assert browser.ask("count.textContent") == "1 of 10000 sounds"
