"""Joined bodies that are played: what holds them is turned, pitches change, and the balance of energy stays."""

import json
import math

import numpy as np
import pytest
from conftest import ROOT
from turned_knobs import sweep_knobs

import engine
from bench.scenes.choirs import struck_choir
from engine.live.hot_reload import changed_parameters
from engine.live.player import Player
from engine.live.replay import replay
from engine.live.voices import retune, sounding_bodies

BOLT = ROOT / "patches" / "bolt_on_a_string.toml"
RANGES = {"stiffness": (1e3, 1e7), "damping_coefficient": (1e-2, 1e2), "rest": (-1e-3, 1e-3)}


@pytest.mark.hard_for("stiffness+damping_coefficient+rest")
@pytest.mark.parametrize("keys", [["stiffness"], ["damping_coefficient"], ["rest"], list(RANGES)], ids="+".join)
def test_a_sweep_keeps_the_balance_of_energy(keys):
    """Of stiffness and damping over 4 decades, and of the rest over 2 mm; and a replay is the same."""
    player = Player(engine.load(BOLT), gain=1e-4, seconds=math.inf)
    played = sweep_knobs(player, {f"connection.thread.{key}": RANGES[key] for key in keys}, 22_050, -2e-3)
    now = player.meter()
    assert played.any() and now["not_finite"] == 0 and now["newton"]["unconverged"] == 0
    assert now["energy_error"] <= 1e-12
    again = replay(json.loads(json.dumps(player.log())))
    np.testing.assert_array_equal(played[: len(again)], again)


def test_played_as_written_it_is_what_is_rendered():
    scene = engine.load(BOLT)
    player, audio = Player(scene, gain=1e-3), engine.render(scene, 0.5).audio
    played = np.zeros((len(audio), player.channels), np.float32)
    player.render_into(played)
    fade = 4410  # after which it has faded in
    assert np.abs(audio).max() > 0.1
    assert np.abs(played[fade:] - 1e-3 * audio[fade:]).max() <= 1e-6 * 1e-3 * np.abs(audio).max()


def compare_voices(scene, ratio, play):
    """A voice tuned from an octave lower sounds as one that was built at its pitch. play: sounds a voice of a player"""
    heard = []
    for lowest, voice, voices in ((1.0, 1, 2), (ratio, 0, 1)):
        player = Player(scene, gain=1e-3, seconds=math.inf, voices=voices, lowest=lowest)
        player.tune(voice, ratio)
        play(player, voice)
        out = np.zeros((8820, player.channels), np.float32)
        player.render_into(out)
        heard.append(out)
        assert player.meter()["energy_error"] <= 1e-12
    assert np.abs(heard[1]).max() > 0.0
    assert np.abs(heard[0] - heard[1]).max() <= 1e-5 * np.abs(heard[1]).max()


STRING = {"name": "s", "kind": "string", "length": 0.65, "mass": 4e-3, "frequency": 196.0, "sigma0": 1.0}
TOP = {"name": "top", "kind": "plate", "size": [0.48, 0.36], "area_density": 1.6, "frequency": 180.0, "modes": 12}
TOP |= {"sigma0": 9.0}
BOX = {"name": "box", "kind": "air", "size": [0.48, 0.36, 0.1], "hole": {"radius": 0.04}, "sigma0": 10.0}
END = {"kind": "end", "body": "s", "at": 1, "on": "top", "on_at": [0.4, 0.4]}
PLUCK = {"body": "s", "kind": "half_sine", "at": 0.2, "amplitude": 1.0, "duration": 0.002}


@pytest.mark.hard_for("False-1.0", "False-1.9", "True-1.0")
@pytest.mark.parametrize("ratio", [1.0, 1.5, 1.9])
@pytest.mark.parametrize("one_way", [False, True])
def test_a_voice_that_is_heard_through_board_and_air_is_tuned(ratio, one_way):
    """Its string is, whether it rides on the board or drives it; as built at that pitch."""
    air = {"kind": "air", "body": "top", "on": "box"}
    told = engine.Scene.model_validate(
        {"body": [STRING, TOP, BOX], "connection": [END | {"one_way": one_way}, air], "force": [PLUCK]}
        | {"pickup": [{"body": "box"}]}
    )
    assert sounding_bodies(told) == ["s"]
    compare_voices(told, ratio, lambda player, voice: player.pluck(f"s_{voice}"))


@pytest.mark.parametrize("ratio", [1.0, 1.5, 1.9])
def test_a_voice_on_a_board_sounds_as_built_at_its_pitch(ratio):
    """A voice that is tuned from an octave lower has the coefficients of one that was built so: mode by mode."""
    scene = engine.Scene.model_validate(struck_choir(2))
    compare_voices(scene, ratio, lambda player, voice: player.strike(f"hammer_{voice}", velocity=2.0))


@pytest.mark.hard_for("True-1.5-end_force")
@pytest.mark.parametrize("quantity", ["velocity", "tension", "end_force"])
@pytest.mark.parametrize("ratio", [1.0, 1.5])
@pytest.mark.parametrize("is_joined", [False, True])
def test_a_voice_whose_string_stretches_sounds_as_built_at_its_pitch(is_joined, ratio, quantity):
    """Struck by a hammer, which meets the string as stretched as it is."""
    string = STRING | {"axial_stiffness": 2e5}
    hammer = {"name": "hammer", "kind": "mass", "mass": 5e-3, "displacement": -1e-3}
    pickup = {"body": "s", "quantity": quantity} | ({"at": {"velocity": 0.1, "end_force": 1.0}.get(quantity)})
    told = engine.Scene.model_validate(
        {"body": [string, hammer, *([TOP] if is_joined else [])], "connection": [END] if is_joined else []}
        | {"contact": [{"body": "hammer", "on": "s", "on_at": 0.11, "stiffness": 1e6, "exponent": 2.0}]}
        | {"pickup": [{name: value for name, value in pickup.items() if value is not None}]}
    )
    compare_voices(told, ratio, lambda player, voice: player.strike(f"hammer_{voice}", velocity=4.0))


def test_knobs_of_connections_are_listed_and_others_refused():
    player = Player(engine.load(BOLT))
    assert {f"connection.thread.{key}" for key in RANGES} <= set(player.live_parameters)
    with pytest.raises(
        KeyError, match=r"no live parameter connection.thread.gap; the live parameters are .*connection.thread.rest"
    ):
        player.set("connection.thread.gap", 1.0)
    with pytest.raises(ValueError, match="damping"):
        player.set("connection.thread.damping_coefficient", -1.0)


def test_an_edited_connection_is_turned_and_not_built_anew():
    old = engine.load(BOLT)
    table = old.model_dump(exclude_none=True)
    table["connection"][0] |= {"stiffness": 1e5, "damping_coefficient": 2.0}
    changed = {"connection.thread.stiffness": 1e5, "connection.thread.damping_coefficient": 2.0}
    assert changed_parameters(old, engine.Scene.model_validate(table)) == changed


def test_notes_tune_the_strings_and_not_the_board():
    scene = engine.load(ROOT / "patches" / "piano_choir.toml")
    assert sounding_bodies(scene) == ["left", "middle", "right"]
    higher = retune(scene, 1.5)
    for before, after in zip(scene.body, higher.body, strict=True):
        assert getattr(after, "frequency", None) == (
            before.frequency * 1.5 if before.kind == "string" else getattr(before, "frequency", None)
        )


def test_a_log_with_a_negative_damping_is_refused():
    player = Player(engine.load(BOLT), seconds=math.inf)
    player.set("connection.thread.damping_coefficient", 2.0)
    player.render_into(np.zeros((64, player.channels), np.float32))
    record = json.loads(json.dumps(player.log()))
    record["events"][0]["row"][6] = -1.0
    with pytest.raises(ValueError, match="an impossible event"):
        replay(record)
