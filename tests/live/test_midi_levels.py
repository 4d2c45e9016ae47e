"""Volume, expression and pan of a MIDI file: their curves, fades and parts."""

import math

import numpy as np
import pytest
import soundfile
from bars import A3, RATE, write_bars
from smf import cc, off, on, smf, track

from engine.cli import main
from engine.instrument.key_names import note_frequency

bars = pytest.fixture(write_bars)


def heard(bars, folder, *words, data):
    """The sound file of a rendering in SI units."""
    (folder / "x.mid").write_bytes(data)
    command = ["render", bars, "--midi", "x.mid", "--gain", "0", "--subtype", "DOUBLE", "-o", "x.wav", "--seconds", "1"]
    assert main.main([*command, *words]) == 0
    return soundfile.read("x.wav", always_2d=True)[0]


def decibels(sound, other):
    return 20 * math.log10(np.abs(sound).max() / np.abs(other).max())


@pytest.mark.parametrize(("control", "value"), [(7, 127), (7, 100), (7, 32), (7, 1), (11, 64), (11, 127), (11, 10)])
def test_volume_and_expression_have_the_curve_of_general_midi(bars, tmp_path, capsys, control, value):
    """40 log10(value/127) dB, where the other one is full."""
    plain = heard(bars, tmp_path, data=smf(track(*A3)))
    sound = heard(bars, tmp_path, data=smf(track((0, cc(control, value)), *A3)))
    assert decibels(sound, plain) == pytest.approx(40 * math.log10(value / 127), abs=1e-6)
    assert "were ignored" not in capsys.readouterr().err


def test_volume_0_is_silence_and_a_fade_has_no_step(bars, tmp_path):
    assert not heard(bars, tmp_path, data=smf(track((0, cc(7, 0)), *A3))).any()
    fade = [(0, on(57)), *((24, cc(7, 127 - 4 * n)) for n in range(30)), (240, off(57))]
    plain, sound = (heard(bars, tmp_path, data=smf(track(*part))) for part in ([fade[0], (960, off(57))], fade))
    assert 20 * math.log10(np.abs(sound[-8820:]).max() / np.abs(plain[-8820:]).max()) < -40.0
    assert np.abs(np.diff(sound, axis=0)).max() <= 1.05 * np.abs(np.diff(plain, axis=0)).max()


def test_parts_of_a_mix_have_their_volumes(bars, tmp_path):
    """A channel without a volume has 100, as in General MIDI."""
    part = [(0, on(57)), (0, on(64, channel=2)), (960, off(57)), (0, off(64, channel=2))]
    plain = heard(bars, tmp_path, "--play", "2=bars.toml", data=smf(track(*part)))
    mix = heard(bars, tmp_path, "--play", "2=bars.toml", data=smf(track((0, cc(7, 64)), *part)))
    first, second = (heard(bars, tmp_path, "--channels", n, data=smf(track(*part))) for n in "12")
    np.testing.assert_allclose(plain, first + second, atol=1e-15)
    np.testing.assert_allclose(mix, first * (64 / 127) ** 2 + second * (100 / 127) ** 2, atol=1e-12)


@pytest.mark.parametrize(
    ("value", "left", "right"), [(0, 1, 0), (1, 1, 0), (64, 0.5, 0.5), (127, 0, 1), (32, 0.86, 0.14)]
)
def test_a_part_of_a_mix_is_panned_with_equal_power(bars, tmp_path, value, left, right):
    part = [(0, on(57)), (0, on(64, channel=2)), (960, off(57)), (0, off(64, channel=2))]
    mix = heard(bars, tmp_path, "--play", "2=bars.toml", data=smf(track((0, cc(10, value)), (0, cc(10, 0, 2)), *part)))
    assert mix.shape[1] == 2
    alone = heard(bars, tmp_path, "--channels", "1", data=smf(track(*part)))[:, 0]
    turns = np.exp(-2j * np.pi * note_frequency(57) * np.arange(len(mix)) / RATE) * np.hanning(len(mix))
    powers = [abs(np.sum(mix[:, n] * turns)) ** 2 / abs(np.sum(alone * turns)) ** 2 / 2 for n in (0, 1)]
    assert powers == pytest.approx([left, right], abs=0.01)


def test_channels_of_one_sound_with_different_volumes_are_named(bars, tmp_path, capsys):
    part = [(0, cc(7, 64)), (0, cc(7, 90, 2)), (0, on(57)), (0, on(64, channel=2)), (960, off(57))]
    heard(bars, tmp_path, data=smf(track(*part)))
    said = capsys.readouterr().err
    assert "channels 1, 2 have different volumes or pans, which one sound cannot follow" in said
    assert "controller 7 (2)" in said
    same = [(0, cc(7, 64)), (0, cc(7, 64, 2)), *part[2:]]
    plain, sound = (heard(bars, tmp_path, data=smf(track(*one))) for one in (part[2:], same))
    np.testing.assert_allclose(sound, plain * (64 / 127) ** 2, atol=1e-15)
