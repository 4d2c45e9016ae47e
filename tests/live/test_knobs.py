"""Knobs turned fast while a scene sounds: whatever they do to the energy is booked, and nothing blows up."""

import json
import math

import numpy as np
import pytest
from conftest import ROOT
from turned_knobs import sweep_knobs

import engine
from bench.scenes.small import scene as small_scene
from engine.live.player import Player
from engine.live.replay import replay

PIANO = ROOT / "patches" / "piano_c4.toml"
RANGES = {"stiffness": (1e4, 1e12), "gap": (-2e-3, 2e-3), "exponent": (1.0, 8.0)}


@pytest.mark.parametrize(
    "keys", [["stiffness"], ["gap"], *(pytest.param(k, marks=pytest.mark.hard) for k in (["exponent"], list(RANGES)))]
)
def test_a_sweep_keeps_the_balance_of_energy(keys):
    """Of stiffness over 8 decades, of the gap over 4 mm, of the exponent from 1 to 8; and a replay is the same."""
    player = Player(engine.load(PIANO), gain=1e-4, seconds=math.inf, general="exponent" in keys)
    played = sweep_knobs(player, {f"contact.felt.{key}": RANGES[key] for key in keys}, 44_100, -1e-4)
    now = player.meter()
    assert played.any() and now["not_finite"] == 0 and now["newton"]["unconverged"] == 0
    assert now["energy_error"] <= 1e-12
    again = replay(json.loads(json.dumps(player.log())))
    np.testing.assert_array_equal(played[: len(again)], again)


@pytest.mark.hard
def test_a_turned_exponent_is_that_of_the_patch():
    """Before the hammer arrives, the exponent is turned from 2.5 to 3: the sound is that of a felt of 3."""
    scene = engine.load(PIANO)
    player = Player(scene, gain=1e-3, seconds=math.inf, general=True)
    assert "contact.felt.exponent" in player.live_parameters
    assert "contact.felt.exponent" not in Player(scene).live_parameters  # of a law of its own
    player.set("contact.felt.exponent", 3.0, seconds=0.0)
    turned = np.zeros((8820, player.channels), np.float32)
    player.render_into(turned)
    told = scene.model_dump(exclude_none=True)
    told["contact"][0]["exponent"] = 3.0
    built = engine.render(engine.Scene.model_validate(told), seconds=0.2).audio * 1e-3
    assert np.abs(turned[300:] - built[300:]).max() <= 1e-6 * np.abs(built).max()
    told["contact"][0]["exponent"] = 2.5
    told["event"] = [{"kind": "change", "time": 0.0, "contact": "felt", "exponent": 3.0, "duration": 0.0}]
    scored = engine.render(engine.Scene.model_validate(told), seconds=0.2)
    np.testing.assert_allclose(scored.audio * 1e-3, built, atol=1e-9 * np.abs(built).max())
    assert scored.stats["energy"]["error_max"] <= 1e-12


@pytest.mark.hard
def test_a_pitch_glides():
    """Two octaves up and down, over and over, while a string sounds: no step in the sound, energy in balance; a glide
    ends where a voice is that was tuned at once; and a replay is the same."""
    glides, stays = (Player(engine.load(PIANO), gain=1e-3, seconds=math.inf, voices=1, lowest=0.5) for _ in range(2))
    heard = []
    for player in (glides, stays):
        player.tune(0, 1.0)
        player.strike("hammer_0")
        heard.append(np.zeros((44_100, player.channels), np.float32))
        player.render_into(heard[-1][:4410])
    for n in range(1, 10):
        glides.tune(0, 2.0 if n % 2 else 0.5, seconds=0.1)
        for player, out in zip((glides, stays), heard, strict=True):
            player.render_into(out[n * 4410 : (n + 1) * 4410])
    steps = [np.abs(np.diff(out[4410:], axis=0)).max() for out in heard]
    assert steps[0] <= 3 * steps[1]  # √2 as loud, at twice the pitch
    assert glides.meter()["energy_error"] <= 1e-12
    stays.tune(0, 2.0)
    for player in (glides, stays):  # the last step of the last glide is due now
        player.render_into(np.zeros((64, player.channels), np.float32))
    most = Player(engine.load(PIANO), voices=1, lowest=2.0).model.step.kick.size - 2  # above, none is heard
    for name in ("kick", "drift", "spring_kick"):
        ours, theirs = (getattr(player.model.step, name) for player in (glides, stays))
        np.testing.assert_array_equal(ours[:most], theirs[:most])
    again = replay(json.loads(json.dumps(glides.log())))
    np.testing.assert_array_equal(heard[0], again[: len(heard[0])])


@pytest.mark.hard
def test_a_long_glide_arrives_and_a_refused_one_changes_nothing(monkeypatch):
    player = Player(engine.load(PIANO), gain=1e-3, seconds=math.inf, voices=1, lowest=0.5)
    player.tune(0, 0.7, seconds=5.0)
    player.strike("hammer_0")
    out = np.zeros((5 * 44_100 + 64, player.channels), np.float32)
    player.render_into(out)
    events = player.log()["events"]
    assert all(e["frame"] is not None for e in events)
    assert [e["why"] for e in events if e["frame"] == 0] == [["strike", "hammer_0"]]
    assert events[-1]["why"] == ["tune", 0, 0.7] and events[-1]["frame"] == 5 * 44_100
    before, table = len(events), player._tuning._table

    def refused(voice: int, ratio: float, body: str | None) -> np.ndarray:
        if ratio > 1.0:
            raise ValueError("vibrates too fast")
        return table(voice, ratio, body)

    monkeypatch.setattr(player._tuning, "_table", refused)
    with pytest.raises(ValueError, match="vibrates too fast"):
        player.tune(0, 1.1, seconds=0.1)
    player.render_into(out[:64])
    assert len(player.log()["events"]) == before and player._tuning._pitch == [(0.7, None)]


@pytest.mark.parametrize("connection", [[], [{"body": "s", "on": "t", "stiffness": 1e3}]])
def test_what_a_new_mass_brings_into_contact_is_in_contact(connection):
    """A hammer of a thousandth of its mass is elsewhere by then, in the string: that energy is supplied, and stays. At
    any frame: also where contacts are looked at anew, and where those that were far were left out."""
    scene = small_scene(
        [
            {"name": "hammer", "kind": "mass", "mass": 1e3, "displacement": 1e-3},
            {"name": "s", "kind": "oscillator", "mass": 1.0, "frequency": 100.0, "displacement": 5e-3},
            {"name": "t", "kind": "oscillator", "mass": 1.0, "frequency": 150.0},
        ],
        contact=[{"name": "felt", "body": "hammer", "on": "s", "stiffness": 1e6, "exponent": 2.5}],
        connection=connection,
        pickup=[{"body": "s"}],
    )
    for frames in range(62, 68):
        player = engine.Player(scene, gain=1.0, kernel="general")
        player.read(frames)
        player.set("body.hammer.mass", 1e-1, seconds=0.0)
        player.read(1)
        assert player.state.compression[0] > 0.0
        player.read(200)
        assert player.meter().energy_error <= 1e-12


def two_pairs(mass, stiffness):
    """Two pairs of oscillators, joined by springs, that balls hit: the spring of one and a mass of the other can be
    turned."""
    bodies, contacts, springs = [], [], []
    for n, (of_pair, spring) in enumerate(((mass, 1e3), (1.0, stiffness))):
        bodies += [
            {"name": f"ball{n}", "kind": "mass", "mass": 0.01, "displacement": -2e-4, "velocity": 1.0},
            {"name": f"s{n}", "kind": "oscillator", "mass": 1.0, "frequency": 100.0},
            {"name": f"t{n}", "kind": "oscillator", "mass": of_pair, "frequency": 150.0},
        ]
        contacts.append({"body": f"ball{n}", "on": f"s{n}", "stiffness": 1e6, "exponent": 1.5})
        springs.append({"name": f"spring{n}", "body": f"s{n}", "on": f"t{n}", "stiffness": spring})
    return small_scene(bodies, contact=contacts, connection=springs, pickup=[{"body": "t0"}, {"body": "t1"}])


@pytest.mark.parametrize("turns", [[3e4], [3e4, 1e3], [3e4, 1e3, 3e4]])
def test_a_mass_and_a_spring_turned_at_once_are_those_of_the_patch(turns):
    """The tables of a new mass hold factors for the springs of the patch. A spring sounds as it is set by then, whether
    that was before the mass was turned, in the same sample, or back to what it was."""
    player = engine.Player(two_pairs(1.0, 1e3), gain=1.0, kernel="general")
    player.set("connection.spring1.stiffness", turns[0], seconds=0.0)
    player.read(1)  # factors are made for it; nothing moves yet but the balls
    for turn in turns[1:]:
        player.set("connection.spring1.stiffness", turn, seconds=0.0)
    player.set("body.t0.mass", 0.4, seconds=0.0)
    heard = player.read(600)[:, 0]
    built = engine.render(two_pairs(0.4, turns[-1]), seconds=0.02).audio[:, 0]
    np.testing.assert_allclose(heard[300:], built[301:601], atol=2e-6 * np.abs(built).max())
    assert player.meter().energy_error <= 1e-12
