"""Scenes from all over the documented ranges: no solve fails, nothing is created or lost, every number is finite.

`FDH_SCENES=10000 uv run pytest -m hard tests/physics/test_extremes.py` runs as many for each order.
"""

import os
from collections.abc import Callable

import numpy as np
import pytest

import engine
from bench.scenes import random_scenes
from engine.assembly.build import build
from engine.faults import BuildError
from engine.offline.simulation import Simulation
from engine.offline.statistics import newton_statistics

FRAMES = 2205
HARD = int(os.environ.get("FDH_SCENES", "300"))


def faults(scene: engine.Scene) -> str | None:
    """What is wrong with a scene; nothing if it is right, None if it is refused with a reason."""
    try:
        model, state, _ = build(scene, random_scenes.RATE)
    except BuildError:
        return None
    simulation, out = Simulation(model, state), np.zeros((FRAMES, 1))
    simulation.render_block(out)
    energies, newton = simulation.energies(), newton_statistics(model, state)
    finite = all(
        np.isfinite(x).all() for x in (out, state.q, state.p, state.compression, list(energies.as_dict().values()))
    )
    found = [] if finite else ["not finite"]
    found += [f"{newton['reversed_steps']} failed"] if newton["reversed_steps"] else []
    found += [f"ledger {energies['error_max']:.1e}"] if not energies["error_max"] <= 1e-9 else []
    return ", ".join(found)


def all_hold(order: int, count: int, draw: Callable[[int, int], engine.Scene]) -> None:
    """So many scenes that are not refused, from seed 0 on. draw: makes one of a seed and an order"""
    wrong, run, seed = {}, 0, 0
    while run < count:
        what = faults(draw(seed, order))
        run += what is not None
        if what:
            wrong[seed] = what
        seed += 1
    print(f"order {order}: {run} scenes, seeds 0 to {seed - 1}, {seed - run} refused, {len(wrong)} wrong")
    assert not wrong


def test_scenes_all_over_the_ranges_hold():
    all_hold(2, 60, random_scenes.scene)


@pytest.mark.hard
@pytest.mark.parametrize(("order", "count"), [(2, 60), (4, 15), (6, 10)])
def test_bodies_that_stretch_are_joined_and_rub_hold(order, count):
    all_hold(order, count, random_scenes.joined_scene)


@pytest.mark.slow_but_each(3)
@pytest.mark.hard
@pytest.mark.parametrize("order", [2, 4, 6])
def test_many_scenes_all_over_the_ranges_hold(order):
    all_hold(order, HARD, random_scenes.scene)


@pytest.mark.slow_but_each(3)
@pytest.mark.hard
@pytest.mark.parametrize("order", [2, 4, 6])
def test_many_bodies_that_stretch_are_joined_and_rub_hold(order):
    all_hold(order, HARD, random_scenes.joined_scene)
