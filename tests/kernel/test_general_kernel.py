"""The general kernel gives what special ones give, bit for bit."""

import numpy as np
import pytest
from conftest import PATCHES, mostly_hard
from hypothesis import HealthCheck, given, settings

import engine
from engine.compiler import background
from engine.parallel import kernel_choice
from scenes.drawn import scenes
from scenes.families import EFFECTS, tanpuras, with_effects

SECONDS = 0.25
NAMES = [path.stem for path in PATCHES]
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


@pytest.mark.parametrize("name", mostly_hard(NAMES, "bouncing_ball", "tanpura"))
def test_every_patch_is_the_same_on_both(patch, name):
    assert_same(*both(patch(name)))


@pytest.mark.hard
@pytest.mark.parametrize("present", OF_EFFECTS, ids="+".join)
def test_effects_are_the_same_on_both(present):
    assert_same(*both(with_effects(dict.fromkeys([e for e in EFFECTS if e in present], 1.0))))


@pytest.mark.hard
@pytest.mark.parametrize("accuracy", [{"order": 4}, {"substeps": 2}, {"precision": "float32"}], ids=str)
def test_accuracy_is_the_same_on_both(patch, accuracy):
    assert_same(*both(patch("piano_c4"), 0.1, **accuracy))


@pytest.mark.hard
@pytest.mark.parametrize("exponent", [1.0, 1.3, 1.5])
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
    with pytest.raises(ValueError, match='"fast" is no kernel; special, general, auto'):
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


def test_the_sound_of_many_islands_is_the_same_on_both_cores(patch):
    scene = patch("tanpura_drone")
    one, two = (engine.render(scene, 0.05, cores=cores, kernel="general").audio for cores in (1, 2))
    assert np.array_equal(one, two)
