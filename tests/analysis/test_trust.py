"""What a render says of itself: that it is not to be trusted, or that something begins inside something else."""

import json
from dataclasses import replace

import numpy as np
import pytest
import soundfile
from conftest import ROOT

import engine
from bench.scenes.small import barrier, mass, oscillator, scene
from engine.cli import main
from engine.faults import BuildError
from engine.offline.statistics import NewtonStatistics, SolveOutcomes
from engine.offline.trust import explain_doubts, warnings

PIANO = ROOT / "patches" / "piano_c4.toml"


def test_a_sound_render_is_trusted(tmp_path, capsys):
    assert main.main([str(PIANO), "-o", str(tmp_path / "a.wav"), "--seconds", "0.05", "--json"]) == 0
    stats = json.loads(capsys.readouterr().out)
    assert stats["trusted"] is True and stats["reasons"] == [] and stats["warnings"] == []


NEWTON = NewtonStatistics(90, 2.0, 2, 2, 0, 0, 0, [0, 0, 90], SolveOutcomes(10, 0, 0, 90, 0, 0))
CLEAN = 1e-14


@pytest.mark.parametrize(
    "newton, energy, finite, why",
    [
        (replace(NEWTON, reversed_steps=3), CLEAN, True, "the forces of 3 steps were not found"),
        (replace(NEWTON, loose_tensions=2), CLEAN, True, "the tensions of 2 steps were not found"),
        (NEWTON, float("nan"), True, "energies are not finite"),
        (NEWTON, 2e-9, True, "the energy error is 2.0e-09"),
        (NEWTON, CLEAN, False, "samples are not finite"),
        (
            replace(NEWTON, solve_outcomes=SolveOutcomes(0, 0, 0, 80, 20, 0)),
            CLEAN,
            True,
            "20% of the contact solves reached",
        ),
    ],
)
def test_what_cannot_be_vouched_for_is_said(newton, energy, finite, why):
    (reason,) = explain_doubts(newton, energy, finite)
    assert why in reason
    assert explain_doubts(NEWTON, CLEAN, True) == []


def test_the_paper_scheme_is_not_trusted_with_heavy_damping(tmp_path, capsys):
    """It moves a heavily damped mass too far, its energies closing all the same."""
    heavy = scene([mass(damping_rate=1e5)], gravity=9.81)
    fdh, exact = (engine.render(heavy, seconds=0.05, scheme=name) for name in ("fdh", "exact"))
    assert fdh.stats["energy"]["error_max"] <= 1e-12
    assert not fdh.stats["trusted"] and "paper's scheme" in fdh.stats["reasons"][0]
    assert exact.stats["trusted"]
    patch = tmp_path / "heavy.toml"
    body = '[[body]]\nname = "body"\nkind = "mass"\nmass = 1.0\ndamping_rate = 1e5\n[[pickup]]\nbody = "body"\n'
    patch.write_text(f"gravity = 9.81\n{body}")
    assert main.main([str(patch), "-o", str(tmp_path / "a.wav"), "--seconds", "0.05", "--scheme", "fdh"]) == 0
    assert "NOT TO BE TRUSTED" in capsys.readouterr().out


@pytest.mark.hard
def test_a_damped_mass_on_a_stop_too_hard_for_it_is_not_trusted():
    """Its compression alternates about the static one; substeps mend that."""
    stop = [barrier(stiffness=1e11, exponent=1.0, side="below"), barrier(barrier=1e5, stiffness=1.0, exponent=7.7)]
    pressed = scene([mass(damping_rate=1e6)], gravity=9.81, contact=stop)
    found = [engine.render(pressed, seconds=0.01, substeps=n).stats for n in (1, 64)]
    assert [s["trusted"] for s in found] == [False, True]
    assert "pressed on a stop too hard for it" in found[0]["reasons"][0]


@pytest.mark.parametrize(
    "hammer, contact, right",
    [
        ({"displacement": 2e-3, "velocity": 4.0}, {"barrier": 0.0}, "displacement = -0.002 is likely meant"),
        ({"displacement": -1e-3, "velocity": 4.0}, {"barrier": -3e-3}, "barrier = 0.003 is likely meant"),
        (
            {"displacement": -2e-3, "velocity": -4.0},
            {"barrier": 0.0, "side": "below"},
            "displacement = 0.002 is likely",
        ),
    ],
)
def test_a_hammer_that_begins_inside_is_said(hammer, contact, right):
    """Which, in what, how deep, with how much energy, and which sign was likely meant."""
    (said,) = warnings(scene([mass(mass=3e-3) | hammer], contact=[barrier(exponent=2.5, stiffness=4.5e9) | contact]))
    assert '"body" begins 0.002 m inside its barrier, which holds' in said
    assert right in said


@pytest.mark.hard
def test_what_begins_beside_or_rests_is_not_said():
    assert warnings(engine.load(PIANO)) == []
    resting = {"displacement": -1e-6}
    stop = barrier(stiffness=9.81e6, exponent=1.0, side="below")
    assert warnings(scene([mass() | resting], gravity=9.81, contact=[stop])) == []
    for path in sorted((ROOT / "patches").glob("*.toml")):
        assert warnings(engine.load(path)) == [], path.name


def test_a_hammer_thrown_inside_by_the_score_is_said():
    event = {"kind": "strike", "time": 0.5, "body": "body", "velocity": 2.0, "displacement": 1e-3}
    (said,) = warnings(scene([mass(displacement=-1e-3)], contact=[barrier()], event=[event]))
    assert "inside its barrier when struck at 0.5 s" in said


def test_the_warning_goes_to_standard_error(tmp_path, capsys):
    text = PIANO.read_text("utf-8").replace("displacement = -2e-3", "displacement = 2e-3")
    assert "displacement = 2e-3" in text
    (tmp_path / "slip.toml").write_text(text, "utf-8")
    slip = str(tmp_path / "slip.toml")
    assert main.main([slip, "-o", str(tmp_path / "a.wav"), "--seconds", "0.05"]) == 0
    assert f'{slip}: "hammer" begins 0.002 m inside "string"' in capsys.readouterr().err


@pytest.mark.parametrize("subtype, most", [("FLOAT", 3.5e38), ("DOUBLE", 1.8e308)])
def test_a_gain_is_no_larger_than_the_file_holds(tmp_path, capsys, subtype, most):
    loud = tmp_path / "loud.toml"
    loud.write_text(
        '[[body]]\nname = "body"\nkind = "oscillator"\nmass = 1e-9\nvelocity = 1e4\nfrequency = 2e4\n'
        '[[pickup]]\nbody = "body"\ngain = 1e12\nquantity = "acceleration"\n'
    )
    out = tmp_path / "a.wav"
    options = ["--gain", "400", "--subtype", subtype, "--seconds", "0.05", "-o", str(out), "--json"]
    assert main.main([str(loud), *options]) == 0
    audio, _ = soundfile.read(out)
    assert np.isfinite(audio).all() and np.abs(audio).max() < most
    said = capsys.readouterr()
    lowered = subtype == "FLOAT"
    assert ("a gain of 400 dB exceeds the range of its numbers" in said.err) == lowered
    assert json.loads(said.out)["gain_db"] == pytest.approx(345.0 if lowered else 400.0, abs=5.0)


# --- limits that say themselves


@pytest.mark.parametrize("stiffness, exponent", [(1e60, 1.0), (1.1e18, 1.0), (1e23, 2.5)])
def test_a_contact_harder_than_anything_is_refused(stiffness, exponent):
    with pytest.raises(ValueError, match=r"is stiffer than any material; at most .* 1e\+15 N at 1 mm"):
        scene([mass()], contact=[barrier(stiffness=stiffness, exponent=exponent)])


def test_a_contact_that_begins_deeper_than_any_force_is_refused():
    deep = scene([oscillator(frequency=1.0)], contact=[barrier(barrier=-1e3, stiffness=1e13, exponent=1.0)])
    with pytest.raises(BuildError, match=r"begins with a compression of 1e.03 m, at which it pushes with 1.0e.16 N"):
        engine.render(deep, seconds=0.01)
