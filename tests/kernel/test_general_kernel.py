"""The general kernel gives what special ones give, bit for bit."""

import json
import os
import subprocess
import sys
from functools import partial

import numpy as np
import pytest
from conftest import PATCHES, ROOT
from hypothesis import HealthCheck, given, settings

import engine
from bench.scenes.choirs import struck_choir
from bench.scenes.drawn import scenes
from bench.scenes.families import EFFECTS, tanpuras, with_effects

SECONDS = 0.25
HARD, SLOW = (partial(pytest.param, marks=mark) for mark in (pytest.mark.hard, pytest.mark.slow))
FEW = ["bouncing_ball", "kalimba_keys", "rattle"]  # of many effects together
OTHERS = sorted({path.stem for path in PATCHES} - set(FEW))  # minutes of compiling
OF_EFFECTS = [("loss",), ("force", "contact"), ("gravity", "contact", "contact loss"), ("loss", "events")]


def both(scene: engine.Scene, seconds: float = SECONDS, **accuracy):
    """A scene rendered by its special kernel, and by the general one."""
    special, general = (engine.render(scene, seconds, trace=True, kernel=k, **accuracy) for k in ("special", "general"))
    assert (special.stats.kernel, general.stats.kernel) == ("special", "general")
    return special, general


def assert_same(special: engine.Rendering, general: engine.Rendering) -> None:
    """The same bytes of sound, motion and forces; and the same energies and solves."""
    assert special.audio.tobytes() == general.audio.tobytes()
    for name in ("displacement", "velocity", "compression", "force", "iterations"):
        assert special.trace[name].tobytes() == general.trace[name].tobytes(), name
    assert special.stats.energy == general.stats.energy
    assert special.stats.newton == general.stats.newton
    assert special.stats.effects == general.stats.effects


@pytest.mark.parametrize("name", [*map(HARD, FEW), *map(SLOW, OTHERS)])
def test_every_patch_is_the_same_on_both(patch, name):
    assert_same(*both(patch(name)))


@pytest.mark.hard
@pytest.mark.slow_but_each(4)
@pytest.mark.parametrize("present", OF_EFFECTS, ids="+".join)
def test_effects_are_the_same_on_both(present):
    assert_same(*both(with_effects(dict.fromkeys([e for e in EFFECTS if e in present], 1.0))))


@pytest.mark.hard
@pytest.mark.parametrize("accuracy", [{"order": 4}, SLOW({"substeps": 2})], ids=str)
def test_accuracy_is_the_same_on_both(patch, accuracy):
    assert_same(*both(patch("barrier_cubic"), 0.1, **accuracy))


@pytest.mark.slow
@pytest.mark.parametrize("accuracy", [{}, {"order": 4}], ids=str)
def test_joined_bodies_are_the_same_on_both(accuracy):
    assert_same(*both(engine.Scene.model_validate(struck_choir()), 0.1, **accuracy))


@pytest.mark.parametrize("exponent", [SLOW(1.0), HARD(1.3), SLOW(1.5)])
def test_a_bridge_of_many_points_is_the_same_on_both(exponent):
    assert_same(*both(tanpuras(1, 24, exponent), 0.1))


@pytest.mark.hard
@settings(max_examples=100, deadline=None, suppress_health_check=list(HealthCheck))
@given(scenes())
def test_any_scene_is_the_same_on_both(scene):
    """A hundred scenes that call for every effect, with exponents of all kinds."""
    assert_same(*both(scene, 0.02))


# --- which one runs


def test_a_kernel_that_nobody_has_is_refused(patch):
    with pytest.raises(ValueError, match='"fast" is not a kernel; give general, special'):
        engine.render(patch("bouncing_ball"), 0.01, kernel="fast")


def test_the_sound_of_many_islands_is_the_same_on_both_cores(patch):
    scene = patch("tanpura_drone")
    one, two = (engine.render(scene, 0.05, cores=cores, kernel="general").audio for cores in (1, 2))
    assert np.array_equal(one, two)


@pytest.mark.hard
def test_a_special_kernel_is_compiled_where_it_is_asked_for_and_kept(tmp_path):
    """The command says which kernel it used; what was compiled once is there the next time."""
    environment = os.environ | {"NUMBA_CACHE_DIR": str(tmp_path / "cache")}

    def said_by(*words: str) -> dict:
        command = [sys.executable, str(ROOT / "render.py"), *words, "--json"]
        done = subprocess.run(command, cwd=tmp_path, env=environment, capture_output=True, text=True, check=True)
        return json.loads(done.stdout)

    render = ["bouncing_ball", "--seconds", "0.01"]
    assert said_by(*render)["kernel"] == "general"
    before = said_by("cache")["kernels"]
    assert said_by(*render, "--kernel", "special")["kernel"] == "special"
    after = said_by("cache")["kernels"]
    assert after == before + 1
    assert said_by(*render, "--kernel", "special")["kernel"] == "special" and said_by("cache")["kernels"] == after


STRING = {"name": "string", "kind": "string", "length": 0.65, "linear_density": 4e-4, "tension": 73.0, "modes": 30}
PLUCKED = STRING | {"axial_stiffness": 1e4, "displacement": {"kind": "triangle", "at": 0.2, "amplitude": 4e-3}}
BRIDGE = {"name": "bridge", "kind": "oscillator", "mass": 0.02, "stiffness": 2e4}


BOW = {"name": "bow", "body": "string", "at": 0.13, "velocity": 0.2, "force": 0.5}
FINGER = {"name": "finger", "kind": "mass", "mass": 0.01, "velocity": 1.0, "displacement": -1e-3}
TOUCH = {"name": "touch", "body": "finger", "on": "string", "on_at": 0.3, "stiffness": 1e5, "exponent": 1.5}
RUB = {"body": "string", "at": 0.3, "angle": 1.5, "velocity": 0.3, "contact": "touch"}


@pytest.mark.hard
@pytest.mark.slow_for("bow", "strings")
@pytest.mark.parametrize(
    "scene",
    [
        {"body": [STRING], "friction": [BOW]},
        {"body": [STRING | {"polarisations": 2}, FINGER], "contact": [TOUCH], "friction": [RUB]},
        {"body": [STRING, STRING | {"name": "on"}], "friction": [{"body": "on", "on": "string", "force": 0.3}, BOW]},
        {"body": [PLUCKED], "friction": [BOW], "accuracy": {"substeps": 2}},
    ],
    ids=["bow", "finger", "strings", "stretching"],
)
def test_friction_is_the_same_on_both(scene):
    for rubbing in scene["friction"]:
        rubbing.setdefault("at", 0.4)
    if scene["friction"][0].get("on"):
        scene["friction"][0]["on_at"] = 0.6
    pickups = [{"body": "string", "at": 0.1}]
    special, general = both(engine.Scene.model_validate(scene | {"pickup": pickups}), 0.05)
    assert np.abs(special.audio).max() > 0.0
    assert_same(special, general)


@pytest.mark.hard
@pytest.mark.slow_for("contact")
@pytest.mark.parametrize(
    "parts",
    [
        {"contact": [{"body": "string", "at": 0.3, "barrier": -1e-3, "stiffness": 1e7, "exponent": 1.5}]},
        {"connection": [{"kind": "end", "body": "string", "at": 1.0, "on": "bridge"}]},
    ],
    ids=["contact", "end"],
)
def test_bodies_that_stretch_are_the_same_on_both(parts):
    bodies = [PLUCKED, BRIDGE] if "bridge" in str(parts) else [PLUCKED]
    pickups = [{"body": "string", "at": 0.1}]
    assert_same(*both(engine.Scene.model_validate({"body": bodies, "pickup": pickups, **parts}), 0.05))
