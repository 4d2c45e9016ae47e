"""An instrument of bars that plays MIDI files, and what is heard of it."""

import math

import numpy as np
from conftest import ROOT
from smf import off, on

import engine
from engine.instrument.key_names import note_frequency
from engine.live.instrument_notes import scene_of_file
from engine.live.midi import render_notes
from engine.live.midi_parts import Excerpt
from engine.patch.control_tables import Midi

RATE, TICK = 44_100, 1 / 960
BARS = """
keyboard = { keys = "C3..C6" }
[key]
body = [{ name = "bar", kind = "oscillator", mass = 1e-3, frequency = "= f", damping_rate = 0.5 }]
on = [{ kind = "pluck", body = "bar", amplitude = "= v", duration = 1e-3 }]
damper = [{ body = "bar", sigma = 40.0 }]
pickup = [{ body = "bar" }]
"""
VOICE = str(ROOT / "patches" / "piano_c4.toml")
HELD, ENDED = -25.0, -45.0  # dB, of the level at the begin: above, a note sounds on; below, it has ended
A3 = [(10, on(57)), (960, off(57))]
TAIL = [(1920, on(84, 1)), (480, off(84))]  # so that the file goes on


def write_bars(tmp_path, monkeypatch):
    """Write the patch of bars to a folder of a test, which becomes the working folder; returns its name."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "bars.toml").write_text(BARS, "utf-8")
    return "bars.toml"


def rendered(patch, data, folder, midi=None, seconds=3.0):
    """The sound of a file, by keys or by voices, in SI units."""
    (folder / "x.mid").write_bytes(data)
    scene = engine.load(patch)
    scene = scene.model_copy(update={"midi": midi or Midi(shortest_lift=0.0)})
    if scene.instrument is None:
        return render_notes(scene, str(folder / "x.mid"), RATE, Excerpt(seconds=seconds), 6).audio[:, 0].astype(float)
    return engine.render(scene_of_file(scene, folder / "x.mid").scene, seconds=seconds, samplerate=RATE).audio[:, 0]


def cents(sound, key, width=7):
    """How far the strongest partial within so many semitones of a key is from it, from 0.1 to 0.5 s."""
    part = sound[RATE // 10 : RATE // 2]
    spectrum = np.abs(np.fft.rfft(part * np.hanning(len(part)), 1 << 18))
    hertz = np.fft.rfftfreq(1 << 18, 1 / RATE)
    near = (hertz > note_frequency(key) * 2 ** (-width / 12)) & (hertz < note_frequency(key) * 2 ** (width / 12))
    return 1200 * math.log2(hertz[near][np.argmax(spectrum[near])] / note_frequency(key))


def level(sound, key, at):
    """The level of the partial at a key a tenth of a second from a time on, dB of that of the first tenth."""

    def amplitude(begin):
        part = sound[round(begin * RATE) :][: RATE // 10]
        turns = np.exp(-2j * np.pi * note_frequency(key) * np.arange(len(part)) / RATE)
        return abs(np.sum(part * np.hanning(len(part)) * turns)) + 1e-300

    return 20 * math.log10(amplitude(at) / amplitude(0.02))
