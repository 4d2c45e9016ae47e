"""Scenes from all over the documented ranges: no solve fails, nothing is created or lost, every number is finite.

`FDH_SCENES=10000 uv run pytest -m hard tests/physics/test_random_scenes.py` runs as many for each order.
"""

import os

import numpy as np
import pytest

from bench.scenes import random_scenes
from engine.assembly.build import build
from engine.faults import BuildError
from engine.offline.simulation import Simulation
from engine.offline.statistics import newton_statistics

FRAMES = 2205
HARD = int(os.environ.get("FDH_SCENES", "1000"))


def faults(seed: int, order: int) -> str | None:
    """What is wrong with a scene; nothing if it is right, None if it is refused with a reason."""
    try:
        model, state, _ = build(random_scenes.scene(seed, order), random_scenes.RATE)
    except BuildError:
        return None
    simulation, out = Simulation(model, state), np.zeros((FRAMES, 1))
    simulation.render_block(out)
    energies, newton = simulation.energies(), newton_statistics(model, state)
    finite = all(
        np.isfinite(x).all() for x in (out, state.q, state.p, state.compression, list(energies.as_dict().values()))
    )
    found = [] if finite else ["not finite"]
    found += [f"{newton['unconverged']} failed"] if newton["unconverged"] else []
    found += [f"ledger {energies['error_max']:.1e}"] if not energies["error_max"] <= 1e-9 else []
    return ", ".join(found)


def all_hold(order: int, count: int) -> None:
    """So many scenes that are not refused, from seed 0 on."""
    wrong, run, seed = {}, 0, 0
    while run < count:
        what = faults(seed, order)
        run += what is not None
        if what:
            wrong[seed] = what
        seed += 1
    print(f"order {order}: {run} scenes, seeds 0 to {seed - 1}, {seed - run} refused, {len(wrong)} wrong")
    assert not wrong


def test_scenes_all_over_the_ranges_hold():
    all_hold(2, 150)


@pytest.mark.hard
@pytest.mark.parametrize("order", [2, 4, 6])
def test_many_scenes_all_over_the_ranges_hold(order):
    all_hold(order, HARD)
