"""Bowed patches: strings that strokes turn, the shipped violins, and what is printed of a bow."""

import math

import numpy as np
import pytest

import engine
from bench.accuracy.bowing import SAMPLERATE
from bench.accuracy.pitch import partial_motion
from engine.analysis.bowing import playing_ranges, schelleng_forces
from engine.assembly.build import build
from engine.cli import main
from engine.instrument.key_names import note_frequency, parse_key
from engine.live.controls import Controls
from engine.live.key_allocator import KeyAllocator, live_scene
from engine.live.midi_notes import Move, Note
from engine.live.player import Player

D4 = 293.66  # Hz
LEAST_SHARE = 0.25  # of the farthest slip: less is a ripple, not a slip of its own
SLIDES = 0.02  # m/s


def slips_per_period(slip: np.ndarray, frequency: float) -> float:
    """Count the slips of a string in a period. slip: [frames], m/s; frequency: Hz"""
    speed = np.abs(slip)
    bounds = np.flatnonzero(np.diff(np.concatenate([[0], (speed > SLIDES).astype(int), [0]])))
    moved = [speed[begin:end].sum() for begin, end in zip(bounds[::2], bounds[1::2], strict=True)]
    return sum(way > LEAST_SHARE * max(moved) for way in moved) / (slip.size / SAMPLERATE * frequency)


def pitch(sound: np.ndarray, near: float) -> float:
    """Return the pitch of a sound, Hz, by the strongest sine near it. sound: [frames]; near: within 3 % of it"""
    window = np.hanning(sound.size)
    times, candidates = np.arange(sound.size) / SAMPLERATE, near * np.linspace(0.97, 1.03, 241)
    levels = [np.abs(np.sum(sound * window * np.exp(-2j * np.pi * f * times))) for f in candidates]
    return float(candidates[int(np.argmax(levels))])


@pytest.fixture(scope="module")
def violin() -> engine.Rendering:
    return engine.render(engine.load("bowed_violin"), trace=True, seconds=4.3)


def test_the_bowed_violin_plays_in_helmholtz_motion_at_its_pitch(violin):
    """In its first stroke the string sticks for most of a period and slips once; the pitch is D4, a little flat as the
    force of a bow makes it."""
    slip = violin.trace["slip"][SAMPLERATE // 2 : 3 * SAMPLERATE // 2, 0]
    assert slips_per_period(slip, D4) == pytest.approx(1.0, abs=0.05)
    assert 0.7 < violin.trace["sticks"][SAMPLERATE // 2 : 3 * SAMPLERATE // 2, 0].mean() < 0.95
    sound = violin.audio[SAMPLERATE // 2 : 3 * SAMPLERATE // 2, 0]
    assert -25.0 < 1200 * math.log2(pitch(sound, D4) / D4) < 10.0
    assert violin.stats.energy.error_max < 1e-12


def test_each_stroke_turns_the_motion_of_the_string(violin):
    """Slip goes against the bow, which goes down in the first stroke and up in the second."""
    down, up = (violin.trace["slip"][round(t * SAMPLERATE) : round((t + 0.5) * SAMPLERATE), 0] for t in (0.8, 2.4))
    assert down.min() < -1.0 and down.max() < 0.3
    assert up.max() > 1.0 and up.min() > -0.3


def test_a_bow_that_is_lifted_between_strokes_rubs_nothing():
    strokes = [{"time": 0.0, "duration": 0.2}, {"time": 0.5, "duration": 0.2}]
    string = {"name": "s", "kind": "string", "length": 0.325, "tension": 43.0, "linear_density": 1.18e-3}
    bow = {"name": "bow", "body": "s", "at": 0.11, "velocity": 0.2, "force": 0.5, "strokes": strokes}
    scene = {"seconds": 0.8, "body": [string], "bow": [bow], "pickup": [{"body": "s", "at": 0.3}]}
    trace = engine.render(engine.load(scene), trace=True).trace
    friction = np.abs(trace["friction"][:, 0])
    assert friction[(trace["time"] > 0.21) & (trace["time"] < 0.49)].max() == 0.0
    assert friction[trace["time"] < 0.19].max() > 0.3 and friction[trace["time"] > 0.55].max() > 0.3


# --- the instrument


def play_note(key: str, velocity: int, seconds: float = 1.1) -> engine.Rendering:
    note = {"time": 0.0, "key": key, "velocity": velocity, "duration": seconds}
    document = engine.load("violin").document | {"note": [note], "seconds": seconds}
    return engine.render(engine.load(document), trace=True)


@pytest.mark.parametrize("key", ["G3", "D4", "B4", "E5"])
def test_a_key_of_the_violin_sounds_in_helmholtz_motion(key):
    rendering = play_note(key, 80)
    last, frequency = -round(0.4 * SAMPLERATE), note_frequency(parse_key(key))
    assert slips_per_period(rendering.trace["slip"][last:, 0], frequency) == pytest.approx(1.0, abs=0.1)
    assert rendering.stats.energy.error_max < 1e-11


def test_a_key_that_is_pressed_harder_is_louder():
    soft, loud = (np.std(play_note("D4", velocity, 0.6).audio[SAMPLERATE // 3 :]) for velocity in (30, 110))
    assert loud > 1.5 * soft


@pytest.mark.hard_but("D4")
@pytest.mark.parametrize("key", ["G3", "D4", "F#4", "C5", "E5", "D6"])
def test_a_key_that_is_pressed_harder_is_brighter(key):
    """From MIDI 10 to 127 by more than 15 dB louder, while the mean frequency of its spectrum rises."""
    levels, means = [], []
    for velocity in (10, 127):
        sound = play_note(key, velocity).audio[-SAMPLERATE // 2 :]
        power = np.sum(np.abs(np.fft.rfft(sound * np.hanning(len(sound))[:, None], axis=0)) ** 2, axis=1)
        levels.append(10 * math.log10(power.sum()))
        means.append(np.arange(power.size) @ power / power.sum())
    assert levels[1] > levels[0] + 15.0
    assert means[1] > 1.004 * means[0]


def test_the_violin_has_two_sides():
    """Neither channel is the other with another gain, and neither is much softer."""
    left, right = play_note("D4", 80).audio.T
    assert abs(np.corrcoef(left, right)[0, 1]) < 0.97
    assert abs(10 * math.log10(np.mean(left**2) / np.mean(right**2))) < 6.0


def hold_and_turn(controller: int, value: float, key: int = 64) -> np.ndarray:
    """Half a second of a note that is held, live, and has no vibrato, a while after a move: [frames, channels]"""
    scene = live_scene(engine.load("violin"), [key])
    player = Player(scene, SAMPLERATE, math.inf, gain=1e-3, waiting=True)
    keys, controls, sounds = KeyAllocator(player), Controls(scene, player), []
    keys.play(Note(0, "soft", 0, 127))
    keys.play(Note(0, "on", key, 80))
    for n in range(80):
        if n == 10:
            controls.move(Move("cc", controller, 1, value))
        controls.poll()
        sounds.append(np.zeros((441, player.channels), np.float32))
        player.render_into(sounds[-1])
    assert not controls.refused
    return np.concatenate(sounds[30:])


@pytest.mark.hard
def test_expression_swells_a_note():
    soft, loud = (np.std(hold_and_turn(11, value)) for value in (0.2, 1.0))
    assert 20 * math.log10(loud / soft) > 15.0


def cents_of_last(sound: np.ndarray, key: int) -> float:
    """How far the end of a note is from its key."""
    return 1200 * math.log2(pitch(sound[-SAMPLERATE // 4 :, 0], note_frequency(key)) / note_frequency(key))


@pytest.mark.parametrize("key", [64, pytest.param(76, marks=pytest.mark.hard)])
def test_the_modulation_wheel_rolls_the_finger(key):
    """By some 20 cents; an open string, which has none, keeps its pitch."""
    flat, sharp = (cents_of_last(hold_and_turn(1, value, key), key) for value in (0.0, 1.0))
    assert abs(sharp - flat) < 1.0 if key == 76 else 15.0 < sharp - flat < 35.0


def test_the_soft_pedal_takes_the_vibrato_of_the_next_key():
    """The pitch of E4 swings by more than 15 cents without it, by less than 3 with it, and is in tune with both."""
    swings = []
    for soft in (0.0, 1.0):
        document = engine.load("violin").document | {"seconds": 1.4, "pedal": [{"time": 0.0, "soft": soft}]}
        document |= {"note": [{"time": 0.01, "key": "E4", "velocity": 80, "duration": 1.4}]}
        motion = partial_motion(engine.render(engine.load(document)).audio, SAMPLERATE, note_frequency(64), 6.0)
        turned = np.unwrap(np.angle(motion[round(0.7 * SAMPLERATE) : round(1.25 * SAMPLERATE), 0]))
        cents = 1200 * np.log2(1 + np.diff(turned[::441]) / (2 * np.pi * 0.01) / note_frequency(64))
        assert abs(cents.mean()) < 5.0
        swings.append(np.ptp(cents))
    assert swings[0] > 15.0 and swings[1] < 3.0


def test_a_key_takes_the_string_from_another_and_lifts_its_bow():
    """Live, as in a score: one note at a time on each string."""
    player = Player(live_scene(engine.load("violin"), [62, 64]), SAMPLERATE, math.inf, waiting=True)
    keys, out = KeyAllocator(player), np.zeros((8820, player.channels), np.float32)
    keys.play(Note(0, "on", 62, 90))
    player.render_into(out)
    assert player.value("friction.D4_bow.force") > 0.5
    keys.play(Note(0, "on", 64, 90))
    player.render_into(out)
    assert player.value("friction.D4_bow.force") == 0.0 and player.value("friction.E4_bow.force") > 0.5
    assert np.abs(out).max() > 0.0 and player.meter().energy_error < 1e-11


# --- what `fdh inspect` prints


def test_inspect_prints_the_limits_of_each_motion_of_a_bow(tmp_path, capsys):
    """They are those of the formulas for the string's impedance and the resistance of its end; a bow that presses
    harder is said to be above them."""
    string = {"name": "s", "kind": "string", "length": 0.325, "tension": 43.0, "linear_density": 1.18e-3, "sigma0": 5.0}
    bow = {"name": "bow", "body": "s", "at": 0.1, "velocity": 0.2, "force": 9.0}
    scene = engine.load({"body": [string], "bow": [bow], "pickup": [{"body": "s", "at": 0.3}]})
    built = build(scene, SAMPLERATE)
    (motion,) = playing_ranges(built.layout)
    impedance, frequency = math.sqrt(43.0 * 1.18e-3), math.sqrt(43.0 / 1.18e-3) / 0.65
    wanted = schelleng_forces(0.1, 0.2, impedance, 2 * impedance * frequency / 5.0, 0.5)
    assert (motion.lowest, motion.highest) == pytest.approx(wanted, rel=1e-3)
    assert motion.several_solutions == pytest.approx(2 * impedance * 0.1 / 0.5, rel=1e-3)
    (tmp_path / "bow.toml").write_text(PRINTED, "utf-8")
    assert main.main(["inspect", str(tmp_path / "bow.toml"), "--seconds", "0.02"]) == 0
    assert "bow: 9 N at 0.2 m/s, above Schelleng's" in capsys.readouterr().out


PRINTED = """[[body]]
name = "s"
kind = "string"
length = 0.325
tension = 43.0
linear_density = 1.18e-3
[[bow]]
name = "bow"
body = "s"
at = 0.1
velocity = 0.2
force = 9.0
[[pickup]]
body = "s"
at = 0.3
"""


def test_a_body_that_carries_the_string_lowers_the_resistance_of_its_end():
    """At a resonance of the body, the least force is higher by far than on a rigid end."""
    at_resonance = 43.0 * (470.0 / D4) ** 2  # N
    scene = engine.load("bowed_violin").replace("body.string.tension", at_resonance)
    free = scene.replace("connection.0.share", 0.0)
    lowest = []
    for one in (scene, free):
        built = build(one, SAMPLERATE)
        lowest.append(playing_ranges(built.layout)[0].lowest)
    assert lowest[0] > 2 * lowest[1]


def test_inspect_says_where_the_force_of_a_pressing_contact_comes_from(capsys):
    assert main.main(["inspect", "squeaking_finger", "--seconds", "0.02"]) == 0
    line = "friction under fingertip: pressed by the force of this contact in the same step"
    assert line in capsys.readouterr().out


def test_a_bow_without_force_is_silent_and_says_so():
    string = {"name": "s", "kind": "string", "length": 0.325, "tension": 43.0, "linear_density": 1.18e-3}
    bow = {"name": "bow", "body": "s", "at": 0.1, "velocity": 0.2}
    scene = {"seconds": 0.1, "body": [string], "bow": [bow], "pickup": [{"body": "s", "at": 0.3}]}
    assert engine.render(engine.load(scene)).silence == (
        'the bow "bow" has no force before 0.1 s; give it a velocity and a force'
    )
