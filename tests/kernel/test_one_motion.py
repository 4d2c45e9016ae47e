"""Every way to advance a sample gives the motion of the measured step: flights, sleep, steps that know what acts before
they move, contacts that are left out because they cannot close, and samples in several stages.

Two computations can agree only while rounding has not grown. So others, by the measured step from starts that differ by
DISTURBANCES, tell how long that is: one alone may lie where nothing grows.
"""

import numpy as np
import pytest
from conftest import PATCHES
from measured_motion import measured_motion

import engine
from bench.scenes.choirs import struck_choir
from bench.scenes.families import colliding, hammered, tanpuras
from bench.scenes.joined import SECONDS, random_joined_scene

DISTURBANCES, GROWN = (1e-15, -1e-15), 1e-13  # of the start; of the peak, from which on motions are not compared
TOLERANCE = 1e-12  # of the peak, for each step of a sample
SCENES, LONG_ENOUGH, MIN_SECONDS = 200, 180, 0.020  # so many scenes are compared for at least so long
RATE = 44_100
STAGES = {2: 1, 4: 5, 6: 9}
NOT_MEASURED = "the measured step has neither stretch nor friction: test_stretching.py, test_friction.py and the ruler"
NOT_MEASURED += " compare these with other integrators"


def stretches(scene: engine.Scene) -> bool:
    """Whether the tension of a body rises."""
    return any(body.find_stretching(np.empty(0)) is not None for body in scene.body)


def relative_differences(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Return the largest difference of each frame [frames], as a share of the peak of its column of b."""
    peak = np.abs(b).max(axis=0, initial=0.0)
    return np.max(np.abs(a - b) / np.where(peak > 0.0, peak, 1.0), axis=1, initial=0.0)


def agreement(scene: engine.Scene, seconds: float = SECONDS) -> tuple[float, float]:
    """Return the largest difference while it can be compared, as a share of the peak, over the steps of a sample; and
    for how long that is, s."""
    measured = measured_motion(scene, seconds)
    rendering = engine.render(scene, seconds, trace=True, silence=-np.inf, cores=1)
    grown = np.zeros(len(measured.audio), dtype=bool)
    for disturbed in (measured_motion(scene, seconds, disturbance=disturbance) for disturbance in DISTURBANCES):
        grown |= relative_differences(disturbed.audio, measured.audio) > GROWN
        grown |= relative_differences(disturbed.trace.displacement, measured.trace.displacement) > GROWN
    frames = int(np.argmax(grown)) if grown.any() else len(grown)
    assert rendering.trace is not None
    order = np.argsort(measured.order)  # of bodies in the patch
    differences = relative_differences(rendering.audio, measured.audio)
    moved = relative_differences(np.nan_to_num(rendering.trace["displacement"]), measured.trace.displacement[:, order])
    steps = scene.accuracy.substeps * STAGES[scene.accuracy.order]
    return float(np.maximum(differences, moved)[:frames].max(initial=0.0)) / steps, frames / RATE


SHARED = {
    "colliding masses": lambda: colliding(8),
    "hammered strings": lambda: hammered(2, 40),
    "tanpuras": lambda: tanpuras(1, 12, 1.5),
    "a struck choir": lambda: engine.Scene.model_validate(struck_choir()),
}


@pytest.mark.hard
@pytest.mark.parametrize("name", SHARED)
def test_shared_scenes(name):
    assert agreement(SHARED[name]())[0] <= TOLERANCE


@pytest.mark.slow_but_each(2)
@pytest.mark.hard
@pytest.mark.parametrize("path", PATCHES, ids=lambda path: path.stem)
def test_patches(path):
    scene = engine.load(path)
    if stretches(scene) or scene.friction:
        pytest.skip(NOT_MEASURED)
    assert agreement(scene, 0.05)[0] <= TOLERANCE


@pytest.mark.hard
def test_random_scenes_in_which_everything_acts_together(monkeypatch):
    found = [agreement(random_joined_scene(seed)) for seed in range(SCENES)]
    assert [f"{seed}: {error:.1e}" for seed, (error, _) in enumerate(found) if not error <= TOLERANCE] == []
    assert sum(seconds >= MIN_SECONDS for _, seconds in found) >= LONG_ENOUGH
