"""Warnings of motion that is too large for the models of bodies, and of sound that nobody hears."""

import json
import math
import os
import subprocess
import sys

import mido
import numpy as np
import pytest
from conftest import PATCHES, ROOT, exit_code, needs_alsa, needs_portaudio

import engine
from engine.analysis.profile import profile_scene
from engine.assembly.build import build
from engine.live.motion_watch import MotionWatch
from engine.live.player import Player
from engine.offline import large_motion
from engine.offline.infrasound import warn_of_infrasound
from engine.offline.large_motion import LargeMotion, MotionRecord
from engine.offline.simulation import Simulation

RATE, LENGTH, THICKNESS = 44_100, 0.65, 1e-3
STRING = {"name": "b", "kind": "string", "length": LENGTH, "linear_density": 4e-4, "tension": 73.0, "modes": 12}
SQUARE = {"name": "b", "kind": "membrane", "size": [0.3, 0.2], "area_density": 0.26, "tension": 2000.0, "modes": 10}
ROUND = {"name": "b", "kind": "membrane", "radius": 0.15, "area_density": 0.26, "tension": 2000.0, "modes": 10}
STEEL = {"kind": "plate", "area_density": 7.8, "young": 2e11, "thickness": THICKNESS, "modes": 10, "sigma0": 5.0}
PLATE = STEEL | {"name": "b", "size": [0.2, 0.15]}
AT = {"string": 0.3, "membrane": [0.4, 0.45], "plate": [0.4, 0.45], "soundboard": [0.4, 0.45], "shell": [0.4, 0.45]}


def scene(body, *others, **more):
    return engine.load({"body": [body, *others], "pickup": [{"body": "b", "at": AT[body["kind"]]}]} | more)


def bent(body, amplitude, number=1):
    return scene(body | {"displacement": {"kind": "mode", "number": number, "amplitude": amplitude}})


def warned(of, seconds=0.05, **more):
    return [line for line in engine.render(of, seconds=seconds, **more).stats.warnings if " moves by " in line]


def slope_of_sine(amplitude):
    """Root of the mean square of the slope of the first mode of a string or a rectangle."""
    return {"string": amplitude * math.pi / LENGTH / math.sqrt(2)} | {
        "membrane": amplitude * math.pi * math.hypot(1 / 0.3, 1 / 0.2) / 2
    }


# --- slopes


@pytest.mark.parametrize("body", [STRING, SQUARE], ids=["string", "membrane"])
@pytest.mark.parametrize(("slope", "count"), [(0.095, 0), (0.105, 1)])
def test_slopes_are_those_of_sines(body, slope, count):
    amplitude = slope / slope_of_sine(1.0)[body["kind"]]
    lines = warned(bent(body, amplitude))
    assert len(lines) == count
    if lines:
        assert f'"b" moves by {1e3 * amplitude:.3g} mm at 0.000 s, with a slope of 0.1' in lines[0]
        assert "(root mean square): theories of small slopes hold up to about 0.1" in lines[0]


@pytest.mark.hard
def test_the_slope_of_a_round_membrane_is_that_of_its_gradient():
    """By differences on a fine grid."""
    of = bent(ROUND, 2e-3, number=4)
    model, state, layout = build(of, RATE)
    motion = LargeMotion(model, state, layout)
    found = large_motion.MAX_SLOPE * motion._size(0, state.q)
    side = np.linspace(0.0, 1.0, 601)
    places = np.stack(np.meshgrid(side, side), axis=-1)
    inside = np.hypot(*np.moveaxis(2 * places - 1, -1, 0)) < 1.0
    moved = np.where(inside, layout.modal_bodies[0].shape(places.reshape(-1, 2)).dot(state.q).reshape(601, 601), 0.0)
    along_y, along_x = np.gradient(moved, 2 * 0.15 / 600)
    assert found == pytest.approx(math.sqrt(np.mean((along_x**2 + along_y**2)[inside])), rel=0.01)


def test_a_string_has_the_slope_of_both_its_directions_and_no_more_for_being_stiff():
    amplitude = 0.105 / slope_of_sine(1.0)["string"]
    for more in ({"polarisations": 2}, {"inharmonicity": 1e-2}, {"axial_stiffness": 1e4}, {"residual": True}):
        (line,) = warned(bent(STRING | more, amplitude))
        assert "with a slope of 0.1 " in line or "with a slope of 0.11 " in line
        assert warned(bent(STRING | more, 0.85 * amplitude)) == []


def test_a_blow_is_warned_of_at_its_time():
    """The largest slope comes after the blow, and a softer one says nothing."""
    for speed, count in ((60.0, 1), (6.0, 0)):
        hammer = {"name": "hammer", "kind": "mass", "mass": 5e-3, "displacement": -0.1}
        strike = {"kind": "strike", "body": "hammer", "time": 0.5, "velocity": speed}
        contact = {"body": "hammer", "on": "b", "on_at": 0.31, "stiffness": 1e7, "exponent": 2.5}
        lines = warned(scene(STRING, hammer, contact=[contact], event=[strike]), 0.6)
        assert len(lines) == count
        if lines:
            assert 0.5 < float(lines[0].split(" at ")[1].split(" s")[0]) < 0.6


# --- thicknesses

LINEAR, BERGER = "linear bending holds up to about one", "the model of its stretch (Berger) is coarse beyond one"
RIGIDITY = {"young": None, "thickness": None, "flexural_rigidity": 2e11 * THICKNESS**3 / 12 / (1 - 0.3**2)}
STRETCHING = {"stretching_stiffness": 2e11 * THICKNESS / (1 - 0.3**2)}
FIRST = math.sqrt(RIGIDITY["flexural_rigidity"] / 7.8) * math.pi / 2 * (1 / 0.2**2 + 1 / 0.15**2)
PLATES = {
    "supported": (PLATE, LINEAR),
    "clamped": (PLATE | {"edges": "clamped"}, LINEAR),
    "round": (STEEL | {"name": "b", "radius": 0.1, "edges": "clamped"}, LINEAR),
    "stretching": (PLATE | {"stretching": True}, BERGER),
    "by its rigidity": (PLATE | RIGIDITY | STRETCHING, BERGER),
    "by its pitch": (PLATE | RIGIDITY | STRETCHING | {"flexural_rigidity": None, "frequency": FIRST}, BERGER),
}


@pytest.mark.parametrize("name", PLATES)
@pytest.mark.parametrize(("amplitude", "count"), [(0.85, 0), (1.2, 1)])
def test_plates_that_move_by_more_than_their_thickness_are_warned_of(name, amplitude, count):
    body, words = PLATES[name]
    lines = warned(bent(body, amplitude * THICKNESS))
    assert len(lines) == count
    for line in lines:
        assert line.startswith(
            f'"b" moves by {amplitude:.3g} mm at 0.000 s, {amplitude:.3g} times its thickness of 1 mm'
        )
        assert words in line


def pushed(body, force, duration=0.02):
    push = {"body": "b", "at": AT[body["kind"]], "kind": "half_sine", "amplitude": force, "duration": duration}
    return scene(body, force=[push])


BOARD = {"name": "b", "kind": "soundboard", "size": [0.5, 0.4], "thickness": 3e-3, "modes": 12}
DRUM = {"name": "b", "kind": "shell", "radius": 0.16, "length": 0.13, "thickness": THICKNESS, "density": 7850.0}
DRUM |= {"young": 2e11, "modes": 12}


@pytest.mark.parametrize(
    ("body", "force"), [(PLATE, 500.0), (BOARD, 2000.0), (DRUM, 6000.0)], ids=lambda v: str(v)[:20]
)
def test_what_moves_is_what_pickups_hear(body, force):
    """The largest of what is seen at many places is near that of the place that is pushed. No shape is computed for
    small motion."""
    for share, count in ((1.0, 1), (1e-4, 0)):
        of = pushed(body, share * force)
        of = of.model_copy(update={"pickup": [of.pickup[0].model_copy(update={"quantity": "displacement"})]})
        lines = warned(of, 0.1)
        assert len(lines) == count
        if lines:
            heard = 1e3 * np.abs(engine.render(of, 0.1).audio).max()
            assert 0.9 * heard < float(lines[0].split(" by ")[1].split(" mm")[0]) < 2.0 * heard


def test_what_moves_a_plate_as_a_whole_does_not_bend_it():
    """A free plate on soft cords may go anywhere."""
    free = PLATE | {"edges": "free", "cords": {"frequency": 2.0}}
    push = {"body": "b", "at": [0.5, 0.5], "kind": "half_sine", "amplitude": 2.0, "duration": 0.1}
    heard = [{"body": "b", "at": [0.5, 0.5], "quantity": "displacement"}]
    of = engine.load({"body": [free], "force": [push], "pickup": heard})
    assert np.abs(engine.render(of, 0.3).audio).max() > 10 * THICKNESS and warned(of, 0.3) == []
    assert len(warned(pushed(free, 2000.0, 2e-3))) == 1


def test_bodies_of_unknown_thickness_are_left_out():
    bar = {"name": "b", "kind": "bar", "length": 0.3, "mass": 0.1, "frequency": 300.0, "modes": 5}
    for body in (PLATE | RIGIDITY, PLATE | {"young": None, "thickness": None, "frequency": 100.0}, bar):
        model, state, layout = (
            build(engine.load({"body": [body], "pickup": [{"body": "b", "at": 0.3}]}), RATE)
            if (body is bar)
            else build(scene(body), RATE)
        )
        assert not LargeMotion(model, state, layout).has_limits


def test_a_look_at_the_motion_leaves_the_samples_as_they_are():
    blocks = []
    for is_recorded in (False, True):
        model, state, layout = build(pushed(PLATE | {"stretching": True}, 500.0), RATE)
        renderer = Simulation(model, state)
        renderer = MotionRecord(renderer, LargeMotion(model, state, layout)) if is_recorded else renderer
        blocks.append(np.zeros((RATE // 10, 1)))
        renderer.render_block(blocks[-1], None)
    assert np.array_equal(*blocks) and blocks[0].any()


# --- everywhere the same


@pytest.mark.slow_but_each(2)
@pytest.mark.hard_but("bouncing_ball", "piano_c4", "bass_frets", "rattle", "slack_bass", "marimba")
@pytest.mark.parametrize("path", PATCHES, ids=lambda path: path.stem)
def test_shipped_patches_move_as_far_as_their_models_hold(path):
    shipped = engine.load(path)
    warnings = engine.render(shipped, min(shipped.seconds, 2.5)).stats.warnings
    assert [warning for warning in warnings if "too short to share momentum" not in warning] == []


def loud_patch(folder):
    """The path of a patch in which a plate is pushed too far."""
    body = "\n".join(f"{key} = {json.dumps(value)}" for key, value in (PLATE | {"sigma0": 1.0}).items())
    force = 'body = "b"\nat = [0.4, 0.45]\nkind = "half_sine"\namplitude = 5000.0\nduration = 0.001'
    pickup = 'body = "b"\nat = [0.4, 0.45]'
    (folder / "loud.toml").write_text(f"[[body]]\n{body}\n[[force]]\n{force}\n[[pickup]]\n{pickup}\n")
    return str(folder / "loud.toml")


def test_the_command_and_inspect_say_so(tmp_path, capsys):
    patch = loud_patch(tmp_path)
    assert exit_code("render", patch, "--seconds", "0.1", "--json", "-o", str(tmp_path / "a.wav")) == 0
    said = capsys.readouterr()
    (line,) = json.loads(said.out)["warnings"]
    assert line.startswith('"b" moves by ') and f"{patch}: {line}" in said.err.splitlines()
    assert exit_code("inspect", patch, "--seconds", "0.1") == 0
    assert f"{patch}: {line}" in capsys.readouterr().err.splitlines()


def test_inspect_renders_again_only_what_may_move_too_far(monkeypatch):
    def fail(*_):
        raise AssertionError("rendered again")

    monkeypatch.setattr("engine.analysis.profile._record_motion", fail)
    assert profile_scene(pushed(PLATE, 1.0), 0.1).warnings == []
    with pytest.raises(AssertionError):
        profile_scene(pushed(PLATE, 500.0), 0.1)


@pytest.mark.parametrize("voices", [0, 3])
def test_live_sound_says_so(voices):
    """Of several voices with the same bodies, it is said once."""
    hammer = {"name": "hammer", "kind": "mass", "mass": 5e-3, "velocity": 60.0, "displacement": -1e-3}
    contact = {"body": "hammer", "on": "b", "on_at": 0.31, "stiffness": 1e7, "exponent": 2.5}
    of = scene(STRING, hammer, contact=[contact])
    player = Player(of, RATE, 10.0, 1e-3, voices=voices)
    watch, out = MotionWatch(player), np.zeros((441, player.channels), np.float32)
    for n in range(max(1, voices)):
        player.strike(f"hammer_{n}" if voices else "hammer", 300.0)
    for _ in range(20):
        player.render_into(out)
        watch.poll()
    (line,) = watch.warnings()
    assert line.startswith('"b" moves by ')
    quiet = Player(of.model_copy(update={"body": [of.body[0], of.body[1].model_copy(update={"velocity": 1.0})]}), RATE)
    watch.follow(quiet)
    assert watch.warnings() == [line]


@pytest.mark.system
@needs_portaudio
@needs_alsa
def test_the_summary_of_a_session_says_so(tmp_path, file_device):
    patch = loud_patch(tmp_path)
    words = ["play", patch, "--seconds", "0.5", "--json"]
    environment = os.environ | file_device[0]
    command = [sys.executable, str(ROOT / "render.py"), *words]
    done = subprocess.run(command, env=environment, capture_output=True, text=True, timeout=120, check=False)
    assert done.returncode == 0, done.stderr
    (line,) = json.loads(done.stdout)["warnings"]
    assert line.startswith('"b" moves by ') and f"{patch}: {line}" in done.stderr.splitlines()


def test_notes_of_a_midi_file_played_by_voices_say_so(tmp_path, capsys, monkeypatch):
    """By the meter of a render and its JSON, as of a patch."""
    monkeypatch.setattr(large_motion, "MAX_SLOPE", 1e-6)
    midi = mido.MidiFile(tracks=[mido.MidiTrack([mido.Message("note_on", note=60, velocity=90, time=0)])])
    midi.tracks[0].append(mido.Message("note_off", note=60, time=480))
    midi.save(tmp_path / "a.mid")
    words = ["--midi", str(tmp_path / "a.mid"), "-o", str(tmp_path / "a.wav"), "--seconds", "0.3", "--voices", "2"]
    assert exit_code("render", "piano_c4", *words, "--json") == 0
    said = capsys.readouterr()
    (line,) = json.loads(said.out)["warnings"]
    assert line.startswith('"string" moves by ') and line in said.err


# --- below what is heard


def swinging(frequency, kind="oscillator", **more):
    body = {"name": "b", "kind": kind, "mass": 1.0, "velocity": 1.0}
    body |= {"frequency": frequency} if kind == "oscillator" else {}
    return engine.load({"body": [body], "pickup": [{"body": "b"} | more]})


def low(of, seconds=2.0):
    return [line for line in engine.render(of, seconds).stats.warnings if "lies below 20 Hz" in line]


def test_sound_below_20_hz_is_warned_of():
    (line,) = low(swinging(8.0))
    assert float(line.split("%")[0]) > 99.0 and "of the sound lies below 20 Hz, too low for ears" in line
    assert low(swinging(40.0)) == low(swinging(25.0)) == []


def test_the_share_is_that_of_the_energy():
    time = np.arange(2 * RATE) / RATE
    for low_energy, count in ((0.94, 0), (0.96, 1)):
        sine = [
            math.sqrt(energy) * np.sin(2 * math.pi * f * time)
            for energy, f in ((low_energy, 7.0), (1 - low_energy, 300.0))
        ]
        lines = warn_of_infrasound(swinging(8.0), np.sum(sine, axis=0)[:, None], RATE)
        assert len(lines) == count
        assert all(float(line.split("%")[0]) == pytest.approx(96.0, abs=0.3) for line in lines)


def test_what_is_looked_at_and_not_heard_is_left_out():
    """Displacements, forces, masses that fly; and what is too short to tell."""
    assert low(swinging(8.0, quantity="displacement")) == low(swinging(8.0, "mass")) == low(swinging(8.0), 0.3) == []
    assert warn_of_infrasound(swinging(8.0), np.zeros((RATE, 1)), RATE) == []
    assert warn_of_infrasound(swinging(8.0), np.full((RATE, 1), np.nan), RATE) == []
