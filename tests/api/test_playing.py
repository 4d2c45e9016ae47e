"""A player in the hands of a Python user: read block by block, fed with sound, at a level that does not clip."""

import math
from itertools import pairwise

import numpy as np
import pytest
import soundfile
from conftest import needs_alsa, needs_portaudio

import engine

OSCILLATOR = {
    "seconds": 1.0,
    "body": [{"name": "reed", "kind": "oscillator", "mass": 1e-3, "frequency": 440.0, "damping_rate": 40.0}],
    "pickup": [{"body": "reed", "quantity": "velocity"}],
}
REED = engine.Scene.model_validate(OSCILLATOR)
RATE = 44_100


def noise(frames, seed=1):
    return np.random.default_rng(seed).uniform(-1.0, 1.0, frames)


def fed(blocks, signal, **options):
    player = engine.Player(REED, gain=1.0, seconds=math.inf, input=engine.AudioInput("reed", newtons=0.5), **options)
    ends = np.cumsum([0, *blocks])
    return np.concatenate([player.read(b - a, signal[a:b]) for a, b in pairwise(ends)])


def test_what_is_read_is_what_a_render_gives():
    scene = engine.load("tanpura")
    player, plain = engine.Player(scene, gain=0.1), engine.render(scene, seconds=0.2)
    blocks = np.concatenate([player.read(n) for n in (1, 999, 5000, 2820)])
    later = slice(300, None)  # it fades in over 5 ms
    np.testing.assert_array_equal(blocks[later], (0.1 * plain.audio).astype(np.float32)[later])
    assert player.frame == len(blocks)


@pytest.mark.hard_for("kalimba", "tanpura")
@pytest.mark.parametrize("patch", ["tanpura", "piano_c4", "bouncing_ball", "kalimba"])
def test_the_level_is_found_so_that_nothing_clips(patch):
    """If the patch gives none."""
    document = engine.load(patch).document
    del document["level"]
    player = engine.Player(engine.Scene.model_validate(document))
    assert 0.4 < np.abs(player.read(2 * RATE)).max() <= 0.5 + 1e-6
    assert player.meter().limited == 0


def test_a_silent_scene_keeps_si_units():
    assert engine.Player(REED).gain == 1.0


def test_all_is_silent_once_it_is_over():
    player = engine.Player(REED.replace("body.reed.velocity", 1.0), seconds=0.1)
    assert player.read(RATE // 10).any() and player.finished
    assert not player.read(100).any()


def test_input_pushes_a_body_as_the_same_file_would(tmp_path):
    """The force is one sample late; blocks of any size give the same, bit for bit."""
    signal = noise(4000)
    soundfile.write(tmp_path / "noise.wav", signal, RATE, subtype="DOUBLE")
    force = {"kind": "file", "file": "noise.wav", "body": "reed", "amplitude": 0.5, "start": 1 / RATE}
    scene = engine.Scene.model_validate(OSCILLATOR | {"force": [force]}, context={"folder": tmp_path})
    plain = engine.render(scene, seconds=4000 / RATE).audio.astype(np.float32)
    played = fed([4000], signal)
    np.testing.assert_allclose(played[300:], plain[300:], rtol=0, atol=1e-6 * np.abs(plain).max())
    np.testing.assert_array_equal(played, fed([1, 1024, 64, 2000, 911], signal))


def test_input_that_pauses_is_as_input_of_zeros():
    """Also where the scene has gone to sleep meanwhile; the energy balance holds."""
    signal = noise(3000)
    signal[1000:2000] = 0.0
    player = engine.Player(REED, gain=1.0, seconds=math.inf, input=engine.AudioInput("reed", newtons=0.5))
    parts = [player.read(1000, signal[:1000]), player.read(1000), player.read(1000, signal[2000:])]
    np.testing.assert_array_equal(np.concatenate(parts), fed([3000], signal))
    player.read(20 * RATE)
    assert player.meter().awake == 0
    assert player.read(1000, signal[:1000]).any()
    assert player.meter().energy_error < 1e-12


def test_input_is_linear_in_its_strength():
    loud, soft = fed([2000], noise(2000)), fed([2000], 0.5 * noise(2000))
    np.testing.assert_allclose(soft, 0.5 * loud, rtol=1e-5, atol=1e-9)


def test_a_pluck_leaves_the_input_alone():
    player = engine.Player(REED, gain=1.0, input=engine.AudioInput("reed"))
    with pytest.raises(KeyError, match="no force plucks reed"):
        player.pluck("reed")


@pytest.mark.parametrize(
    ("call", "kind", "says"),
    [
        (lambda p: p.read("many"), TypeError, "frames = 'many' is not a whole number"),
        (lambda p: p.read(-1), ValueError, "frames = -1 is out of range; 0 or more"),
        (lambda p: p.read(10, np.zeros(9)), ValueError, "the input has shape (9,); give [10] or [10, channels]"),
        (lambda p: p.read(2, ["a", "b"]), TypeError, "the input is not an array of numbers"),
        (lambda p: p.read(2, np.zeros(2, np.int16)), TypeError, "the input is an array of int16; give floating-point"),
        (lambda p: p.read(2, [math.nan, 0.0]), ValueError, "not finite; give numbers, full scale = 1"),
        (lambda p: engine.Player(REED, gain=1.0).read(1, [0.0]), ValueError, "has no input; Player(scene, input="),
        (lambda p: engine.Player(REED, input="mic"), TypeError, "'mic' is not an input; give one, such as fdh.Aud"),
        (lambda p: engine.Player(REED, input=engine.AudioInput("red")), engine.PatchError, '"red"'),
        (lambda p: engine.Player(REED, voices=2, input=engine.AudioInput("reed")), ValueError, "leave out voices"),
        (lambda p: engine.Player(REED, voces=2), TypeError, "Player has no argument 'voces'; did you mean \"voices\"?"),
        (lambda p: p.log(), RuntimeError, "audio input is in no log"),
    ],
)
def test_what_cannot_be_is_refused_with_the_remedy(call, kind, says):
    player = engine.Player(REED, gain=1.0, input=engine.AudioInput("reed"))
    with pytest.raises(kind) as refused:
        call(player)
    assert says in str(refused.value) and player.frame == 0


@pytest.mark.system
@needs_portaudio
@needs_alsa
def test_a_with_block_plays_on_a_device_and_fades_out_at_its_end(file_device, tmp_path):
    """In a process of its own, for PortAudio reads its devices once."""
    import os
    import subprocess
    import sys

    code = (
        "import engine\n"
        "with engine.Player(engine.load('tanpura'), seconds=60.0) as player:\n"
        "    player.wait(0.3)\n"
        "    try: player.read(1)\n"
        "    except RuntimeError as error: print(error)\n"
        "print(player.finished, player.frame > 4410)\n"
        "scene = engine.load('sympathetic_strings').replace('body.hammer.velocity', 0.0)\n"
        "with engine.Player(scene, gain=1.0, input=engine.AudioInput('free', at=0.3)) as listening:\n"
        "    listening.wait(0.1)\n"  # to whatever lies in memory, for nothing is there to be heard
        "meter = listening.meter()\n"
        "print(listening.frame > 0, meter.not_finite, meter.energy_error < 1e-12)"
    )
    environment = os.environ | file_device[0]
    done = subprocess.run([sys.executable, "-c", code], env=environment, capture_output=True, text=True, timeout=100)
    assert done.returncode == 0, done.stderr
    assert "a device plays" in done.stdout and done.stdout.endswith("True True\nTrue 0 True\n")
