"""Ends of strings that move: strings on boards, against the eigenvalues of the same modes, statics and the ledger."""

import math

import numpy as np
import pytest
from held_strings import PLUCK, held
from poles import SAMPLERATE, engine_poles, errors, exact_poles

import engine
from bench.scenes.choirs import board, choir, string
from engine.bodies import String


@pytest.mark.hard
def test_a_choir_on_a_board_has_the_right_pitch_and_decay():
    """With two substeps, partials 1 to 12 of three strings on a board of 261 modes."""
    scene = engine.Scene.model_validate(choir())
    exact, found = exact_poles(scene), engine_poles(scene, substeps=2)
    for n in range(1, 13):
        f = 261.6256 * n * math.sqrt(1 + 3.7702e-4 * n * n)
        near = exact[np.abs(exact.imag / (2 * math.pi) - f) < 0.03 * f]
        assert len(near) >= 3
        for pole in near[np.argsort(-near.real)][:3]:  # those of the strings die last
            mine = found[np.argmin(np.abs(found - pole))]
            assert abs(1200 * math.log2(mine.imag / pole.imag)) <= 0.05
            assert 0.95 <= mine.real / pole.real <= 1.05


def test_the_ledger_of_many_strings_on_a_board_closes():
    """Of 24 strings at 12 points of it."""
    points = {f"p{i}": (0.1 + 0.06 * i, 0.37) for i in range(12)} | {"ear": (0.3, 0.6)}
    names = [f"s{i}" for i in range(24)]
    scene = engine.Scene.model_validate(
        {
            "body": [*(string(name, 100.0 * i - 600.0, modes=20) for i, name in enumerate(names)), board(points)],
            "connection": [
                {"kind": "end", "body": name, "at": 1.0, "on": "board", "on_at": f"p{i // 2}"}
                for i, name in enumerate(names)
            ],
            "force": [{**PLUCK[0], "body": "s5"}],
            "pickup": [{"body": "board", "at": "ear"}],
        }
    )
    assert engine.render(scene, 0.5).stats.energy.error_max <= 1e-13


def test_both_ends_of_a_string_may_move():
    """The force at one end depends on where the other is."""
    bodies = [
        {"name": f"o{n}", "kind": "oscillator", "mass": 0.05, "frequency": f} for n, f in enumerate((100.0, 150.0))
    ]
    scene = held([{"kind": "end", "body": "s", "at": float(n), "on": f"o{n}"} for n in (0, 1)], bodies)
    pitch, decay = errors(scene)
    assert pitch.max() <= 0.4
    assert decay[2:12].max() <= 1e-3  # the lowest two are of the oscillators, that lose next to nothing


def test_a_heavy_mass_at_the_end_is_as_a_fixed_end():
    scene = held(
        [{"kind": "end", "body": "s", "at": 1.0, "on": "o"}],
        [{"name": "o", "kind": "oscillator", "mass": 1e4, "frequency": 1e-3}],
    )
    found = engine_poles(scene)
    f = 261.6256 * np.arange(1, 19) * np.sqrt((1 + 3.7702e-4 * np.arange(1, 19) ** 2) / (1 + 3.7702e-4))
    strings = found[found.imag > 100.0][:18]
    assert np.abs(1200 * np.log2(strings.imag / (2 * math.pi) / f)).max() <= 0.01


@pytest.mark.hard
def test_the_force_on_the_end_of_a_pulled_string_is_its_share():
    """A weight that hangs at x/L pulls the far end with that share of itself; on a spring, by as much as that gives."""
    pull = [{"kind": "constant", "body": "s", "at": 0.3, "amplitude": 2.0}]
    pickups = [{"body": "s", "at": at, "quantity": "end_force", "channel": n + 1} for n, at in enumerate((0.0, 1.0))]
    body = string("s", modes=400, sigma0=300.0)
    fixed = engine.Scene.model_validate({"body": [body], "force": pull, "pickup": pickups})
    forces = engine.render(fixed, 0.2, samplerate=768_000).audio[-1]
    assert forces == pytest.approx([1.4, 0.6], rel=5e-3)
    stand = {"name": "o", "kind": "oscillator", "mass": 0.02, "stiffness": 5e3, "damping_rate": 500.0}
    moving = {
        "body": [body, stand],
        "connection": [{"kind": "end", "body": "s", "at": 1.0, "on": "o"}],
        "force": pull,
        "pickup": [*pickups, {"body": "o", "quantity": "displacement", "channel": 3}],
    }
    last = engine.render(engine.Scene.model_validate(moving), 0.2, samplerate=768_000).audio[-1]
    tension = String.model_validate(body).tension_and_bending()[0] / 0.62  # N/m: the string holds its end, too
    assert last[2] == pytest.approx(0.6 / (5e3 + tension), rel=5e-3)
    assert last[1] == pytest.approx(5e3 * last[2], rel=5e-3)
    assert last[0] + last[1] == pytest.approx(2.0, rel=5e-3)


def test_a_choir_dies_away_in_two_stages():
    """The first partial falls fast while the strings move together, and slowly once they do not."""
    scene = choir(seconds=4.0)
    scene["force"] = [
        {"kind": "half_sine", "body": f"string_{i}", "at": 0.12, "amplitude": 10.0, "duration": 2e-3} for i in range(3)
    ]
    audio = engine.render(engine.Scene.model_validate(scene)).audio[:, 0]
    size, f = 8192, 261.6256 * math.sqrt(1 + 3.7702e-4)
    window = np.hanning(size) * np.exp(-2j * np.pi * f * np.arange(size) / SAMPLERATE)
    starts = np.arange(0, len(audio) - size, 2048)
    level = 20 * np.log10([abs(audio[s : s + size] @ window) for s in starts])
    times = starts / SAMPLERATE
    early, late = (np.polyfit(times[span], level[span], 1)[0] for span in (times < 0.25, times > 2.0))
    assert early < 3 * late < 0.0
