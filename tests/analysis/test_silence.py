"""A render that is silent says why; one that sounds does not."""

import json

import pytest
from conftest import ROOT

from engine import Scene, render
from engine.analysis.silence import explain_silence, is_inaudible
from engine.cli import main
from engine.offline.effects import EffectStatistics
from engine.offline.energy_statistics import EnergyStatistics
from engine.offline.statistics import Activity, NewtonStatistics, SimulationStatistics, SolveOutcomes

TEMPLATES = ROOT / "patches" / "templates"
OTHER = '[[body]]\nname = "other"\nkind = "string"\nlength = 1.0\nmass = 1.0\nfrequency = 50.0\n[[pickup]]'
STILL = '[[body]]\nname = "b"\nkind = "mass"\nmass = 1\n[[pickup]]\nbody = "b"\n'


@pytest.fixture
def silent(tmp_path, capsys):
    """What is said of a template with some changes, rendered for 50 ms, alike on stderr, in the summary, as JSON."""

    def says(template: str, *changes: tuple[str, str], seconds: str = "0.05") -> str | None:
        text = (TEMPLATES / f"{template}.toml").read_text("utf-8") if template else STILL
        for old, new in changes:
            assert old in text
            text = text.replace(old, new)
        patch = tmp_path / "p.toml"
        patch.write_text(text, "utf-8")
        words = [str(patch), "-o", str(tmp_path / "a.wav"), "--seconds", seconds]
        assert main.main([*words, "--json"]) == 0
        out, err = capsys.readouterr()
        told = json.loads(out)["silent"]
        if told is not None:
            assert err.splitlines()[-1] == f"{patch}: silent; {told}"  # it may have been compiled before
            assert main.main(words) == 0
            out, err = capsys.readouterr()
            assert f"silent: {told}" in out and err.splitlines()[-1] == f"{patch}: silent; {told}"
        return told

    return says


VELOCITY = "velocity = 2.5 "
REST = (VELOCITY, "velocity = 0.0 ")


def test_a_render_that_sounds_is_not_silent(silent):
    assert silent("hammer") is None


def test_nothing_moves(silent):
    assert silent("") == (
        "nothing moves at the start, and no force or strike acts; give a body a velocity or a displacement, or add a"
        " [[force]] or an [[event]]"
    )


def test_all_comes_later(silent):
    assert silent("hammer", REST) == "nothing happens before 2 s, and it ends at 0.05 s; give more seconds"


def test_the_hammer_moves_away(silent):
    told = silent("hammer", (VELOCITY, "velocity = -2.5 "))
    assert told.startswith('no contact ever closes: "hammer" moves away from "string"; reverse its velocity')


def test_the_hammer_is_too_far(silent):
    told = silent("hammer", ("displacement = -2e-3", "displacement = -0.5"))
    assert 'no contact ever closes: "hammer" needs 0.2 s to reach "string", and it ends at 0.05 s; give more' in told


def test_the_ball_is_still_falling(silent):
    """√(2·0.1/9.81) s."""
    assert '"ball" needs 0.143 s to reach "head"' in silent("ball")


def test_the_ball_is_thrown_the_wrong_way(silent):
    lighter = ("gravity = 9.81", "gravity = -9.81")
    thrown = ("displacement = 0.1", "velocity = -0.1\ndisplacement = 0.1")
    assert '"ball" turns back before it reaches "head"' in silent("ball", lighter, thrown)


def test_the_pickup_hears_another_body(silent):
    told = silent("hammer", ('[[pickup]]\nbody = "string"', OTHER + '\nbody = "other"'))
    joined = "do not reach; add a [[contact]] or a [[connection]]"
    assert told == f'the pickup is on "other", which the moving bodies ("hammer") {joined}'


@pytest.mark.parametrize("at", ["0.0", "1.0"])
def test_the_pickup_is_at_a_node(silent, at):
    """Where rounding alone would be heard, and brought up to full level."""
    told = silent("hammer", ("at = 0.9 ", f"at = {at} "), ("displacement = -2e-3", "displacement = 0.0"))
    assert told == f'the pickup on "string" is at {at}, where it never moves; give another position'


@pytest.mark.hard
def test_the_pluck_is_at_a_node(silent):
    told = silent("bridge", ("at = 0.37 ", "at = 1.0 "))
    assert told == '"string" is only pushed at 1.0, where it never moves; give another position'


def test_pickups_without_gain(silent):
    told = silent("hammer", ("[[pickup]]", "[[pickup]]\ngain = 0.0"))
    assert told == "every pickup has gain = 0; change a gain"


def untouched(initial_energy: float) -> SimulationStatistics:
    """Of 0.1 s without any contact."""
    newton = NewtonStatistics(0, 0.0, 0, 0, 0, 0, 0, [], SolveOutcomes(4410, 0, 0, 0, 0, 0))
    energy = EnergyStatistics(initial_energy, initial_energy, 0.0, 0.0, 0.0, 0.0)
    return SimulationStatistics(newton, energy, EffectStatistics([], []), Activity(1.0, 0.0, 0.0))


@pytest.mark.parametrize("reverse", [False, True])
@pytest.mark.parametrize(("side", "up"), [("above", 1.0), ("below", -1.0)])
def test_when_a_contact_would_close(side, up, reverse):
    """A mass 1 m from a wall or a string, from either side, named first or second."""
    simulated = untouched(initial_energy=1.0)
    string = {"name": "s", "kind": "string", "length": 1.0, "mass": 1.0, "frequency": 50.0}

    def says(speed: float, gravity: float = 0.0) -> str:
        ball = {"name": "b", "kind": "mass", "mass": 1.0, "velocity": up * speed}
        touch = {"body": "b", "stiffness": 1e6, "exponent": 1.5, "side": side}
        if reverse:
            other = {"above": "below", "below": "above"}[side]
            touch |= {"body": "s", "at": 0.3, "on": "b", "gap": 1.0, "side": other}
        else:
            touch |= {"barrier": up}
        pickup = [{"body": "b", "quantity": "force"}] if not reverse else [{"body": "s", "at": 0.3}]
        parts = {"body": [ball, string], "contact": [touch], "pickup": pickup, "gravity": gravity}
        return explain_silence(Scene.model_validate(parts), 0.1, 44_100, 0.0, simulated) or ""

    target = '"s"' if reverse else "the barrier"
    assert f'"b" needs 2 s to reach {target}, and it ends at 0.1 s' in says(0.5)
    assert f'"b" moves away from {target}' in says(-0.5)
    assert f'"b" needs 0.5 s to reach {target}' in says(0.0, gravity=-8.0 * up)
    assert f'"b" needs 1 s to reach {target}' in says(2.0, gravity=2.0 * up)
    assert f'"b" turns back before it reaches {target}' in says(1.9, gravity=2.0 * up)


def test_a_barrier_that_moves_in_is_heard():
    """Nothing moves at first, but a contact changes and pushes."""
    body = {"name": "b", "kind": "oscillator", "mass": 1.0, "frequency": 200.0}
    wall = {"name": "wall", "body": "b", "barrier": 1e-3, "stiffness": 1e8, "exponent": 1.5}
    push = {"kind": "change", "time": 0.01, "contact": "wall", "barrier": -1e-3}
    told = {"body": [body], "contact": [wall], "event": [push], "pickup": [{"body": "b"}]}
    simulated = untouched(initial_energy=0.0)
    assert explain_silence(Scene.model_validate(told), 0.1, 44_100, 0.5, simulated) is None
    quiet = Scene.model_validate(told | {"event": []})
    assert "nothing moves" in (explain_silence(quiet, 0.1, 44_100, 0.0, simulated) or "")


def test_what_a_string_does_to_its_end_is_heard_though_nothing_moves_there():
    string = {"name": "s", "kind": "string", "length": 0.6, "linear_density": 4e-3, "frequency": 200.0}
    pluck = {"kind": "pluck", "body": "s", "at": 0.2, "amplitude": 1.0, "duration": 2e-3}
    pickup = {"body": "s", "at": 1.0, "quantity": "end_force"}
    scene = Scene.model_validate({"body": [string], "force": [pluck], "pickup": [pickup]})
    stats = render(scene, seconds=0.02).stats
    assert explain_silence(scene, 0.02, 44_100, stats.peak, stats) is None
    assert not is_inaudible(scene)
