"""The general kernel gives what special ones give, bit for bit."""

import json
import os
import subprocess
import sys
import time
from functools import partial

import numpy as np
import pytest
from conftest import PATCHES, ROOT
from hypothesis import HealthCheck, given, settings

import engine
from bench.scenes.choirs import struck_choir
from bench.scenes.drawn import scenes
from bench.scenes.families import EFFECTS, tanpuras, with_effects
from engine.compiler import background, kernel_name
from engine.runtime import kernel_choice

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
    with pytest.raises(ValueError, match='"fast" is not a kernel; give special, general, auto'):
        engine.render(patch("bouncing_ball"), 0.01, kernel="fast")


def test_what_is_not_compiled_runs_on_the_general_kernel(patch, monkeypatch):
    """And its special kernel is asked for, for the next time."""
    asked, ready = [], kernel_choice.is_ready
    monkeypatch.setattr(
        kernel_choice,
        "is_ready",
        lambda prepared, uses: prepared.name == "general" or (ready(prepared, uses) and False),
    )
    monkeypatch.setattr("engine.offline.simulation.compile_beside", asked.extend)
    rendering = engine.render(patch("bouncing_ball"), 0.01, kernel="auto")
    assert rendering.stats.kernel == "general"
    assert [function for _, function, _ in asked] == ["render_block", "render_block"]
    assert asked[0][2] != asked[1][2]


def test_nothing_is_compiled_beside_tests_workers_and_where_it_is_forbidden(monkeypatch):
    monkeypatch.delenv("CI", raising=False)
    monkeypatch.delenv(background.VARIABLE)
    assert not background.is_allowed()
    monkeypatch.delenv("PYTEST_CURRENT_TEST")
    monkeypatch.setattr(background, "parent_process", lambda: None)
    assert background.is_allowed()
    with background.forbidden():
        assert not background.is_allowed()
    with monkeypatch.context() as patched:
        patched.setattr(background, "parent_process", lambda: "someone")
        assert not background.is_allowed()
    monkeypatch.setenv("CI", "true")
    assert not background.is_allowed()
    monkeypatch.delenv("CI")
    monkeypatch.setenv(background.VARIABLE, "off")
    assert not background.is_allowed()


def test_nothing_is_compiled_beside_live_sound(base, monkeypatch):
    started: list = []
    monkeypatch.setattr(background, "is_allowed", lambda: True)
    monkeypatch.setattr(background.subprocess, "Popen", lambda *words, **_: started.append(words))
    request = [("module", "function", ("int",))]
    with background.postponed():
        background.compile_beside(request)
        assert not started and not background.is_compiling()
        background.compile_requests(request)  # ends at once
    background.compile_beside(request)
    assert len(started) == 1


def test_the_sound_of_many_islands_is_the_same_on_both_cores(patch):
    scene = patch("tanpura_drone")
    one, two = (engine.render(scene, 0.05, cores=cores, kernel="general").audio for cores in (1, 2))
    assert np.array_equal(one, two)


def wait_until(condition, interval: float) -> None:
    """Ask each interval (s): compilation is of the lowest priority, so asking must leave it time."""
    begin = time.monotonic()
    while not condition():
        assert time.monotonic() - begin < 900.0  # another test may take its core from it
        time.sleep(interval)


@pytest.mark.hard
def test_a_kernel_is_compiled_beside_for_the_next_time(tmp_path):
    """A pipe does not wait for it; `fdh cache` tells of it; and then the special kernel runs."""
    forbidding = (background.VARIABLE, *background.FORBIDDING, kernel_name.VARIABLE)
    environment = {name: value for name, value in os.environ.items() if name not in forbidding}
    environment["NUMBA_CACHE_DIR"] = str(tmp_path / "cache")

    def told(*words: str) -> dict:
        command = [sys.executable, str(ROOT / "render.py"), *words, "--json"]
        done = subprocess.run(command, cwd=tmp_path, env=environment, capture_output=True, text=True, check=True)
        return json.loads(done.stdout)

    render = ["bouncing_ball", "--seconds", "0.01"]
    assert told(*render)["kernel"] == "general"
    wait_until(lambda: told("cache")["compiling"], 0.2)
    assert told(*render)["kernel"] == "general"
    wait_until(lambda: not told("cache")["compiling"], 5.0)
    assert told(*render)["kernel"] == "special"
    assert told(*render, "--kernel", "general")["kernel"] == "general"
    assert not told("cache")["compiling"]


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
