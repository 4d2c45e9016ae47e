"""The instruments among the patches, a note at a time: in tune, brighter where louder, their energy exact."""

import tomllib

import numpy as np
import pytest
from conftest import ROOT

import engine

RATE = 44_100
EDGES = (0.15, 0.85)  # s: after the pluck, before the end
NOTES = [  # of each instrument: a key, and what it sounds, Hz
    ("guitar", "E2", 82.4069),
    ("guitar", "G3", 195.9977),
    ("guitar", "E5", 659.2551),
    ("guitar_slide", "B3", 246.9417),
    ("guitar_slide", "C#4", 277.1826),
    ("guitar_slide", "G#4", 415.3047),
    ("kalimba_keys", "C4", 261.6256),
    ("kalimba_keys", "C5", 523.2511),
    ("kalimba_keys", "E6", 1318.5102),
    ("sitar", "C3", 130.8128),
    ("sitar", "C4", 261.6256),
    ("sitar", "C5", 523.2511),
    ("tanpura_body", "C2", 65.4064),
    ("tanpura_body", "G2", 97.9989),
    ("tanpura_body", "C#3", 130.8733),  # the second C3, 0.8 cents above the first
]
BRIGHT = [  # a key of each, and the frequency above which a louder note has a larger share, Hz
    ("guitar", "G3", 1000.0),
    ("guitar_slide", "C#4", 1000.0),
    ("kalimba_keys", "C4", 1000.0),
    ("sitar", "C4", 2000.0),
    ("tanpura_body", "C2", 1000.0),
]


def render_note(name: str, key: str, velocity: int, seconds: float = 1.0) -> engine.Rendering:
    """One note of an instrument, held."""
    document = tomllib.loads((ROOT / "patches" / f"{name}.toml").read_text("utf-8"))
    note = {"time": 0.0, "key": key, "velocity": velocity, "duration": seconds}
    events = {"event": [], "note": [note], "seconds": seconds}
    return engine.render(engine.Scene.model_validate(document | events), samplerate=RATE)


def frequency_near(x: np.ndarray, near: float) -> float:
    """Frequency of a partial, Hz: a straight line through the phase of its complex amplitude, weighted by its size."""
    size = round(8 * RATE / near)
    window = np.hanning(size) / np.sum(np.hanning(size))
    for _ in range(2):
        time = np.arange(x.size) / RATE
        z = np.convolve(x * np.exp(-2j * np.pi * near * time), window, "valid")
        turn = np.polyfit(time[: z.size], np.unwrap(np.angle(z)), 1, w=np.abs(z))[0]
        near += float(turn) / (2 * np.pi)
    return near


def share_above(x: np.ndarray, frequency: float) -> float:
    """The share of the energy above a frequency, dB."""
    power = np.abs(np.fft.rfft(x * np.hanning(x.size))) ** 2
    is_high = np.fft.rfftfreq(x.size, 1 / RATE) > frequency
    return 10 * float(np.log10(np.sum(power[is_high]) / np.sum(power)))


@pytest.mark.hard_but("guitar_slide-B3-246.9417", "sitar-C5-523.2511", "kalimba_keys-E6-1318.5102", "sitar-C3-130.8128")
@pytest.mark.parametrize(("name", "key", "pitch"), NOTES)
def test_a_note_is_in_tune_and_its_energy_exact(name, key, pitch):
    rendering = render_note(name, key, 80)
    begin, end = (round(t * RATE) for t in EDGES)
    found = frequency_near(rendering.audio[begin:end].mean(axis=1), pitch)
    assert abs(1200 * np.log2(found / pitch)) < 5.0
    assert rendering.stats.energy.error_max <= 1e-10


@pytest.mark.hard
@pytest.mark.parametrize(("name", "key", "frequency"), BRIGHT)
def test_louder_is_brighter(name, key, frequency):
    """On average over some velocities: one rattle at a fret is as it happens."""
    soft, loud = (
        [render_note(name, key, v, 0.5).audio.mean(axis=1) for v in velocities]
        for velocities in ((30, 40, 50), (110, 120, 127))
    )
    assert np.mean([np.std(note) for note in loud]) > 2.0 * np.mean([np.std(note) for note in soft])
    means = [np.mean([share_above(note, frequency) for note in notes]) for notes in (soft, loud)]
    assert means[1] > means[0] + 1.0


def test_a_string_of_the_guitar_sounds_one_note_at_a_time():
    """F3 ends D3, which lies on the same string, but not G3, of the next."""
    notes = [{"time": t, "key": key, "duration": 0.6} for t, key in ((0.0, "D3"), (0.0, "G3"), (0.3, "F3"))]
    document = tomllib.loads((ROOT / "patches" / "guitar.toml").read_text("utf-8"))
    scene = engine.Scene.model_validate(document | {"note": notes, "seconds": 0.9})
    damped = {(e.body, e.time) for e in scene.event if e.kind == "damp" and e.time > 0.0}
    assert ("D3_normal", 0.3) in damped and ("G3_normal", 0.6) in damped


@pytest.mark.hard
def test_the_taraf_answer_a_note_of_the_sitar():
    """The sympathetic strings go on when the finger has left the fret."""
    document = tomllib.loads((ROOT / "patches" / "sitar.toml").read_text("utf-8"))
    names = {body["name"] for body in document["body"] if body["name"].startswith("taraf")}
    parts = {
        "body": [b for b in document["body"] if b["name"] not in names],
        "connection": [c for c in document["connection"] if c["body"] not in names],
    }
    note = {"note": [{"time": 0.0, "key": "C4", "duration": 0.3}], "seconds": 0.9}
    with_taraf, without = (
        engine.render(engine.Scene.model_validate(document | note | more), samplerate=RATE).audio[round(0.7 * RATE) :]
        for more in ({}, parts)
    )
    assert np.std(with_taraf) > 10.0 * np.std(without)


def test_pressure_and_wheel_pull_the_sitar_by_three_semitones():
    """A pull raises the tension, so that the same one is three semitones at each key."""
    document = tomllib.loads((ROOT / "patches" / "sitar.toml").read_text("utf-8"))
    controls = {control["kind"]: control for control in document["control"]}
    assert set(controls) == {"pressure", "poly_pressure"} and document["midi"]["bend_range"] == 3
    string = document["key"]["body"][0]
    for control in controls.values():
        assert control["parameter"] == "body.string.tension"
        assert control["range"][0] == string["tension"]
        assert 600 * np.log2(control["range"][1] / control["range"][0]) == pytest.approx(300.0, abs=0.1)


@pytest.mark.hard
@pytest.mark.parametrize(("key", "pitch"), [("C3", 130.8128), ("C4", 261.6256)])
def test_a_pulled_string_of_the_sitar_is_three_semitones_higher(key, pitch):
    document = tomllib.loads((ROOT / "patches" / "sitar.toml").read_text("utf-8"))
    note = {"time": 0.0, "key": key, "duration": 1.0, "bend": [[0.0, 3.0]]}
    rendering = engine.render(engine.load(document | {"note": [note], "seconds": 1.0}), samplerate=RATE)
    begin, end = (round(t * RATE) for t in EDGES)
    found = frequency_near(rendering.audio[begin:end].mean(axis=1), pitch * 2**0.25)
    assert abs(1200 * np.log2(found / pitch) - 300.0) < 6.0
    assert rendering.stats.energy.error_max <= 1e-10
