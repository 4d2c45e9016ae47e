"""The estimate of the error of a rendering, against the error that it has."""

import numpy as np
import pytest

import engine
from bench.ruler.problems import ruler_scene
from bench.scenes.small import mass, scene
from bench.scenes.struck import random_collision
from engine import problems
from engine.analysis.error_estimate import trusted_frames
from engine.analysis.metrics import relative_rms_error

MOST = 3.0  # what an estimate may be over the error, and the error over it
ROUNDING = 1e-11


def ratio_to_error(told: engine.Scene, reference: np.ndarray, **accuracy) -> float:
    """The estimated error of a rendering over its error against a reference [frames, channels]."""
    rendering = engine.render(told, cores=1, **accuracy)
    estimate = engine.estimate_error(told, rendering, cores=1)
    error = relative_rms_error(rendering.audio, reference, round(estimate.horizon * 44_100) or len(reference))
    return (estimate.motion + ROUNDING) / (error + ROUNDING)


def share_within(seeds: range) -> float:
    """The share of random scenes whose estimate is within a factor of 3 of the error."""
    ratios = []
    for seed in seeds:
        told = random_collision(seed)
        order = 4 if told.contact[0].loss else 6
        reference = engine.render(told, cores=1, order=order, substeps=32).audio
        ratios.append(ratio_to_error(told, reference, order=4 if seed % 5 == 0 else 2))
    return float(np.mean((np.array(ratios) < MOST) & (np.array(ratios) > 1 / MOST)))


def test_the_estimate_is_near_the_error_of_random_scenes():
    assert share_within(range(12)) >= 0.9


@pytest.mark.hard
def test_the_estimate_is_near_the_error_of_many_random_scenes():
    assert share_within(range(100, 200)) >= 0.9


def test_a_rendering_that_does_not_err_has_no_error():
    """Free flight is exact."""
    told = scene([mass(velocity=1.0)])
    estimate = engine.estimate_error(told, engine.render(told, seconds=0.05))
    assert estimate.motion <= 1e-14
    assert estimate.horizon == pytest.approx(0.05)


def test_the_horizon_is_where_two_renderings_part():
    fine = np.sin(0.1 * np.arange(4410))[:, None]
    other = fine.copy()
    other[2300:] += 0.2
    assert trusted_frames(fine, fine, 44_100) == 4410
    assert 2300 - 220 <= trusted_frames(other, fine, 44_100) <= 2300


def test_bodies_that_are_damped_heavily_have_an_estimate():
    told = scene([mass(damping_rate=1e6, velocity=1.0)])
    assert engine.estimate_error(told, engine.render(told, seconds=0.01)).finer == {
        "order": 2,
        "substeps": 2,
        "max_error": None,
    }


@pytest.mark.hard
def test_the_estimate_is_near_the_error_of_the_certified_problems():
    ratios = {}
    for name in problems.NAMES:
        known = problems.load_problem(name)[1].displacement[:-1, None]  # a rendering has the state before each step
        scene_of_problem = ruler_scene(name)
        for order in (2,) if scene_of_problem.friction else (2, 4):
            ratios[name, order] = ratio_to_error(scene_of_problem, known, order=order)
    within = [1 / MOST < ratio < MOST for ratio in ratios.values()]
    assert np.mean(within) >= 0.9, ratios


def test_the_finest_setting_has_no_estimate_and_not_one_of_zero():
    told = random_collision(0)
    for substeps, finer in ((4096, 8192), (8192, 8192)):
        rendering = engine.render(told, seconds=0.005, substeps=substeps)
        estimate = engine.estimate_error(told, rendering)
        assert estimate.finer == {"order": 2, "substeps": finer, "max_error": None}
        assert (estimate.motion > 0.0) if substeps < finer else np.isnan(estimate.motion)
