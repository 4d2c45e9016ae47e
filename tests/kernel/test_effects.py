"""What a scene does not call for is not there: neither in the sound, nor in the machine code."""

import itertools
import json
import os
import subprocess
import sys

import numpy as np
import pytest
from conftest import ROOT

import engine
from bench.performance.stripped import strip
from bench.scenes.families import EFFECTS, NOTHING, with_effects
from bench.scenes.small import mass, oscillator, scene
from engine.assembly.build import build
from engine.compiler.special_kernels import ALL, VARIABLE
from engine.kernel.data.effects import CONTACTS, SPRINGS
from engine.runtime.kernel_choice import prepare

SUBSETS = [s for n in range(len(EFFECTS) + 1) for s in itertools.combinations(EFFECTS, n)]
SUBSETS = [s for s in SUBSETS if "contact loss" not in s or "contact" in s]
FEW = [("loss", "contact")]  # each needs a kernel of its own


def absent_is_as_nothing(present: tuple[str, ...]) -> None:
    bare = engine.render(with_effects(dict.fromkeys(present, 1.0)), seconds=0.05, silence=-np.inf, kernel="special")
    strengths = dict.fromkeys(EFFECTS, NOTHING) | dict.fromkeys(present, 1.0)
    full = engine.render(with_effects(strengths), seconds=0.05, silence=-np.inf, kernel="special")
    wanted = {"external force" if n == "force" else n for n in EFFECTS}
    named = {"external force" if n == "force" else n for n in present}
    assert wanted & set(bare.stats["effects"]["compiled"]) == named
    assert wanted <= set(full.stats["effects"]["compiled"])
    largest = np.abs(bare.audio).max(axis=0)
    assert np.all(np.abs(full.audio - bare.audio).max(axis=0) <= 1e-13 * largest + 1e-290)


@pytest.mark.hard
@pytest.mark.parametrize("present", FEW, ids="+".join)
def test_an_absent_effect_does_as_one_of_no_strength(present):
    absent_is_as_nothing(present)


@pytest.mark.slow
@pytest.mark.parametrize("present", [s for s in SUBSETS if s not in FEW], ids="+".join)
def test_every_subset_of_effects(present):
    absent_is_as_nothing(present)


@pytest.mark.hard
def test_absent_effects_leave_no_instruction(tmp_path):
    """The sample loop of a special kernel is as long as one in whose source they were never written, to 1 %."""
    strip(ROOT, tmp_path)
    count = []
    for folder, effects in ((ROOT, SPRINGS), (tmp_path, ALL)):
        environment = {
            **os.environ,
            "NUMBA_CACHE_DIR": str(tmp_path / f"cache_{folder.name}"),
            "PYTHONPATH": f"{folder}{os.pathsep}{ROOT}",
            VARIABLE: str(effects),
        }
        command = [sys.executable, "-m", "bench.performance.stripped", str(folder)]
        done = subprocess.run(command, cwd=folder, env=environment, capture_output=True, text=True, check=True)
        count.append(json.loads(done.stdout)["instructions"])
    assert count[0] > 500
    assert abs(count[0] / count[1] - 1) <= 0.01
    source = (tmp_path / "engine" / "kernel" / "modes" / "mode_step.py").read_text("utf-8")
    assert "EFFECTS & LOSS" not in source  # it was stripped indeed


def kernel(scene: engine.Scene):
    """The kinds and effects that the special kernel of a scene is compiled for."""
    return prepare([(built := build(scene, 44_100)).model], built.state, "special").kinds


@pytest.mark.parametrize(
    "absence",
    [
        {"body": [oscillator(frequency=100.0, displacement=1e-3, damping_rate=0.0)]},
        {"gravity": 0.0},
        {"contact": [{"body": "body", "barrier": 0.0, "stiffness": 0.0, "exponent": 1.5}]},
        {"contact": [{"body": "body", "barrier": 1.001e-3, "stiffness": 1e6, "exponent": 1.5}]},
        {"force": [{"body": "body", "kind": "pulse", "amplitude": 0.0, "duration": 0.1}]},
    ],
    ids=["no damping", "no gravity", "no stiffness", "out of reach for ever", "no force"],
)
def test_what_amounts_to_absence_builds_the_same_kernel(absence):
    body = [oscillator(frequency=100.0, displacement=1e-3)]
    assert kernel(scene(**({"body": body} | absence))) == kernel(scene(body))


def test_a_contact_within_reach_is_built():
    body = [oscillator(frequency=100.0, displacement=1e-3)]
    near = [{"body": "body", "barrier": 0.999e-3, "stiffness": 1e6, "exponent": 1.5}]
    assert build(scene(body, contact=near), 44_100).model.effects & CONTACTS
    drifting = [mass(velocity=1e-9)]
    far = [{"body": "body", "barrier": 1e3, "stiffness": 1e6, "exponent": 1.5}]
    assert build(scene(drifting, contact=far), 44_100).model.effects & CONTACTS


# --- sleep


def dying(**more) -> engine.Scene:
    """Two oscillators that die away; one of them is struck later."""
    bodies = [
        {"name": "a", "kind": "oscillator", "mass": 0.01, "frequency": 300.0, "damping_rate": 40.0, "velocity": 1.0},
        {"name": "b", "kind": "oscillator", "mass": 0.01, "frequency": 200.0, "damping_rate": 40.0, "velocity": 1.0},
    ]
    event = [{"kind": "strike", "time": 2.0, "body": "b", "velocity": 0.5}]
    pickups = [{"body": "a"}, {"body": "b", "channel": 2}]
    return engine.Scene.model_validate({"seconds": 3.0, "body": bodies, "event": event, "pickup": pickups} | more)


def test_sleep_is_below_its_threshold_and_ends_with_an_event():
    sleepy, awake = engine.render(dying()), engine.render(dying(), silence=-np.inf)
    assert awake.stats["activity"]["asleep"] == 0.0
    assert sleepy.stats["activity"]["asleep"] > 0.4
    assert np.abs(sleepy.audio - awake.audio).max() <= 1e-6 * np.abs(awake.audio).max()
    struck = sleepy.audio[round(2.01 * 44_100) :, 1]
    assert np.abs(struck).max() > 0.4
    assert sleepy.stats["energy"]["error_max"] <= 1e-12


def test_a_body_on_its_way_wakes_what_sleeps():
    """A hammer sets out from afar at a string at rest; nothing is computed but its flight, and the blow is the same."""
    bodies = [
        {
            "name": "string",
            "kind": "string",
            "length": 0.62,
            "mass": 4e-3,
            "tension": 670.0,
            "modes": 40,
            "sigma0": 3.0,
        },
        {"name": "hammer", "kind": "mass", "mass": 3e-3, "displacement": -1.0, "velocity": 2.0},
    ]
    felt = {"name": "felt", "body": "hammer", "on": "string", "on_at": 0.12, "stiffness": 4e9, "exponent": 2.5}
    parts = {"seconds": 1.0, "body": bodies, "contact": [felt], "pickup": [{"body": "string", "at": 0.4}]}
    told = engine.Scene.model_validate(parts)
    sleepy, awake = engine.render(told), engine.render(told, silence=-np.inf)
    assert sleepy.stats["activity"]["asleep"] > 0.45
    np.testing.assert_array_equal(sleepy.audio, awake.audio)


@pytest.mark.parametrize("blocks", [[64], [1, 7, 300], [4096]])
def test_sleep_does_not_depend_on_blocks(blocks):
    from engine.offline.simulation import Simulation

    model, state, _ = build(dying(), 44_100)
    simulation, begin, n = Simulation(model, state), 0, 0
    whole = engine.render(dying()).audio
    cut = np.zeros_like(whole)
    while begin < len(cut):
        end = min(len(cut), begin + blocks[n % len(blocks)])
        simulation.render_block(cut[begin:end])
        begin, n = end, n + 1
    np.testing.assert_array_equal(cut, whole)
